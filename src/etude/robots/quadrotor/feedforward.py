"""Feedforward of a flight: what is added to the feedback, computed before take-off from the plan alone.

Three parts, each optional: the reference's own acceleration; the drag, which the vehicle leans against; and
the voltage that an inverse model plans. The feedback commands voltages itself, so the last is the planned
voltage less the voltage that the controller's own map gives for the planned thrust.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from etude.control.feedforward import smoothstep, trust
from etude.errors import NumericalError
from etude.models.flight.model import FlightModel
from etude.plants.flight.plan import FlightPlan, plan_on_grid
from etude.robots.vehicle import Vehicle
from etude.trajectories.flight.flatness import Drag, FlatMotion, flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.states import FlightStates
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]

GRID = 100.0
"""Hz at which models are asked; between, feedforwards are linear."""
LARGEST_CORRECTION = 0.5
"""V by which a learned voltage may differ from the analytic one: more has always been an extrapolation."""
REACH = 0.25
"""Part of an input's range beyond which an uncalibrated model is not asked."""


class Voltages(Protocol):
    """What a feedforward asks of an inverse model."""

    def predict(self, states: FlightStates) -> Array:
        """Commands (T, 4)."""
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
    """Known coefficients (dx, dy, dz), 1/s: the exact drag of a simulated vehicle, or none."""

    coefficients: Drag = (0.0, 0.0, 0.0)

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """-d v (T, 2), without variance."""
        force = -velocity[:, :2] * np.array(self.coefficients[:2])
        return force, np.zeros_like(force)


@dataclass(frozen=True)
class FlightFeedforward:
    """What is fed forward.

    Attributes:
        acceleration: whether the reference's acceleration is.
        drag: of the lean, or None for the thesis's drag-free attitude.
        voltages: planned, gated and clipped; or None.
    """

    acceleration: bool = True
    drag: LateralDrag | None = None
    voltages: Voltages | None = None


PID_ALONE = FlightFeedforward(acceleration=False)


def flight_plan(
    trajectory: FourierTrajectory, feedforward: FlightFeedforward, vehicle: Vehicle, rate: float
) -> FlightPlan:
    """The plan of a flight on the control grid, with its feedforward.

    Args:
        trajectory: a Fourier flight.
        feedforward: its parts.
        vehicle: the nominal body and motors that the controller's own map is made of.
        rate: of the control, Hz.

    Raises:
        UnsafeTrajectoryError: the plan is singular (see `flat_motion`).
        NumericalError: a planned feedforward is not finite.
    """
    count = int(np.floor(trajectory.duration * GRID + 1e-9)) + 1
    motion = motion_of(trajectory, np.minimum(np.arange(count) / GRID, trajectory.duration))
    drag = feedforward.drag or LinearDrag()
    flat = flat_motion(motion, drag.coefficients)
    acceleration = motion.acceleration + _against(drag, flat) if feedforward.acceleration else None
    voltage = None
    if feedforward.voltages is not None:
        voltage = feedforward.voltages.predict(flat.states) - thrust_voltage(vehicle, flat.thrust)[:, None]
    for name, rows in (("acceleration", acceleration), ("voltage", voltage)):
        if rows is not None and not np.isfinite(rows).all():
            raise NumericalError(f"the planned {name} is not finite", next_step="Train the model again.")
    return plan_on_grid(motion.t, motion.position, motion.velocity, acceleration, voltage, rate)


def thrust_voltage(vehicle: Vehicle, thrust: Array) -> Array:
    """Voltage (T,) at which four equal steady motors give a thrust per mass (T,), m/s^2."""
    speed = np.sqrt(np.maximum(vehicle.mass * thrust / (4.0 * vehicle.thrust_constant), 0.0))
    return np.asarray(vehicle.steady_voltage(speed))


def _against(drag: LateralDrag, flat: FlatMotion) -> Array:
    """(T, 3) acceleration in the world frame that balances the drag."""
    assert flat.states.velocity is not None
    force, _ = drag.predict(flat.states.velocity)
    return np.asarray(-np.einsum("tij,tj->ti", flat.R_world_body[:, :, :2], force))


@dataclass(frozen=True)
class GatedVoltages:
    """A learned model's voltages where it knows better, the analytic one's elsewhere, never far from those.

    The model's own deviation says how much it is trusted. One that too few flights have calibrated is trusted
    besides only within the inputs it was trained on.

    Attributes:
        model: learned.
        analytic: what it is held against.
        limit: largest difference, V.
    """

    model: FlightModel
    analytic: Voltages
    limit: float = LARGEST_CORRECTION

    def predict(self, states: FlightStates) -> Array:
        """Voltages (T, 4)."""
        safe = self.analytic.predict(states)
        mean, variance = self.model.predict(states)
        weight = trust(variance, self.model.prior_deviation)
        if not self.model.calibrated:
            weight = weight * _familiar(self.model, states)[:, None]
        return np.asarray(safe + weight * np.clip(mean - safe, -self.limit, self.limit))


def _familiar(model: FlightModel, states: FlightStates) -> Array:
    """(T,) 1 within the ranges of the training inputs, falling to 0 over a further REACH of each range."""
    known = model.processes[0].outputs[0].X
    low, high = known.min(axis=0), known.max(axis=0)
    X = model.features.transform(states)
    beyond = np.maximum(np.maximum(low - X, X - high), 0.0) / np.maximum(high - low, np.finfo(float).tiny)
    return np.asarray(1.0 - smoothstep(np.clip(beyond.max(axis=1) / REACH, 0.0, 1.0)))
