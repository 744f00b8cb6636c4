"""What a model of an arm looks at: x = [q, qd, qdd, tanh(qd / (s v0)) ...] (thesis 6.1 and friction).

A smooth kernel spends its data on the Coulomb step at qd = 0; the tanh columns hand it the step. Samples of a
joint that stands still will be masked, which a plan knows as a smooth weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from etude.contracts import Array, Channel, Code, Column, Index, Log, Motion, Planned, Row, Samples
from etude.errors import UsageError
from etude.robots.arm.spec import ORDERS, PATH, PLAN, ArmSpec

FRICTION_SCALES = (1.0, 4.0, 16.0)
"""Multiples of v0 with a friction column each: a curve over speed; static may exceed kinetic friction.

With one column, identification stalls at twice the tracking error on an arm with Stribeck friction.
"""


@dataclass(frozen=True, eq=False)
class ArmInputs:
    """Implements `contracts.Inputs`; stateless, so any times will do.

    Attributes:
        channels: by name, of q, qd, qdd and their plans.
        stick_velocity: (J,) vm >= 0, speed below which a sample is masked, rad/s; 0 for no mask.
        friction_velocity: (J,) v0 > 0 in rad/s, or None for the thesis's plain inputs.
        friction_scales: multiples s of v0, one column for each and each axis.
        desired: look at the plan (thesis) instead of at what was measured.
    """

    channels: Mapping[str, Channel]
    stick_velocity: Array
    friction_velocity: Array | None = None
    friction_scales: tuple[float, ...] = FRICTION_SCALES
    desired: bool = False

    def __post_init__(self) -> None:
        v0 = self.friction_velocity
        if v0 is not None and (
            v0.shape != self.stick_velocity.shape or not bool(np.all(np.isfinite(v0) & (v0 > 0)))
        ):
            raise UsageError(
                "friction velocities must be one positive number (rad/s) for each axis",
                where=f"friction_velocity = {v0.tolist()}",
            )

    @classmethod
    def of(cls, spec: ArmSpec, friction_fraction: float, desired: bool = False) -> ArmInputs:
        """v0 of the friction columns is a part of the velocity limits; 0 for no such columns."""
        channels = {c.name: c for c in spec.channels() if c.name in (*PATH, *PLAN)}
        v0 = friction_fraction * spec.velocity if friction_fraction else None
        return cls(channels, np.zeros(spec.dof), v0, desired=desired)

    @property
    def names(self) -> tuple[str, str, str]:
        """The channels that are looked at: position, velocity, acceleration."""
        return PLAN if self.desired else PATH

    @property
    def thresholds(self) -> list[Array]:
        """The velocities s v0, (J,) each; empty without friction columns."""
        if self.friction_velocity is None:
            return []
        return [scale * self.friction_velocity for scale in self.friction_scales]

    @property
    def columns(self) -> tuple[Column, ...]:
        """One block of J columns after another: q, qd, qdd, then friction from the narrowest step on."""
        found: list[Column] = []
        for name in self.names:
            channel = self.channels[name]
            found += [(name, part, unit, "") for part, unit in zip(channel.parts, channel.units, strict=True)]
        speed = self.channels[self.names[1]]
        return (*found, *((speed.name, part, "1", "tanh") for _ in self.thresholds for part in speed.parts))

    @property
    def orders(self) -> int:
        return ORDERS

    @property
    def rate(self) -> float:
        return 0.0

    def states(self, motion: Motion) -> Log:
        """Measured as planned: what a perfect run leaves."""
        names = (*PATH, *PLAN)
        values = dict(zip(names, (*motion.orders[:ORDERS], *motion.orders[:ORDERS]), strict=True))
        return Log(motion.t, {name: self.channels[name] for name in names}, values, source="plan")

    def of_log(self, log: Log) -> Array:
        """X (T, D). KeyError where the log lacks a channel."""
        return self._columns(*(log[name] for name in self.names))

    def plan(self, motion: Motion, keep: Index | None = None) -> Planned:
        """X (T, D), signed stick gains (T, J), and the way back to q, qd and qdd."""
        q, qd, qdd = motion.orders[:ORDERS] if keep is None else motion.orders[:ORDERS, keep]
        gains, slopes = stick_gains(qd, self.stick_velocity)

        def pull(in_X: Array, in_gains: Array) -> Array:
            return self._pulled(qd, in_X) + np.stack([0.0 * gains, in_gains * slopes, 0.0 * gains])

        return Planned(self._columns(q, qd, qdd), gains, pull)

    def step(self, row: Row, memory: Array | None) -> tuple[Array, Array]:  # noqa: ARG002
        """x (D,) of one instant; nothing is remembered."""
        q, qd, qdd = (row[name][None] for name in self.names)
        return self._columns(q, qd, qdd)[0], np.zeros(0)

    def rates(self, motion: Motion) -> tuple[Array, Array] | None:
        """dX/dt and d2X/dt2 (T, D); the motion needs five orders. UsageError if it has fewer."""
        if len(motion.orders) < ORDERS + 2:
            raise UsageError(f"rates of inputs take {ORDERS + 2} orders, not {len(motion.orders)}")
        qd, qdd, qddd = motion.orders[1:4]
        first, second = list(motion.orders[1:4]), list(motion.orders[2:5])
        for threshold in self.thresholds:
            step = np.tanh(qd / threshold)
            slope = (1.0 - step**2) / threshold
            first.append(slope * qdd)
            second.append(slope * qddd - 2.0 * step * slope * qdd**2 / threshold)
        return np.concatenate(first, axis=1), np.concatenate(second, axis=1)

    def tuned(self, samples: Samples) -> ArmInputs:
        """With the top speed of the samples that were masked as standing: slower ones will be masked too."""
        speed = np.abs(samples.log[self.names[1]])
        return replace(self, stick_velocity=np.where(samples.moving, 0.0, speed).max(axis=0, initial=0.0))

    def arrays(self) -> dict[str, Array]:
        """What `tuned` has set, to be stored with a model."""
        return {"stick_velocity": self.stick_velocity}

    def restore(self, arrays: Mapping[str, Array]) -> ArmInputs:
        """The same inputs with what `arrays` holds."""
        return replace(self, stick_velocity=np.asarray(arrays["stick_velocity"], dtype=float))

    def c(self, name: str) -> Code | None:  # noqa: ARG002
        return None

    def _columns(self, q: Array, qd: Array, qdd: Array) -> Array:
        shape = (len(q), len(self.stick_velocity))
        for name, values in zip(self.names, (q, qd, qdd), strict=True):
            if values.shape != shape:
                raise UsageError(f"{name} has shape {values.shape}, not {shape}", where="inputs of the model")
        friction = [np.tanh(qd / threshold) for threshold in self.thresholds]
        return np.concatenate([q, qd, qdd, *friction], axis=1)

    def _pulled(self, qd: Array, in_X: Array) -> Array:
        """Gradient (3, T, J) of sum(in_X * X) in q, qd and qdd."""
        blocks = np.stack(np.split(in_X, ORDERS + len(self.thresholds), axis=1))
        found = blocks[:ORDERS].copy()
        for block, threshold in zip(blocks[ORDERS:], self.thresholds, strict=True):
            found[1] += block * ((1.0 - np.tanh(qd / threshold) ** 2) / threshold)
        return found


def stick_gains(qd: Array, stick_velocity: Array) -> tuple[Array, Array]:
    """Signed gains d = v/sqrt(v^2 + vm^2) and their derivatives in v.

    The noise of a slow sample is sn^2 (1 + (vm/v)^2) = sn^2/d^2. The sign cancels in every criterion and
    keeps the gain smooth through v = 0.

    Args:
        qd: (T, J) rad/s.
        stick_velocity: (J,) vm >= 0, speed below which a sample is masked, rad/s; 0 for no mask.

    Returns:
        gains (T, J) in (-1, 1), derivatives (T, J) in s/rad.
    """
    free = stick_velocity == 0.0
    reach = np.sqrt(qd**2 + np.where(free, 1.0, stick_velocity) ** 2)
    gain = np.where(free, 1.0, qd / reach)
    return gain, np.where(free, 0.0, stick_velocity**2 / reach**3)
