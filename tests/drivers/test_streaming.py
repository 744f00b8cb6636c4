"""A stream plays whole motions: exactly on the path, to rest however it ends, and all of it comes back."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.drivers import (
    About,
    Bounds,
    Ended,
    PlannedMotion,
    Reaction,
    Recording,
    Sample,
    Streamed,
    Supervisor,
    Watch,
    first_segment_ends,
    planned,
    read_recording,
    write_recording,
)
from etude.errors import DataError, UsageError
from etude.testing import FakeRobot
from etude.trajectories import Chain, PointToPoint, from_json
from etude.types import Array

NAMES = ("base", "elbow")


def moves(dwell: float = 0.1) -> PointToPoint:
    """There and back in 2 s."""
    there = np.array([[0.0, 0.0], [0.5, -0.4], [0.0, 0.0]])
    return PointToPoint(there, peak_velocity=1.2, dwell=dwell)


def motion(rate: float = 250.0, speed: int = 100, dwell: float = 0.1) -> PlannedMotion:
    text = moves(dwell).to_json().encode()
    return planned(text, number=1, part="motion", speed=speed, names=NAMES, joints=NAMES, rate=rate)


def bounds(error: float = 0.05) -> Bounds:
    ones = np.ones(2)
    return Bounds(error=error * ones, lower=-2 * ones, upper=2 * ones, velocity=5 * ones)


def go(sample: Sample) -> Reaction:
    return Reaction.GO


def played(
    watch: Watch = go, robot: FakeRobot | None = None, own: PlannedMotion | None = None
) -> tuple[Recording, FakeRobot]:
    robot = robot or FakeRobot()
    with Streamed(robot) as player:
        return player.play(own or motion(robot.rate), watch, "feedback"), robot


def test_it_plays_the_path_exactly() -> None:
    own = motion()
    recording, _ = played(own=own)
    assert recording.ended is Ended.DONE, recording.reason
    on_path = (recording.at > 0) & (recording.at < own.duration)
    np.testing.assert_allclose((recording.t - recording.began)[on_path], recording.at[on_path], atol=1e-9)
    exact = from_json(own.trajectory_json).motion(recording.at, 1).orders[0]
    np.testing.assert_allclose(recording.asked, exact, atol=1e-9)
    assert recording.reached == own.duration
    assert recording.late == 0
    assert np.all(np.diff(recording.t) > 0)
    assert recording.t[0] < recording.began < recording.t[-1] - own.duration
    assert np.abs(recording.qd[-1]).max() < 1e-3


def test_the_recording_comes_back_from_its_file(tmp_path: Path) -> None:
    recording, _ = played()
    write_recording(tmp_path / "r.parquet", recording)
    back = read_recording(tmp_path / "r.parquet")
    for name in (
        "t",
        "at",
        "began",
        "reached",
        "ended",
        "reason",
        "late",
        "identity",
        "command_unit",
        "held",
    ):
        np.testing.assert_array_equal(getattr(back, name), getattr(recording, name))
    for name in ("q", "qd", "command", "asked"):
        np.testing.assert_allclose(getattr(back, name), getattr(recording, name), rtol=1e-7, atol=1e-9)
    assert back.motion.sha256 == recording.motion.sha256
    np.testing.assert_array_equal(back.motion.q, recording.motion.q)
    (tmp_path / "r.parquet").write_bytes((tmp_path / "r.parquet").read_bytes()[:-50])
    with pytest.raises(DataError, match="not a recording of etude run"):
        read_recording(tmp_path / "r.parquet")


class Accelerated(FakeRobot):
    """Its learned command may be an acceleration; it keeps the speeds and commands that it was sent."""

    learned_as = ""

    def about(self) -> About:
        return replace(super().about(), learned_as=self.learned_as)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.rows = [*getattr(self, "rows", []), (np.linalg.norm(qd), effort)]
        super().send(q, qd, qdd, None)


@pytest.mark.parametrize("reaction", [Reaction.STOP, Reaction.HOLD])
def test_a_learned_acceleration_goes_with_the_speed_that_braking_takes_away(reaction: Reaction) -> None:
    own = motion()
    own = replace(own, effort=np.ones_like(own.q))
    for learned_as, at_rest in (("px4", 0.0), ("", 1.0)):
        robot = Accelerated()
        robot.learned_as = learned_as
        with Streamed(robot) as player:
            braked = iter([Reaction.GO] * 150 + [reaction] * 150)
            player.play(own, lambda _, left=braked: next(left, Reaction.STOP), "learned")
        speed, effort = (np.array(part) for part in zip(*robot.rows, strict=True))
        assert effort[120] == pytest.approx([1.0, 1.0]), "at full speed"
        assert effort[-1] == pytest.approx([at_rest, at_rest], abs=1e-6)
        slowed = (speed > 0.2 * speed[149]) & (speed < 0.8 * speed[149]) & (np.arange(len(speed)) > 150)
        assert slowed.any()
        assert np.all(effort[slowed] < 0.95) == (learned_as == "px4")


def test_joints_go_by_name() -> None:
    text = moves().to_json().encode()
    turned = ("elbow", "base")
    own = planned(text, number=1, part="motion", speed=100, names=NAMES, joints=turned, rate=100.0)
    straight = planned(text, number=1, part="motion", speed=100, names=NAMES, joints=NAMES, rate=100.0)
    np.testing.assert_array_equal(own.q, straight.q[:, ::-1])
    with pytest.raises(UsageError, match="lacks elbow and also has wrist"):
        planned(text, number=1, part="motion", speed=100, names=NAMES, joints=("base", "wrist"), rate=100.0)


def test_the_last_row_is_the_end_and_a_motion_is_cut_only_at_rest() -> None:
    chain = Chain((("segment", moves()), ("link", moves()), ("segment", moves())))
    text = chain.to_json().encode()
    end = first_segment_ends(chain)
    assert end == moves().duration

    def cut(until: float | None) -> PlannedMotion:
        return planned(
            text, number=1, part="motion", speed=25, names=NAMES, joints=NAMES, rate=97.0, until=until
        )

    assert cut(None).duration == chain.duration
    assert cut(end).duration == end
    np.testing.assert_allclose(np.diff(cut(end).t)[:-1], 1 / 97)
    with pytest.raises(UsageError, match="is not at rest at 0"):
        cut(0.5)


def test_a_stop_comes_to_rest_within_the_braking_distance() -> None:
    seen: list[Sample] = []

    def stops(sample: Sample) -> Reaction:
        seen.append(sample)
        return Reaction.STOP if sample.at is not None and sample.at > 0.4 else Reaction.GO

    recording, robot = played(stops)
    assert recording.ended is Ended.STOPPED
    assert recording.reached == pytest.approx(0.4, abs=0.01)
    assert np.abs(recording.qd[-1]).max() < 2e-3
    stop = int(np.argmax(recording.at > 0.4))
    speeds = np.abs(np.diff(recording.asked, axis=0)) * 250.0
    assert np.all(np.diff(speeds[stop + 30 :], axis=0) <= 1e-9), "it never speeds up again"
    accelerations = np.abs(np.diff(recording.asked, 2, axis=0)) * 250.0**2
    assert accelerations.max() < 1.02 * np.abs(motion().qdd).max()
    assert robot.stopped


def test_a_hold_waits_on_the_path_and_goes_on() -> None:
    """Braked and started again along the path, inside the motion's own accelerations."""

    def holds(sample: Sample) -> Reaction:
        return Reaction.HOLD if 0.8 < sample.t < 2.0 else Reaction.GO

    own = motion()
    recording, _ = played(holds, own=own)
    assert recording.ended is Ended.DONE
    assert len(recording.held) == 1
    start, end = recording.held[0]
    assert 0.8 < start < 0.82
    assert 2.0 < end < 4.0
    exact = from_json(own.trajectory_json).motion(recording.at, 1).orders[0]
    np.testing.assert_allclose(recording.asked, exact, atol=1e-7)
    waits = (recording.t > 1.8) & (recording.t < 2.0)
    assert np.ptp(recording.at[waits]) == 0.0
    accelerations = np.abs(np.diff(recording.asked, 2, axis=0)) * 250.0**2
    assert accelerations.max() < 1.1 * np.abs(own.qdd).max()


