"""Description of a robot of joints as a self-contained campaign folder.

Command limits are compared with the robot's weight. Files contain placeholders: 0, 1 or 1000 N m on every
joint, numbers of another robot, or another unit. A limit too small for the arm at rest leaves no motion; one
far too large permits every motion. Both are reported when the robot is read, for a person to correct.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.limits import CommandLimit, made_limits
from etude.types import Array, Described, Mask
from etude_arm.command_limits import NO_MOTION, commands_of, weight_on_drives
from etude_arm.physics.geometry import has_masses, read_geometry
from etude_arm.physics.newton_euler import nominal_commands
from etude_arm.physics.transmission import Geometry
from etude_arm.robot_file import read_robot, robot_to_toml
from etude_arm.spec import FORCES, ArmSpec

if TYPE_CHECKING:
    from etude_arm.clearance.surroundings import Floor
    from etude_arm.loading.loaded_model import Loaded

ROBOT_FILE = "robot.toml"
MODEL_NAME = "robot_model"


def read(
    path: Path,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    limits: Mapping[str, Mapping[str, float]] | None = None,
    joint_limits: Path | None = None,
) -> tuple[ArmSpec, tuple[str, ...]]:
    """The robot of a robot file, a URDF or an MJCF, and sentences for a person to confirm.

    Args:
        path: of the file.
        joints, held: select an arm of a model file, see `loading.load.load`.
        limits: replace the file's.
        joint_limits: MoveIt's file, used where it is tighter.
    """
    if path.suffix.lower() == ".toml":
        if joints or held or limits or joint_limits:
            raise UsageError(
                "a robot file already states the moving joints, their limits, and the fixed joints",
                where=str(path),
                next_step="Change its [[axis]] and [held] tables, or give the URDF or MJCF to --robot.",
            )
        return read_robot(path), ()
    from etude_arm.model_file import spec_from_model

    description = spec_from_model(path, joints=joints, held=held, given=limits, joint_limits=joint_limits)
    return description.spec, description.confirm


POSES, SEED = 2048, 0
"""Random poses among which the heaviest is searched; the same robot has the same poses."""
GRID, ROUNDS = 33, 3
"""Positions of a joint that are tried, and how often each joint has its turn."""
QUANTILE = 0.95
"""Quantile of the demand at the limits of speed and acceleration, over random poses and directions."""
STRONG = 10.0
"""Times that: no arm carries several times its own weight, so no drive is as strong as that throughout."""
APART, FAR = 10.0, 100.0
"""Times the nearest limit of another joint: joints of few arms differ by the first, of none by the second."""
TOO_FEW_JOINTS = 2
"""Number of joints of one unit among which numbers alone do not show which limit is wrong."""
MOST_JOINTS = 0.75
"""Of the joints."""


@dataclass(frozen=True, eq=False)
class Weight:
    """Demand of the masses on the drives, in command units.

    Attributes:
        home: (J,) |command| at rest at home.
        most: (J,) largest |command| found at rest within the position limits, and `at` (J, J): its pose.
        moving: (J,) at the limits of speed and acceleration, which few poses exceed.
    """

    home: Array
    most: Array
    at: Array
    moving: Array


def weight_of(spec: ArmSpec, home: Array) -> Weight | None:
    """The demand; None without masses in a model file, or with commands that are not forces."""
    if not has_masses(spec) or spec.command_unit not in FORCES:
        return None
    geometry = read_geometry(spec)
    assert geometry is not None
    rng = np.random.default_rng(SEED)
    poses = rng.uniform(spec.lower, spec.upper, (POSES, spec.dof))
    signs = rng.choice((-1.0, 1.0), poses.shape)
    moving = np.abs(nominal_commands(geometry, poses, signs * spec.velocity, signs * spec.acceleration))
    most, at = _heaviest(geometry, spec, np.concatenate([home[None], poses]))
    return Weight(_at_rest(geometry, home[None])[0], most, at, np.quantile(moving, QUANTILE, axis=0))


def sentences(spec: ArmSpec, home: Array) -> tuple[str, ...]:
    """Sentences to confirm: joints that cannot hold the arm, or limits that permit everything."""
    weight = weight_of(spec, home)
    if weight is None:
        return ()
    limit = np.minimum(spec.command, spec.torque)
    weak, loaded = weight.most > limit, weight.moving > 0.0
    lines = [_weak_joints(spec, limit, weight)] if weak.any() else []
    commands = commands_of(spec, None, home)
    if isinstance(commands, CommandLimit) and commands.share is not None:
        lines.append(f"{commands.gaps[-1]} Give another [search] home, or correct command in robot.toml.")
    factors = np.divide(spec.command, weight.moving, out=np.full(spec.dof, np.inf), where=loaded)
    factor = float(factors.min()) if loaded.any() else 0.0
    lines += [_loose_limits(factor)] if factor > STRONG else _equal_limits(spec, factors)
    lines += _outlying_limits(spec, factors, weak)
    return (*lines, *(_slide_limits(spec, factors) if factor <= STRONG else ()))


def _weak_joints(spec: ArmSpec, limit: Array, weight: Weight) -> str:
    """A sentence on joints whose limit cannot hold the arm: at home, or elsewhere in its range."""
    pose = ", ".join(f"{value:.2g}" for value in weight.at[int(np.argmax(weight.most / limit))].tolist())
    ever = _joints(spec, weight.most, limit, f" (at [{pose}])")
    if np.all(weight.home <= limit):
        return (
            "With the masses of the model file, the drives cannot hold the arm in all of its range: at "
            f"worst {ever}. Motions stay where they can: correct command of [[axis]] in robot.toml if a "
            "limit is wrong."
        )
    return (
        f"{NO_MOTION}: at rest at home {_joints(spec, weight.home, limit)}; at worst {ever}. Correct "
        "command (or torque) of [[axis]] in robot.toml and remove this line. If the limits are not real "
        "(placeholders, weight carried by springs), only remove the line: forces are then not verified."
    )


def _joints(spec: ArmSpec, demand: Array, limit: Array, of_first: str = "") -> str:
    """Joints with a demand above their limit, the worst first, with its details."""
    order = np.argsort(-demand / limit, kind="stable")
    parts = [
        f"{spec.names[j]} takes {demand[j]:.4g} {spec.command_units[j]} of {limit[j]:.4g}"
        for j in order
        if demand[j] > limit[j]
    ]
    return ", ".join([parts[0] + of_first, *parts[1:]])


def _loose_limits(factor: float) -> str:
    return (
        f"The command limits are at least {factor:.3g} times the need of the arm at its limits of speed "
        "and acceleration: perhaps placeholders, or another unit. They restrict no motion, and the "
        "scales of friction and noise depend on them: correct command of [[axis]] in robot.toml."
    )


def _equal_limits(spec: ArmSpec, factors: Array) -> list[str]:
    """One number for joints of all sizes, far above the demand of most."""
    same = spec.dof > 2 and np.ptp(spec.command) == 0.0 and np.quantile(factors, 1.0 - MOST_JOINTS) > STRONG
    return [
        f"All joints state the same command limit, {limit:.4g}, but most need less than a tenth of it at "
        "their limits of speed and acceleration: perhaps a placeholder. Correct command of [[axis]] in "
        "robot.toml."
        for limit in spec.command[:1]
        if same
    ]


def _outlying_limits(spec: ArmSpec, factors: Array, weak: Mask) -> list[str]:
    """Limits that differ from those of the other joints, and do not fit the arm's demand either."""
    parts = []
    for unit in dict.fromkeys(axis.unit for axis in spec.axes):
        joints = np.array([j for j, axis in enumerate(spec.axes) if axis.unit == unit])
        for j, times in _outliers(spec.command[joints]):
            k, sign = int(joints[j]), "N m" if unit == "rad" else "N"
            far = len(joints) > TOO_FEW_JOINTS and max(times, 1.0 / times) > FAR
            if not weak[k] and (far or _unfit(times, factors[k], factors)):
                parts.append(f"{spec.names[k]} {spec.command[k]:.4g} {sign}, {times:.3g} times the nearest")
    if not parts:
        return []
    return [
        f"Command limits differ much from those of the other joints: {'; '.join(parts)}. Perhaps in "
        "another unit: correct command of [[axis]] in robot.toml."
    ]


