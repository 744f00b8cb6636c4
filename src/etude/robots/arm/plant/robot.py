"""ArmRobot: a simulated arm that turns a trajectory and a controller into a Log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from etude.contracts import Array, Controller, Log, Motion, Trajectory
from etude.errors import DataError, UsageError
from etude.robots.arm.plant.changes import with_friction, with_payload
from etude.robots.arm.plant.led_in import LedIn, control_times, led_in
from etude.robots.arm.plant.parameters import ArmParameters, load_parameters, plant_names
from etude.robots.arm.plant.trace import LoopInputs, Running, Trace
from etude.robots.arm.spec import COMMAND, ORDERS, PATH, PLAN, ArmSpec

Engine = Literal["compiled", "mujoco"]
FEEDFORWARD, FEEDBACK, TRUE = "command_ff", "command_fb", "q_true"
SENSOR = "sensor_"


@dataclass(frozen=True, eq=False)
class ArmRobot:
    """A simulated arm under its own PD control (implements `contracts.Robot`).

    Attributes:
        name: the plant's name.
        spec: what its owner would know of it.
        parameters: what it is.
        engine: "compiled", or "mujoco", independent of it; they agree to 0.001 deg over a minute.
        lead_in: s at rest in the first desired position before t = 0, kept in the log.
        sensor: (J,) command units that the logged command reads too much; (): nothing.
    """

    name: str
    spec: ArmSpec
    parameters: ArmParameters
    engine: Engine = "compiled"
    lead_in: float = 2.0
    sensor: tuple[float, ...] = ()

    def run(
        self,
        trajectory: Trajectory,
        controller: Controller | None,
        rng: np.random.Generator | None,
        changes: Mapping[float, ArmRobot] | None = None,
    ) -> Log:
        """Follows the trajectory by PD control and what the controller adds.

        Args:
            trajectory: of as many axes.
            controller: None for feedback alone. What it plans is held at its first row during the lead-in.
                One that plans nothing is asked at every tick: its row holds what a perfect run would
                measure, and `observe` then gets what was measured.
            rng: of the encoder noise, the same for every engine; None for an encoder without noise.
            changes: time in s -> the robot whose physics this one has from then on.

        Raises:
            UsageError: other axes, values that are not finite, or an engine that cannot go tick by tick.
        """
        motion = self.planned(trajectory)
        feedforward = None if controller is None else controller.planned(motion)
        if controller is None:
            feedforward = np.zeros_like(motion.orders[0])
        if feedforward is not None:
            self._check("the feedforward", feedforward, len(motion.t))
        held = round(self.lead_in * self.spec.rate)
        plan = led_in(
            motion, feedforward, held, self.spec.rate, self.parameters.controller.encoder_noise, rng
        )
        if feedforward is not None and not changes:
            return self._log(plan, plan.feedforward, self._simulate(plan.inputs(self.substeps)))
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
            self._check(name, rows, len(motion.t))
        return motion

    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]:
        """Mean |desired - actual| (J,) over t >= 0, deg (m); actual is the true position if the log knows it.

        Raises:
            DataError: the log has no desired positions, or nothing at t >= 0.
        """
        moving = log.t >= 0.0
        wanted, actual = log.get(PLAN[0]), log.get(TRUE)
        if wanted is None or not moving.any():
            raise DataError(
                "the tracking error needs desired positions at t >= 0",
                where=log.source,
                next_step="Log q_des beside q.",
            )
        actual = log[PATH[0]] if actual is None else actual
        error = np.abs(wanted - actual)[moving].mean(axis=0)
        turning = np.array([axis.unit == "rad" for axis in self.spec.axes])
        return np.where(turning, np.rad2deg(error), error), tuple("deg" if t else "m" for t in turning)

    def changed(self, **what: float) -> ArmRobot:
        """The robot with `payload` (kg) at its hand, `friction` times as large, or with so much added to the
        logged command of a joint (`sensor_<joint>`, command units).

        Raises:
            UsageError: another change, or an impossible one.
        """
        made = {"payload": with_payload, "friction": with_friction}
        joints = {f"{SENSOR}{name}": place for place, name in enumerate(self.spec.names)}
        parameters, sensor = self.parameters, self._sensor()
        for name, value in what.items():
            if name in joints:
                sensor[joints[name]] += value
            elif name in made:
                parameters = made[name](parameters, value)
            else:
                raise UsageError(
                    f"a simulated arm has no '{name}' to change",
                    next_step=f"It has {', '.join([*made, *joints])}.",
                )
        if not np.isfinite(sensor).all():
            raise UsageError("a sensor's offset must be a finite number")
        return replace(self, parameters=parameters, sensor=tuple(sensor.tolist()))

    def _sensor(self) -> Array:
        return np.array(self.sensor or (0.0,) * self.spec.dof)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The exact inverse model: the command (T, J) that keeps up this motion (T, J each).

        Friction is at its steady state for the given velocity, with sign(0) = 0, so a joint at rest is
        described only up to its static friction.
        """
        from etude.robots.arm.plant.compiled import inverse

        for name, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
            self._check(name, rows, len(q))
        return inverse(self.parameters, q, qd, qdd)

    @property
    def substeps(self) -> int:
        """Physics steps per control tick."""
        return round(1.0 / (self.spec.rate * self.parameters.timestep))

    def _simulate(self, inputs: LoopInputs) -> Trace:
        """One engine's closed loop; its heavy package is imported only when chosen."""
        if self.engine == "mujoco":
            from etude.robots.arm.plant.mujoco_engine import simulate as simulate_in_mujoco

            return simulate_in_mujoco(self.parameters, inputs)
        from etude.robots.arm.plant.compiled import simulate

        return simulate(self.parameters, inputs)

    def _tick_by_tick(
        self, plan: LedIn, controller: Controller | None, changes: list[tuple[float, ArmRobot]]
    ) -> Log:
        feedforward, traces = plan.feedforward.copy(), []
        running, inputs = self._begin(plan.orders[0, 0]), plan.inputs(self.substeps)
        asked = controller if controller is not None and not plan.fixed else None
        for k, t in enumerate(plan.t.tolist()):
            while changes and t >= changes[0][0]:
                running.change(changes.pop(0)[1].parameters)
            row = plan.row(k)
            if asked is not None:
                feedforward[k] = np.clip(asked.command(t, row)[0], -self.spec.command, self.spec.command)
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

    def _begin(self, q: Array) -> Running:
        if self.engine != "compiled":
            raise UsageError(
                "this engine runs a trajectory as a whole only", where=self.name, next_step='Use "compiled".'
            )
        from etude.robots.arm.plant.running import RunningArm

        return RunningArm(self.parameters, q)

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

    def _check(self, name: str, rows: Array, count: int) -> None:
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


