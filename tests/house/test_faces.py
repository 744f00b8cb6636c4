"""Tests use the rooms' faces: what a face names is imported from it, so that modules behind it may move."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parents[1]
OWN = {"robots/arm": "etude_arm", "robots/quadrotor": "etude_quadrotor"}
"""Folders of tests whose room has another name than `etude.FOLDER`."""
TOP = (
    "types",
    "protocols",
    "errors",
    "abilities",
    "plugins",
    "storage",
    "threads",
    "progress",
    "codes",
    "toml_tables",
)
"""Modules of the core that are faces themselves."""
BEHIND = 359
"""Names that tests import from behind the face of another room than their own: it may only fall."""


@cache
def face(room: str) -> frozenset[str]:
    return frozenset(getattr(importlib.import_module(room), "__all__", ()))


def room_of(module: str) -> str:
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "etude" else parts[0]


def imported() -> Iterator[tuple[str, str, str]]:
    """(file, module, name) of what tests import from behind a face."""
    for path in sorted(TESTS.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("etude"):
                continue
            module = str(node.module)
            if module != room_of(module) and module.removeprefix("etude.") not in TOP:
                yield from ((path.relative_to(TESTS).as_posix(), module, alias.name) for alias in node.names)


def test_what_a_face_names_is_imported_from_it() -> None:
    found = []
    for file, module, name in imported():
        if name in face(room_of(module)):
            inside, outside = (importlib.import_module(one) for one in (module, room_of(module)))
            if getattr(inside, name, None) is getattr(outside, name):
                found.append(f"{file}: {name} of {module}")
    assert found == []


def test_tests_look_behind_the_faces_of_other_rooms_less_and_less() -> None:
    other = []
    for file, module, name in imported():
        folder = file.rpartition("/")[0]
        own = next(
            (room for of, room in OWN.items() if folder.startswith(of)), f"etude.{folder.split('/')[0]}"
        )
        if room_of(module) != own:
            other.append(f"{file}: {name} of {module}")
    assert len(other) <= BEHIND, "\n".join(other)
