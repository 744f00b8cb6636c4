"""Feedback loop: a simulated arm with feedback control follows a trajectory and returns a Log."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from etude._runtime.rounding import MEASURED, whole_up
from etude.errors import DataError, UsageError
from etude.protocols import Controller, Trajectory
from etude.types import Array, Log, Motion
from etude_arm.plant.trace import LoopInputs, Running, Trace
from etude_arm.spec import COMMAND, ORDERS, PATH, PLAN, ArmSpec

SHARE = "% of range"
SENSOR = "sensor_"
CHANGES = ("payload", "friction")
FEEDFORWARD, FEEDBACK, TRUE = "command_ff", "command_fb", "q_true"


@dataclass(frozen=True, eq=False)
class LedIn:
    """The whole run.

    Attributes:
        t: (T,) s, below 0 during the lead-in.
        orders: (3, T, J) desired motion; feedforward, noise: (T, J), of commands and of the encoder.
        fixed: whether the feedforward is known ahead.
    """

    t: Array
    orders: Array
    feedforward: Array
    noise: Array
    fixed: bool

    def inputs(self, substeps: int) -> LoopInputs:
        """The run as inputs of an engine."""
        q, qd, qdd = self.orders
        return LoopInputs(q, qd, self.feedforward, self.noise, substeps, qdd)

    def row(self, k: int) -> dict[str, Array]:
        """The row of a perfect run at tick k, with the plan."""
        return {name: self.orders[i % ORDERS, k] for i, name in enumerate((*PATH, *PLAN))}


def led_in(
    motion: Motion,
    feedforward: Array | None,
    held: int,
    rate: float,
    deviation: float | Array,
    rng: np.random.Generator | None,
) -> LedIn:
    """The motion after `held` ticks at rest in its first position, with the first row of its feedforward.

    Args:
        motion: three orders at the control ticks.
        feedforward: (T, J), None if it is not known ahead.
        rate: Hz.
        deviation, rng: of the encoder's noise, rad (J,) or for all; None for no noise.
    """
    still = np.stack([motion.orders[0, 0], *np.zeros((2, motion.orders.shape[2]))])
    rows = np.concatenate([np.repeat(still[:, None], held, axis=1), motion.orders[:ORDERS]], axis=1)
    ff = np.zeros_like(motion.orders[0]) if feedforward is None else feedforward
    ff = np.concatenate([np.repeat(ff[:1], held, axis=0), ff]).astype(np.float64)
    return LedIn(
        t=np.concatenate([motion.t[0] - np.arange(held, 0, -1) / rate, motion.t]),
        orders=np.ascontiguousarray(rows),
        feedforward=ff,
        noise=np.zeros_like(ff) if rng is None else rng.normal(0.0, deviation, ff.shape),
        fixed=feedforward is not None,
    )


def control_times(duration: float, rate: float) -> Array:
    """Control ticks (T,) in [0, duration), s: 6000 of them in 60 s at 100 Hz."""
    if not 0.0 < duration < math.inf:
        raise UsageError(f"the trajectory lasts {duration} s", next_step="Give it a positive duration.")
    ticks: Array = np.arange(whole_up(duration * rate, MEASURED)) / rate
    return ticks


class Following(ABC):
    """Common part of the simulated arms (implements `protocols.Robot`).

    A controller without a planned feedforward is called at every tick (`asks_each_tick`).

    Attributes:
        name: the plant's name.
        spec: description by its owner.
        lead_in: s at rest in the first desired position before t = 0, kept in the log.
        sensor: (J,) offset of the logged command, command units; (): none.
    """

    name: str
    spec: ArmSpec
    lead_in: float
    sensor: tuple[float, ...]
    asks_each_tick: ClassVar[bool] = True

    @property
    @abstractmethod
    def physics(self) -> Any:
        """What `Running.change` takes."""

    @property
    @abstractmethod
    def substeps(self) -> int:
        """Physics steps per control tick."""

    @property
    @abstractmethod
    def deviation(self) -> float | Array:
        """Of the encoder's noise, rad (m)."""

    @abstractmethod
    def whole(self, inputs: LoopInputs) -> Trace:
        """A run whose feedforward is known ahead, from rest at its first desired position."""

    @abstractmethod
    def begin(self, q: Array) -> Running:
        """A run from rest at q (J,), to be advanced tick by tick."""

    @abstractmethod
    def altered(self, name: str, value: float) -> Self:
        """The robot with that change of its physics, one of `CHANGES`. UsageError: the change is
        impossible.
        """

    @abstractmethod
    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The exact inverse model: the command (T, J) that produces this motion (T, J each).

        Friction is at its steady state for the given velocity, with sign(0) = 0, so the command of a joint at
        rest is uncertain by its static friction.
        """

    def inverse_along(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The same for consecutive rows from rest, if the friction model has memory; otherwise with steady
        friction.
        """
        return self.inverse(q, qd, qdd)

    def run(
        self,
        trajectory: Trajectory,
        controller: Controller | None,
        rng: np.random.Generator | None,
        changes: Mapping[float, Following] | None = None,
    ) -> Log:
        """Follows the trajectory by PD control and what the controller adds.

        Args:
            trajectory: of as many axes.
            controller: None for feedback alone. What it plans is held at its first row during the lead-in.
                One without a planned feedforward is called at every tick, with the row of a perfect run;
                `observe` then gets the measured row.
            rng: of the encoder noise, the same for every engine; None for an encoder without noise.
            changes: time in s -> the robot whose physics apply from then on.

        Raises:
            UsageError: other axes, values that are not finite, or an engine that cannot go tick by tick.
        """
        motion = self.planned(trajectory)
        feedforward = None if controller is None else controller.planned(motion)
        if controller is None:
            feedforward = np.zeros_like(motion.orders[0])
        if feedforward is not None:
            self.check("the feedforward", feedforward, len(motion.t))
        held = round(self.lead_in * self.spec.rate)
        plan = led_in(motion, feedforward, held, self.spec.rate, self.deviation, rng)
        if feedforward is not None and not changes:
            return self._log(plan, plan.feedforward, self.whole(plan.inputs(self.substeps)))
        return self._tick_by_tick(plan, controller, sorted((changes or {}).items(), key=lambda item: item[0]))

    def planned(self, trajectory: Trajectory) -> Motion:
        """The trajectory at the control ticks. UsageError if this robot has other axes."""
        motion = trajectory.motion(control_times(trajectory.duration, self.spec.rate), ORDERS)
        if motion.orders.shape[2] != self.spec.dof:
            raise UsageError(
                f"the trajectory has {motion.orders.shape[2]} joints, the robot {self.spec.dof}",
                where=self.name,
                next_step=f"Its joints are {', '.join(self.spec.names)}.",
            )
        for name, rows in zip(PLAN, motion.orders, strict=True):
            self.check(name, rows, len(motion.t))
        return motion

    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]:
        """Mean |desired - actual| (J,) over t >= 0; actual is the true position if the log has it.

        Units: deg; m if all joints slide; % of each joint's range if some do, since a mean over m and deg is
        meaningless.

        Raises:
            DataError: the log has no desired positions, or nothing at t >= 0.
        """
        moving = log.t >= 0.0
        desired, actual = log.get(PLAN[0]), log.get(TRUE)
        if desired is None or not moving.any():
            raise DataError(
                "the tracking error needs desired positions at t >= 0",
                where=log.source,
                next_step="Log q_des together with q.",
            )
        actual = log[PATH[0]] if actual is None else actual
        error = np.abs(desired - actual)[moving].mean(axis=0)
        turning = np.array([axis.unit == "rad" for axis in self.spec.axes])
        if turning.any() and not turning.all():
            return 100.0 * error / (self.spec.upper - self.spec.lower), (SHARE,) * len(turning)
        return (
            (np.rad2deg(error), ("deg",) * len(turning)) if turning.all() else (error, ("m",) * len(turning))
        )

    def changed(self, **what: float) -> Self:
        """The robot with a `payload` (kg) at its tip, `friction` times a factor, or an offset of the logged
        command of a joint (`sensor_<joint>`, command units).

        Raises:
            UsageError: another change, or an impossible one.
        """
        joints = {f"{SENSOR}{name}": place for place, name in enumerate(self.spec.names)}
        robot, sensor = self, self._sensor()
        for name, value in what.items():
            if name in joints:
                sensor[joints[name]] += value
            elif name in CHANGES:
                robot = robot.altered(name, value)
            else:
                raise UsageError(
                    f"a simulated arm has no '{name}' to change",
                    next_step=f"It has {', '.join([*CHANGES, *joints])}.",
                )
        if not np.isfinite(sensor).all():
            raise UsageError("a sensor's offset must be a finite number")
        return replace(robot, sensor=tuple(sensor.tolist()))  # type: ignore[type-var]

    def _sensor(self) -> Array:
        return np.array(self.sensor or (0.0,) * self.spec.dof)

    def _tick_by_tick(
        self, plan: LedIn, controller: Controller | None, changes: list[tuple[float, Following]]
    ) -> Log:
        feedforward, traces = plan.feedforward.copy(), []
        running, inputs = self.begin(plan.orders[0, 0]), plan.inputs(self.substeps)
        feedforward_controller = controller if controller is not None and not plan.fixed else None
        for k, t in enumerate(plan.t.tolist()):
            while changes and t >= changes[0][0]:
                running.change(changes.pop(0)[1].physics)
            row = plan.row(k)
            if feedforward_controller is not None:
                feedforward[k] = np.clip(
                    feedforward_controller.command(t, row)[0], -self.spec.command, self.spec.command
                )
            trace = running.advance(inputs.tick(k, feedforward[k]))
            traces.append(trace)
            if controller is not None:
                measured = {
                    PATH[0]: trace.q[0],
                    COMMAND: trace.tau[0] + self._sensor(),
                    FEEDBACK: trace.tau_fb[0],
                }
                plans = {name: row[name] for name in PLAN}
                controller.observe(t, {**plans, **measured, FEEDFORWARD: feedforward[k]})
        return self._log(plan, feedforward, Trace.joined(traces))

    def _log(self, plan: LedIn, feedforward: Array, trace: Trace) -> Log:
        values = {
            PATH[0]: trace.q,
            **dict(zip(PLAN, plan.orders, strict=True)),
            COMMAND: trace.tau + self._sensor(),
            FEEDFORWARD: feedforward,
            FEEDBACK: trace.tau_fb,
            TRUE: trace.q_true,
        }
        channels = {c.name: c for c in self.spec.channels() if c.name in values}
        return Log(plan.t, channels, values, source=f"simulated {self.name}")

    def check(self, name: str, rows: Array, count: int) -> None:
        """UsageError unless `rows` are `count` finite rows, one column per joint."""
        if np.shape(rows) != (count, self.spec.dof) or count == 0:
            raise UsageError(
                f"{name} has shape {np.shape(rows)}, not ({max(count, 1)}, {self.spec.dof})",
                where=self.name,
                next_step=f"Give one row per time and one column per joint: {', '.join(self.spec.names)}.",
            )
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0]
            raise UsageError(
                f"{name} is {rows[row, column]}",
                where=f"{self.name}, row {row}, joint {self.spec.names[column]}",
                next_step="Every desired value and every feedforward must be a finite number.",
            )
