"""Which simulated vehicles there are: one row each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.plants.flight.simulated import SimulatedVehicle


def from_data_file(name: str) -> SimulatedVehicle:
    """The vehicle of `plants/data/NAME.toml`."""
    from etude.plants.flight.parameters import load_flight_parameters
    from etude.plants.flight.simulated import SimulatedVehicle

    parameters = load_flight_parameters(name)
    return SimulatedVehicle(name, parameters, parameters.nominal)


# plant name -> name -> vehicle
FLIGHT_PLANTS: dict[str, Callable[[str], SimulatedVehicle]] = {
    "quadrotor": from_data_file,
    "quadrotor_rough": from_data_file,
    "pelican": from_data_file,
}


def flight_plant(name: str) -> SimulatedVehicle:
    """The simulated vehicle `name`, one of FLIGHT_PLANTS; another noise: `dataclasses.replace(v, noise=...)`.

    Raises:
        UsageError: unknown name.
    """
    if name not in FLIGHT_PLANTS:
        raise UsageError(
            f"there is no simulated vehicle {name!r}", next_step=f"Choose one of: {', '.join(FLIGHT_PLANTS)}."
        )
    return FLIGHT_PLANTS[name](name)
