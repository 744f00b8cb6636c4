"""Approach of `ask --from`: motions from the robot's pose to a proposal's start and back, in files of their
own.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.abilities import SupportsOrder, SupportsPoses
from etude.campaign.propose.constraints import Constraints
from etude.campaign.propose.proposal import reachable
from etude.campaign.propose.typical_motions import approaches_of
from etude.campaign.record.events import Exported
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import FULL, settle
from etude.deploy.trajectory_files import TrajectoryFiles, column_names, render
from etude.design.chain_design import Approaches
from etude.errors import UnsafeTrajectoryError, UsageError, did_you_mean, typed
from etude.limits.certificate import Certificate, certify, require_certified
from etude.limits.lead_ins import leads, with_leads
from etude.protocols import Limit, Trajectory
from etude.trajectories.chain import JOINED, Chain, Part
from etude.trajectories.splined import Splined
from etude.types import Array

HOME = "home"
WRITE = (
    "Write --from home (flights: also ground), --from joint=value,joint=value,... or --from a CSV whose "
    "last row is the pose."
)


@dataclass(frozen=True)
class Approached:
    """Files of an approach and a return, all certified.

    Attributes:
        pose: start of the approach and end of the return, by axis, rad or m.
        folder: their folder, below the proposal's.
        files: approach.json, approach.csv, ...; trajectory.json joins approach, motion and return.
        certificates: by file stem: "approach", "return", and "trajectory" if it exists.
        whole: approach, motion and return; None for a motion that is not at rest at its ends.
        renewed: a sentence, if the files were written anew.
    """

    pose: Mapping[str, float]
    folder: Path
    files: tuple[Path, ...]
    certificates: dict[str, Certificate]
    whole: Trajectory | None
    renewed: tuple[str, ...] = ()


def approached(
    campaign: Campaign,
    number: int,
    motion: Trajectory,
    folder: Path,
    start: str,
    constraints: Constraints,
    speed: int = FULL,
) -> Approached:
    """Writes the approach from `start` to the motion and the return; writes them anew if they have changed.

    The caller holds the writer's lock.

    Args:
        campaign: the folder. number: of the proposal. motion: to be run. folder: of the motion's files.
        start: "home", for flights "ground", joint=value for every joint, or a CSV whose last row is the pose.
        constraints: those of the proposal. speed: per cent, of the motion; the approach has it too.

    Raises:
        UsageError: the pose is unknown or outside the limits, the kind has no approaches, or a file was
            changed.
        UnsafeTrajectoryError: no approach is proved, straight or by home; nothing is written.
    """
    try:
        pose, paths, made = prepared(campaign, motion, start, constraints, speed)
    except UnsafeTrajectoryError as problem:
        require_pose(campaign, start, constraints, problem, f"; proposal {number} stays open")
        raise UnsafeTrajectoryError(
            f"no certified approach from there to proposal {number}, which stays open: {problem.fact}",
            where=problem.where,
            next_step="Move the robot to its start with its own controller, or write another motion: etude "
            f"abandon {typed(campaign.path)} {number}, then etude ask {typed(campaign.path)} --from "
            f"{start}",
        ) from None
    place = folder / f"from_{_folder_name(campaign, start, pose)}"
    certificates = {stem: files.certificate for stem, files in made.items()}
    contents = {path: data for files in made.values() for path, data in files.contents(place).items()}
    renewed = settle(campaign, number, contents, Exported(start=tuple(pose.tolist())))
    named = dict(zip(campaign.axes, pose.tolist(), strict=True))
    return Approached(named, place, tuple(contents), certificates, paths.whole, renewed)


SLOWER = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Factors by which an approach is stretched until it is proved: margins may leave little of a velocity limit,
and friction little of a command limit.
"""


@dataclass(frozen=True, eq=False)
class There:
    """An approach to a motion and the return from it.

    Attributes:
        approach: from the pose to the motion's start; one move or several.
        back: from the motion's end to the pose; one move or several.
        whole: approach, motion and return; None if the approach ends at rest and the motion begins moving.
    """

    approach: Trajectory
    back: Trajectory
    whole: Trajectory | None


