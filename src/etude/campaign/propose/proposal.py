"""Design of the next proposal: from the model and the visited states, or from the limits before any log."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.abilities import SupportsBlocking, SupportsReachable
from etude.campaign.propose.typical_motions import (
    approaches_of,
    from_rest,
    reference_motions,
    segments_of,
    typical_motions,
)
from etude.campaign.record.events import Asked
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.stored_files import FULL, stored_trajectory
from etude.codes import Notice, Warn
from etude.design.latents import Latent
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits.certificate import utilization
from etude.protocols import Family, Inputs, Limit, Model, Trajectory
from etude.types import Array, Reachable

if TYPE_CHECKING:
    from etude.design.candidates import ReachablePoses, VisitedTimes

FIRST = {"scaled": "random, scaled to the limits", "uniform": "random, uniform inside the limits"}
"""What a random first trajectory is, by the sampler that draws it."""


@dataclass(frozen=True, eq=False)
class DesignBasis:
    """Basis of a design: inputs, model or prior of the robot, and whether a model was learned."""

    inputs: Inputs
    model: Model | Sequence[Latent]
    learned: bool


def proposed(
    campaign: Campaign,
    model: Model | None,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory],
    open_ones: Sequence[Trajectory],
    limits: Sequence[Limit],
    say: Say,
) -> tuple[Trajectory, Asked]:
    """The next trajectory to record, and how it was found.

    Before any log, tasks are ignored: a motion for them alone would leave the rest of the robot unknown.

    Args:
        campaign: the folder. model: the newest; None before any log. rng: source of random numbers.
        tasks: motions that the model is intended for.
        open_ones: proposals that await their logs; their information counts as known.
        limits: less the tracking margins. say: receives one sentence per step.
    """
    basis = _design_basis(campaign, model)
    if basis is None:
        trajectory, asked = _random(campaign, rng, limits)
    else:
        what = "from the model" if basis.learned else "from the limits alone"
        say(f"Designing the next trajectory {what}.")
        trajectory, asked = _designed(campaign, basis, rng, tasks if basis.learned else (), open_ones, limits)
    _require_motion(trajectory, limits)
    return from_rest(campaign, trajectory, limits), asked


def _require_motion(trajectory: Trajectory, limits: Sequence[Limit]) -> None:
    """UnsafeTrajectoryError: the trajectory stands still, because its limits leave no room to move."""
    pieces = [piece for _, _, piece in trajectory.pieces()]
    t = [np.linspace(0.0, piece.duration, LOOKED_AT) for piece in pieces]
    paths = np.concatenate([p.motion(at, 1).orders[0] for p, at in zip(pieces, t, strict=True)])
    if np.ptp(paths, axis=0).max() > STILL * max(1.0, float(np.abs(paths).max())):
        return
    names = [f"{quantity} of {axis}" for quantity, axis in _used_up(limits, pieces)]
    raise UnsafeTrajectoryError(
        "only rest keeps all limits and their tracking margins",
        where=", ".join(names),
        next_step="Enlarge these limits, or make the controller track better: the margins leave no room.",
    )


def _design_basis(campaign: Campaign, model: Model | None) -> DesignBasis | None:
    """Basis of the design; None before any log, or if campaign.toml turns the design off."""
    from etude.design.latents import prior_latents

    if model is not None:
        return DesignBasis(model.inputs, model, True)
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    if config.design.first == "random":
        return None
    inputs = kind.inputs(spec, config)
    latents = prior_latents(
        inputs, kind.expected(spec).limits, kind.limit(spec), config.model, campaign.command.parts
    )
    return None if latents is None else DesignBasis(inputs, latents, False)


def _random(
    campaign: Campaign, rng: np.random.Generator, limits: Sequence[Limit]
) -> tuple[Trajectory, Asked]:
    """A chain of random segments."""
    from etude.design.chain_design import dropped_sentence, linked_chain

    family = campaign.kind.family(campaign.spec, campaign.config)
    count = segments_of(campaign, family)
    motions = typical_motions(campaign, rng, count, limits, grown=True)
    home = campaign.kind.home(campaign.spec)
    trajectory, linked = linked_chain(motions, approaches_of(campaign), limits, home)
    several = f"{linked} segments, " if linked > 1 else ""
    status = f"{several}{FIRST[campaign.config.design.sampler]}: nothing has been learned yet"
    return trajectory, Asked(status=status + dropped_sentence(count - linked))


SMALL = 0.1
"""Of each axis's range: where no axis sweeps more, a motion teaches hardly anything."""
STILL = 1e-9
"""rad (m), or relative to larger positions: what rounding leaves of a motion that is shrunk to rest."""
WHOLE = 0.95
"""Of a range: nothing is missing from it."""
LOOKED_AT = 400
"""Instants of each segment."""
NEAR = 0.05
"""Part of a range: at its end nothing but the end itself holds a joint back."""
AHEAD = (0.1, 0.3, 0.6)
"""Parts of what is left of a range at which it is asked what stands there. Not at its end: that always stands
there, and would be named where time alone is over."""
USED_UP = 0.9
"""Of a limit: a motion that is shrunk until a limit holds may end some per cent below it."""
NO_TIME = "no limit (the motion's duration)"


