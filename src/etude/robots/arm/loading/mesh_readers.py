"""Vertices of STL and OBJ files; COLLADA has a file of its own. A convex hull needs no more of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from etude.contracts import Array
from etude.errors import UsageError
from etude.robots.arm.loading.collada import collada_vertices

STL_HEAD, STL_FACET = 84, 50  # bytes
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_vertices(path: Path) -> Array:
    """(n, 3) vertices that a mesh file's faces use, in m, possibly repeated.

    Raises:
        UsageError: the format is not known, or the file is not of it.
    """
    read = READERS.get(path.suffix.lower())
    if read is None:
        raise UsageError(
            f"meshes of the form '{path.suffix}' are not read",
            where=str(path),
            next_step=f"Convert it to one of {', '.join(READERS)}.",
        )
    try:
        points = read(path.read_bytes())
    except (OSError, ValueError, LookupError, SyntaxError) as problem:
        raise UsageError(f"the mesh cannot be read: {problem}", where=str(path)) from None
    if not len(points) or not np.all(np.isfinite(points)):
        raise UsageError("the mesh has no vertices, or some that are no numbers", where=str(path))
    return points


def stl_vertices(data: bytes) -> Array:
    """Binary if its length says so: many binary files begin with "solid", the word of the other form."""
    if len(data) >= STL_HEAD:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEAD + STL_FACET * count:
            return np.frombuffer(data, FACET, offset=STL_HEAD)["corners"].reshape(-1, 3).astype(float)
    return _rows(data, b"vertex")


def obj_vertices(data: bytes) -> Array:
    return _rows(data, b"v")


def _rows(data: bytes, word: bytes) -> Array:
    """The first three numbers of every line that begins with `word`."""
    rows = [line.split()[1:4] for line in data.splitlines() if line.split(None, 1)[:1] == [word]]
    return np.array(rows, dtype=float).reshape(-1, 3)


READERS: Mapping[str, Callable[[bytes], Array]] = {
    ".stl": stl_vertices,
    ".obj": obj_vertices,
    ".dae": collada_vertices,
}
