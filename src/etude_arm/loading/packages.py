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
IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
"""Files that keep a folder out of a workspace; colcon lays the first into what it builds and installs."""
BUILT, INSTALLED = ("build", "log"), ("install", "devel")
"""Beside `src`: what a build leaves, and what it installs."""


def folders_of(package: str, model: Path, roots: Sequence[Path] = ()) -> Iterator[Path]:
    """Folders of that package, those that count more first.

    They are looked for at any depth of `roots`, then on the way up from the model file, then where
    AMENT_PREFIX_PATH and ROS_PACKAGE_PATH say that packages are installed.
    """
    above = model.resolve().parents
    for root in roots:
        yield from folders_below(package, root)
    for start in above:
        yield from (one for one in (start, start / package) if is_package(one, package))
    for start in above[:NEAR]:
        levels = REPOSITORY if start.name == SOURCES else 1
        yield from (one for one in _below(start, levels) if declared(one) == package)
    for prefix in _listed("AMENT_PREFIX_PATH"):
        yield from (one for one in (prefix / "share" / package,) if is_package(one, package))
    for entry in _listed("ROS_PACKAGE_PATH"):
        yield from (one for one in _below(entry, DEEPEST) if is_package(one, package))


def folders_below(package: str, root: Path) -> list[Path]:
    """Folders of that package at any depth of a folder; each once, however many links lead to it.

    The folder itself, if it is the package; else those of the sources, else those that are installed; of both
    those whose package.xml says so, else those of its name.
    """
    if is_package(root, package):
        return [root]
    for installed in (False, True):
        folders = _workspace(root, installed)
        found = [one for one in folders if declared(one) == package]
        found = found or [one for one in folders if one.name == package]
        if found:
            return found
    return []


@cache
def _workspace(root: Path, installed: bool) -> tuple[Path, ...]:
    """Every folder below one that colcon would look at, with or without those of what is installed.

    What lies in a package is none of them, and a folder that two paths or a circle of links lead to is one.
    """
    seen: set[Path] = set()
    found: list[Path] = []
    left = [root]
    while left:
        folder = left.pop(0)
        real = folder.resolve()
        if real in seen:
            continue
        seen.add(real)
        found.append(folder)
        if declared(folder) and folder != root:
            continue
        children = _children(folder)
        names = {one.name for one in children}
        for one in children:
            built = one.name in (*BUILT, *INSTALLED) and (SOURCES in names or _ignored(one))
            if (installed and one.name in INSTALLED) or (not built and not _ignored(one)):
                left.append(one)
    return tuple(found[1:])


def _ignored(folder: Path) -> bool:
    return any((folder / name).exists() for name in IGNORED)


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
