"""The driver `px4` over a stand-in that speaks MAVLink: in virtual time, and over UDP in real time."""

from __future__ import annotations

import math
import socket

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the driver px4 needs pymavlink")

from px4_stand_in import HOLD, LAND, POSITION, OverUdp, StandIn, Wire
from vehicle_flights import AXES, go, through

from etude.drivers import (
    Bounds,
    Ended,
    PlannedMotion,
    Reaction,
    Recording,
    Sample,
    Streamed,
    Supervisor,
    find_driver,
    read_recording,
    write_recording,
)
from etude.errors import UsageError
from etude.testing import DriverSuite
from etude_drivers import Px4Vehicle

START = np.array([0.4, 0.2, 1.1])
"""Of the stand-in: east, north, up."""


def vehicle(own: StandIn, **settings: object) -> Px4Vehicle:
    return Px4Vehicle(AXES, "stand-in", settings, lambda _: Wire(own), virtual=True)


def motion(start: np.ndarray = START) -> PlannedMotion:
    return through(start, start + np.array([0.3, -0.2, 0.1]), start)


def flown(own: StandIn, watch=go, **settings: object) -> Recording:
    with Streamed(vehicle(own, **settings)) as player:
        return player.play(motion(), watch, "feedback")


class TestPx4Vehicle(DriverSuite):
    joints = AXES
    way = 0.15

    def driver(self) -> Px4Vehicle:
        return vehicle(StandIn())


def test_set_points_go_north_east_down_and_places_come_back() -> None:
    own = StandIn()
    with Streamed(vehicle(own)) as player:
        np.testing.assert_allclose(player.where().q, START, atol=1e-6)
        player.play(motion(), lambda s: Reaction.STOP if (s.at or 0) > 0.7 else Reaction.GO, "feedback")
    north, east, down = own.place
    assert east > 0.45
    assert north < 0.15
    assert down < -1.12


def test_the_learned_drag_is_in_the_acceleration_set_point_and_ends_at_rest() -> None:
    own, speed = StandIn(), np.array([0.4, 0.2, -0.1])
    with vehicle(own) as driver:
        driver.ready("learned")
        for qd, told in ((speed, [1.3, 2.4, 2.5]), (np.zeros(3), [1.0, 2.0, 3.0])):
            driver.send(START, qd, np.array([1.0, 2.0, 3.0]), np.array([0.3, 0.4, -0.5]))
            north, east, down = own.asked[6:]
            assert [east, north, -down] == pytest.approx(told)


def test_what_a_vehicle_learns_from_is_recorded_in_its_frames(tmp_path) -> None:
    recording = flown(StandIn(), motors=["a", "b", "c", "d"])
    assert recording.ended is Ended.DONE
    write_recording(tmp_path / "r.parquet", recording)
    beside = read_recording(tmp_path / "r.parquet").extra
    found = {name: values[-1] for name, values in beside.items()}
    expected = {f"command_{name}": x for name, x in zip("abcd", (0.4, 0.5, 0.6, 0.7), strict=True)}
    expected |= {"specific_force_x": 0.1, "specific_force_y": -0.2, "specific_force_z": 9.8}
    expected |= {"rates_x": 0.01, "rates_y": -0.02, "rates_z": -0.03, "battery_voltage_pack": 15.8}
    expected |= {"orientation_w": 1.0, "orientation_x": 0.0, "orientation_y": 0.0, "orientation_z": 0.0}
    assert sorted(found) == sorted(expected)
    for name, value in expected.items():
        assert abs(abs(found[name]) - abs(value)) < 1e-5, name
        assert name.startswith("orientation") or found[name] * value >= 0.0, name


def test_it_arms_in_offboard_mode_and_lands_what_it_has_armed() -> None:
    own = StandIn()
    with Streamed(vehicle(own)) as player:
        assert player.play(motion(), go, "feedback").ended is Ended.DONE
        assert own.armed
        assert own.mode == HOLD
    assert own.mode == LAND
    flying = StandIn()
    flying.armed = True
    flown(flying)
    assert flying.mode == HOLD, "a vehicle that flew before is left hovering"


