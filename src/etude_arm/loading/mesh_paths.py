"""Paths of the meshes that a model file names, found without ROS.

`package://arm_description/meshes/a.stl` names a package, which is searched by name. If it is not found, a
file of the same path in a folder above the model file may be meant, since folders get renamed. It may also be
the mesh of another package, since names like meshes/base.stl are common. So the file is used only if it is
unique and no other name refers to it, and a note names it. `meshes/a.stl` without a package is relative to
the model file; if it is not there, the same rule applies.

A folder is the package that its package.xml names, and also the package of its folder name: files installed
without ROS are often referred to by folder.
"""

from __future__ import annotations

import os
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

from etude.errors import UsageError
from etude_arm.loading.mesh_readers import READERS

NAMES_SHOWN = 5
"""Largest number of names in a sentence."""


MANIFEST = "package.xml"
FOLDERS_ABOVE = 4
"""Number of folders above the model file whose subfolders are searched; a workspace's src is searched deeper.
"""
SOURCES, REPOSITORY = "src", 2
DEEPEST = 4
"""Levels below an entry of ROS_PACKAGE_PATH."""
IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
"""Files that exclude a folder from a workspace; colcon puts the first into build and install folders."""
BUILT, INSTALLED = ("build", "log"), ("install", "devel")
"""Folders beside `src`: those of the build, and those of the installation."""


def folders_of(package: str, model: Path, roots: Sequence[Path] = ()) -> Iterator[Path]:
    """Folders of the package, in order of precedence.

    The search order is: any depth of `roots`, the folders above the model file, then AMENT_PREFIX_PATH and
    ROS_PACKAGE_PATH.
    """
    above = model.resolve().parents
    for root in roots:
        yield from folders_below(package, root)
    for start in above:
        yield from (one for one in (start, start / package) if is_package(one, package))
    for start in above[:FOLDERS_ABOVE]:
        levels = REPOSITORY if start.name == SOURCES else 1
        yield from (one for one in _below(start, levels) if declared(one) == package)
    for prefix in _listed("AMENT_PREFIX_PATH"):
        yield from (one for one in (prefix / "share" / package,) if is_package(one, package))
    for entry in _listed("ROS_PACKAGE_PATH"):
        yield from (one for one in _below(entry, DEEPEST) if is_package(one, package))


def folders_below(package: str, root: Path) -> list[Path]:
    """Folders of the package at any depth of a folder, each once even if several links lead to it.

    The folder itself if it is the package; else source folders, else installed ones. A match of package.xml
    precedes a match of the folder name.
    """
    if is_package(root, package):
        return [root]
    for installed in (False, True):
        folders = _workspace(root, installed)
        matches = [one for one in folders if declared(one) == package]
        matches = matches or [one for one in folders if one.name == package]
        if matches:
            return matches
    return []


@cache
def _workspace(root: Path, installed: bool) -> tuple[Path, ...]:
    """Every folder below `root` that colcon would search, with or without installed ones.

    Folders inside a package do not count, and a folder with several paths or in a loop of links counts once.
    """
    visited: set[Path] = set()
    folders: list[Path] = []
    pending = [root]
    while pending:
        folder = pending.pop(0)
        real = folder.resolve()
        if real in visited:
            continue
        visited.add(real)
        folders.append(folder)
        if declared(folder) and folder != root:
            continue
        children = _children(folder)
        names = {one.name for one in children}
        for one in children:
            built = one.name in (*BUILT, *INSTALLED) and (SOURCES in names or _ignored(one))
            if (installed and one.name in INSTALLED) or (not built and not _ignored(one)):
                pending.append(one)
    return tuple(folders[1:])


def _ignored(folder: Path) -> bool:
    return any((folder / name).exists() for name in IGNORED)


def is_package(folder: Path, package: str) -> bool:
    """Whether the folder is that package."""
    return folder.is_dir() and package in (folder.name, declared(folder))