def there_and_back(
    motion: Trajectory,
    pose: Array,
    approaches: Approaches,
    limits: Sequence[Limit],
    home: Array,
    clear: Array | None = None,
    speed: float = FULL,
) -> There | None:
    """Straight approach and return; if these are not proved, by home, by a clear pose and home, or by a clear
    pose alone.

    A motion that moves at its ends is led in and out along its own path, if that path continues.

    Args:
        motion: to be run. pose: (k,) start of the approach and end of the return, rad (m).
        approaches: the kind's. limits: to be kept. home: (k,) a pose clear of everything, rad (m).
        clear: (n, k) poses with a straight path to home, rad (m); None if unknown.
        speed: per cent, at which approach and return run; those that lead into a moving end have its speed.

    Returns:
        None for kinds without approaches.

    Raises:
        UnsafeTrajectoryError: no approach is proved. The error names the limit that the straight one breaks.
    """
    before, after = leads(motion, limits) or (None, None)
    led = with_leads(motion, before, after)
    straight, by_home = approaches(led, pose), approaches(led, home)
    if straight is None or by_home is None:
        return None
    out, back = approaches(by_home[0], pose), approaches(by_home[1], pose)
    assert out is not None
    assert back is not None
    around = [] if clear is None else _routes_by_clear_pose(by_home, pose, approaches, clear)
    to, back_by = ([], []) if clear is None else _legs_by_clear_pose(led, pose, approaches, clear)
    outs = [(straight[0],), (out[0], by_home[0]), *(legs for legs, _ in around), *to]
    approach = _first_proved(outs, limits, speed)
    backs = [(straight[1],), (by_home[1], back[1]), *(legs for _, legs in around), *back_by]
    returned = _first_proved(backs, limits, speed)
    there, again = _labelled("approach", approach), _labelled("return", returned)
    meet = _is_continuous(approach[-1], led, returned[0])
    there = there if before is None else (*there, ("lead-in", before))
    again = again if after is None else (("lead-out", after), *again)
    pieces = [(label, piece) for _, label, piece in motion.pieces()]
    whole = Chain((*there, *pieces, *again)) if meet else None
    return There(_as_trajectory(there), _as_trajectory(again), whole)


PLACES = ("position", "clearance")
"""Quantities of a path that do not depend on its speed."""
MANY = 2
"""Paths that are tried at all speeds: the straight one, and that by home. Others are many."""
MOST_AROUND = 24
"""Clear poses, the nearest first, by which a way is looked for."""
Legs = tuple[Trajectory, ...]


def _routes_by_clear_pose(
    by_home: tuple[Trajectory, Trajectory], pose: Array, approaches: Approaches, clear: Array
) -> list[tuple[Legs, Legs]]:
    """Approaches and returns by a clear pose and home, for a pose without a straight path to home."""
    routes: list[tuple[Legs, Legs]] = []
    for corner in _nearest(clear, pose):
        inner = approaches(by_home[0], corner)
        outer = None if inner is None else approaches(inner[0], pose)
        after = approaches(by_home[1], corner)
        last = None if after is None else approaches(after[1], pose)
        if inner is not None and outer is not None and after is not None and last is not None:
            routes.append(((outer[0], inner[0], by_home[0]), (by_home[1], after[1], last[1])))
    return routes


def _legs_by_clear_pose(
    motion: Trajectory, pose: Array, approaches: Approaches, clear: Array
) -> tuple[list[Legs], list[Legs]]:
    """Approaches, and returns, by a clear pose, for a motion whose end has no straight path to home."""
    start, end = motion.motion(np.array([0.0, motion.duration]), 1).orders[0]
    to: list[Legs] = []
    back: list[Legs] = []
    for legs, place, at in ((to, 0, start), (back, 1, end)):
        for corner in _nearest(clear, at):
            near = approaches(motion, corner)
            far = None if near is None else approaches(near[place], pose)
            if near is not None and far is not None:
                pair = far[place], near[place]
                legs.append(pair if place == 0 else pair[::-1])
    return to, back


def _nearest(clear: Array, at: Array) -> Array:
    """The clear poses (n, k) nearest to a pose (k,), relative to their ranges."""
    size = np.maximum(np.ptp(clear, axis=0), np.finfo(float).tiny)
    order = np.argsort(np.linalg.norm((clear - at) / size, axis=1), kind="stable")
    return np.asarray(clear[order[:MOST_AROUND]])


def require_inside(
    pose: Array, lower: Array, upper: Array, names: Sequence[str], where: str = "--from"
) -> None:
    """Raises UsageError with the first coordinate of `pose` (k,) outside `lower`..`upper` (k,)."""
    for name, at, low, high in zip(names, pose.tolist(), lower.tolist(), upper.tolist(), strict=True):
        if not low <= at <= high:
            raise UsageError(
                f"{name} is at {at:g}, outside its limits {low:g}..{high:g}",
                where=where,
                next_step="First move the robot inside its limits, or correct the pose or robot.toml.",
            )


