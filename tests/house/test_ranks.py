"""The house: imports go down the ranks, never up, never in a circle, and the entrance stays light."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from syntax_trees import imports_and_calls, tree

import etude

SOURCE = Path(etude.__file__).parent
ROOT = Path(__file__).parents[2]
BESIDE = {
    "etude_arm": set(),
    "etude_quadrotor": set(),
    "etude_lagrangian": set(),
    "etude_sparse": set(),
    "etude_online": {"etude_sparse"},
    "etude_drivers": {"etude_quadrotor"},  # frames of PX4
}
"""Packages beside the core, found by the table of plug-ins, and what each imports of the others."""
KINDS = ("etude_arm", "etude_quadrotor")
RANKS = {
    "errors": 0,
    "codes": 0,
    "_runtime": 0,
    "storage": 0,
    "threads": 0,
    "abilities": 0,
    "protocols": 0,
    "toml_tables": 0,
    "types": 0,
    "plugin_values": 0,
    "plugins": 0,
    "progress": 0,
    "trajectories": 1,
    "limits": 2,
    "logs": 2,
    "models": 2,
    "design": 3,
    "deploy": 3,
    "drivers": 3,
    "campaign": 4,
    "report": 5,
    "testing": 5,
    "cli": 6,
}
# within one rank a room imports no other, but for these: what stands on nothing else may be used by all of
# rank 0
SIDEWAYS = {
    ("codes", "errors"),
    ("storage", "errors"),
    ("plugins", "errors"),
    ("plugins", "_runtime"),
    ("plugins", "plugin_values"),
    ("plugins", "abilities"),
    ("plugins", "protocols"),
    ("plugin_values", "_runtime"),
    ("plugin_values", "abilities"),
    ("plugin_values", "errors"),
    ("plugin_values", "protocols"),
    ("_runtime", "errors"),
    ("_runtime", "storage"),
    ("threads", "_runtime"),
    ("types", "_runtime"),
    ("toml_tables", "errors"),
    ("abilities", "_runtime"),
    ("abilities", "codes"),
    ("abilities", "protocols"),
    ("abilities", "types"),
    ("protocols", "types"),
}
# a kind supplies nouns, the steps are the pipeline's
NOT_OF_A_KIND = {"design", "campaign", "report", "cli"}


def modules() -> list[Path]:
    """Of the core, all but the programs that are copied to robots: they are data."""
    return sorted(path for path in SOURCE.rglob("*.py") if path.parent.name != "players")


def packages() -> list[Path]:
    """Of the packages beside the core."""
    paths = [path for own in BESIDE for path in sorted((SOURCE.parent / own).rglob("*.py"))]
    return [path for path in paths if path.parent.name != "players"]


def module_name(path: Path) -> str:
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def all_imported(path: Path) -> set[str]:
    """Everything that `path` imports anywhere, inside functions too."""
    names: set[str] = set()
    for node in imports_and_calls(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the rank"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module or ""}
    return names


def imported(path: Path) -> set[str]:
    """Every module of them that comes with Étude."""
    return {
        name for name in all_imported(path) if name.startswith(("etude.", *(f"{own}." for own in BESIDE)))
    }


def room(name: str) -> str:
    return name.split(".")[1]


def wrong_imports(path: Path) -> list[str]:
    """One sentence for each import of a module that does not go down the ranks."""
    name = module_name(path)
    if name == "etude":
        return []  # the face of all: what it imports, type checkers see
    own, found = room(name), []
    if own == "__main__":
        return []
    if own not in RANKS:
        return [f"{own} has no rank: add it to the house on purpose"]
    for other in {room(target) for target in imported(path) if target.startswith("etude.")} - {own}:
        if other.startswith("__"):
            continue
        if other not in RANKS:
            found.append(f"{name} imports etude.{other}, which is no room")
        elif not (RANKS[other] < RANKS[own] or (own, other) in SIDEWAYS):
            found.append(f"{name} (rank {RANKS[own]}) imports etude.{other} (rank {RANKS[other]})")
    return found


def test_imports_go_down() -> None:
    assert len(modules()) > 200
    assert [sentence for path in modules() for sentence in wrong_imports(path)] == []


def test_no_files_import_each_other_in_a_circle() -> None:
    """Imports inside functions and for type checkers count too."""
    studies = ROOT / "packages" / "etude-studies" / "src"
    known = {module_name(path): path for path in (*modules(), *packages())}
    known |= {".".join(p.relative_to(studies).with_suffix("").parts): p for p in studies.rglob("*.py")}
    files = {name: path for name, path in known.items() if path.name != "__init__.py"}
    graph = {name: (all_imported(path) & files.keys()) - {name} for name, path in files.items()}
    assert sum(map(len, graph.values())) > 2000
    tuple(TopologicalSorter(graph).static_order())  # CycleError names the files of a circle


def test_the_core_knows_no_package_beside_it() -> None:
    """No kind of robot, and no member that no default uses: all come by the table of plug-ins."""
    for path in modules():
        found = {name for name in all_imported(path) if name.split(".")[0].startswith("etude_")}
        assert not found, f"{module_name(path)} imports {found}"


def test_packages_beside_the_core_import_what_they_may() -> None:
    found = []
    for path in packages():
        own = module_name(path).split(".")[0]
        for name in all_imported(path):
            package, _, rest = name.partition(".")
            if package.startswith("etude_") and package not in {own, *BESIDE[own]}:
                found.append(f"{module_name(path)} imports {name}")
            if own in KINDS and package == "etude" and rest.split(".")[0] in NOT_OF_A_KIND:
                found.append(f"{module_name(path)} imports {name}, a step of the pipeline")
    assert found == []


def test_nothing_imports_the_studies() -> None:
    for path in modules():
        found = {name for name in all_imported(path) if name.split(".")[0] == "etude_studies"}
        assert not found, f"{module_name(path)} imports {found}"


def studies() -> list[Path]:
    return sorted((ROOT / "packages" / "etude-studies" / "src").rglob("*.py"))


def test_the_studies_use_what_an_outside_user_may() -> None:
    """They import from the faces of rooms, and from modules that stand beside these."""
    alone = {path.stem for path in SOURCE.glob("*.py")}
    found = []
    for path in studies():
        for node in imports_and_calls(path):
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            first, _, rest = module.partition(".")
            if module == "etude" or first not in {"etude", *BESIDE} or rest in alone:
                continue
            offered = importlib.import_module(module).__all__ if module in faces() else []
            lacking = [alias.name for alias in node.names if alias.name not in offered]
            found += [f"{path.name} imports {name}, which {module} does not offer" for name in lacking]
    assert found == []


def faces() -> dict[str, Path]:
    """Rooms that offer names: packages with `__all__`."""
    inits = [path for path in (*modules(), *packages()) if path.name == "__init__.py"]
    return {module_name(path): path for path in inits if "__all__" in path.read_text(encoding="utf-8")}


def seen_by_type_checkers(face: str) -> dict[str, str]:
    """Name -> module, of what a face imports under TYPE_CHECKING."""
    guarded = [node for node in tree(faces()[face]).body if isinstance(node, ast.If)]
    imports = [one for node in guarded for one in node.body if isinstance(one, ast.ImportFrom)]
    return {alias.name: str(one.module) for one in imports for alias in one.names}


@pytest.mark.parametrize("face", faces())
def test_what_is_offered_is_there_and_type_checkers_see_it(face: str) -> None:
    room, places = importlib.import_module(face), seen_by_type_checkers(face)
    assert set(places) == set(room.__all__)
    assert len(set(room.__all__)) == len(room.__all__)
    for name in room.__all__:
        assert getattr(room, name) is not None
        beside = importlib.util.find_spec(f"{face}.{name}")
        assert places[name] == face or beside is None, f"{name} is a module of {face} too"
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        _ = room.no_such_name


def test_processes_know_no_robot() -> None:
    for path in sorted((SOURCE / "models" / "gp").glob("*.py")):
        rooms = {name.split(".")[2] for name in imported(path) if name.startswith("etude.models.")}
        assert rooms <= {"gp"}, f"{path.name} imports {rooms}"


def test_no_import_cycle() -> None:
    known = {module_name(path): path for path in (*modules(), *packages())}
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


def test_importing_the_package_loads_nothing_at_all() -> None:
    code = "import etude, sys; print(sorted(n for n in sys.modules if n.startswith(('etude.', 'numpy'))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_public_names_are_there() -> None:
    for name in etude.__all__:
        assert getattr(etude, name) is not None
    assert set(etude.__all__) <= set(dir(etude))
    with pytest.raises(AttributeError, match="no attribute 'certifie'"):
        _ = etude.certifie


def test_nothing_prints_below_the_reports() -> None:
    for path in modules():
        name = module_name(path)
        if name in ("etude", "etude.__main__") or RANKS[room(name)] >= 5:
            continue
        calls = [
            node.lineno
            for node in imports_and_calls(path)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        ]
        assert not calls, f"{name} prints at lines {calls}"


def test_the_twelve_answers_of_the_contributing_page_are_true() -> None:
    """Somebody new finds the room for a change: the files that a row names exist and hold the row's names."""
    root = Path(__file__).parents[2]
    page = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ") and "src/" in line]
    assert len(rows) == 12
    for question, cells, names in rows:
        files = [root / name for name in re.findall(r"`(src/[^`]+\.py)`", cells)]
        text = "".join(file.read_text(encoding="utf-8") for file in files)
        assert files, question
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"\b(def|class) {name}\b|^ *{name}\b.*[:=]|import .*\b{name}\b", text, re.M), (
                question,
                name,
            )
