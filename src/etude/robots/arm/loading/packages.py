"""Where the folder of a named ROS package is, without ROS.

A folder is the package that its package.xml names, and the one of its own name: files that are installed
without ROS are often named by their folder, whatever its package.xml says.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

MANIFEST = "package.xml"
NEAR = 4
"""Folders above the model file whose other folders are looked through, those of a workspace's src deeper."""
SOURCES, REPOSITORY = "src", 2
DEEPEST = 4
"""Levels below an entry of ROS_PACKAGE_PATH."""


def folders_of(package: str, model: Path, roots: Sequence[Path] = ()) -> Iterator[Path]:
    """Folders of that package, those that count more first.

    They are looked for in `roots`, then on the way up from the model file, then where AMENT_PREFIX_PATH and
    ROS_PACKAGE_PATH say that packages are installed.
    """
    above = model.resolve().parents
    for start in (*roots, *above):
        yield from (one for one in (start, start / package) if is_package(one, package))
    for start in (*roots, *above[:NEAR]):
        levels = REPOSITORY if start.name == SOURCES else 1
        yield from (one for one in _below(start, levels) if declared(one) == package)
    for prefix in _listed("AMENT_PREFIX_PATH"):
        yield from (one for one in (prefix / "share" / package,) if is_package(one, package))
    for entry in _listed("ROS_PACKAGE_PATH"):
        yield from (one for one in _below(entry, DEEPEST) if is_package(one, package))


def is_package(folder: Path, package: str) -> bool:
    """Whether the folder is that package."""
    return folder.is_dir() and package in (folder.name, declared(folder))


@cache
def declared(folder: Path) -> str:
    """The name in a folder's package.xml; "" if there is none that can be read."""
    try:
        return (ET.parse(folder / MANIFEST).getroot().findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return ""


def _listed(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _below(folder: Path, levels: int) -> Iterator[Path]:
    """The folder and those below it, but for what lies in a package."""
    yield folder
    if levels and not declared(folder):
        for child in _children(folder):
            yield from _below(child, levels - 1)


def _children(folder: Path) -> list[Path]:
    try:
        return sorted(one for one in folder.iterdir() if one.is_dir() and not one.name.startswith("."))
    except OSError:
        return []