def _first_proved(
    tried: Sequence[tuple[Trajectory, ...]], limits: Sequence[Limit], speed: float
) -> tuple[Trajectory, ...]:
    """The first path proved at `speed` (per cent), or slower; else the error of the straight path."""
    factors = [FULL / speed * factor for factor in SLOWER]
    known: dict[tuple[int, float], bool] = {}
    barred: set[int] = set()  # legs, which ways share; no speed helps them

    def proves(part: Trajectory, factor: float) -> bool:
        key = id(part), factor
        if key not in known and id(part) not in barred:
            certificate = certify(part.slowed(factor), limits)
            known[key] = certificate.ok
            if any(row.quantity in PLACES for row in certificate.failed):
                barred.add(id(part))
        return known.get(key, False)

    for i, parts in enumerate(tried):
        resting = all(_is_at_rest(part) for part in parts)  # others lead into a motion, whose speed is given
        for factor in (factors if i < MANY else factors[:1]) if resting else (1.0,):
            if all(proves(part, factor) for part in parts):
                return tuple(part.slowed(factor) for part in parts)
    for part in tried[0]:
        require_certified(part.slowed(factors[-1]) if _is_at_rest(part) else part, limits)
    raise AssertionError("a certified approach was refused")


def _labelled(label: str, parts: tuple[Trajectory, ...]) -> tuple[Part, ...]:
    """The parts with labels: `label` for a path of one piece, the pieces' own labels otherwise."""
    labelled: list[Part] = []
    for part in parts:
        pieces = part.pieces()
        labelled += [(piece_label if len(pieces) > 1 else label, piece) for _, piece_label, piece in pieces]
    return tuple(labelled)


def _as_trajectory(parts: tuple[Part, ...]) -> Trajectory:
    return parts[0][1] if len(parts) == 1 else Chain(parts)


def _ends(motion: Trajectory) -> Array:
    """Position, velocity and acceleration at both ends, (3, 2, k)."""
    return motion.motion(np.array([0.0, motion.duration]), 3).orders


def _is_at_rest(motion: Trajectory) -> bool:
    return bool(np.abs(_ends(motion)[1:]).max() <= JOINED)


def _is_continuous(approach: Trajectory, motion: Trajectory, back: Trajectory) -> bool:
    """Whether speed and acceleration are continuous where approach, motion and return join."""
    ends = _ends(motion)
    jumps = _ends(approach)[1:, 1] - ends[1:, 0], _ends(back)[1:, 0] - ends[1:, 1]
    return all(np.abs(jump).max() <= JOINED for jump in jumps)


def clear_poses(campaign: Campaign) -> Array | None:
    """Poses with a straight path to home, (n, k), for robots with obstacles; None if there are none."""
    reach = reachable(campaign)
    return None if reach is None or len(reach.poses) < 2 else reach.poses


def pose_inside(campaign: Campaign, start: str) -> Array:
    """The pose (k,) that `start` names, rad (m). UsageError: it is unknown, or outside the limits."""
    pose = pose_of(campaign, start)
    if start not in poses_of(campaign):
        limits = campaign.kind.expected(campaign.spec).limits[campaign.kind.path]
        require_inside(pose, *limits, campaign.axes)
    return pose


def require_pose(
    campaign: Campaign,
    start: str,
    constraints: Constraints,
    problem: UnsafeTrajectoryError,
    beside: str = "",
) -> None:
    """Raises UnsafeTrajectoryError if the pose at rest breaks the limit that the approach breaks.

    No other motion helps in this case.

    Args:
        campaign: the folder. start: names the pose. constraints: those of the proposal.
        problem: the error of the approach. beside: text after the fact.
    """
    pose = pose_of(campaign, start)
    still = np.zeros((2, 2, len(pose)))
    still[0] = pose
    hold = Splined(np.array([0.0, 1.0]), still)
    for limit in constraints.limits(campaign):
        rows = limit.prove(hold) if isinstance(limit, SupportsOrder) and limit.order == 0 else ()
        for row in rows:
            low, high = row.lower - row.tracking_margin, row.upper + row.tracking_margin
            if row.upper >= row.proved_upper and row.proved_lower >= row.lower:
                continue
            if problem.limit != (row.axis, row.quantity):
                continue
            raise UnsafeTrajectoryError(
                f"the pose itself is the problem: {row.quantity} of '{row.axis}' is {row.proved_upper:.6g}; "
                f"motions stay in {row.lower:.6g}..{row.upper:.6g}, {row.tracking_margin:.3g} inside of "
                f"{low:.6g}..{high:.6g} for tracking{beside}",
                where="--from",
                next_step="Name a pose inside, or move the robot to the start with its own controller.",
            ) from None


