"""Bounds of a motion's supervisor, from the robot file and the measured tracking errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.campaign.propose.constraints import Constraints, ranges_of
from etude.campaign.propose.learned_velocity import MOST_FASTER, peak_speeds
from etude.campaign.record.controls import FEEDBACK, LEARNED
from etude.campaign.record.events import Event
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import stored_trajectory
from etude.campaign.run.run_history import measured_errors, measured_residuals, whole_numbers
from etude.drivers import About, Bounds
from etude.limits.tracking_margins import margins_of
from etude.protocols import Trajectory
from etude.types import Array

OF_ASSUMED, OF_MEASURED = 4.0, 2.0
"""Times a margin at which a motion is stopped. A margin holds in 95 of 100 runs, so it is no bound itself."""
LEAST_ASSUMED = 0.5
"""Of the margin that is assumed before any log; no error below that stops a motion. New motions err by more
than those that were recorded."""
LEAST_STEPS = 5.0
"""Steps of the encoder below which no error stops a motion."""
FASTER = 1.25
"""Times the velocity limit that measured velocities may reach: they hold noise."""
STRONGER = 1.05  # the same of commands, which drives cut at their limit
DEVIATIONS, OF_DRIVE = 4.0, 0.05
"""Deviations of the model, and part of what a drive can give, below which no residual of commands stops a
motion: another form of motion errs by more than those that were recorded."""


def bounds_for(
    campaign: Campaign,
    about: About,
    constraints: Constraints,
    trajectory: Trajectory,
    control: str,
    deviation: Array | None = None,
) -> Bounds:
    """The bounds (k,) of a motion, in the campaign's order of axes.

    Args:
        constraints: what the motion was proved with. trajectory: it.
        deviation: (T, k) of the learned command along it; None where none is sent.
    """
    events = campaign.events()
    limits = campaign.kind.expected(campaign.spec).limits
    path = campaign.kind.path
    lower, upper = (np.asarray(end, dtype=float) for end in limits[path])
    rate = next((c.name for c in campaign.channels if c.derivative_of == path), "")
    fastest = np.asarray(limits[rate][1]) if rate in limits else np.full(len(lower), np.inf)
    by_joint = len(campaign.command.parts) == len(lower)  # a vehicle's are of its rotors
    command = limits.get(campaign.command.name) if by_joint else None
    return Bounds(
        error=_error_bound(campaign, about, constraints, trajectory, control, events),
        lower=lower,
        upper=upper,
        velocity=FASTER * fastest,
        silence=about.silence,
        effort=None if command is None else STRONGER * np.asarray(command[1]),
        residual=_residual_bound(
            _beyond_recorded(campaign, trajectory, control, events),
            events,
            control,
            deviation,
            None if command is None else np.asarray(command[1]),
        ),
    )


def _error_bound(
    campaign: Campaign,
    about: About,
    constraints: Constraints,
    trajectory: Trajectory,
    control: str,
    events: Sequence[Event],
) -> Array:
    """(k,) bound of the tracking error. Where a hard limit is nearer to the path, it stops the motion."""
    margin = assumed_margin(campaign, constraints, trajectory)
    errors, feedback = measured_errors(events, control), measured_errors(events, FEEDBACK)
    bound = OF_ASSUMED * margin
    if errors is not None:
        bound = OF_MEASURED * errors.expected
    elif feedback is not None:
        bound = np.minimum(bound, OF_ASSUMED * feedback.expected)
    if control == LEARNED and feedback is not None:
        # where a model knows nothing its command fades, and the feedback is what is left
        bound = np.maximum(bound, feedback.expected)
    bound = np.fmax(bound, LEAST_ASSUMED * margin_before_logs(campaign, trajectory))
    if about.encoder_step is not None:
        order = [about.joints.index(axis) for axis in campaign.axes]
        bound = np.maximum(bound, LEAST_STEPS * about.encoder_step[order])
    return np.asarray(bound)


def assumed_margin(campaign: Campaign, constraints: Constraints, trajectory: Trajectory) -> Array:
    """(k,) largest position margin of the forms of a motion, as it was proved; as before any log where the
    certificate keeps none.
    """
    forms = {piece.form for _, _, piece in trajectory.pieces()}
    margins = [np.asarray(table)[0] for form, (table, _) in constraints.margins.items() if form in forms]
    if not margins:
        return np.nan_to_num(margin_before_logs(campaign, trajectory), nan=np.inf)
    return np.asarray(np.nan_to_num(np.max(margins, axis=0), nan=np.inf))


def margin_before_logs(campaign: Campaign, trajectory: Trajectory) -> Array:
    """(k,) largest position margin that is assumed of the forms of a motion; NaN where nothing tells one."""
    tracking = replace(campaign.config.tracking, margin="assumed")
    forms = {piece.form for _, _, piece in trajectory.pieces()}
    start = margins_of(tracking, ranges_of(campaign), {}, sorted(forms))
    return np.asarray(np.max([np.asarray(table)[0] for table, _ in start.values()], axis=0))


def _beyond_recorded(
    campaign: Campaign, trajectory: Trajectory, control: str, events: Sequence[Event]
) -> float:
    """Factor on residuals of a motion that is faster than the recorded ones; 1 if it is not.

    Forces of motion grow with the square of the speed, and so does what a model misses of them.
    """
    before = [peak_speeds(stored_trajectory(campaign, number)) for number in whole_numbers(events, control)]
    if not before:
        return 1.0
    fastest, now = np.max(before, axis=0), peak_speeds(trajectory)
    ratio = np.divide(now, fastest, out=np.ones_like(now), where=fastest > 0.0)
    return min(max(1.0, float(ratio.max())), MOST_FASTER) ** 2


def _residual_bound(
    faster: float, events: Sequence[Event], control: str, deviation: Array | None, drive: Array | None
) -> Array | None:
    """(k,) bound of the residual; None before recordings under the learned command.

    faster: factor on recorded residuals. drive: (k,) largest commands; None: unknown.
    """
    residuals = measured_residuals(events, control) if deviation is not None else None
    if residuals is None or deviation is None:
        return None
    bound = np.maximum(OF_MEASURED * faster * residuals.expected, DEVIATIONS * deviation.max(axis=0))
    return np.asarray(bound if drive is None else np.maximum(bound, OF_DRIVE * drive))
