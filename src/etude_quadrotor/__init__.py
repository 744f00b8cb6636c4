"""Multirotors with flat dynamics: description, motions, and model inputs."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_quadrotor.config import FlightConfig
    from etude_quadrotor.controller import FlightFeedforward, GatedVoltages, flight_plan, leaning
    from etude_quadrotor.export.offboard import NED, OFFBOARD
    from etude_quadrotor.export.poly4d import POLY4D
    from etude_quadrotor.flatness import Drag
    from etude_quadrotor.inputs import QuadrotorInputs
    from etude_quadrotor.kind import KIND
    from etude_quadrotor.motions import flight_family
    from etude_quadrotor.physics.vehicle_inverse import nominal_inverse
    from etude_quadrotor.plant.robot import SimulatedFlights
    from etude_quadrotor.plant.simulated_vehicle import Disturbance, Start
    from etude_quadrotor.preprocessing import common_lag
    from etude_quadrotor.recorder import on_even_grid, with_states
    from etude_quadrotor.spec import QuadrotorSpec

__all__ = [
    "KIND",
    "NED",
    "OFFBOARD",
    "POLY4D",
    "Disturbance",
    "Drag",
    "FlightConfig",
    "FlightFeedforward",
    "GatedVoltages",
    "QuadrotorInputs",
    "QuadrotorSpec",
    "SimulatedFlights",
    "Start",
    "common_lag",
    "flight_family",
    "flight_plan",
    "leaning",
    "nominal_inverse",
    "on_even_grid",
    "with_states",
]
__getattr__, __dir__ = face(__name__)