class Holding(FakeRobot):
    """It is where it was asked to be, and rests there where no other set-point comes."""

    def _step(self, dt: float, q: Array, qd: Array, added: Array, parts: int = 4) -> None:
        self.q, self.qd = np.array(q), qd if dt < 1.5 / self.rate else np.zeros(2)
        self.t += dt
        self._measured = self.q


def stalled(robot: FakeRobot, seconds: float) -> Recording:
    """It gets no set-point for so long in the middle of its way."""
    own = motion(robot.rate, dwell=0.4)
    supervisor = Supervisor(bounds(0.01), robot.about(), own)

    def watch(sample: Sample) -> Reaction:
        if sample.at is not None and 0.7 <= sample.at < 0.7 + 0.9 / robot.rate:
            robot.stall(seconds)
        return supervisor.watch(sample)

    recording, _ = played(watch, robot, own)
    assert recording.ended is Ended.DONE, supervisor.reason
    return recording


def lag_of(recording: Recording) -> Array:
    """(n,) s of the path behind the robot's clock, while it moves."""
    moves = (recording.at > 0.0) & (recording.at < recording.motion.duration)
    return (recording.t - recording.began - recording.at)[moves]


@pytest.mark.parametrize(("cycles", "rate"), [(3, 250.0), (9, 1000.0)])
def test_few_lost_cycles_are_no_jump_and_are_caught_up_with(cycles: int, rate: float) -> None:
    """Set-points go on by one cycle each, inside the motion's own velocities and accelerations."""
    robot = Holding(rate=rate)
    recording = stalled(robot, cycles / rate)
    own = recording.motion
    assert recording.late == cycles - 1
    assert recording.held == ()
    velocities = np.abs(np.diff(robot.sent, axis=0)) * rate
    accelerations = np.abs(np.diff(robot.sent, 2, axis=0)) * rate**2
    assert np.all(velocities.max(axis=0) <= np.abs(own.qd).max(axis=0) * 1.001)
    assert np.all(accelerations.max(axis=0) <= np.abs(own.qdd).max(axis=0) * 1.001)
    assert lag_of(recording).max() == pytest.approx((cycles - 1) / rate, abs=0.1 / rate)
    assert lag_of(recording)[-1] <= 0.7 / rate, "it catches up"


