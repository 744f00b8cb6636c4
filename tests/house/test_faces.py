"""Tests use the rooms' faces, so that modules behind a face may move.

A face is a package with `__all__`, or a module that stands alone at the top of the core. Only tests in
`tests/ROOM/inside` may look behind the face of that room, and no test outside imports a helper of theirs.
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from syntax_trees import statements, tree

import etude

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "tests", ROOT / "packages" / "etude-studies" / "tests")
ALONE = {path.stem for path in Path(etude.__file__).parent.glob("*.py")}
"""Modules of the core that are faces themselves."""
OURS = {
    path.parent.name
    for base in ("src", "packages/etude-studies/src")
    for path in ROOT.glob(f"{base}/*/__init__.py")
}
ENTRANCE = ("etude.cli", "main")
SHARED = "etude._runtime"
"""Stands below all rooms and has no face: tests inside any room may import it."""


@cache
def face(room: str) -> frozenset[str]:
    if find_spec(room) is None:  # the studies are a distribution of their own, and have no face
        return frozenset()
    return frozenset(getattr(importlib.import_module(room), "__all__", ()))


def room_of(module: str) -> str:
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "etude" else parts[0]


@cache
def own_room(path: Path) -> str:
    """The room whose inside a test may look into; "" if it stands outside."""
    for folder in FOLDERS:
        if path.is_relative_to(folder) and "inside" in path.relative_to(folder).parts:
            name = path.relative_to(folder).parts[0]
            known = {"runtime": SHARED, "inside": "etude_studies"}
            beside = f"etude_{name}"
            return known.get(name) or (beside if find_spec(beside) else f"etude.{name}")
    return ""


@cache
def files() -> tuple[Path, ...]:
    return tuple(sorted(path for folder in FOLDERS for path in folder.rglob("*.py")))


@cache
def imports(path: Path) -> tuple[tuple[str, str], ...]:
    """(module, name) of each import; "" where the module itself is imported."""
    found: list[tuple[str, str]] = []
    for node in statements(tree(path)):
        if isinstance(node, ast.ImportFrom):
            found += [(node.module or "", alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
    return tuple(found)


def behind() -> Iterator[tuple[Path, str, str]]:
    """(file, module, name) of what tests import from behind a face."""
    for path in files():
        for module, name in imports(path):
            room = room_of(module)
            if room.split(".")[0] not in OURS or module == "etude" or module.removeprefix("etude.") in ALONE:
                continue
            public = module == room and (not name or name in face(room) or (room, name) == ENTRANCE)
            if not public:
                yield path, module, name


MEMORY = "tests/conftest.py"
"""It has each log judged once for all tests, and offers no test what it takes."""


def test_what_a_face_names_is_imported_from_it() -> None:
    found = []
    for file, module, name in behind():
        if module != room_of(module) and name in face(room_of(module)):
            inside, outside = (importlib.import_module(one) for one in (module, room_of(module)))
            if getattr(inside, name, None) is getattr(outside, name):
                found.append(f"{file.relative_to(ROOT)}: {name} of {module}")
    assert found == []


def test_only_tests_inside_a_room_look_behind_its_face() -> None:
    found = [
        f"{file.relative_to(ROOT)}: {name} of {module}"
        for file, module, name in behind()
        if file.relative_to(ROOT).as_posix() != MEMORY
        and room_of(module) not in ({own_room(file), SHARED} if own_room(file) else set())
    ]
    assert found == []


def test_helpers_that_look_inside_stay_there() -> None:
    """Else a test outside would look behind a face through them."""
    known = {path.stem: path for path in files()}
    found = [
        f"{path.relative_to(ROOT)}: {module}"
        for path in files()
        for module, _ in imports(path)
        if module in known and own_room(known[module]) not in ("", own_room(path))
    ]
    assert found == []


def test_names_of_test_modules_differ() -> None:
    """Helpers are imported by their names alone."""
    names = [path.stem for path in files() if path.stem != "conftest"]
    assert sorted(names) == sorted(set(names))
