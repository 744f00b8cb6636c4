from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feasible_examples import FAMILIES, ROOMS, room

from etude.errors import UnsafeTrajectoryError
from etude.trajectories.flight.certificate import certify_flight, require_flight_certified
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.limits import check_flight_room, check_start
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import SAMPLERS, uniform_parameters

EVERY_ROOM = pytest.mark.parametrize("spec", ROOMS.values(), ids=ROOMS.keys())
EVERY_FAMILY = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())


@EVERY_ROOM
@EVERY_FAMILY
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_every_sampled_flight_is_certified_and_can_be_flown(spec, family: FlightFamily, sampler: str) -> None:
    rng, feasible = np.random.default_rng(0), feasible_flights(spec, family)
    for chosen in SAMPLERS[sampler](rng, feasible, 4):
        assert feasible.contains(chosen)
        trajectory = family.trajectory(chosen)
        certificate = require_flight_certified(trajectory, spec, rest=family.rest)
        flat_motion(motion_of(trajectory, np.linspace(0.0, family.duration, 200)))
        if sampler == "boundary":
            # no more than the samples' share is given away, but for tilt: there, climbing counts as falling
            assert certificate.worst.use > (0.99 if spec.tilt is None else 0.85)
            assert not feasible.contains(feasible.centre + 1.001 * (chosen - feasible.centre))


@EVERY_ROOM
@EVERY_FAMILY
def test_the_set_is_convex(spec, family: FlightFamily) -> None:
    rng, feasible = np.random.default_rng(1), feasible_flights(spec, family)
    points = SAMPLERS["boundary"](rng, feasible, 10)
    for one, other in zip(points[:5], points[5:], strict=True):
        assert feasible.contains(rng.uniform() * (one - other) + other)


def test_the_same_seed_draws_the_same_flights_and_many_together_are_many_alone() -> None:
    feasible = feasible_flights(ROOMS["box"], FAMILIES["thesis"])
    for sampler in SAMPLERS.values():
        one, again = (sampler(np.random.default_rng(5), feasible, 3) for _ in range(2))
        np.testing.assert_array_equal(one, again)
        assert len({tuple(row) for row in one}) == 3


def test_uniform_flights_are_faster_than_timid_ones() -> None:
    """In the thesis's room timid flights make 1.0 m/s on average, uniform ones 1.8."""
    feasible, family = feasible_flights(room(), FlightFamily()), FlightFamily()
    t = np.linspace(0.0, 30.0, 100)
    speeds = {}
    for name, sampler in SAMPLERS.items():
        flights = [
            motion_of(family.trajectory(p), t) for p in sampler(np.random.default_rng(6), feasible, 60)
        ]
        speeds[name] = np.mean([np.linalg.norm(flight.velocity, axis=1).mean() for flight in flights])
    assert speeds["scaled"] == pytest.approx(1.0, abs=0.15)
    assert speeds["uniform"] == pytest.approx(1.85, abs=0.2)
    assert speeds["scaled"] < 0.7 * speeds["boundary"] < speeds["uniform"]


def test_the_walk_has_forgotten_its_start() -> None:
    """More steps change no quartile of the distance from the centre by more than sampling does."""
    feasible = feasible_flights(ROOMS["box"], FAMILIES["thesis"])
    uses = []
    for steps in (200, 300):
        points = uniform_parameters(np.random.default_rng(steps), feasible, 100, steps)
        ends = feasible.chord(np.tile(feasible.centre, (100, 1)), points - feasible.centre)[1]
        uses.append(np.quantile(1.0 / ends, [0.25, 0.5, 0.75]))
    np.testing.assert_allclose(uses[0], uses[1], atol=0.04)


def test_room_in_a_cylinder_off_the_middle_of_its_box() -> None:
    spec = room(lower=(0.0, -5.0, 0.0), upper=(10.0, 5.0, 5.0), radius=3.0)
    with pytest.raises(UnsafeTrajectoryError, match="no room"):
        feasible_flights(spec, FlightFamily())
    family = FlightFamily(free_centre=True)
    feasible = feasible_flights(spec, family)
    x, y = family.coefficients(feasible.centre)[0, :2]
    assert 0.5 < x < 2.5
    assert y == 0.0
    require_flight_certified(
        family.trajectory(uniform_parameters(np.random.default_rng(0), feasible)[0]), spec
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"margin": 2.4}, r"box is 4\.7 m wide in z, not more than two margins of 2\.4 m"),
        ({"lower": (-10.0, 12.0, 0.3)}, "wide in y"),
        ({"lower": (-10.0, float("nan"), 0.3)}, "wide in y"),
        ({"radius": 0.5}, "radius 0.5 m is not above the margin"),
        ({"speed": 0.0}, "no flight meets a speed limit of 0 m/s"),
        ({"speed": -1.0}, "speed limit of -1"),
        ({"speed": float("nan")}, "speed limit of nan"),
        ({"tilt": 0.0}, "tilt limit of 0"),
        ({"tilt": 1.6}, "tilt limit"),
        ({"thrust": (10.0, 12.0)}, "cannot hover"),
        ({"thrust": (5.0, 9.0)}, "cannot hover"),
        ({"margin": -0.1}, "margin must be"),
    ],
)
def test_limits_that_no_flight_meets(changes, message: str) -> None:
    with pytest.raises(UnsafeTrajectoryError, match=message) as caught:
        feasible_flights(room(**changes), FlightFamily())
    assert caught.value.exit_code == 4
    with pytest.raises(UnsafeTrajectoryError):
        check_flight_room(room(**changes))


def test_a_family_centred_outside() -> None:
    with pytest.raises(UnsafeTrajectoryError, match="no room") as caught:
        feasible_flights(room(), FlightFamily(centre=(9.8, 0.0)))
    assert caught.value.where == "x"


def test_a_start_outside() -> None:
    check_start(ROOMS["cylinder"], np.array([1.0, 1.0, 1.0]))
    with pytest.raises(UnsafeTrajectoryError, match=r"start at z = 0\.1 m, outside 0\.3\.\.2\.3 m"):
        check_start(ROOMS["cylinder"], np.array([0.0, 0.0, 0.1]))
    with pytest.raises(UnsafeTrajectoryError, match=r"1\.69706 m from the axis"):
        check_start(ROOMS["cylinder"], np.array([1.2, 1.2, 1.0]))
    with pytest.raises(UnsafeTrajectoryError, match="x = nan"):
        check_start(ROOMS["box"], np.array([np.nan, 0.0, 1.0]))


def test_tighter_limits_make_a_smaller_set() -> None:
    wide, narrow = (
        feasible_flights(s, FlightFamily()) for s in (room(), replace(room(), margin=1.0, speed=3.0))
    )
    for chosen in uniform_parameters(np.random.default_rng(2), narrow, 5):
        assert wide.contains(chosen)
        assert certify_flight(FlightFamily().trajectory(chosen), room()).ok