def _slide_limits(spec: ArmSpec, factors: Array) -> list[str]:
    """Slides without others for comparison: the moved mass gives the demand."""
    slides = [j for j, axis in enumerate(spec.axes) if axis.unit == "m"]
    far = [j for j in slides if len(slides) <= TOO_FEW_JOINTS and FAR < factors[j] < np.inf]
    if not far:
        return []
    parts = [f"{spec.names[j]} {spec.command[j]:.4g} N, {factors[j]:.3g} times that" for j in far]
    return [
        "Command limits of slides are far above their need at their limits of speed and acceleration: "
        f"{'; '.join(parts)}. Perhaps in another unit: correct command of [[axis]] in robot.toml."
    ]


def _unfit(times: float, factor: float, factors: Array) -> bool:
    """Whether a limit `times` the others' does not fit the demand on that joint either."""
    return factor > STRONG if times > 1.0 else factor < min(1.0, float(np.median(factors)) / APART)


def _outliers(limits: Array) -> list[tuple[int, float]]:
    """The fewer of the joints on either side of a gap of `APART`, and their limits by the next beyond it.

    Of two joints both, where the gap is `FAR`.
    """
    order = np.argsort(limits, kind="stable")
    outliers = []
    for k in range(1, len(order)):
        low, high = limits[order[k - 1]], limits[order[k]]
        if len(order) == TOO_FEW_JOINTS and high > FAR * low:
            outliers += [(int(order[0]), float(low / high)), (int(order[1]), float(high / low))]
        elif high > APART * low and 2 * k != len(order):
            fewer, nearest = (order[:k], high) if 2 * k < len(order) else (order[k:], low)
            outliers += [(int(j), float(limits[j] / nearest)) for j in fewer]
    return outliers