@cache
def declared(folder: Path) -> str:
    """The name in a folder's package.xml; "" if there is no readable one."""
    try:
        return (ET.parse(folder / MANIFEST).getroot().findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return ""


def _listed(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _below(folder: Path, levels: int) -> Iterator[Path]:
    """The folder and the folders below it, except those inside a package."""
    yield folder
    if levels and not declared(folder):
        for child in _children(folder):
            yield from _below(child, levels - 1)


def _children(folder: Path) -> list[Path]:
    try:
        return sorted(one for one in folder.iterdir() if one.is_dir() and not one.name.startswith("."))
    except OSError:
        return []


@dataclass
class MeshPaths:
    """The meshes of one model file.

    Attributes:
        model: the file. roots: folders named by the user, which are searched first.
        names: of all its meshes. A file that one of them names is never guessed for another name.
    """

    model: Path
    roots: Sequence[Path] = ()
    names: Iterable[str] = ()
    _guessed: dict[str, Path] = field(default_factory=dict)
    _several: dict[str, list[Path]] = field(default_factory=dict)

    def find(self, name: str) -> Path | None:
        """The file of the mesh `name`, or its converted copy; None if there is none or several are
        possible.
        """
        path = self._named(name) or self._guess(name)
        return None if path is None else _readable(path)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each folder whose files are used although their package was not found."""
        by_folder: dict[tuple[str, Path], list[str]] = {}
        for name, path in self._guessed.items():
            scheme, package, inside = _parts(name)
            key = f"{scheme}://{package}" if scheme else "", _holder(path, inside)
            by_folder.setdefault(key, []).append(inside)
        return tuple(
            f"{_lacking(package, self.model)} {_few(list(dict.fromkeys(inside)))} the files below "
            f"{folder} are used. If they belong to another package, name the right folder with "
            "--mesh-root."
            for (package, folder), inside in by_folder.items()
        )

    def in_words(self, name: str) -> str:
        """The name of a missing mesh, with the possible files if there are several."""
        several = self._several.get(name, [])
        return f"{name} ({' or '.join(map(str, several))})" if several else name

    def _named(self, name: str) -> Path | None:
        """The file by its package's name; a path without package is relative to the model file."""
        scheme, package, inside = _parts(name)
        absolute = Path(name.partition("://")[2] or name)
        if absolute.is_absolute() and absolute.is_file():
            return absolute
        if not scheme:
            starts = (*self.roots, self.model.resolve().parent)
            return next((start / name for start in starts if (start / name).is_file()), None)
        for root in self.roots if package else ():
            self._require_one(package, inside, root)
        folders = folders_of(package, self.model, self.roots) if package else ()
        return next((one / inside for one in folders if (one / inside).is_file()), None)

    @staticmethod
    def _require_one(package: str, inside: str, root: Path) -> None:
        """Raises a UsageError if several packages of one name below a root have the mesh."""
        packages = [one for one in folders_below(package, root) if (one / inside).is_file()]
        if len(packages) > 1:
            raise UsageError(
                f"several packages below {root} are called {package}: {', '.join(map(str, packages))}",
                where=f"{package}/{inside}",
                next_step=f"Name the right folder: --mesh-root {shlex.quote(str(packages[0]))}",
            )

    def _guess(self, name: str) -> Path | None:
        """The only file of that path, with or without its package, below a root or in a folder above the
        model file.
        """
        scheme, package, inside = _parts(name)
        if scheme and any(declared(one) == package for one in folders_of(package, self.model, self.roots)):
            return None  # the package exists and does not have this mesh
        tails = dict.fromkeys((f"{package}/{inside}" if package else inside, inside))
        for starts in (self.roots, self.model.resolve().parents):
            places = [start / tail for start in starts for tail in tails if tail]
            files = {path.resolve(): path for path in places if path.is_file()}
            free = [path for real, path in files.items() if real not in self._named_files]
            if len(free) > 1:
                self._several[name] = free
                return None
            if free:
                if starts is not self.roots or declared(_holder(free[0], inside)):
                    self._guessed[name] = free[0]
                return free[0]
        return None

    @cached_property
    def _named_files(self) -> set[Path]:
        """Files that a name of the model file refers to, which no guess may use."""
        return {path.resolve() for name in self.names if (path := self._named(name)) is not None}


def _lacking(package: str, model: Path) -> str:
    """The beginning of a sentence that names the missing package or path."""
    return f"{package} is not found: for its" if package else f"Not found from {model.name} itself: for"


def _few(names: list[str]) -> str:
    more = f" and {len(names) - NAMES_SHOWN} more" if len(names) > NAMES_SHOWN else ""
    return f"{', '.join(names[:NAMES_SHOWN])}{more}"


def _parts(name: str) -> tuple[str, str, str]:
    """Scheme, package and path of "scheme://package/path"; a path without scheme has no package."""
    scheme, separator, location = name.partition("://")
    if not separator:
        return "", "", name
    package, _, inside = location.lstrip("/").partition("/")
    return scheme, package, inside


def _holder(path: Path, inside: str) -> Path:
    """The folder that the path `inside` is relative to."""
    return Path(str(path).removesuffix(str(Path(inside))))


def _readable(path: Path) -> Path:
    """The file; if its format is not supported, a converted copy beside it."""
    if path.suffix.lower() in READERS:
        return path
    return next((one for form in READERS if (one := path.with_suffix(form)).is_file()), path)
