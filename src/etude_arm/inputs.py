"""Inputs of an arm's model: x = [q, qd, qdd, tanh(qd / (s v0)) ...] (thesis 6.1 and friction).

A smooth kernel spends its data on the Coulomb step at qd = 0; the tanh columns provide the step. Samples of a
joint at rest are masked; for a plan, the mask is a smooth weight. With a friction state, each joint has two
more columns: sigma e and e = exp(-|qd| / v0), for kernels that use them. They give the force at rest, and the
degree of rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from etude._runtime.operators import Piece
from etude.errors import UsageError
from etude.types import Array, Channel, Code, Column, Index, Log, Motion, Planned, Row, Samples
from etude_arm.memory import MEMORY_RATE, memory_vjp, remembered, turning
from etude_arm.spec import MEMORY, ORDERS, PATH, PLAN, TURNING, ArmSpec

FRICTION_SCALES = (1.0, 4.0, 16.0)
"""Multiples of v0 with a friction column each: a curve over speed; static may exceed kinetic friction.

With one column, identification stalls at twice the tracking error on an arm with Stribeck friction.
"""
SLOW = 0.02
"""v0 of e as a part of the joint's top speed."""
SLOWEST = 0.05
"""Least top speed that `fitted` takes from a log, as a fraction of the velocity limit."""
FASTEST = 3.0
"""rad/s (m/s): largest transition speed of friction. Slow samples are masked, so no sample determines a
larger one, which would smear reversals over seconds."""


def friction_speeds(spec: ArmSpec, fraction: float) -> Array:
    """Friction velocities v0 (J,), a fraction of the velocity limits."""
    return np.asarray(fraction * np.minimum(spec.velocity, FASTEST))