def _at_rest(geometry: Geometry, q: Array) -> Array:
    still = np.zeros_like(q)
    return np.abs(nominal_commands(geometry, q, still, still))


def _heaviest(geometry: Geometry, spec: ArmSpec, poses: Array) -> tuple[Array, Array]:
    """Largest |command| (J,) at rest of each joint, and its pose (J, J); joints are moved in turn."""
    dof = spec.dof
    held = _at_rest(geometry, poses)
    at = poses[held.argmax(axis=0)]
    for _ in range(ROUNDS):
        for i in range(dof):
            candidates = np.repeat(at, GRID + 1, axis=0)
            grid = np.linspace(spec.lower[i], spec.upper[i], GRID)
            candidates[:, i] = np.concatenate([np.append(grid, at[j, i]) for j in range(dof)])
            demand = _at_rest(geometry, candidates).reshape(dof, GRID + 1, dof)
            best = [int(demand[j, :, j].argmax()) for j in range(dof)]
            at = np.array([candidates[j * (GRID + 1) + k] for j, k in enumerate(best)])
    largest = _at_rest(geometry, at)
    return np.diagonal(largest).copy(), at


def describe(
    path: Path,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    mesh_roots: Sequence[Path] = (),
    limits: Mapping[str, Mapping[str, float]] | None = None,
    floor: float | None = None,
    joint_limits: Path | None = None,
) -> Described:
    """robot.toml and a whole copy of its model file with the meshes.

    Args:
        path, joints, held, limits, joint_limits: as in `read`.
        mesh_roots: folders to search for meshes first.
        floor: its height, m; None: the model file's, or an assumed one at 0.

    Raises:
        UsageError: no robot, or a model file that cannot be read or completed.
    """
    spec, confirm = read(path, joints, held, limits, joint_limits)
    made_limits(spec.limits, spec, None, {}, spec.names)  # a wrong name in a table is refused now
    if floor is not None:
        spec = replace(spec, around=replace(spec.around, floor=_floor(path, floor)))
    files: dict[str, bytes] = {}
    if spec.model_file is not None:
        whole_file = path.suffix.lower() != ".toml"
        spec, files, notes = _packed_model(spec, spec.model_file, mesh_roots, whole_file=whole_file)
        confirm = (*confirm, *notes)
    spec = replace(spec, confirm=tuple(dict.fromkeys((*spec.confirm, *confirm))))
    return Described({ROBOT_FILE: robot_to_toml(spec).encode(), **files}, spec.confirm)


def _packed_model(
    spec: ArmSpec, model_file: Path, mesh_roots: Sequence[Path], *, whole_file: bool
) -> tuple[ArmSpec, dict[str, bytes], tuple[str, ...]]:
    """The robot with a model file of its own and surroundings by it, that file's bytes, and sentences.

    Args:
        whole_file: the description is the model file alone, without tables of a person.
    """
    from etude_arm.clearance.defaults import disabled
    from etude_arm.clearance.robot_clearance import completed
    from etude_arm.loading.implausible import check_lengths, placeholder_sentences
    from etude_arm.loading.load import load_arm
    from etude_arm.loading.overlapping_links import links_that_overlap, overlap_sentences, overlaps_of
    from etude_arm.loading.pack import packed

    name, leave = f"{MODEL_NAME}{model_file.suffix}", disabled(model_file)
    loaded = load_arm(spec, mesh_roots=mesh_roots)
    if whole_file:
        check_lengths(loaded)
    overlapping = links_that_overlap(overlaps_of(loaded, spec.lower, spec.upper))
    finer: list[str] = []
    text, meshes = packed(model_file, mesh_roots, overlapping, finer)
    files = {name: text, **meshes}
    packed_spec = replace(spec, model_file=Path(name))
    final = _loaded_from(packed_spec, files)
    around, of_around = completed(packed_spec, final, leave, weight_on_drives(spec), whole_file=whole_file)
    if around.collision.look:
        finer += overlap_sentences(
            overlaps_of(final, packed_spec.lower, packed_spec.upper), around.collision.ignore
        )
    packed_spec = replace(packed_spec, around=around)
    home = np.array(around.search.home) if around.search else 0.5 * (packed_spec.lower + packed_spec.upper)
    return (
        packed_spec,
        files,
        (*loaded.notes, *placeholder_sentences(loaded), *finer, *of_around, *sentences(spec, home)),
    )


def _floor(path: Path, height: float) -> Floor:
    """The floor. UsageError: a robot file has its own, or the height is not a number."""
    from etude_arm.clearance.surroundings import Floor

    if path.suffix.lower() == ".toml":
        raise UsageError(
            "a robot file already states the floor",
            where=str(path),
            next_step="Write [floor] in it, or in the campaign's robot.toml.",
        )
    return Floor(height)


def _loaded_from(spec: ArmSpec, files: Mapping[str, bytes]) -> Loaded:
    """The model as the campaign will load it, with the packed shapes."""
    from etude_arm.loading.load import load_arm

    assert spec.model_file is not None
    with TemporaryDirectory() as folder:
        for name, data in files.items():
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return load_arm(replace(spec, model_file=Path(folder) / spec.model_file))
