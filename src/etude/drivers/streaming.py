"""The clock loop of streams: a robot that takes a set-point in each cycle plays whole motions.

Each cycle takes the newest sample, the supervisor's reaction to it, and the set-point of the coming cycle. At
every end of a motion the robot comes to rest, its driver holds it, and the recording is returned.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np

from etude.drivers.contract import (
    About,
    Control,
    Ended,
    PlannedMotion,
    Player,
    Reaction,
    Recording,
    Sample,
    Stream,
    Watch,
)
from etude.drivers.playing import Interrupt, RecordedRows, interrupts, own_arrays, why_not
from etude.drivers.set_points import (
    Pace,
    PathClock,
    PathInTime,
    SetPoint,
    Stopping,
    acceleration_limits,
    room_to_catch_up,
)
from etude.drivers.within_limits import refusals
from etude.types import Array

LEAD = 0.1
"""s of recording before the first set-point of the path."""
SETTLED, LONGEST_SETTLE = 0.1, 0.5
"""s of recording after the last moving set-point: at least; at most, if the robot still moves."""
RESTS = 2e-3
"""rad/s or m/s: a slower joint rests."""
LOST, PAUSED = 0.01, 0.05
"""s without a set-point after which the path continues from the robot's own progress; s after which the rows
until full speed count as held."""
SLOWED = 0.9
"""Part of the pace below which the robot did not continue."""
PRIORITY = 40
"""Of real-time threads: below those of the kernel for interrupts."""
LOOKED = 0.05
"""s between two checks of the loop by the watchdog."""


class Streamed:
    """A Player that plays motions over a stream."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self._identity = ""
        self._set_point: Array | None = None
        self._run: _Run | None = None

    def about(self) -> About:
        """The description by the stream."""
        return self.stream.about()

    def __enter__(self) -> Self:
        self.stream.__enter__()
        self._identity, self._set_point = self.about().identity, None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stream.__exit__(kind, error, trace)

    def where(self) -> Sample:
        """The present sample, with the last set-point if the robot does not report its own."""
        sample = own_arrays(self.stream.state())
        return sample if sample.asked is not None else replace(sample, asked=self._set_point)

    def check(self, motion: PlannedMotion) -> Sequence[str]:
        """Sentences on limits stated by the robot that the motion leaves."""
        return refusals(motion, self.about())

    def play(self, motion: PlannedMotion, watch: Watch, control: Control) -> Recording:
        """Play a motion; in the main thread, Ctrl-C and SIGTERM bring the robot to rest."""
        about = self.about()
        why = self._refused(motion, control, about)
        run = self._run = _Run(self.stream, about, motion, watch)
        if why:
            self._run = None
            return run.recording(Ended.REFUSED, why)
        try:
            with (
                interrupts(run.interrupt),
                _without_garbage_collection(),
                _with_priority(about),
                _watchdog(run, about),
            ):
                ended, reason = run.play(control)
        finally:
            self._run = None
        self._set_point = run.point.q if ended in (Ended.DONE, Ended.STOPPED, Ended.INTERRUPTED) else None
        return run.recording(ended, reason)

    def stop(self, kill: bool = False) -> None:
        """Stop the motion, from any thread or signal handler."""
        run = self._run
        if run is None or kill:
            self.stream.stop(kill)
        if run is not None:
            run.interrupt("stop() was called", kill)

    def _refused(self, motion: PlannedMotion, control: Control, about: About) -> str:
        if about.identity != self._identity:
            return f"the robot was {self._identity} when it was connected, and is {about.identity} now"
        if control not in about.controls:
            return f"{about.name} has no control {control!r}; it has {', '.join(about.controls)}"
        return why_not(self, motion)


