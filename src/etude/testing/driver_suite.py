"""Laws of drivers (`etude.drivers`), tested with small motions that the suite plays."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from etude.drivers import (
    Bounds,
    Ended,
    PlannedMotion,
    Player,
    Reaction,
    Recording,
    Sample,
    Stream,
    Streamed,
    Supervisor,
    Watch,
    planned,
)
from etude.testing.faults import FAULTS, Faulty
from etude.trajectories import PointToPoint
from etude.types import Array

RESTS = 0.02
"""rad/s or m/s that count as rest, measured as differences over the last samples."""
LATE = 0.02
"""s: a robot that rests since then rests."""


class DriverSuite:
    """Laws of `drivers.Stream` and `drivers.Player`. It moves the robot, there and back.

    Override `driver`; it is called for every law, and gives a robot that may move by `way` from where it
    stands. A robot with a virtual clock is tested in little time.

    Attributes:
        joints: their names, in the order of the driver. way: rad or m of each joint. velocity, acceleration:
            of the motions. error: bound of |q - asked|. clock: s by which a simulation may be slow.
    """

    joints: ClassVar[tuple[str, ...]]
    way: ClassVar[float] = 0.3
    velocity: ClassVar[float] = 0.8
    acceleration: ClassVar[float] = 4.0
    error: ClassVar[float] = 0.1
    clock: ClassVar[float] = 0.5

    def driver(self) -> Stream | Player:
        """A new one, not connected."""
        raise NotImplementedError

    def test_it_says_what_it_is_before_it_is_connected(self) -> None:
        about = self.driver().about()
        assert about.joints == self.joints, f"joints are {about.joints}"
        assert about.rate > 0.0, "no rate"
        assert about.identity, "a robot without an identity may be any other one"
        assert about.command_of is not None, "command_of is not stated: it is unknown what is learned"
        assert about.gravity_in_command is not None, "gravity_in_command is not stated"
        assert "feedback" in about.controls, "every robot follows set-points by its feedback"
        for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque_rate", "encoder_step"):
            value = getattr(about, name)
            assert value is None or np.shape(value) == (len(self.joints),), f"{name} is not (J,)"

    def test_looking_moves_nothing(self) -> None:
        with self._player() as player:
            first = player.where()
            for sample in (first, player.where()):
                self._require_shapes(sample)
            motion = self._motion(player)
            assert not player.check(motion), f"it refuses a small motion: {player.check(motion)}"
            assert np.abs(player.where().q - first.q).max() < 5e-3, "it moved"

    def test_a_motion_is_played_and_recorded(self) -> None:
        with self._player() as player:
            motion = self._motion(player)
            recording = player.play(motion, _go, "feedback")
            self._require_done(recording, player)
            exact = np.array([np.interp(recording.at, motion.t, q) for q in motion.q.T]).T
            period = 1.0 / player.about().rate
            # between two rows, and while a robot of its own clock waits for a set-point that is late
            allowed = np.abs(motion.qdd).max() * period**2 + np.abs(motion.qd).max() * recording.late * period
            off = np.abs(recording.asked - exact).max()
            assert off <= allowed + 1e-6, f"the set-point is {off:.3g} off the path at `at`"
            assert np.abs(recording.q - recording.asked).max() < self.error, "it does not follow"

    def test_times_are_the_robots_own_and_fit_the_trajectory(self) -> None:
        with self._player() as player:
            recording = player.play(self._motion(player), _go, "feedback")
            period = 1.0 / player.about().rate
            assert np.all(np.diff(recording.t) > 0.0), "times do not increase"
            usual = float(np.median(np.diff(recording.t)))
            assert usual < 1.5 * period, f"samples are {usual:.3g} s apart, and rate says {period:.3g} s"
            moves = (recording.at > 0.0) & (recording.at < recording.motion.duration)
            apart = np.abs(recording.t - recording.began - recording.at)[moves].max()
            assert apart <= (2 + recording.late) * period, f"times are {apart:.3g} s off the trajectory's"
            assert recording.t[0] <= recording.began, "nothing is recorded before the motion"

    def test_one_motion_after_the_other(self) -> None:
        with self._player() as player:
            for _ in range(2):
                self._require_done(player.play(self._motion(player), _go, "feedback"), player)

    def test_from_elsewhere_it_is_refused(self) -> None:
        with self._player() as player:
            before, motion = player.where(), self._motion(player, off=0.5 * self.way)
            recording = player.play(motion, _go, "feedback")
            assert recording.ended is Ended.REFUSED, f"it ended {recording.ended.value}"
            assert recording.reason, "it states no reason"
            assert np.abs(player.where().q - before.q).max() < 5e-3, "it moved"

    def test_other_joints_and_too_much_are_refused(self) -> None:
        with self._player() as player:
            motion = self._motion(player)
            if len(self.joints) > 1:
                turned = replace(motion, joints=motion.joints[::-1])
                assert player.check(turned), "joints in another order pass"
            about = player.about()
            if about.upper is not None and np.isfinite(about.upper).any():
                joint = int(np.argmax(np.isfinite(about.upper)))
                beyond = motion.q.copy()
                beyond[:, joint] += about.upper[joint] - beyond[:, joint].min() + 0.01
                assert player.check(replace(motion, q=beyond)), "a motion beyond a limit passes"

    def test_stop_ends_it_at_rest(self) -> None:
        with self._player() as player:
            recording = player.play(self._motion(player), _react_from(0.4, Reaction.STOP), "feedback")
            assert recording.ended is Ended.STOPPED, f"it ended {recording.ended.value}"
            most = 0.4 + player.about().stop_latency + 2.0 / player.about().rate
            assert recording.reached <= most, f"it went on to {recording.reached:.3f} s"
            self._require_rest(recording)
            self._require_done(player.play(self._motion(player), _go, "feedback"), player)

    def test_kill_ends_it(self) -> None:
        with self._player() as player:
            recording = player.play(self._motion(player), _react_from(0.4, Reaction.KILL), "feedback")
            assert recording.ended is Ended.STOPPED, f"it ended {recording.ended.value}"
            assert recording.reached < recording.motion.duration, "it went on"

    def test_hold_waits_and_goes_on(self) -> None:
        with self._player() as player:
            recording = player.play(self._motion(player), _Held(0.4, 0.5), "feedback")
            if not player.about().can_hold:
                assert recording.ended is Ended.STOPPED, "it cannot hold, and went on"
                self._require_rest(recording)
                return
            self._require_done(recording, player)
            assert len(recording.held) == 1, f"it was held {len(recording.held)} times"

    def test_a_stream_that_is_stopped_in_motion_rests_in_time_and_stays(self) -> None:
        """As where the supervisor fails: no set-point of ours brakes it, and `stop` alone does."""
        if isinstance(self.driver(), Player):
            return
        with self._player() as player:
            recording = player.play(self._motion(player), _call_at(0.4, _raise_error), "feedback")
            about, moving = player.about(), recording.t[-1]
            stopped = _sample_at(player, moving + about.stop_latency + about.stopping_time)
            later = _sample_at(player, stopped.t + 0.2)
            distance = self.velocity * (about.stop_latency + about.stopping_time) + self.error
            far = np.abs(stopped.q - recording.q[-1]).max()
            assert far <= distance, f"it goes on by {far:.3g} after stop()"
            moved = np.abs(later.q - stopped.q).max()
            assert moved <= 5e-3, f"it still moves {about.stopping_time:g} s after stop(), by {moved:.3g}"
            assert later.qd is None or np.abs(later.qd).max() <= RESTS, "it still moves after stop()"

    def test_stop_from_another_thread_ends_it_at_rest(self) -> None:
        with self._player() as player:

            def twice() -> None:
                player.stop()
                player.stop()

            recording = player.play(self._motion(player), _call_at(0.4, _in_a_thread(twice)), "feedback")
            assert recording.ended is Ended.INTERRUPTED, f"it ended {recording.ended.value}"
            self._require_rest(recording)

    def test_stop_harms_nobody_who_does_not_move(self) -> None:
        player = self._player()
        with player:
            player.stop()
            player.stop(kill=True)
            self._require_shapes(player.where())

    def test_what_the_supervisor_raises_ends_it_at_rest(self) -> None:
        with self._player() as player:
            recording = player.play(self._motion(player), _call_at(0.4, _raise_error), "feedback")
            assert recording.ended in (Ended.FAULT, Ended.STOPPED), f"it ended {recording.ended.value}"

    def test_faults_end_as_they_have_to(self) -> None:
        """Of a stream: what a wire or a clock can do to its samples, under a supervisor."""
        if isinstance(self.driver(), Player):
            return
        for name, fault in FAULTS.items():
            stream = self.driver()
            assert isinstance(stream, Stream)
            if fault.needs or (fault.at_once and name != "refused" and self._symmetrical(stream)):
                continue
            if name == "clock drifts" and self.clock > 1.0:
                continue  # it may
            recording, reason = self._run_with_fault(Faulty(stream, name, after=0.4))
            ended = recording.ended
            assert ended in fault.ends, f"{fault.words}: it ended {ended.value}, {recording.reason}{reason}"

    def _run_with_fault(self, stream: Faulty) -> tuple[Recording, str]:
        with Streamed(stream) as player:
            motion = self._motion(player)
            supervisor = Supervisor(self._bounds(), player.about(), motion)
            return player.play(motion, supervisor.watch, "feedback"), supervisor.reason

    def _symmetrical(self, stream: Stream) -> bool:
        """A pose that looks the same in degrees, in another order and with the other sign."""
        with stream:
            q = stream.state().q
        return bool(np.abs(q).max() < 2 * self.error)

    def _bounds(self) -> Bounds:
        ones = np.ones(len(self.joints))
        far, fast = 1e3 * ones, 10 * self.velocity * ones
        return Bounds(self.error * ones, -far, far, fast, clock=self.clock)

    def _player(self) -> Player:
        driver = self.driver()
        return driver if isinstance(driver, Player) else Streamed(driver)

    def _motion(self, player: Player, off: float = 0.0) -> PlannedMotion:
        about, sample = player.about(), player.where()
        start = (sample.q if sample.asked is None else sample.asked) + off
        toward = np.where(start > self._middle(about.lower, about.upper), -1.0, 1.0)
        points = np.array([start, start + toward * self.way, start])
        path = PointToPoint(
            points, self.velocity, dwell=0.05, peak_acceleration=self.acceleration, peak_jerk=1e3
        )
        return planned(
            path.to_json().encode(),
            number=1,
            part="motion",
            speed=100,
            names=about.joints,
            joints=about.joints,
            rate=about.rate,
        )

    def _middle(self, lower: Array | None, upper: Array | None) -> Array:
        if lower is None or upper is None:
            return np.zeros(len(self.joints))
        return 0.5 * (np.maximum(lower, -10.0) + np.minimum(upper, 10.0))

    def _require_shapes(self, sample: Sample) -> None:
        for name in ("q", "qd", "command", "asked"):
            value = getattr(sample, name)
            assert value is None or np.shape(value) == (len(self.joints),), f"{name} is not (J,)"
        assert np.isfinite(sample.q).all(), "a position is not a number"

    def _require_done(self, recording: Recording, player: Player) -> None:
        assert recording.ended is Ended.DONE, f"it ended {recording.ended.value}: {recording.reason}"
        assert abs(recording.reached - recording.motion.duration) < 1e-6, "it did not reach the end"
        n, J = len(recording.t), len(self.joints)
        for name in ("q", "command", "asked"):
            assert np.shape(getattr(recording, name)) == (n, J), f"{name} is not (n, J)"
            beside = name == "command" and any(key.startswith("command_") for key in recording.extra)
            values = np.array([*recording.extra.values()]) if beside else getattr(recording, name)
            assert np.isfinite(values).all(), f"{name} has values that are not numbers"
        assert recording.at.shape == (n,), "at is not (n,)"
        assert recording.identity == player.about().identity, "the recording is of another robot"
        self._require_rest(recording)

    def _require_rest(self, recording: Recording) -> None:
        late = recording.t >= recording.t[-1] - LATE
        moved = np.abs(np.ptp(recording.asked[late], axis=0)).max()
        assert moved <= RESTS * LATE, "its set-points still move at the end"
        if recording.qd is not None:
            assert np.abs(recording.qd[-1]).max() <= RESTS, "it still moves at the end"


def _go(sample: Sample) -> Reaction:  # noqa: ARG001
    return Reaction.GO


def _react_from(at: float, reaction: Reaction) -> Watch:
    return lambda sample: reaction if sample.at is not None and sample.at >= at else Reaction.GO


class _Held:
    """HOLD from a place of the motion on, for some seconds of our clock."""

    def __init__(self, at: float, span: float) -> None:
        self.at, self.span, self.since = at, span, np.inf

    def __call__(self, sample: Sample) -> Reaction:
        if sample.at is not None and sample.at >= self.at:
            self.since = min(self.since, sample.seen)
        return Reaction.HOLD if 0.0 <= sample.seen - self.since <= self.span else Reaction.GO


def _call_at(at: float, what: Callable[[], None]) -> Watch:
    """Watch that calls `what` once, at that time of the motion."""
    left = [what]

    def watch(sample: Sample) -> Reaction:
        if left and sample.at is not None and sample.at >= at:
            left.pop()()
        return Reaction.GO

    return watch


def _raise_error() -> None:
    raise ZeroDivisionError


def _sample_at(player: Player, t: float) -> Sample:
    """Sample at that time of the robot's clock; at once if the clock is virtual."""
    about, sample = player.about(), player.where()
    while sample.t < t and not about.virtual:
        time.sleep(1.0 / about.rate)
        sample = player.where()
    return sample


def _in_a_thread(what: Callable[[], None]) -> Callable[[], None]:
    def run() -> None:
        thread = threading.Thread(target=what)
        thread.start()
        thread.join()

    return run
