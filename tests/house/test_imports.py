"""What a reader walks through: short chains of imports, and a record that stands without the engine."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import polars as pl
import pytest
from syntax_trees import tree
from test_ranks import SOURCE, module_name, modules

FIXTURE = Path(__file__).parents[1] / "campaign" / "fixtures" / "one_round"
LONGEST_CHAIN = 16
FILES_OF_ASK, FILES_OF_TELL = 80, 120
"""Of the core, in which a function is entered."""
MODULES_OF_STATUS = 60
"""Of the core and of the arm, without the name of the package that runs the command."""
RECORD = "etude.campaign.record"
ENGINE = ("models", "design", "deploy", "logs", "limits", "trajectories", "report", "campaign")
"""Rooms that compute; of these the record may read the tables of campaign.toml."""
TABLES = {"etude.limits.tracking_margins", *(f"etude.{room}.config" for room in ("models", "design", "logs"))}
STATUS = """
import sys
from etude.cli import main
code = main(["status", sys.argv[1], "--json"])
own = sorted(name for name in sys.modules if name.split(".")[0].startswith("etude"))
print(*own, file=sys.stderr)
sys.exit(code)
"""


def _statements(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """Those that run when the module is imported, but for type checkers' own."""
    found: list[ast.stmt] = []
    for one in body:
        if isinstance(one, ast.If):
            checkers = "TYPE_CHECKING" in ast.dump(one.test)
            found += _statements([*([] if checkers else one.body), *one.orelse])
        elif isinstance(one, ast.Try):
            found += _statements([*one.body, *one.orelse])
        else:
            found.append(one)
    return found


@cache
def graph() -> Mapping[str, frozenset[str]]:
    """Of each module of the core the modules of it that its import loads directly."""
    known = {module_name(path): path for path in modules()}
    found = {}
    for name, path in known.items():
        own: set[str] = set()
        for one in _statements(tree(path).body):
            if isinstance(one, ast.ImportFrom) and one.module:
                full = {f"{one.module}.{alias.name}" for alias in one.names}
                own |= (full & known.keys()) or {one.module}
            elif isinstance(one, ast.Import):
                own |= {alias.name for alias in one.names}
        found[name] = frozenset((own & known.keys()) - {name})
    return found


@cache
def chain(name: str) -> tuple[str, ...]:
    """The longest chain of imports that begins with this module."""
    return max(((name, *chain(other)) for other in graph()[name]), key=len, default=(name,))


def test_no_chain_of_imports_is_long() -> None:
    longest = max(map(chain, graph()), key=len)
    assert len(longest) <= LONGEST_CHAIN, " > ".join(longest)


def test_the_record_imports_no_engine() -> None:
    own = {name: others for name, others in graph().items() if name.startswith(RECORD)}
    assert len(own) > 10
    for name, others in own.items():
        rooms = {other for other in others if other.split(".")[1] in ENGINE and not other.startswith(RECORD)}
        assert rooms <= TABLES, f"{name} imports {sorted(rooms - TABLES)}: import them where they are used"


def test_status_loads_few_modules(tmp_path: Path) -> None:
    shutil.copytree(FIXTURE, tmp_path / "lab")
    done = subprocess.run(
        [sys.executable, "-c", STATUS, str(tmp_path / "lab")], capture_output=True, text=True, check=True
    )
    loaded = done.stderr.split()
    assert SOURCE.name in loaded
    assert len(loaded) <= MODULES_OF_STATUS, loaded


ENTERED = """
import inspect, json, sys
seen = set()
def watch(frame, event, _):
    # bodies of modules and of classes, which an import runs, are not optimised code: they are no functions
    if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:
        seen.add(frame.f_code.co_filename)
sys.setprofile(watch)
from etude.cli import main
code = main(sys.argv[1:])
sys.setprofile(None)
print(json.dumps(sorted(seen)), file=sys.stderr)
sys.exit(code)
"""


def entered(place: Path, *words: str) -> list[str]:
    """Files of the core that a command enters, by their names in it."""
    command = [sys.executable, "-c", ENTERED, *words]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=True)
    names = json.loads(done.stderr.splitlines()[-1])
    return [str(Path(name).relative_to(SOURCE)) for name in names if Path(name).is_relative_to(SOURCE)]


@pytest.mark.slow
def test_ask_and_tell_enter_few_files(tmp_path: Path) -> None:
    """What somebody has to read who follows a command through the core."""
    start = ["init", "lab", "--robot", "arm4_rough"]
    assert entered(tmp_path, *start)
    asked = entered(tmp_path, "ask", "lab")
    assert 40 < len(asked) <= FILES_OF_ASK, asked
    entered(tmp_path, "init", "made", "--robot", "arm4_rough")
    entered(tmp_path, "simulate", "made", "--rounds", "1")
    pl.read_parquet(tmp_path / "made" / "runs" / "0001.parquet").write_csv(tmp_path / "run.csv")
    told = entered(tmp_path, "tell", "lab", "run.csv", "--foreign")
    assert 60 < len(told) <= FILES_OF_TELL, told
