"""The house: imports go down the ranks, never up, never in a circle, and the entrance stays light."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import etude

SOURCE = Path(etude.__file__).parent
RANKS = {
    "errors": 0,
    "storage": 0,
    "threads": 0,
    "interrupt": 0,
    "robots": 1,
    "logs": 1,
    "trajectories": 1,
    "plants": 1,
    "models": 2,
    "design": 3,
    "control": 3,
    "campaign": 4,
    "deploy": 4,
    "studies": 5,
    "report": 5,
    "commands": 6,
    "cli": 6,
}
# Within one rank a package imports no other, but for these: a robot's description is read by everything
# that moves or records it, and a study may draw its own page.
SIDEWAYS = {
    ("storage", "errors"),
    ("logs", "robots"),
    ("trajectories", "robots"),
    ("plants", "robots"),
    ("plants", "logs"),
    ("plants", "trajectories"),
    ("logs", "trajectories"),
    ("campaign", "deploy"),
    ("studies", "report"),
    ("cli", "commands"),
}


def modules() -> list[Path]:
    return sorted(SOURCE.rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> set[str]:
    """Every etude module that `path` imports anywhere, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the rank"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module or ""}
    return {name for name in names if name.startswith("etude.")}


def room(name: str) -> str:
    return name.split(".")[1]


@pytest.mark.parametrize("path", modules(), ids=module_name)
def test_imports_go_down(path: Path) -> None:
    name = module_name(path)
    if name == "etude":
        assert not imported(path), "import etude must stay light"
        return
    own = room(name)
    assert own in RANKS, f"{own} has no rank: add it to the house on purpose"
    for other in {room(target) for target in imported(path)} - {own}:
        if other.startswith("__"):
            continue
        allowed = RANKS[other] < RANKS[own] or (own, other) in SIDEWAYS
        assert allowed, f"{name} (rank {RANKS[own]}) imports etude.{other} (rank {RANKS[other]})"


@pytest.mark.parametrize(
    ("own", "foreign"), [("gp", "physics"), ("physics", "gp"), ("lwpr", "kernels, physics")]
)
def test_processes_know_no_robot_and_physics_no_process(own: str, foreign: str) -> None:
    allowed = {
        "gp": {"gp"},
        "physics": {"physics", "dataset", "features"},
        "lwpr": {"lwpr", "gp"},  # the check of training data
    }[own]
    for path in sorted((SOURCE / "models" / own).glob("*.py")):
        rooms = {name.split(".")[2] for name in imported(path) if name.startswith("etude.models.")}
        assert rooms <= allowed, f"{path.name} imports {rooms - allowed}, {foreign} or above"


def test_no_import_cycle() -> None:
    known = {module_name(path): path for path in modules()}
    graph = {name: imported(path) & set(known) - {name, "etude"} for name, path in known.items()}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail[trail.index(name) :], name))
        if name in done:
            return
        for other in sorted(graph[name]):
            # a package's __init__ re-exports nothing, so only module-to-module edges count
            visit(other, (*trail, name))
        done.add(name)

    for name in graph:
        visit(name, ())


@pytest.mark.parametrize("statement", ["import etude", "import etude.cli"])
def test_the_entrance_loads_nothing_heavy(statement: str) -> None:
    heavy = {"numba", "mujoco", "plotly", "polars", "scipy"}
    code = f"{statement}; import sys; print(' '.join(sorted({heavy!r} & set(sys.modules))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_nothing_prints_below_the_studies() -> None:
    for path in modules():
        name = module_name(path)
        if name == "etude" or RANKS[room(name)] >= 5:
            continue
        calls = [
            node.lineno
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        ]
        assert not calls, f"{name} prints at lines {calls}"