@dataclass(frozen=True)
class Swept:
    """Range of one axis that the segments of a motion cover.

    The range has 20 bins. A bin counts if the motion spends at least half a percent of its time there.

    Attributes:
        axis: its name.
        of_range: covered fraction of its range; for a hinge, of one turn at most.
        of_clear: covered fraction of the range between its extreme clear poses.
        held: the obstacle at the end of the covered range, on the side with more range left.
    """

    axis: str
    of_range: float
    of_clear: float
    held: str


def swept(campaign: Campaign, trajectory: Trajectory, limits: Sequence[Limit]) -> tuple[Swept, ...]:
    """Covered range of each axis; () for kinds without `reachable` and for motions without segments."""
    from etude.design.candidates import VisitedTimes

    reach = reachable(campaign)
    pieces = [piece for _, label, piece in trajectory.pieces() if label == "segment"]
    if reach is None or not pieces:
        return ()
    whole = replace(reach, poses=reach.poses[:0])
    of_range, of_clear = (
        VisitedTimes.nothing(region).adding([trajectory]).share() for region in (whole, reach)
    )
    times = [piece.duration * np.linspace(0.0, 1.0, LOOKED_AT) for piece in pieces]
    positions = np.concatenate([p.motion(t, 1).orders[0] for p, t in zip(pieces, times, strict=True)])
    used_up = _used_up(limits, pieces)
    held = [
        _obstacle_beyond(reach, positions, j, limits, pieces[0].form)
        or _named_limits(used_up, campaign.axes, axis)
        or NO_TIME
        for j, axis in enumerate(campaign.axes)
    ]
    rows = zip(campaign.axes, of_range.tolist(), of_clear.tolist(), held, strict=True)
    return tuple(Swept(axis, r, c, "" if r >= WHOLE else why) for axis, r, c, why in rows)


def _obstacle_beyond(reach: Reachable, positions: Array, j: int, limits: Sequence[Limit], form: str) -> str:
    """The obstacle for the pose farthest out on axis `j`, if this axis alone moves on; "" without one."""
    room = positions[:, j].min() - reach.lower[j], reach.upper[j] - positions[:, j].max()
    at = int(positions[:, j].argmin() if room[0] > room[1] else positions[:, j].argmax())
    end = reach.lower[j] if room[0] > room[1] else reach.upper[j]
    left = abs(end - positions[at, j])
    near = min(1.0, NEAR * float(reach.upper[j] - reach.lower[j]) / left) if left > 0.0 else 1.0
    for part in sorted((near, *AHEAD)):
        pose = positions[at].copy()
        pose[j] += part * (end - pose[j])
        for limit in limits:
            if isinstance(limit, SupportsBlocking) and (obstacle := limit.blocked(form, pose)):
                return obstacle
    return ""


def _used_up(limits: Sequence[Limit], pieces: Sequence[Trajectory]) -> dict[tuple[str, str], None]:
    """(quantity, axis) of limits that bound no pose, an energy for example, and that a segment uses up."""
    rows = [
        row
        for limit in limits
        if not isinstance(limit, SupportsBlocking)
        for p in pieces
        for row in limit.prove(p)
    ]
    return {(row.quantity, row.axis): None for row in rows if utilization(row) >= USED_UP}


