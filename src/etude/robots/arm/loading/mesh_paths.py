"""Where the meshes are that a model file names, without ROS.

`package://arm_description/meshes/a.stl` names a package, whose folder only an installed ROS knows. But a file
that belongs to a package lies within it, so the way up from the file passes by what is meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def mesh_path(name: str, model: Path, roots: Sequence[Path] = ()) -> Path | None:
    """The file that a model file means by `name`; None if there is none.

    `roots` come first, then the model file's folder and every one above it; in each, the name with its
    package and without.
    """
    scheme, found, rest = name.partition("://")
    rest = rest if found else scheme
    if rest.startswith("/") and Path(rest).is_file():
        return Path(rest)
    rest = rest.lstrip("/")
    folder = model.resolve().parent
    _, _, inside = rest.partition("/")
    for start in (*roots, folder, *folder.parents):
        for tail in (rest, inside) if found else (rest,):
            if tail and (start / tail).is_file():
                return start / tail
    return None
