"""Which simulated vehicles there are: one file of parameters each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from etude.errors import UsageError

if TYPE_CHECKING:
    from etude_quadrotor.plant.simulated_vehicle import SimulatedVehicle

PLANTS = ("quadrotor", "quadrotor_rough", "pelican")


def simulated_vehicle(name: str, where: str = "") -> SimulatedVehicle:
    """The simulated vehicle `name`, one of PLANTS; another noise: `dataclasses.replace(v, noise=...)`.

    Raises:
        UsageError: unknown name; `where` it stands is told.
    """
    from etude_quadrotor.plant.parameters import load_flight_parameters
    from etude_quadrotor.plant.simulated_vehicle import SimulatedVehicle

    if name not in PLANTS:
        raise UsageError(
            f"there is no simulated vehicle {name!r}",
            where=where,
            next_step=f"Choose one of: {', '.join(PLANTS)}.",
        )
    parameters = load_flight_parameters(name)
    return SimulatedVehicle(name, parameters, parameters.nominal)