def _named_limits(used_up: Iterable[tuple[str, str]], axes: Sequence[str], axis: str) -> str:
    """Those of this axis and of the whole robot."""
    own = [(quantity, of) for quantity, of in used_up if of == axis or of not in axes]
    return " and ".join(f"the limit of {quantity} of {of}" for quantity, of in own)


def as_facts(rows: Sequence[Swept]) -> list[dict[str, Any]]:
    """The rows as JSON values, for certificates and programs."""
    return [asdict(row) for row in rows]


def teaches_little(rows: Sequence[Swept]) -> tuple[Notice, ...]:
    """A warning about a motion that covers little of every axis."""
    if not rows or max(row.of_range for row in rows) > SMALL:
        return ()
    held = tuple(dict.fromkeys(row.held for row in rows if row.held and row.held != NO_TIME))
    part = {"part": float(max(row.of_range for row in rows))}
    if held:
        return (Notice(Warn.TEACHES_LITTLE_HELD, {**part, "held": held}),)
    return (Notice(Warn.TEACHES_LITTLE, part),)


def reachable(campaign: Campaign) -> Reachable | None:
    """Poses that the robot can reach; None for kinds that do not know."""
    kind = campaign.kind
    return kind.reachable(campaign.spec) if isinstance(kind, SupportsReachable) else None


def roam_of(campaign: Campaign, family: Family, open_ones: Sequence[Trajectory]) -> ReachablePoses | None:
    """Region for the search of the next motion; None for robots without obstacles.

    Args:
        campaign: the folder. family: of the motion's segments.
        open_ones: proposals that await their logs.
    """
    from etude.design.candidates import ReachablePoses

    reach = reachable(campaign)
    if reach is None or not len(reach.poses):
        return None
    visited = visited_by(campaign, reach).adding(open_ones)
    segment = family.trajectory(np.zeros(family.size)).duration
    return ReachablePoses(reach, visited, visited.total + segments_of(campaign, family) * segment)


def visited_by(campaign: Campaign, reach: Reachable) -> VisitedTimes:
    """Poses that the motions with a log have visited, as planned; for unsolicited logs, as recorded."""
    from etude.design.candidates import VisitedTimes

    visited = VisitedTimes.nothing(reach)
    for ingested in campaign.state().ingested:
        if ingested.asked is not None and not (ingested.ingested and ingested.ingested.foreign):
            with contextlib.suppress(UsageError):
                visited = visited.adding([stored_trajectory(campaign, ingested.number, FULL)])
            continue
        with contextlib.suppress(UsageError):
            from etude.logs.readers.log_file import read_log_file

            log = read_log_file(campaign.run_file(ingested.number))
            visited = visited.adding_poses(log[campaign.kind.path], float(np.ptp(log.t)))
    return visited


def _designed(
    campaign: Campaign,
    basis: DesignBasis,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory],
    open_ones: Sequence[Trajectory],
    limits: Sequence[Limit],
) -> tuple[Trajectory, Asked]:
    """The most informative trajectory to record, and how it was found."""
    from etude.design.chain_design import design_chain

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    family = kind.family(spec, config)
    mixed = basis.learned and config.design.reference == "mixed"
    design = design_chain(
        family,
        limits,
        kind.home(spec),
        basis.inputs,
        basis.model,
        config.design,
        rng,
        tasks,
        count=segments_of(campaign, family),
        approaches=approaches_of(campaign),
        standing_in=reference_motions(campaign, rng) if mixed else (),
        given=open_ones,
        rate=float(spec.rate),
        physics=kind.physics(spec, config),
        roam=roam_of(campaign, family, open_ones),
    )
    first, last = design.segments[0], design.segments[-1]
    asked = Asked(
        status=design.status if basis.learned else f"from the limits alone: {design.status}",
        gain=design.variance_removed if basis.learned else None,
        criterion=last.criterion,
        value=last.value,
        baseline_value=last.baseline,
        choice=max((c for segment in design.segments if (c := segment.choice) is not None), default=None),
        deviation_before=tuple(first.deviation_before.tolist()),
        deviation_after=tuple(last.deviation_after.tolist()),
        evaluations=sum(segment.evaluations for segment in design.segments),
        seconds=sum(segment.seconds for segment in design.segments),
    )
    return design.trajectory, asked