@pytest.mark.parametrize(
    ("own", "says"),
    [
        (StandIn(refuses="Preflight Fail: no position"), "PX4 refuses to arm (Preflight Fail: no position)"),
        (StandIn(charge=20), "the battery has 20% left, and 30% are asked for"),
        (StandIn(yaw=0.0), "it looks 90 degrees away from the x axis"),
    ],
)
def test_a_refused_start_moves_nothing_and_says_why(own: StandIn, says: str) -> None:
    recording = flown(own)
    assert recording.ended is Ended.REFUSED
    assert says in recording.reason
    assert not own.armed
    np.testing.assert_allclose(own.place, [0.2, 0.4, -1.1])


@pytest.mark.parametrize(("kind", "motors"), [(1, 4), (13, 4), (2, 6)])
def test_another_vehicle_is_no_multirotor_of_that_many_rotors(kind: int, motors: int) -> None:
    own = vehicle(StandIn(kind), motors=[f"m{i}" for i in range(motors)])
    with pytest.raises(UsageError, match=f"MAV_TYPE {kind} of autopilot 12"), own:
        pass


class During:
    """Does something to the vehicle at 0.5 s of the motion."""

    def __init__(self, what) -> None:
        self.what = what

    def __call__(self, sample: Sample) -> Reaction:
        if self.what and (sample.at or 0.0) > 0.5:
            self.what, what = None, self.what
            what()
        return Reaction.GO


def test_a_pilot_who_takes_over_ends_the_motion_and_keeps_the_mode() -> None:
    own = StandIn()
    recording = flown(own, During(lambda: own.enters(POSITION)))
    assert recording.ended is Ended.FAULT
    assert (
        "has left offboard mode for position mode: a pilot or a failsafe has taken over" in recording.reason
    )
    assert recording.reached < 0.5 + 0.2, "the mode is asked for ten times a second"
    assert own.mode == POSITION, "what a pilot has chosen is not undone"


@pytest.mark.parametrize("at", [0.5, 0.51, 0.53, 0.57])
def test_a_pilot_who_takes_over_just_before_a_stop_keeps_the_mode(at: float) -> None:
    own = StandIn()

    def watch(sample: Sample) -> Reaction:
        if (sample.at or 0.0) < at:
            return Reaction.GO
        own.mode = POSITION
        return Reaction.KILL

    assert flown(own, watch).ended is Ended.STOPPED
    assert own.mode == POSITION


def test_a_pilot_who_takes_over_after_the_motion_is_not_landed() -> None:
    own = StandIn()
    with Streamed(vehicle(own)) as player:
        assert player.play(motion(), go, "feedback").ended is Ended.DONE
        own.mode = POSITION
    assert own.mode == POSITION


def test_set_points_that_end_leave_it_hovering() -> None:
    own = StandIn()
    with vehicle(own) as stream:
        stream.ready("feedback")
        for _ in range(30):  # time passes, and nobody sends
            own.step(0.02)
        assert own.mode == HOLD
        assert np.abs(own.speed).max() < 0.01


def test_what_the_supervisor_sees_of_a_lost_link() -> None:
    own = StandIn()

    def lost() -> None:
        own.silent = True

    with Streamed(vehicle(own)) as player:
        ones = np.ones(3)
        watch = Supervisor(Bounds(0.3 * ones, -9 * ones, 9 * ones, 9 * ones), player.about(), motion())
        during = During(lost)
        recording = player.play(motion(), lambda s: (during(s), watch.watch(s))[1], "feedback")
    assert recording.ended is Ended.LOST
    assert own.mode in (HOLD, LAND)


@pytest.mark.slow
def test_over_udp_in_real_time() -> None:
    """The connection of pymavlink itself, found by its name."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with OverUdp(StandIn(), port), find_driver(f"px4:udpin:127.0.0.1:{port}", AXES) as player:
        recording = player.play(motion(), go, "feedback")
    assert recording.ended is Ended.DONE, recording.reason
    assert math.isclose(recording.reached, motion().duration)
