"""Velocity envelope: limits that shrink towards the ends of a joint's range, as some controllers enforce.

Franka's FR3 stops if |qd| exceeds min(velocity, offset + sqrt(slope (end - q))) on the way to an end; see
"Robot and interface specifications" in the documentation of libfranka. It aborts such a motion even inside
the constant limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from etude.limits.certificate import memoized
from etude.limits.lipschitz import FIRST_STEP, SEARCH_STEP, TOLERANCE, extremes
from etude.limits.motion_limits import bound_of, envelope_speed, tracked
from etude.protocols import Family, Trajectory
from etude.types import Array, Cone, Margins, Motion, Proof
from etude_arm.spec import Axis, Envelope

QUANTITY = "velocity left before the end"
"""How much faster the joint may go at the position where it is."""


@dataclass(frozen=True, eq=False)
class EnvelopeLimit:
    """A `Limit`: all joints keep their envelopes under tracking errors of position and velocity.

    Attributes:
        names: of these joints. axes: their places in the motion. envelopes: of them.
        velocity: (n,) rad/s (m/s), constant limits, which no envelope exceeds.
        margins: of tracking, by form of motion.
    """

    names: tuple[str, ...]
    axes: tuple[int, ...]
    envelopes: tuple[Envelope, ...]
    velocity: Array
    margins: Margins = field(default_factory=dict)
    _proofs: dict[str, tuple[Proof, ...]] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        return QUANTITY

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None, because position and velocity are bounded together."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """Mean square of the excess, relative to the constant limit."""
        gradient = np.zeros_like(motion.orders)
        value, size = 0.0, len(motion.t) * len(self.axes)
        for sign in (1.0, -1.0):
            q, qd = self._towards(motion, sign)
            top, slope = self._top(q, sign)
            over = np.maximum(qd - top, 0.0) / self.velocity
            value += float((over**2).sum()) / size
            push = 2.0 * over / self.velocity / size
            gradient[0][:, self.axes] += sign * push * np.where(top > 0.0, slope, 0.0)
            gradient[1][:, self.axes] += sign * push
        return value, gradient

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples keep the limit; for searches, whose result is proved later."""
        count = max(2, math.ceil(piece.duration / SEARCH_STEP)) + 1
        motion = piece.motion(np.linspace(0.0, piece.duration, count), 2)
        return bool(np.all(self._slack(motion, piece.form) >= 0.0))

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each joint."""
        return memoized(self._proofs, piece.to_json(), lambda: self._rows(piece))

    def of_motion(self, motion: Motion) -> Array:
        """Slack (T, n), rad/s (m/s), without tracking margins."""
        return self._slack(motion, "")

    def _rows(self, piece: Trajectory) -> tuple[Proof, ...]:
        t = np.linspace(0.0, piece.duration, max(2, math.ceil(piece.duration / FIRST_STEP)) + 1)
        motion = piece.motion(t, 2)
        values, rates = self._slack(motion, piece.form), self._rates(piece)
        confidence = self._tracking(piece.form)[2]
        margins = (self._slack(motion, "") - values).max(axis=0).tolist()
        rows = []
        for j, name in enumerate(self.names):

            def at(instants: Array, j: int = j) -> Array:
                return self._slack(piece.motion(instants, 2), piece.form)[:, j]

            least, most = extremes(at, t, values[:, j], float(rates[j]), TOLERANCE * float(self.velocity[j]))
            how = f"samples, and a rate of at most {rates[j]:.3g} per s between them"
            sure = float(confidence[j])
            ends = 0.0, math.inf, least, most
            rows.append(Proof(name, QUANTITY, *ends, how, tracking_margin=margins[j], confidence=sure))
        return tuple(rows)

    def _rates(self, piece: Trajectory) -> Array:
        """Bound (n,) of the slack's rate: |qdd| and |qd| times the envelope's slope."""
        none = np.zeros(len(self.axes))
        q, qd, qdd = (bound_of(piece, order, 1, list(self.axes), none).range() for order in range(3))
        error = self._tracking(piece.form)[0]
        steepest = np.maximum(self._top(q[1] + error, 1.0)[1], self._top(-(q[0] - error), -1.0)[1])
        speed, change = (np.maximum(np.abs(low), np.abs(high)) for low, high in (qd, qdd))
        return np.asarray(change + steepest * speed)

    def _slack(self, motion: Motion, form: str) -> Array:
        """Slack (T, n) in the tighter of both directions."""
        error, speed, _ = self._tracking(form)
        slacks = []
        for sign in (1.0, -1.0):
            q, qd = self._towards(motion, sign)
            slacks.append(self._top(q + error, sign)[0] - speed - qd)
        return np.minimum(*slacks)

    def _tracking(self, form: str) -> tuple[Array, Array, Array]:
        """Tracking margins (n,) of position and velocity, and their confidence."""
        places = list(self.axes)
        (error, sure), (speed, quick) = (tracked(0.0, self.margins, form, order, places) for order in (0, 1))
        return error, speed, np.minimum(sure, quick)

    def _towards(self, motion: Motion, sign: float) -> tuple[Array, Array]:
        """Positions and velocities (T, n), mirrored for the lower end."""
        q, qd = (motion.orders[order][:, self.axes] for order in (0, 1))
        return sign * q, sign * qd

    def _top(self, q: Array, sign: float) -> tuple[Array, Array]:
        """(..., n) as `envelope_speed`, of (mirrored) positions."""
        end = np.array([envelope.upper if sign > 0.0 else -envelope.lower for envelope in self.envelopes])
        offset = np.array([envelope.offset for envelope in self.envelopes])
        slope = np.array([envelope.slope for envelope in self.envelopes])
        return envelope_speed(end - q, offset, slope, self.velocity)


def envelope_of(
    names: Sequence[str], envelopes: Sequence[Envelope | None], velocity: Array, margins: Margins
) -> EnvelopeLimit | None:
    """The limit of the joints with an envelope; None without any. Arguments in the order of the axes."""
    places = tuple(j for j, envelope in enumerate(envelopes) if envelope is not None)
    if not places:
        return None
    stated = tuple(envelope for envelope in envelopes if envelope is not None)
    return EnvelopeLimit(tuple(names[j] for j in places), places, stated, velocity[list(places)], margins)


def braked_range(axis: Axis) -> tuple[float, float]:
    """Ends, rad (m), between which every motion within the constant limits keeps the axis's envelope.

    A motion that stays before an end can stop before it: |qd| <= min(velocity, sqrt(2 acceleration left)).
    The envelope allows this at a distance of (|qd| - offset)^2 / slope from its own end.
    """
    envelope = axis.envelope
    if envelope is None:
        return axis.lower, axis.upper
    first = max(envelope.offset, 0.0)
    if first >= axis.velocity:
        return axis.lower, axis.upper
    bend = 1.0 / envelope.slope - 0.5 / axis.acceleration
    worst = first if bend == 0.0 else envelope.offset / envelope.slope / bend
    speeds = np.array([first, float(np.clip(worst, first, axis.velocity)), axis.velocity])
    away = np.max((speeds - envelope.offset) ** 2 / envelope.slope - 0.5 * speeds**2 / axis.acceleration)
    return max(axis.lower, envelope.lower + float(away)), min(axis.upper, envelope.upper - float(away))