def simulated_robot(name: str, spec: ArmSpec, engine: Engine = "compiled") -> ArmRobot:
    """The arm whose parameters are `plant/data/NAME.toml`, as `spec` describes it to its owner.

    Raises:
        UsageError: unknown plant or engine, other joints, or a rate that the physics cannot keep.
    """
    if name not in plant_names():
        raise UsageError(
            f"there is no simulated robot {name!r}", next_step=f"Choose one of: {', '.join(plant_names())}."
        )
    if engine not in ("compiled", "mujoco"):
        raise UsageError(f"there is no engine {engine!r}", next_step="Choose one of: mujoco, compiled.")
    parameters = load_parameters(name)
    _check_spec(name, spec, parameters)
    return ArmRobot(name, spec, parameters, engine)


def _check_spec(name: str, spec: ArmSpec, arm: ArmParameters) -> None:
    joints = tuple(motor.joint for motor in arm.motors)
    if spec.names != joints:
        raise UsageError(
            f"the robot's joints {', '.join(spec.names)} are not those of the plant {name}",
            where=spec.name,
            next_step=f"Name them {', '.join(joints)}, in this order.",
        )
    steps = 1.0 / (spec.rate * arm.timestep)
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise UsageError(
            f"a control rate of {spec.rate:g} Hz is no multiple of the plant's time step {arm.timestep:g} s",
            where=spec.name,
            next_step="Choose a rate such as 100 Hz.",
        )
