"""Feedforward of a flight, computed before take-off from the plan alone.

It has three optional parts: the reference's acceleration, a lean against the drag, and the voltage from an
inverse model. The feedback itself commands voltages. So the last part is the planned voltage less the voltage
of the controller's own map for the planned thrust.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from etude._runtime.rounding import whole_down
from etude.errors import DataError, NumericalError
from etude.models.trust import training_range_weight, trusted
from etude.protocols import Controller, Model, Trajectory
from etude.types import Array, Log, Motion, Row
from etude_quadrotor.channels import BATTERY, STATES
from etude_quadrotor.flatness import ORDERS, Drag, FlatMotion, flat_motion
from etude_quadrotor.inputs import QuadrotorInputs
from etude_quadrotor.physics.vehicle_inverse import nominal_inverse
from etude_quadrotor.plant.flight_plan import FlightPlan, plan_on_grid
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import Vehicle

GRID = 100.0
"""Hz at which models are asked; between, feedforwards are linear."""


LARGEST_CORRECTION = 0.5
"""V: largest difference of a learned voltage from the analytic one; larger ones have always been
extrapolation errors.
"""


class Voltages(Protocol):
    """An inverse model for a feedforward."""

    def predict(self, log: Log) -> Array:
        """Commands (T, n)."""
        ...


class LateralDrag(Protocol):
    """Drag as a function of the body's velocity."""

    @property
    def coefficients(self) -> Drag: ...

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """Force per mass along body x and y (T, 2), and its variance."""
        ...


@dataclass(frozen=True)
class LinearDrag:
    """Known coefficients (dx, dy, dz), 1/s: exact drag of a simulated vehicle, or none."""

    coefficients: Drag = (0.0, 0.0, 0.0)

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """-d v (T, 2), without variance."""
        force = -velocity[:, :2] * np.array(self.coefficients[:2])
        return force, np.zeros_like(force)


