"""Rooms and families of flights for the tests."""

from __future__ import annotations

import math

from etude.robots.flight_spec import FlightSpec
from etude.trajectories.flight.family import FlightFamily


def room(**changes) -> FlightSpec:
    """The thesis's box, 20 x 20 x 5 m, at 6 m/s."""
    given = {
        "name": "example",
        "lower": (-10.0, -10.0, 0.3),
        "upper": (10.0, 10.0, 5.0),
        "speed": 6.0,
        "command_names": ("m1", "m2", "m3", "m4"),
        "command_unit": "V",
        "command_lower": (0.0,) * 4,
        "command_upper": (11.1,) * 4,
        "rate": 10.0,
    }
    return FlightSpec(**(given | changes))


ROOMS = {
    "box": room(),
    "slow": room(speed=2.0),
    "cylinder": room(lower=(-1.5, -1.5, 0.3), upper=(1.5, 1.5, 2.3), radius=1.5, speed=1.5, margin=0.2),
    "tilt": room(tilt=0.05),
    "all": room(speed=5.0, radius=9.0, tilt=0.3, thrust=(7.0, 11.0)),
}
FAMILIES = {
    "thesis": FlightFamily(),
    "aggressive": FlightFamily(harmonics=5),
    "rest, free centre": FlightFamily(harmonics=4, rest=True, free_centre=True, omega0=4.0 * math.pi / 30.0),
    "fast": FlightFamily(harmonics=3, omega0=1.3),
}