class _Run:
    """State of one motion while it is played."""

    def __init__(self, stream: Stream, about: About, motion: PlannedMotion, watch: Watch) -> None:
        self.stream, self.about, self.motion, self.watch = stream, about, motion, watch
        self.period = 1.0 / about.rate
        self.path = PathInTime(motion, about.rate)
        self.limits = acceleration_limits(motion, about)
        self.rows = RecordedRows(int((motion.duration + 2.0) * about.rate), len(motion.joints))
        self.clock = _Clock(about)
        self.point = self.path.at(0.0)
        self.began = np.nan
        self.late = 0
        self.held: list[tuple[float, float]] = []
        self.interrupt, self.lost = Interrupt(), False
        self._pace, self._steps = Pace(), PathClock(self.period)
        self._room = room_to_catch_up(motion, about)
        self._stopping: Stopping | None = None
        self._since = 0.0
        self._before = self._newest = Sample(np.nan, np.full(len(motion.joints), np.nan))
        self._outcome = Ended.DONE, ""
        self._fresh_at = 0.0
        self._moves = False

    def play(self, control: Control) -> tuple[Ended, str]:
        """End of the motion and its reason. The stream is stopped in every case and holds its pose."""
        try:
            self.stream.ready(control)
        except (Exception, SystemExit) as error:
            return Ended.REFUSED, f"{type(error).__name__}: {error}"
        try:
            self.clock.start()
            while self._cycle():
                pass
        except KeyboardInterrupt:
            self._outcome = Ended.INTERRUPTED, "Ctrl-C"
        # an error of the driver or of the supervisor must not leave the robot in motion
        except (Exception, SystemExit) as error:
            self._outcome = Ended.FAULT, f"{type(error).__name__}: {error}"
        try:
            self.stream.stop(self.interrupt.killed)
        except (Exception, SystemExit) as error:
            why = (
                f"the driver's stop() failed ({type(error).__name__}: {error}): it is unknown whether the "
                "robot is at rest"
            )
            self._outcome = Ended.FAULT, f"{self._outcome[1]}; {why}" if self._outcome[1] else why
        return self._outcome

    def recording(self, ended: Ended, reason: str) -> Recording:
        """The recording so far."""
        recording = self.rows.recording(self.motion, self.about, ended, reason, self.began)
        reached = self.point.at if self.rows.n else 0.0
        return replace(recording, reached=reached, late=self.late, held=tuple(self.held))

    def _cycle(self) -> bool:
        """Run one cycle; False: the motion is over."""
        sample = self.clock.wait(self.stream.state)
        self.late += self.clock.late
        reaction = Reaction.GO
        if self.clock.fresh:
            sample = self._completed(sample)
            self._before, self._newest = self._newest, sample
            if self.clock.forward:
                self.rows.add(sample)
            reaction = self.watch(sample)
        if self._is_over(sample, reaction):
            return False
        self.point = self._next(reaction)
        self.stream.send(self.point.q, self.point.qd, self.point.qdd, self._effort())
        return True

    def _effort(self) -> Array | None:
        """Effort of the set-point. Learned accelerations are scaled by the remaining speed while braking."""
        effort, on_path = self.point.effort, self.path.at(self.point.at)
        if effort is None or not self.about.learned_as:
            return effort
        speed = float(np.linalg.norm(on_path.qd))
        return effort if speed == 0.0 else effort * (float(np.linalg.norm(self.point.qd)) / speed)

    def _completed(self, sample: Sample) -> Sample:
        copy = own_arrays(sample)
        asked = self.point.q if copy.asked is None else copy.asked
        return replace(copy, asked=asked, at=self.point.at, seen=self.clock.now)

    def _is_over(self, sample: Sample, reaction: Reaction) -> bool:
        """Whether the motion is over; otherwise start a stop if there is a reason."""
        killed = self.interrupt.killed = self.interrupt.killed or reaction is Reaction.KILL
        if self.clock.fresh and sample.fault:
            self._outcome = Ended.FAULT, f"{self.about.name} reports: {sample.fault}"
            return True
        why: tuple[Ended, str] | None = None
        if self.interrupt.why:
            why = Ended.INTERRUPTED, self.interrupt.why
        elif self.lost:
            why = Ended.LOST, "a cycle did not end: the driver or this computer was blocked"
        elif self.clock.silent > self.about.silence:
            why = Ended.LOST, f"no sample for {self.about.silence:g} s"
        elif reaction in (Reaction.STOP, Reaction.KILL):
            why = Ended.STOPPED, ""
        elif reaction is Reaction.HOLD and not self.about.can_hold:
            why = Ended.STOPPED, f"{self.about.name} cannot hold"
        if why is not None and self._stopping is None:
            self._outcome = why
            self._stopping, self._since = Stopping(self.point, self.limits), 0.0
        return killed or self.lost or self._is_settled(sample)

    def _is_settled(self, sample: Sample) -> bool:
        """Whether the robot rests, and the last moving set-point is long enough ago."""
        if self._stopping is not None:
            past = self._since - self._stopping.span
        elif self.point.at >= self.motion.duration:
            past = self._since
        else:
            return False
        rests = sample.qd is None or bool(np.all(np.abs(sample.qd) <= RESTS))
        return past >= (SETTLED if rests else LONGEST_SETTLE)

    def _next(self, reaction: Reaction) -> SetPoint:
        """The set-point of the coming cycle."""
        room = bool(self._room[self.path.row(self.point.at)])
        tick = self._steps.step(self.clock.passed, self.clock.elapsed, room)
        if self._stopping is not None:
            self._since += tick
            return self._stopping.at(self._since)
        if not self._moves:
            self._since += tick
            if self._since < LEAD:
                return self.point
            self._moves, self._since, self.began = True, 0.0, self.clock.robot
            self._steps, tick = PathClock(self.period), self.period
        elif self.point.at >= self.motion.duration:
            self._since += tick
            return self.point
        return self._advanced(tick, reaction is Reaction.HOLD)

    def _advanced(self, tick: float, wait: bool) -> SetPoint:
        """The next set-point on the path, at the present pace."""
        s = self.point.at
        if self.clock.fresh and self.clock.passed - self.period >= LOST:
            s += self._progress(s)
        pace, before, speed = self._pace, self._pace.now, self._steps.speed
        if pace.steady and wait == (pace.end == 1.0):
            pace.end = 0.0 if wait else 1.0
            if wait:
                self.held.append((self.clock.robot, np.inf))
        pace.go_on(tick, self.path, s, self.limits)
        if self.held and self.held[-1][1] == np.inf and pace.now == pace.end == 1.0:
            self.held[-1] = self.held[-1][0], self.clock.robot
        change = pace.change * speed + pace.now * self._steps.change
        return self.path.at(s + 0.5 * tick * (before + pace.now), pace.now * speed, change)

    def _progress(self, s: float) -> float:
        """s of path that the robot covered during lost cycles; the path takes over its pace."""
        along = self.motion.qd[self.path.row(s)]
        size, passed, now = float(along @ along), self.clock.passed, self._newest
        progress = float(along @ (now.q - self._before.q)) / max(size, 1e-12)
        if not (size > 0.0 and np.isfinite(progress)):
            return 0.0
        measured = progress / passed if now.qd is None else float(along @ now.qd) / size
        self._pace.now, self._pace.change = min(max(measured, 0.0), self._pace.now), 0.0
        holds = bool(self.held) and self.held[-1][1] == np.inf
        if passed - self.period >= PAUSED and self._pace.now < SLOWED and not holds:
            self.held.append((self.clock.robot - passed, np.inf))
        progress = min(max(progress - self.period, 0.0), passed - self.period)
        self._steps.lag -= progress
        return progress