@runtime_checkable
class Ranged(Protocol):
    """A `Model` with the ranges (2, D) of its training inputs; also tells whether it is calibrated."""

    @property
    def calibrated(self) -> bool: ...
    @property
    def ranges(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class GatedVoltages:
    """Voltages of a learned model where it is certain, and of the analytic model elsewhere, with a bounded
    difference.

    The learned model's deviation is its weight. A model that too few flights have calibrated counts only
    within its training ranges.

    Attributes:
        model: learned.
        analytic: for comparison.
        limit: largest difference, V.
    """

    model: Model
    analytic: Voltages
    limit: float = LARGEST_CORRECTION

    def predict(self, log: Log) -> Array:
        """Voltages (T, n)."""
        safe = self.analytic.predict(log)
        mean, variance = self.model.posterior(log)
        near = safe + np.clip(mean - safe, -self.limit, self.limit)
        voltages = trusted(near, variance, prior_deviation(self.model), safe)
        model = self.model
        if isinstance(model, Ranged) and not model.calibrated:
            range_weight = training_range_weight(model.inputs.of_log(log), model.ranges)
            voltages = safe + range_weight[:, None] * (voltages - safe)
        return voltages


def prior_deviation(model: Model) -> Array:
    """Prior deviation (n,) of the learned part of each command, in its unit.

    A command with physics alone has the deviation of an additional process, which still shows where the
    vehicle has been. Without any process it is infinite, so that nothing fades.
    """
    count = 1 + max(c for candidate in model.candidates for c in candidate.commands)
    deviation, best = np.full(count, np.inf), np.full(count, -1.0)
    chosen = {
        c: one.structure
        for one in model.candidates
        for c, w in zip(one.commands, one.weights, strict=True)
        if w > 0.0
    }
    for candidate in model.candidates:
        if candidate.process is None:
            continue
        prior = candidate.process.signal_variance + candidate.process.noise_variance
        for place, command in enumerate(candidate.commands):
            weight = float(candidate.weights[place])
            if weight == 0.0:  # of the structures that are not used, those with the same physics come first
                weight = -0.5 * float(candidate.structure != f"{chosen.get(command, '')}+gp")
            if weight > best[command]:
                best[command] = weight
                deviation[command] = abs(candidate.units[1, place]) * np.sqrt(prior[place])
    return deviation


@dataclass(frozen=True, eq=False)
class FlightFeedforward:
    """The feedforward. Implements `protocols.Controller`.

    Attributes:
        acceleration: whether it contains the reference's acceleration.
        drag: compensated by the lean; None for the thesis's drag-free attitude.
        voltages: planned, gated and clipped; or None.
    """

    acceleration: bool = True
    drag: LateralDrag | None = None
    voltages: Voltages | None = None

    def flat(self, motion: Motion) -> FlatMotion:
        """The motion as flown, with the lean against the drag. UnsafeTrajectoryError: it is singular."""
        return flat_motion(motion, (self.drag or LinearDrag()).coefficients)

    def planned(self, motion: Motion) -> Array | None:
        """Voltages (T, n) of the plan; None if the feedback gives them alone."""
        return None if self.voltages is None else self.voltages.predict(states_of(self.flat(motion)))

    def accelerated(self, flat: FlatMotion) -> Array | None:
        """Acceleration (T, 3) m/s^2 added to the feedback's, world frame; None without one."""
        if not self.acceleration:
            return None
        force, _ = (self.drag or LinearDrag()).predict(flat.states["body_velocity"])
        lean = -np.einsum("tij,tj->ti", flat.R_world_body[:, :, :2], force)
        return np.asarray(flat.motion.orders[2] + lean)

    def accelerations(self, motion: Motion) -> Array | None:
        """Feedforward acceleration (T, 3) m/s^2, world frame: the reference's own and the compensation of the
        drag.

        None without a known drag. UnsafeTrajectoryError: the motion is singular.
        """
        return None if self.drag is None else self.accelerated(self.flat(motion))

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """Voltages (n,) in a measured state, without their deviation.

        Raises:
            DataError: this feedforward has no voltages.
        """
        if self.voltages is None:
            raise DataError(
                "this feedforward has no command of the motors: of a vehicle without description, only "
                "accelerations are planned",
                next_step="Describe it under [vehicle] in robot.toml, or export the model itself: --to c.",
            )
        channels = {c.name: c for c in (*STATES, BATTERY) if c.name in row}
        log = Log(np.array([t]), channels, {name: np.atleast_2d(row[name]) for name in channels})
        voltages = self.voltages.predict(log)[0]
        return voltages, np.full(len(voltages), np.nan)

    def observe(self, t: float, row: Row) -> None:
        """Does nothing: this controller does not learn in flight."""


PID_ALONE = FlightFeedforward(acceleration=False)


@dataclass(frozen=True, eq=False)
class PlannedBy:
    """The plan of any controller as `Voltages`."""

    commands: Array

    def predict(self, log: Log) -> Array:  # noqa: ARG002
        """The planned commands (T, n)."""
        return self.commands


def flight_plan(
    trajectory: Trajectory, controller: Controller | None, vehicle: Vehicle, rate: float
) -> FlightPlan:
    """The plan of a flight on the control grid, with its feedforward.

    Args:
        trajectory: a Fourier flight.
        controller: a feedforward; None for feedback alone. The plan of another kind of controller is used as
            voltages, beside the reference's acceleration.
        vehicle: nominal body and motors of the controller's own map.
        rate: of the control, Hz.

    Raises:
        UnsafeTrajectoryError: the plan is singular (see `flat_motion`).
        NumericalError: a planned feedforward is not finite.
    """
    count = whole_down(trajectory.duration * GRID) + 1
    times = np.minimum(np.arange(count) / GRID, trajectory.duration)
    motion = trajectory.motion(times, ORDERS)
    feedforward = _feedforward(controller, motion)
    flat = feedforward.flat(motion)
    acceleration = feedforward.accelerated(flat)
    voltage = None
    if feedforward.voltages is not None:
        nominal_voltage = thrust_voltage(vehicle, flat.thrust)[:, None]
        voltage = feedforward.voltages.predict(states_of(flat)) - nominal_voltage
    for name, rows in (("acceleration", acceleration), ("voltage", voltage)):
        if rows is not None and not np.isfinite(rows).all():
            raise NumericalError(f"the planned {name} is not finite", next_step="Train the model again.")
    return plan_on_grid(times, motion.orders[0], motion.orders[1], acceleration, voltage, rate)


def _feedforward(controller: Controller | None, motion: Motion) -> FlightFeedforward:
    if controller is None:
        return PID_ALONE
    if isinstance(controller, FlightFeedforward):
        return controller
    planned = controller.planned(motion)
    return FlightFeedforward(voltages=None if planned is None else PlannedBy(planned))


def states_of(flat: FlatMotion) -> Log:
    """The planned states as a log."""
    channels = {channel.name: channel for channel in STATES}
    return Log(flat.motion.t, channels, {name: flat.states[name] for name in channels}, "planned")


def thrust_voltage(vehicle: Vehicle, thrust: Array) -> Array:
    """Voltage (T,) at which equal steady motors give a thrust per mass (T,), m/s^2."""
    speed = np.sqrt(np.maximum(vehicle.mass * thrust / (len(vehicle.spins) * vehicle.thrust_constant), 0.0))
    return np.asarray(vehicle.steady_voltage(speed))


def learned(spec: QuadrotorSpec, model: Model) -> FlightFeedforward:
    """Feedforward of acceleration, learned drag, and the model's gated voltages.

    Without voltages for a vehicle that is commanded by attitude and thrust, or whose motors are not
    described.
    """
    inputs = model.inputs
    drag = inputs.lateral if isinstance(inputs, QuadrotorInputs) else None
    if spec.body is None:
        return FlightFeedforward(drag=drag)
    return FlightFeedforward(drag=drag, voltages=GatedVoltages(model, nominal_inverse(spec.body)))


def leaning(model: Model) -> FlightFeedforward:
    """Feedforward of acceleration and learned drag; the feedback gives the voltages, so that they stay
    informative.
    """
    inputs = model.inputs
    return FlightFeedforward(drag=inputs.lateral if isinstance(inputs, QuadrotorInputs) else None)


def baselines(spec: QuadrotorSpec) -> Mapping[str, Controller | None]:
    """Feedforwards without learning, and the exact drag of a simulated vehicle."""
    nominal = None if spec.body is None else nominal_inverse(spec.body)
    controllers: dict[str, Controller | None] = {"pid": None, "analytic": FlightFeedforward(voltages=nominal)}
    if spec.plant is not None:
        from etude_quadrotor.plant.simulated_vehicle import simulated_vehicle

        dx, dy, dz = simulated_vehicle(spec.plant).parameters.drag_per_mass.tolist()
        controllers["exact_drag"] = FlightFeedforward(drag=LinearDrag((dx, dy, dz)), voltages=nominal)
    return controllers