@pytest.mark.parametrize("seconds", [0.03, 0.08])
def test_from_many_lost_cycles_a_robot_that_held_is_led_on_from_rest(seconds: float) -> None:
    robot = Holding(rate=250.0)
    recording = stalled(robot, seconds)
    sent, peak = np.array(robot.sent), np.abs(recording.motion.qdd).max()
    gap = int(np.argmax(np.diff(recording.t) > 0.02))
    first = int(np.argmin(np.abs(sent - recording.asked[gap + 1]).sum(axis=1)))
    assert np.abs(sent[first + 1] - sent[first]).max() <= peak / 250.0**2
    assert np.abs(np.diff(sent[first:], 2, axis=0)).max() * 250.0**2 <= 1.05 * peak
    assert bool(recording.held) == (seconds > 0.05)


@pytest.mark.parametrize("seconds", [0.02, 0.04])
def test_a_robot_that_went_on_meanwhile_is_not_pulled_back(seconds: float) -> None:
    """Nor stopped by its supervisor: the path goes on by what the robot did, and at most by the time."""
    robot = FakeRobot(rate=250.0, stiffness=400.0)
    recording = stalled(robot, seconds)
    lag = lag_of(recording)
    assert lag.min() > -1e-6
    assert lag[np.argmax(lag) + 1] < 0.6 * seconds


@pytest.mark.parametrize("kill", [False, True])
def test_stop_from_a_thread_ends_at_rest(kill: bool) -> None:
    robot, moves = FakeRobot(virtual=False), threading.Event()

    def watch(sample: Sample) -> Reaction:
        if sample.at is not None and sample.at > 0.1:
            moves.set()
        return Reaction.GO

    with Streamed(robot) as player:

        def person() -> None:
            moves.wait()
            player.stop(kill)
            player.stop(kill)

        thread = threading.Thread(target=person)
        thread.start()
        recording = player.play(motion(), watch, "feedback")
        moves.set()  # or it would wait for ever where nothing moved
        thread.join()
    assert recording.ended is Ended.INTERRUPTED
    assert 0.0 < recording.reached < motion().duration
    if not kill:
        assert np.abs(recording.qd[-1]).max() < 2e-3