class _Clock:
    """The clocks of the robot and of this computer. A robot whose `state` waits for a sample sets the pace.

    Attributes:
        now: this computer's, s; of a virtual robot, counted cycles. robot: its own, s, or an estimate.
        passed, elapsed: s since the last cycle by the robot's clock, and by this computer's.
        fresh: the sample is new. forward: it is new and later.
        silent: s since the last new sample. late: cycles missed before this one.
    """

    def __init__(self, about: About) -> None:
        self.virtual, self.period, self.believed = about.virtual, 1.0 / about.rate, about.silence
        self.now = self.robot = self.passed = self.elapsed = self.silent = 0.0
        self.fresh, self.forward, self.late = False, False, 0
        self.beat = np.inf  # the watchdog waits for the first cycle
        self._blocks = False
        self._cycles = 0
        self._sampled = self._newest = -np.inf
        self._due = self._last_heard = 0.0

    def start(self) -> None:
        """Start the clock just before the first cycle."""
        self.beat = time.monotonic()
        self.now = self._due = self._last_heard = self.period if self.virtual else self.beat

    def wait(self, state: Callable[[], Sample]) -> Sample:
        """The sample of this cycle, when it is due."""
        before = self.now
        if (
            not self.virtual and not self._blocks and self._cycles >= 4
        ):  # before, it shows whether it waits by itself
            self._due = max(self._due + self.period, self.now)
            time.sleep(max(self._due - time.monotonic(), 0.0))
        start = time.monotonic()
        sample = state()
        self.beat = time.monotonic()
        self._cycles += 1
        self.now = self.now + self.period if self.virtual else self.beat
        self._blocks = self._blocks or self.beat - start > 0.5 * self.period
        self._update(sample.t, self.now - before)
        return sample

    def _update(self, t: float, elapsed: float) -> None:
        first = self._newest == -np.inf
        expected = self.robot + elapsed
        # a stamp that is far off is a glitch or a case for the supervisor: neither path nor rows use it
        sound = first or abs(t - expected) <= self.believed
        self.fresh, self.forward = t != self._sampled, sound and t > self._newest
        between = t - self._newest if sound and (self.virtual or self._blocks) else elapsed
        self.late = 0 if first else max(round(between / self.period) - 1, 0)
        robot = t if self.fresh and sound else expected
        self.passed, self.elapsed = 0.0 if first else max(robot - self.robot, 0.0), elapsed
        self.robot, self._sampled = robot, t
        self._newest = max(self._newest, t) if sound else self._newest
        self._last_heard = self.now if self.fresh else self._last_heard
        self.silent = self.now - self._last_heard


@contextlib.contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Postpone Python's garbage collection, which would delay cycles."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextlib.contextmanager
def _with_priority(about: About) -> Iterator[None]:
    """Real-time priority of this thread and its watchdog, if permitted.

    On a busy computer nearly all cycles of 1 ms would be late without it.
    """
    if about.virtual or sys.platform != "linux" or os.sched_getscheduler(0) != os.SCHED_OTHER:
        yield
        return
    before = os.sched_getparam(0)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, before)


@contextlib.contextmanager
def _watchdog(run: _Run, about: About) -> Iterator[None]:
    """Stop the stream from a separate thread if a call of the loop does not return."""
    if about.virtual:
        yield
        return
    over = threading.Event()
    limit = about.silence + max(4 / about.rate, 2 * LOOKED)

    def look() -> None:
        while not over.wait(LOOKED):
            if time.monotonic() - run.clock.beat > limit and not run.lost:
                run.lost = True
                with contextlib.suppress(Exception):  # the loop reports it when it returns
                    run.stream.stop()

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _is_player(stream: Stream) -> Player:
    """Static check that Streamed is a Player."""
    return Streamed(stream)
