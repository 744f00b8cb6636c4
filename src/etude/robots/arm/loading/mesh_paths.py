"""Where the meshes are that a model file names, without ROS.

`package://arm_description/meshes/a.stl` names a package, whose folder only an installed ROS knows. But a file
that belongs to a package lies within it, so the way up from the file passes by what is meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from etude.robots.arm.loading.mesh_readers import READERS


def mesh_path(name: str, model: Path, roots: Sequence[Path] = ()) -> Path | None:
    """The file that a model file means by `name`, or its converted copy; None if there is none.

    `roots` come first, then the model file's folder and every one above it: all of them with the whole name,
    and then with the name without its package.
    """
    scheme, found, rest = name.partition("://")
    rest = rest if found else scheme
    if rest.startswith("/") and Path(rest).is_file():
        return _readable(Path(rest))
    package, _, inside = rest.partition("/")
    folder = model.resolve().parent
    tails = [rest.lstrip("/"), inside] if found and package else [rest.lstrip("/")]
    for tail in filter(None, tails):
        for start in (*roots, folder, *folder.parents):
            if (start / tail).is_file():
                return _readable(start / tail)
    return None


def _readable(path: Path) -> Path:
    """The file, or where its form is not read one that lies beside it, converted."""
    if path.suffix.lower() in READERS:
        return path
    return next((one for form in READERS if (one := path.with_suffix(form)).is_file()), path)