def test_the_loop_comes_before_others_where_that_is_permitted() -> None:
    usual = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, usual, os.sched_param(0))
    except PermissionError:
        pytest.skip("this user may not have real-time threads")
    seen: set[int] = set()

    def watch(sample: Sample) -> Reaction:
        seen.add(os.sched_getscheduler(0))
        return Reaction.STOP

    played(watch, FakeRobot(virtual=False))
    assert seen == {os.SCHED_FIFO}
    assert os.sched_getscheduler(0) == usual


def test_it_refuses_from_elsewhere_and_moves_nothing() -> None:
    robot = FakeRobot(start=np.array([0.3, 0.0]))
    recording, _ = played(robot=robot)
    assert recording.ended is Ended.REFUSED
    assert "base is 0.3 away from the first point" in recording.reason
    assert not robot.sent
    assert len(recording.t) == 0


def test_a_driver_that_raises_ends_in_a_recording() -> None:
    robot = FakeRobot()
    before = robot.send

    def fails(*args: object) -> None:
        if robot.t > 0.5:
            raise ConnectionError("the cable is out")
        before(*args)  # type: ignore[arg-type]

    robot.send = fails  # type: ignore[method-assign]
    recording, _ = played(robot=robot)
    assert recording.ended is Ended.FAULT
    assert recording.reason == "ConnectionError: the cable is out"
    assert robot.stopped


def test_a_driver_that_leaves_the_program_or_cannot_stop_is_said_so() -> None:
    robot = FakeRobot()
    before = robot.send

    def leaves(*args: object) -> None:
        if robot.t > 0.5:
            raise SystemExit(0)
        before(*args)  # type: ignore[arg-type]

    def fails(kill: bool = False) -> None:
        raise RuntimeError("no answer")

    robot.send, robot.stop = leaves, fails  # type: ignore[method-assign, assignment]
    player = Streamed(robot)
    player.__enter__()
    recording = player.play(motion(robot.rate), go, "feedback")
    assert recording.ended is Ended.FAULT
    assert recording.reason.startswith("SystemExit: 0; the driver's stop() failed (RuntimeError: no answer)")


def test_the_supervisor_lets_a_good_motion_through() -> None:
    robot, own = FakeRobot(), motion()
    supervisor = Supervisor(bounds(), robot.about(), own)
    recording, _ = played(supervisor.watch, robot, own)
    assert recording.ended is Ended.DONE, supervisor.reason
    np.testing.assert_allclose(
        supervisor.worst_error, np.abs(recording.q - recording.asked).max(axis=0), rtol=0.1
    )


def test_a_robot_that_stood_for_a_while_is_not_stopped() -> None:
    robot, whole = FakeRobot(rate=50.0, virtual=False), motion(50.0)
    supervisor = Supervisor(bounds(), robot.about(), whole)
    with Streamed(robot) as player:
        player.where()
        time.sleep(0.2)
        player.play(
            whole, lambda s: Reaction.STOP if len(robot.sent) > 10 else supervisor.watch(s), "feedback"
        )
    assert supervisor.reason == ""


def test_a_blocked_joint_is_stopped_and_one_glitch_is_not() -> None:
    robot, own = FakeRobot(), motion()
    supervisor = Supervisor(bounds(), robot.about(), own)
    glitches = {101}

    def watch(sample: Sample) -> Reaction:
        robot.blocked[1] = sample.t > 0.7
        if len(robot.sent) in glitches:
            sample = replace(sample, q=sample.q + 1.0)
        return supervisor.watch(sample)

    recording, _ = played(watch, robot, own)
    assert recording.ended is Ended.STOPPED
    assert supervisor.reason.startswith("elbow is 0.0")
    assert 0.7 < recording.t[-1] < 1.6
    assert recording.t[np.argmax(recording.at == recording.reached)] < 0.95


def test_one_stamp_that_is_far_off_harms_nothing() -> None:
    robot, own = FakeRobot(), motion()
    before = robot.state

    def state() -> Sample:
        sample = before()
        return replace(sample, t=sample.t + 5.0) if len(robot.sent) == 150 else sample

    robot.state = state  # type: ignore[method-assign]
    supervisor = Supervisor(bounds(), robot.about(), own)
    recording, _ = played(supervisor.watch, robot, own)
    assert recording.ended is Ended.DONE, supervisor.reason
    np.testing.assert_allclose(np.diff(recording.t).max(), 2 / 250, atol=1e-9)
    assert np.abs(recording.t - recording.began - recording.at).max() < 0.5