@dataclass(frozen=True, eq=False)
class ArmInputs:
    """Implements `protocols.Inputs`; without a friction state, the times are arbitrary.

    Attributes:
        channels: by name, of q, qd, qdd and their plans.
        stick_velocity: (J,) vm >= 0, speed below which a sample is masked, rad/s; 0 for no mask.
        friction_velocity: (J,) v0 > 0 in rad/s, or None for the thesis's plain inputs.
        friction_scales: multiples s of v0, one column for each and each axis.
        desired: use the plan (thesis) instead of the measured motion.
        presliding: (J,) presliding distance, rad or m; None: no friction state.
        play: (J,) half width that a position must leave to count as motion. slow: (J,) v0 of e, rad/s.
        presliding_distances: (W, J) possible presliding distances of the physics, rad or m; perfect runs have
            their friction states. None: they have none.
    """

    channels: Mapping[str, Channel]
    stick_velocity: Array
    friction_velocity: Array | None = None
    friction_scales: tuple[float, ...] = FRICTION_SCALES
    desired: bool = False
    presliding: Array | None = None
    play: Array | None = None
    slow: Array | None = None
    presliding_distances: Array | None = None

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
    def of(
        cls,
        spec: ArmSpec,
        friction_fraction: float,
        desired: bool = False,
        presliding: float = 0.0,
        stick_fraction: float = 0.0,
        physics: bool = False,
    ) -> ArmInputs:
        """Inputs whose v0 is a fraction of the velocity limits (`friction_speeds`); 0 for no friction
        columns.

        Args:
            spec: of the robot. friction_fraction: v0 over the velocity limit. desired: use the plan.
            presliding: of hinges, rad; that of slides is a tenth of it, in m. 0 for no friction state.
            stick_fraction: fraction of the velocity limit below which samples are masked, until `fitted`.
            physics: perfect runs have the friction states of identified physics.
        """
        channels = {
            c.name: c for c in (*spec.channels(), spec.turning()) if c.name in (*PATH, *PLAN, TURNING)
        }
        v0 = friction_speeds(spec, friction_fraction) if friction_fraction else None
        distances = spec.presliding_distances() if physics else None
        inputs = cls(
            channels, stick_fraction * spec.velocity, v0, desired=desired, presliding_distances=distances
        )
        if not presliding:
            return inputs
        length = spec.presliding(presliding)
        return replace(inputs, presliding=length, play=np.zeros(spec.dof), slow=SLOW * spec.velocity)

    @property
    def names(self) -> tuple[str, str, str]:
        """The channels in use: position, velocity, acceleration."""
        return PLAN if self.desired else PATH

    @property
    def thresholds(self) -> list[Array]:
        """The velocities s v0, (J,) each; empty without friction columns."""
        if self.friction_velocity is None:
            return []
        return [scale * self.friction_velocity for scale in self.friction_scales]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Blocks of J columns: q, qd, qdd, friction from the narrowest step on, and the friction state."""
        columns: list[Column] = []
        for name in self.names:
            channel = self.channels[name]
            columns += [
                (name, part, unit, "") for part, unit in zip(channel.parts, channel.units, strict=True)
            ]
        speed = self.channels[self.names[1]]
        ops = ["tanh" for _ in self.thresholds] + (["memory", "rest"] if self.presliding is not None else [])
        return (*columns, *((speed.name, part, "1", op) for op in ops for part in speed.parts))

    def scales(self) -> Array:
        """Velocities (D,) of tanh and rest; 1 for plain columns, NaN for friction states."""
        plain = np.ones(ORDERS * len(self.stick_velocity))
        held = [] if self.slow is None else [np.full(len(self.slow), np.nan), self.slow]
        return np.concatenate([plain, *self.thresholds, *held])

    @property
    def orders(self) -> int:
        return ORDERS

    @property
    def rate(self) -> float:
        return 0.0 if self.presliding is None else MEMORY_RATE

    def states(self, motion: Motion) -> Log:
        """The log of a perfect run, measured as planned."""
        names = (*PATH, *PLAN)
        values = dict(zip(names, (*motion.orders[:ORDERS], *motion.orders[:ORDERS]), strict=True))
        log = Log(motion.t, {name: self.channels[name] for name in names}, values, source="plan")
        return log if len(log) < 2 else self.followed(log)

    def followed(self, log: Log) -> Log:
        """The log with friction states, for successive rows of a run from rest; unchanged if it has them."""
        if self.presliding_distances is None or TURNING in log:
            return log
        q = log[self.names[0]]
        return log.put(self.channels[TURNING], turning(q, np.zeros(q.shape[1]), self.presliding_distances))

    def apart(self, log: Log) -> Log:
        """The log for independent rows, with friction states of zero."""
        if TURNING in log:
            log = log.without(TURNING)
        if self.presliding is None:
            return log
        return log.put(self._memory, np.zeros(log[self.names[0]].shape))

    def carried(self, row: Log, before: Array | None) -> tuple[Log, Array | None]:
        """One row after another with its friction states, and the memory (2, W J + J): states and positions
        before.
        """
        lengths = [] if self.presliding_distances is None else [*self.presliding_distances]
        plays = [np.zeros(len(each)) for each in lengths]
        if self.presliding is not None and self.play is not None:
            lengths, plays = [*lengths, self.presliding], [*plays, self.play]
        if not lengths:
            return row, None
        q = np.tile(row[self.names[0]], (1, len(lengths)))
        if before is not None and before.shape[1] < q.shape[1]:  # an older version carried no other friction
            more = np.stack([np.zeros(q.shape[1]), q[0]])[:, before.shape[1] :]
            before = np.concatenate([before, more], axis=1)
        memory = remembered(q, np.concatenate(plays), np.concatenate(lengths), before)[0]
        J = len(self.stick_velocity)
        if self.presliding is not None:
            row = row.put(self._memory, memory[:1, -J:])
        if self.presliding_distances is not None:
            row = row.put(self.channels[TURNING], memory[:1, : self.presliding_distances.size])
        return row, memory

    def of_log(self, log: Log) -> Array:
        """X (T, D). KeyError: the log lacks a channel."""
        q, qd, qdd = (log[name] for name in self.names)
        memory = log.get(MEMORY)
        return self._columns(q, qd, qdd, self._sigma(q) if memory is None else memory)

    def plan(self, motion: Motion, keep: Index | None = None) -> Planned:
        """X (T, D), signed stick gains (T, J), and the vector-Jacobian product to q, qd and qdd."""
        rows = slice(None) if keep is None else keep
        whole = motion.orders[0]
        q, qd, qdd = motion.orders[:ORDERS, rows]
        gains, slopes = stick_gains(qd, self.stick_velocity)
        sigma = self._sigma(whole)

        def vjp(in_X: Array, in_gains: Array) -> Array:
            gradient = np.zeros((ORDERS, *whole.shape), dtype=motion.orders.dtype)
            direct, on_sigma = self._columns_vjp(qd, in_X, sigma[rows])
            gradient[:, rows] = direct + np.stack([0.0 * gains, in_gains * slopes, 0.0 * gains])
            if self.presliding is not None and self.play is not None:
                in_sigma = np.zeros(whole.shape)
                in_sigma[rows] = on_sigma
                gradient[0] += memory_vjp(whole, self.play, self.presliding, in_sigma)
            return gradient

        return Planned(self._columns(q, qd, qdd, sigma[rows]), gains, vjp)

    def step(self, row: Row, memory: Array | None) -> tuple[Array, Array]:
        """x (D,) of one instant; memory (2, J): friction and the position behind the play."""
        q, qd, qdd = (row[name][None] for name in self.names)
        if self.presliding is None or self.play is None:
            return self._columns(q, qd, qdd, self._sigma(q))[0], np.zeros(0)
        state = remembered(q, self.play, self.presliding, memory)[0]
        return self._columns(q, qd, qdd, state[:1])[0], state

    def rates(self, motion: Motion) -> tuple[Array, Array] | None:
        """dX/dt and d2X/dt2 (T, D) along a motion of five orders. UsageError: it has fewer."""
        if len(motion.orders) < ORDERS + 2:
            raise UsageError(f"rates of inputs take {ORDERS + 2} orders, not {len(motion.orders)}")
        qd, qdd, qddd = motion.orders[1:4]
        first, second = list(motion.orders[1:4]), list(motion.orders[2:5])
        for threshold in self.thresholds:
            step = np.tanh(qd / threshold)
            slope = (1.0 - step**2) / threshold
            first.append(slope * qdd)
            second.append(slope * qddd - 2.0 * step * slope * qdd**2 / threshold)
        if self.slow is not None:
            more = self._memory_rates(*motion.orders[:4])
            first, second = [*first, *more[0]], [*second, *more[1]]
        return np.concatenate(first, axis=1), np.concatenate(second, axis=1)

    def fitted(self, samples: Samples) -> ArmInputs:
        """The inputs with the top speed of the samples that were masked at rest; slower ones will be masked
        too.

        With a friction state, also the play of the log's positions, and v0 of e.
        """
        speed = np.abs(samples.log[self.names[1]])
        inputs = replace(self, stick_velocity=np.where(samples.moving, 0.0, speed).max(axis=0, initial=0.0))
        if self.presliding is None:
            return inputs
        limit = np.array(self.channels[self.names[1]].reach)
        top = np.clip(speed.max(axis=0, initial=0.0), SLOWEST * limit, limit)
        quantum = samples.log.channels[self.names[0]].quantum
        return replace(inputs, slow=SLOW * top, play=np.array(quantum) if quantum else self.play)

    def arrays(self) -> dict[str, Array]:
        """Values set by `fitted`, to be stored with a model."""
        arrays = {"stick_velocity": self.stick_velocity}
        if self.presliding is not None and self.play is not None and self.slow is not None:
            arrays |= {"presliding": self.presliding, "play": self.play, "slow": self.slow}
        return arrays

    def restore(self, arrays: Mapping[str, Array]) -> ArmInputs:
        """The same inputs with the values of `arrays`; a model without a friction state has none."""
        inputs = replace(self, stick_velocity=np.asarray(arrays["stick_velocity"], dtype=float))
        if "friction_velocity" in arrays:  # of models of an earlier version
            v0 = np.asarray(arrays["friction_velocity"], dtype=float)
            inputs = replace(inputs, friction_velocity=v0)
        if "play" not in arrays:
            return replace(inputs, presliding=None, play=None, slow=None)
        length, play, slow = (np.asarray(arrays[n], dtype=float) for n in ("presliding", "play", "slow"))
        return replace(inputs, presliding=length, play=play, slow=slow)

    def c(self, name: str) -> Code:
        """C99 of the map, with its memory."""
        from etude_arm.c99 import inputs_code

        return inputs_code(name, self)

    def onnx(self) -> Piece:
        """ONNX operators of the map, with its memory."""
        from etude_arm.onnx import inputs_piece

        return inputs_piece(self)

    @property
    def _memory(self) -> Channel:
        parts = self.channels[self.names[0]].parts
        return Channel(MEMORY, parts, ("1",) * len(parts))

    def _sigma(self, q: Array) -> Array:
        """Friction state (T, J) along positions q (T, J) from an unknown past; zeros without one."""
        if self.presliding is None or self.play is None:
            return np.zeros(q.shape)
        return remembered(q, self.play, self.presliding)[:, 0]

    def _columns(self, q: Array, qd: Array, qdd: Array, sigma: Array) -> Array:
        shape = (len(q), len(self.stick_velocity))
        for name, values in zip(self.names, (q, qd, qdd), strict=True):
            if values.shape != shape:
                raise UsageError(f"{name} has shape {values.shape}, not {shape}", where="inputs of the model")
        friction = [np.tanh(qd / threshold) for threshold in self.thresholds]
        if self.slow is not None:
            standstill = np.exp(-np.abs(qd) / self.slow)
            friction += [sigma * standstill, standstill]
        return np.concatenate([q, qd, qdd, *friction], axis=1)

    def _columns_vjp(self, qd: Array, in_X: Array, sigma: Array) -> tuple[Array, Array]:
        """Gradient (3, T, J) of sum(in_X * X) in q, qd and qdd with sigma held fixed, and that in sigma."""
        scales = len(self.thresholds)
        blocks = np.stack(np.split(in_X, ORDERS + scales + (0 if self.slow is None else 2), axis=1))
        gradient, on_sigma = blocks[:ORDERS].copy(), np.zeros(qd.shape)
        for block, threshold in zip(blocks[ORDERS : ORDERS + scales], self.thresholds, strict=True):
            gradient[1] += block * ((1.0 - np.tanh(qd / threshold) ** 2) / threshold)
        if self.slow is not None:
            held, rested = blocks[-2:]
            standstill = np.exp(-np.abs(qd) / self.slow)
            gradient[1] -= (held * sigma + rested) * np.sign(qd) * standstill / self.slow
            on_sigma = held * standstill
        return gradient, on_sigma

    def _memory_rates(self, q: Array, qd: Array, qdd: Array, qddd: Array) -> tuple[list[Array], list[Array]]:
        """dX/dt and d2X/dt2 of sigma e and of e, with sigma held fixed."""
        assert self.slow is not None
        sign, sigma = np.sign(qd), self._sigma(q)
        standstill = np.exp(-np.abs(qd) / self.slow)
        first = -sign * qdd * standstill / self.slow
        second = standstill * ((qdd / self.slow) ** 2 - sign * qddd / self.slow)
        return [sigma * first, first], [sigma * second, second]


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
