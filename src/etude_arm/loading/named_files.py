"""Files that a URDF or an MJCF names: meshes, includes, attached models, textures."""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

from etude_arm.loading.mesh_paths import MeshPaths

FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of <compiler> that names of files may be relative to."""


def named_files(path: Path) -> Iterator[Path]:
    """Files that exist and that the model at `path` names, with those that MJCF files among them name.

    A name that may mean several files gives each. An unreadable file names none: its reader says so.
    """
    root = _root(path)
    if root is not None and root.tag == "robot":
        yield from _of_urdf(root, path)
    elif root is not None:
        yield from _of_mjcf(root, path, (), {path.resolve()})


def _root(path: Path) -> ET.Element | None:
    try:
        return ET.parse(path).getroot()
    except (OSError, ValueError, ET.ParseError):
        return None


def _of_urdf(root: ET.Element, path: Path) -> Iterator[Path]:
    names = tuple(mesh.get("filename", "") for mesh in root.iter("mesh"))
    paths = MeshPaths(path, (), names)
    for name in names:
        if file := paths.find(name):
            yield file


def _of_mjcf(root: ET.Element, path: Path, above: Sequence[Path], followed: set[Path]) -> Iterator[Path]:
    """above: folders that names in the files that include this one are relative to; followed: files done."""
    named = [Path(one.get(key, "")) for one in root.iter("compiler") for key in FOLDERS]
    starts = tuple(dict.fromkeys((*above, path.parent)))
    folders = tuple(dict.fromkeys((*starts, *(start / one for start in starts for one in named))))
    names = [name for one in root.iter() for key, name in one.attrib.items() if key.startswith("file")]
    for file in (folder / name for name in names for folder in folders):
        with contextlib.suppress(OSError, ValueError):
            if not file.is_file():
                continue
            yield file
            inner = None if file.resolve() in followed else _root(file)
            followed.add(file.resolve())
            if inner is not None:
                yield from _of_mjcf(inner, file, folders, followed)