def prepared(
    campaign: Campaign, motion: Trajectory, start: str, constraints: Constraints, speed: int = FULL
) -> tuple[Array, There, dict[str, TrajectoryFiles]]:
    """The pose (k,), its approach and return, and their files by stem; writes nothing.

    Raises:
        UsageError, UnsafeTrajectoryError: as `approached`.
    """
    kind, spec, limits = campaign.kind, campaign.spec, constraints.limits(campaign)
    pose = pose_inside(campaign, start)
    paths = there_and_back(
        motion, pose, approaches_of(campaign), limits, kind.home(spec), clear_poses(campaign), speed
    )
    if paths is None:
        raise UsageError(
            f"robots of the kind '{kind.name}' have no approach to the start of a motion",
            where="--from",
            next_step="Move the robot there with its own controller.",
        )
    parts = {"approach": paths.approach, "return": paths.back}
    parts |= {} if paths.whole is None else {"trajectory": paths.whole}
    made = {
        stem: render(
            part, kind, spec, campaign.config, limits, constraints.unenforced, stem, constraints.control
        )
        for stem, part in parts.items()
    }
    return pose, paths, made


def poses_of(campaign: Campaign) -> dict[str, Array]:
    """Poses (k,) by name, rad (m): home, and those of the kind."""
    kind = campaign.kind
    more = kind.poses(campaign.spec) if isinstance(kind, SupportsPoses) else {}
    return {HOME: np.asarray(kind.home(campaign.spec), dtype=float), **more}


def pose_of(campaign: Campaign, start: str) -> Array:
    """The pose (k,) that `start` names, rad (m). UsageError: it is unknown."""
    named = poses_of(campaign)
    if start in named:
        return named[start]
    if "=" in start and not Path(start).is_file():
        return _parse_pose(start, campaign.axes)
    if not Path(start).exists():
        raise UsageError(
            f"there is no pose {start!r}, and no such file",
            where="--from",
            next_step=did_you_mean(start, named) + WRITE,
        )
    return _last_row(Path(start), campaign)


def _parse_pose(text: str, axes: tuple[str, ...]) -> Array:
    values: dict[str, float] = {}
    for one in text.replace(",", " ").split():
        axis, _, value = one.rpartition("=")
        try:
            values[axis] = float(value)
        except ValueError:
            raise UsageError(
                f"{one!r} does not have the form joint=value", where="--from", next_step=WRITE
            ) from None
    missing, unknown = ([a for a in one if a not in other] for one, other in ((axes, values), (values, axes)))
    if missing or unknown:
        what = f"lacks {', '.join(missing)}" if missing else f"has no joint {', '.join(unknown)}"
        raise UsageError(
            f"the pose {what}" if missing else f"the robot {what}",
            where="--from",
            next_step=f"Name each of {', '.join(axes)} once.",
        )
    return np.array([values[axis] for axis in axes])


def _last_row(path: Path, campaign: Campaign) -> Array:
    """Positions (k,) in the last row of a table with a column for each joint."""
    try:
        lines = [line for line in csv.reader(io.StringIO(path.read_text(errors="replace"))) if any(line)]
    except OSError as error:
        raise UsageError(
            f"the file of the pose cannot be read: {error.strerror}", where=f"--from {path}", next_step=WRITE
        ) from None
    columns = column_names(campaign.channel(campaign.kind.path))
    header = [cell.strip() for cell in lines[0]] if lines else []
    missing = [name for name in columns if name not in header]
    if missing or len(lines) < 2:
        raise UsageError(
            f"the table has no {'column ' + ', '.join(missing) if missing else 'row'}",
            where=str(path),
            next_step=f"The table needs the columns {', '.join(columns)}; its last row is the pose.",
        )
    try:
        pose = np.array([float(lines[-1][header.index(name)]) for name in columns])
    except (ValueError, IndexError):
        raise UsageError("its last row is not a pose", where=str(path), next_step=WRITE) from None
    if not np.isfinite(pose).all():
        raise UsageError("its last row is not a pose", where=str(path), next_step=WRITE)
    return pose


def _folder_name(campaign: Campaign, start: str, pose: Array) -> str:
    """Name of the folder for a pose; each pose has its own."""
    return start if start in poses_of(campaign) else hashlib.sha256(pose.tobytes()).hexdigest()[:8]
