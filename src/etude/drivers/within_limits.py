"""Comparison of a motion with the limits that the robot itself states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.drivers.contract import About, PlannedMotion, VelocityEnvelope
from etude.limits.motion_limits import envelope_speed
from etude.types import Array

SLACK = 1e-6
"""Part of each limit that rounding may take."""


def refusals(motion: PlannedMotion, about: About) -> Sequence[str]:
    """A sentence for each limit of `about` that the motion leaves, and for what it cannot play at all."""
    if motion.joints != about.joints:
        return [
            f"the motion has the joints {', '.join(motion.joints)}, not {', '.join(about.joints)} in this "
            "order"
        ]
    sentences = []
    steps = np.diff(motion.t) * about.rate
    if motion.t[0] != 0.0 or not np.allclose(steps[:-1], 1.0, atol=1e-6) or not np.all(steps <= 1.0 + 1e-6):
        sentences.append(f"the rows of the motion are not {about.rate:g} Hz from 0")
    if motion.effort is not None and "learned" not in about.controls:
        sentences.append(f"{about.name} accepts no effort besides set-points")
    for quantity, values, lower, upper in _limited_quantities(motion, about):
        sentences += _violations(quantity, values, lower, upper, motion)
    return sentences


def velocity_range(envelope: VelocityEnvelope, q: Array) -> tuple[Array, Array]:
    """(n, J) lowest and highest velocity at positions q (n, J)."""
    parameters = envelope.offset, envelope.slope, envelope.most
    down, up = (envelope_speed(room, *parameters)[0] for room in (q - envelope.lower, envelope.upper - q))
    return -down, up


def _limited_quantities(motion: PlannedMotion, about: About) -> Sequence[tuple[str, Array, Array, Array]]:
    """Limited quantities: name, values (n, J), lower and upper bound."""
    rows: list[tuple[str, Array, Array, Array]] = []
    low = np.full(len(about.joints), -np.inf) if about.lower is None else about.lower
    high = np.full(len(about.joints), np.inf) if about.upper is None else about.upper
    rows.append(("position", motion.q, low, high))
    sizes = [
        ("velocity", motion.qd, about.velocity),
        ("acceleration", motion.qdd, about.acceleration),
        ("jerk", np.diff(motion.qdd, axis=0) / np.diff(motion.t)[:, None], about.jerk),
    ]
    if motion.effort is not None:
        rates = np.diff(motion.effort, axis=0) / np.diff(motion.t)[:, None]
        sizes.append(("rate of the command", rates, about.torque_rate))
    rows += [(quantity, values, -limit, limit) for quantity, values, limit in sizes if limit is not None]
    if about.envelope is not None:
        rows.append(("velocity at its position", motion.qd, *velocity_range(about.envelope, motion.q)))
    return rows


def _violations(
    quantity: str, values: Array, lower: Array, upper: Array, motion: PlannedMotion
) -> Sequence[str]:
    """A sentence on the joint that is furthest outside its limit; none if all are inside."""
    if not np.isfinite(values).all():
        return [f"the {quantity} of the motion has values that are not numbers"]
    lower, upper = np.broadcast_to(lower, values.shape), np.broadcast_to(upper, values.shape)
    beyond = np.maximum(values - upper, lower - values)
    allowed = SLACK * np.where(values > 0, np.abs(upper), np.abs(lower))
    beyond = np.where(np.isfinite(beyond), beyond - np.nan_to_num(allowed, posinf=0.0), -np.inf)
    row, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    if beyond[row, joint] <= 0.0:
        return []
    limit = upper[row, joint] if values[row, joint] > upper[row, joint] else lower[row, joint]
    return [
        f"the {quantity} of {motion.joints[joint]} is {values[row, joint]:.4g} at {motion.t[row]:.2f} s, "
        f"but its limit is {limit:.4g}"
    ]
