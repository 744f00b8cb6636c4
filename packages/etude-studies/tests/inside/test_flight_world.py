"""A vehicle as the studies fly it: the noise asked for, the room asked for, each structure's own tails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude_studies.flight_world import THESIS_ROOM, Flights, models_by_rung


def test_flights_are_of_the_vehicle_asked_for() -> None:
    flights = Flights.of("quadrotor_rough", "low", room=THESIS_ROOM, start="hover", harmonics=3)
    assert (flights.robot.vehicle.noise, flights.robot.start) == ("low", "hover")
    assert flights.robot.vehicle.name == "quadrotor_rough"
    assert flights.family.size == 3 * 2 * 3 + 1  # the constant terms of x and y are fixed
    (flight,) = flights.drawn(np.random.default_rng(0), 1, "boundary")
    position = flight.motion(np.linspace(0.0, flight.duration, 2001), 1).orders[0]
    lower, upper = np.array([-9.5, -9.5, 0.8]), np.array([9.5, 9.5, 4.5])
    assert np.all((position >= lower) & (position <= upper))


def test_each_rung_has_the_tails_of_its_own_errors() -> None:
    flights, rng = Flights.of("quadrotor", "low"), np.random.default_rng(0)
    samples = flights.world.samples(*flights.flown(flights.drawn(rng, 2), rng))
    config = replace(flights.world.config.model, replace="chance")  # one structure for all
    selection = flights.world.learned(samples, config, rng)
    found = models_by_rung(selection)
    assert set(found) == set(selection.model.structures) >= {"gp", "identified", "nominal", "linear"}
    for rung, model in found.items():
        assert model.chosen == (rung,) * 4
        assert model.student is not None
    (common,) = set(selection.chosen)
    assert found[common].student == selection.model.student
    assert found["gp"].student != found["linear"].student
