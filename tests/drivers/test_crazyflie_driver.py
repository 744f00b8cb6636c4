"""The driver `crazyflie` over a stand-in that speaks CRTP: in virtual time, and over UDP in real time."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cflib", reason="the driver crazyflie needs cflib")

from crazyflie_stand_in import FLYING, HIGH, IDLE, SERIAL, OverUdp, StandIn, address_of
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
from etude_drivers import CrazyflieVehicle

START = np.array([0.4, 0.2, 0.0])
"""Of the stand-in: on the ground."""
OWN = "".join(f"{part:08X}" for part in SERIAL)


def vehicle(own: StandIn, **settings: object) -> CrazyflieVehicle:
    return CrazyflieVehicle(AXES, address_of(own), settings, virtual=True)


def motion(start: np.ndarray = START) -> PlannedMotion:
    return through(start, start + np.array([0.3, -0.2, 0.4]))


def flown(own: StandIn, watch=go, **settings: object) -> Recording:
    with Streamed(vehicle(own, **settings)) as player:
        return player.play(motion(), watch, "feedback")


class TestCrazyflieVehicle(DriverSuite):
    joints = AXES
    way = 0.15

    def driver(self) -> CrazyflieVehicle:
        return vehicle(StandIn())


def test_it_hovers_by_itself_after_a_motion_and_is_landed_at_the_end() -> None:
    own = StandIn()
    with Streamed(vehicle(own)) as player:
        recording = player.play(motion(), go, "feedback")
        assert recording.ended is Ended.DONE, recording.reason
        for _ in range(500):  # 10 s pass, and nobody sends
            own.step(0.02)
        np.testing.assert_allclose(own.place, START + np.array([0.3, -0.2, 0.4]), atol=2e-3)
        assert (own.planner, own.priority, own.locked) == (FLYING, HIGH, False)
    np.testing.assert_allclose(own.place, START + np.array([0.3, -0.2, 0.0]), atol=2e-3)
    assert (own.planner, own.fell, own.thrust_of_zero) == (IDLE, False, False)


def test_what_flew_before_is_left_in_the_air() -> None:
    own = StandIn()
    own.place = np.array([0.4, 0.2, 0.8])
    own.planner, own.priority, own.plan = FLYING, HIGH, (own.now, 1.0, own.place, own.speed, own.place)
    own.step(0.02)
    with Streamed(vehicle(own)) as player:
        assert player.play(motion(own.place), go, "feedback").ended is Ended.DONE
    for _ in range(500):
        own.step(0.02)
    assert own.place[2] > 1.1
    assert not own.fell, "a link that closes sends no thrust of zero"


def test_set_points_are_the_nearest_millimetres() -> None:
    own = StandIn()
    with vehicle(own) as driver:
        driver.ready("feedback")
        for value, told in ((0.0006, 0.001), (-1.2346, -1.235), (1.001, 1.001), (32.767, 32.767)):
            driver.send(np.array([value, -value, 0.1]), np.full(3, -value), np.full(3, value), None)
            np.testing.assert_allclose(own.goal, [[told, -told, 0.1], 3 * [-told], 3 * [told]])


def test_no_set_point_follows_a_stop() -> None:
    own = StandIn()
    with vehicle(own) as driver:
        driver.ready("feedback")
        driver.send(START, np.zeros(3), np.zeros(3), None)
        driver.stop()
        driver.send(START + 1.0, np.zeros(3), np.zeros(3), None)
        assert own.planner == FLYING, "the high-level commander flies, and no set-point stops it"
    assert not own.fell


def test_what_a_vehicle_learns_from_is_recorded_in_its_units(tmp_path) -> None:
    recording = flown(StandIn(), motors=["a", "b", "c", "d"])
    assert recording.ended is Ended.DONE
    assert np.all(np.diff(recording.t) > 0.0), "stamps of 24 bits go on where they begin again"
    assert np.ptp(recording.t) < 10.0
    write_recording(tmp_path / "r.parquet", recording)
    found = {name: values[-1] for name, values in read_recording(tmp_path / "r.parquet").extra.items()}
    expected = {f"command_{name}": (30001 + i) / 65535 for i, name in enumerate("abcd")}
    expected |= {"specific_force_x": 0.0981, "specific_force_y": 0.1962, "specific_force_z": 9.81}
    expected |= {f"rates_{axis}": np.radians(i) for i, axis in enumerate(AXES, 1)}
    expected |= {"orientation_w": 1.0, "orientation_x": 0.0, "orientation_y": 0.0, "orientation_z": 0.0}
    expected |= {"battery_voltage_pack": 3.9}
    assert sorted(found) == sorted(expected)
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-5), name


@pytest.mark.parametrize(
    ("own", "says"),
    [
        (StandIn(charge=20), "the battery has 20% left, and 30% are asked for"),
        (StandIn(yaw=-1.5), "it looks 86 degrees away from the x axis"),
        (StandIn(known=0.5), "it knows its position to 0.5 m only"),
        (StandIn(locked=True), "it is locked until it is restarted"),
    ],
)
def test_a_refused_start_moves_nothing_and_says_why(own: StandIn, says: str) -> None:
    recording = flown(own)
    assert recording.ended is Ended.REFUSED
    assert says in recording.reason
    assert own.goal is None


def test_what_has_to_be_armed_is_armed() -> None:
    own = StandIn(arming=True)
    recording = flown(own)
    assert recording.ended is Ended.DONE, recording.reason
    assert own.armed


@pytest.mark.parametrize(
    ("address", "settings", "says"),
    [
        ("radio://0/80/2M/E7E7E7E7E7", {}, "any Crazyflie may answer at"),
        ("radio://0/80/2M", {}, "identifies no robot"),
        ("usb://0", {}, "identifies no robot"),
        ("radio://0/80/2M/E7E7E7E701", {"rate": 40}, "40 Hz is not possible"),
        ("radio://0/80/2M/E7E7E7E701", {"rate": 0}, "0 Hz is not possible"),
        ("radio://0/80/2M/E7E7E7E701", {"motors": ["a"]}, "a Crazyflie has four motors"),
        ("radio://0/80/2M/E7E7E7E701", {"speed": 3}, "no key speed"),
    ],
)
def test_what_is_not_stated_is_refused(address: str, settings: dict[str, object], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        CrazyflieVehicle(AXES, address, settings)


def test_another_crazyflie_is_refused_with_the_serial_to_write() -> None:
    with pytest.raises(UsageError, match=f"is the Crazyflie {OWN}") as found, vehicle(StandIn(), serial="?"):
        pass
    assert f'serial = "{OWN}"' in str(found.value.next_step)
    with vehicle(StandIn(), serial=OWN.lower()) as driver:
        assert OWN.lower() in driver.about().identity


def test_a_firmware_that_does_not_log_it_and_an_address_where_nobody_is() -> None:
    with (
        pytest.raises(ConnectionError, match=r"does not log.*kalman\.varPX"),
        vehicle(StandIn(lacks="kalman.varPX")),
    ):
        pass
    with pytest.raises(ConnectionError, match="no Crazyflie at nowhere://1"):
        CrazyflieVehicle(AXES, "nowhere://1", {}).__enter__()


class During:
    """Does something to the vehicle at 0.5 s of the motion."""

    def __init__(self, what) -> None:
        self.what = what

    def __call__(self, sample: Sample) -> Reaction:
        if self.what and (sample.at or 0.0) > 0.5:
            self.what, what = None, self.what
            what()
        return Reaction.GO


def test_a_crash_ends_the_motion_with_the_firmwares_reason() -> None:
    own = StandIn()

    def crash() -> None:
        own.locked = True

    recording = flown(own, During(crash))
    assert recording.ended is Ended.FAULT
    assert "has stopped the rotors: it is locked" in recording.reason
    assert recording.reached < 0.8


def test_the_supervisor_sees_a_lost_link_before_the_firmware_levels_out() -> None:
    own = StandIn()

    def lost() -> None:
        own.silent = True

    with Streamed(vehicle(own)) as player:
        ones = np.ones(3)
        watch = Supervisor(Bounds(0.3 * ones, -9 * ones, 9 * ones, 9 * ones), player.about(), motion())
        during = During(lost)
        recording = player.play(motion(), lambda s: (during(s), watch.watch(s))[1], "feedback")
    assert recording.ended is Ended.LOST
    assert recording.reached < 0.5 + 0.4, "s"
    assert not own.fell


@pytest.mark.slow
def test_over_udp_in_real_time() -> None:
    """cflib's own link, found by the driver's name."""
    own = StandIn()
    with OverUdp(own) as wire, find_driver(f"crazyflie:{wire.address}", AXES) as player:
        recording = player.play(motion(), go, "feedback")
        assert recording.ended is Ended.DONE, recording.reason
    assert abs(own.place[2]) < 0.01, "landed"
    assert not own.fell
