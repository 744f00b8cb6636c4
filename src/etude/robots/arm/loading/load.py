"""The one way to load a robot: path in, `Loaded` out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from etude.robots.arm.loading.loaded import Loaded
from etude.robots.arm.loading.parsing import parsed


def load(
    path: Path,
    joints: Sequence[str] | None = None,
    *,
    held: Mapping[str, float] | None = None,
    mesh_roots: Sequence[Path] = (),
) -> Loaded:
    """The model of a URDF or MJCF file's arm.

    Args:
        path: the file.
        joints: the joints that move, names or patterns such as "arm_*"; None: those of the one arm that the
            file has.
        held: positions of others, rad or m; the rest are held at 0, or at their limit next to it.
        mesh_roots: folders to look for meshes in first.

    Raises:
        UsageError: no such file, not loadable, no arm or several, a floating base, a joint that does not
            exist, a held position outside its limits.
    """
    root = parsed(path)
    given = dict(held or {})
    if root.tag == "robot":
        from etude.robots.arm.loading.urdf import load_urdf

        return load_urdf(root, path, joints, given, mesh_roots)
    from etude.robots.arm.loading.mjcf import load_mjcf

    return load_mjcf(root, path, joints, given)
