"""Loading of a robot: from a path to a `Loaded`, repeated when the file changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from etude.errors import UsageError
from etude.limits.certificate import memoized
from etude_arm.loading.attachments import Additions
from etude_arm.loading.loaded_model import Loaded
from etude_arm.loading.parsing import parsed
from etude_arm.spec import ArmSpec

NOTHING = Additions()


def load(
    path: Path,
    joints: Sequence[str] | None = None,
    *,
    held: Mapping[str, float] | None = None,
    mesh_roots: Sequence[Path] = (),
    shapes: bool = True,
    drives: bool = False,
    added: Additions = NOTHING,
) -> Loaded:
    """The model of a URDF or MJCF file's arm.

    Args:
        path: the file.
        joints: the joints that move, names or patterns such as "arm_*"; None: those of the one arm that the
            file has.
        held: positions of other joints, rad or m; the rest are held at 0, or at the limit nearest to 0.
        mesh_roots: folders that are searched first for the meshes of a URDF.
        shapes: False: only masses; no mesh of a URDF is read.
        drives: keep the actuators of an MJCF and their tendons.
        added: mounting of the base, tool and payload.

    Raises:
        UsageError: no such file, not loadable, no arm or several, a floating base, a joint that does not
            exist, a held position outside its limits.
        UnsafeModelError: the compiled model differs from the file and the additions (`compiled_model_check`).
    """
    root = parsed(path)
    positions = dict(held or {})
    if root.tag == "robot":
        from etude_arm.loading.urdf import load_urdf

        loaded = load_urdf(root, path, joints, positions, mesh_roots, shapes, added)
    else:
        from etude_arm.loading.mjcf import load_mjcf

        loaded = load_mjcf(path, joints, positions, drives, added)
    loaded.model()  # compiles once, which checks the model against the description
    return loaded


def load_arm(
    spec: ArmSpec, *, shapes: bool = True, drives: bool = False, mesh_roots: Sequence[Path] = ()
) -> Loaded:
    """The model of the robot's `model_file`: its axes move, other joints are held at the positions in `held`.

    Raises:
        UsageError: as `load`; or the robot has no model file.
    """
    if spec.model_file is None:
        raise UsageError(
            f"robot '{spec.name}' has no model_file",
            next_step="Add a URDF or MJCF, or choose a model without one.",
        )
    carried = [(name, one) for name, one in (("tool", spec.tool), ("payload", spec.payload)) if one]
    added = Additions(spec.mounting, tuple(carried))
    how = {"held": spec.held, "mesh_roots": mesh_roots, "shapes": shapes, "drives": drives}
    return load(spec.model_file, spec.names, **how, added=added)  # type: ignore[arg-type]


T = TypeVar("T")
ROBOTS_KEPT = 8
"""Number of robots whose values are kept."""


def of_file(store: dict[str, T], spec: ArmSpec, make: Callable[[], T]) -> T:
    """A value computed from a robot's model file; computed again when the robot or the file changes."""
    assert spec.model_file is not None
    stamp = spec.model_file.stat()
    return memoized(store, repr((spec, stamp.st_mtime_ns, stamp.st_size)), make, ROBOTS_KEPT)
