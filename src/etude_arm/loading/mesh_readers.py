"""Triangles of STL and OBJ files; COLLADA, glTF and PLY have files of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.collada import collada_triangles, fans
from etude_arm.loading.glb import glb_triangles
from etude_arm.loading.ply import ply_triangles

ANEW = "Export it anew, or take its shape out of the model file."
POINTER = b"version https://git-lfs"
OBJ_WORDS = frozenset(b"v vt vn vp f l p g o s mg usemtl mtllib usemap maplib".split())
STL_HEAD, STL_FACET = 84, 50  # bytes
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_triangles(path: Path) -> Array:
    """(n, 3, 3) corners of a mesh file's triangles, in m; an OBJ without faces gives its vertices thrice.

    A file without any is a mesh all the same, an empty one: makers leave them where a link shows nothing.

    Raises:
        UsageError: the format is not known, or the file is not of it.
    """
    read = READERS.get(path.suffix.lower())
    if read is None:
        raise UsageError(
            f"meshes of the form '{path.suffix}' are not read",
            where=str(path),
            next_step=f"Convert it to one of {', '.join(READERS)}, beside it and under the same name.",
        )
    try:
        data = path.read_bytes()
        triangles = read(data)
    except (OSError, ValueError, LookupError, SyntaxError) as problem:
        raise UsageError(f"the mesh cannot be read: {problem}", where=str(path), next_step=ANEW) from None
    if not len(triangles) and not _is_mesh(path.suffix.lower(), data):
        pointer = data.startswith(POINTER)
        raise UsageError(
            "the file holds no mesh" + (", but a pointer of Git LFS to one" if pointer else ""),
            where=str(path),
            next_step="Fetch it: git lfs pull, where it was cloned." if pointer else ANEW,
        )
    if not np.all(np.isfinite(triangles)):
        raise UsageError("the mesh has corners that are no numbers", where=str(path), next_step=ANEW)
    return triangles


def _is_mesh(suffix: str, data: bytes) -> bool:
    """Whether a file without triangles is of its form: other readers than these two refuse what is not."""
    if suffix == ".stl":
        return (len(data) == STL_HEAD and not any(data[80:84])) or data.lstrip().startswith(b"solid")
    if suffix == ".obj":
        words = {line.split(None, 1)[0] for line in data.splitlines() if line.strip()}
        return bool(words) and all(word in OBJ_WORDS or word.startswith(b"#") for word in words)
    return True


def stl_triangles(data: bytes) -> Array:
    """Binary if its length says so: many binary files begin with "solid", the word of the other form."""
    if len(data) >= STL_HEAD:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEAD + STL_FACET * count:
            return np.frombuffer(data, FACET, offset=STL_HEAD)["corners"].astype(float)
    return _rows(data, b"vertex").reshape(-1, 3, 3)


def obj_triangles(data: bytes) -> Array:
    points = _rows(data, b"v")
    faces = [line.split()[1:] for line in data.splitlines() if line.split(None, 1)[:1] == [b"f"]]
    if not faces:
        return np.repeat(points[:, None], 3, axis=1)
    corners = [int(corner.partition(b"/")[0]) for face in faces for corner in face]
    indices = np.array([corner - 1 if corner > 0 else corner for corner in corners])
    return points[fans(indices, [len(face) for face in faces])]


def _rows(data: bytes, word: bytes) -> Array:
    """The first three numbers of every line that begins with `word`."""
    rows = [line.split()[1:4] for line in data.splitlines() if line.split(None, 1)[:1] == [word]]
    return np.array(rows, dtype=float).reshape(-1, 3)


READERS: Mapping[str, Callable[[bytes], Array]] = {
    ".stl": stl_triangles,
    ".obj": obj_triangles,
    ".dae": collada_triangles,
    ".ply": ply_triangles,
    ".glb": glb_triangles,
}
