"""The driver `ros2`: a joint_trajectory_controller by its topics.

The controller plays the whole motion, which starts at a stamp of the robot's clock. A stop is another, short
trajectory, which leaves the first one where both have one position, velocity and acceleration. A topic has
no tolerances and no answer, so the driver compares what the controller follows with what it was sent.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import (
    About,
    Control,
    Ended,
    Interrupt,
    PathInTime,
    PlannedMotion,
    Reaction,
    RecordedRows,
    Recording,
    Sample,
    Stopping,
    Watch,
    acceleration_limits,
    interrupts,
    refusals,
    require_known,
    why_not,
)
from etude.errors import EtudeError, UsageError
from etude.types import Array
from etude_drivers.dds import DdsTopics, JointRow, Points, Topics

STARTS_AFTER = 0.5
"""s from sending a motion to its start, so that the controller has it in time."""
BRANCHES_AFTER = 0.05
"""s from sending a stop to the set-point at which it leaves the motion."""
SETTLES = 0.3
"""s that are recorded after the last set-point that moves."""
MATCHES = 5.0
"""s in which both sides have to know each other."""
FOLLOWS, FOR_S = 0.01, 0.1
"""rad or m, and s, by which what the controller follows may differ from what it was sent."""
KEYS = ("rate", "command_unit", "command_of", "gravity_in_command", "joint_states", "domain", "on_loss")
"""Of the table [driver]."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> Ros2Controller:
    """`--on ros2` or `ros2:CONTROLLER`; [driver] has `KEYS`."""
    controller = address or "joint_trajectory_controller"
    topics = DdsTopics(controller, str(settings.get("joint_states", "joint_states")), _domain(settings))
    return Ros2Controller(joints, controller, settings, topics)


class Ros2Controller:
    """A Player over the topics of a joint_trajectory_controller."""

    def __init__(
        self,
        joints: Sequence[str],
        controller: str,
        settings: Mapping[str, Any],
        topics: Topics,
        real: bool = True,
    ) -> None:
        require_known(settings, KEYS, "ros2")
        self.joints, self.controller, self.settings = tuple(joints), controller, dict(settings)
        self.topics, self.real = topics, real
        self._interrupt: Interrupt | None = None

    def about(self) -> About:
        settings = self.settings
        return About(
            name=f"ROS 2, {self.controller}",
            identity=f"/{self.controller} in domain {_domain(settings)}",
            joints=self.joints,
            rate=float(settings.get("rate", 100.0)),
            command_unit=str(settings.get("command_unit", "N m")),
            command_of=settings.get("command_of"),
            gravity_in_command=settings.get("gravity_in_command"),
            stop_latency=BRANCHES_AFTER,
            on_loss=settings.get("on_loss", "goes on"),  # the controller has the whole motion
            silence=0.2,
            real=self.real,
        )

    def __enter__(self) -> Self:
        self.topics.open(MATCHES)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stop()
        self.topics.close()

    def where(self) -> Sample:
        self.topics.drop()
        sample = self._sample(self.about().silence)
        if sample is None:
            raise EtudeError(
                "no joint states arrive", next_step="Check whether the robot's driver is running."
            )
        reference = self.topics.reference()
        return replace(sample, asked=None if reference is None else self._ordered(reference, reference.q))

    def check(self, motion: PlannedMotion) -> Sequence[str]:
        return refusals(motion, self.about())

    def play(self, motion: PlannedMotion, watch: Watch, control: Control) -> Recording:
        interrupt = self._interrupt = Interrupt()
        run = _Playing(self, motion, watch, interrupt)
        why = "" if control == "feedback" else "the topic accepts no effort"
        why = why or why_not(self, motion)
        try:
            with interrupts(interrupt):
                return run.refused(why) if why else run.play()
        finally:
            self._interrupt = None

    def stop(self, kill: bool = False) -> None:
        """Of a robot that does not move there is nothing to stop."""
        if self._interrupt is not None:
            self._interrupt("stop() was called", kill)

    def _sample(self, wait: float) -> Sample | None:
        row = self.topics.state(wait)
        if row is None:
            return None
        effort = self._ordered(row, row.effort) if len(row.effort) else None
        qd = self._ordered(row, row.qd) if len(row.qd) else None
        return Sample(row.t, self._ordered(row, row.q), effort, qd, seen=self.topics.now())

    def _ordered(self, row: JointRow, values: Array) -> Array:
        """(J,) of the joints by name."""
        at = {name: place for place, name in enumerate(row.names)}
        lacking = [name for name in self.joints if name not in at]
        if lacking:
            raise UsageError(f"no {', '.join(lacking)} among {', '.join(row.names)}", where=self.controller)
        return np.array([values[at[name]] for name in self.joints])


class _Playing:
    """One motion, as the controller plays it."""

    def __init__(
        self, robot: Ros2Controller, motion: PlannedMotion, watch: Watch, interrupt: Interrupt
    ) -> None:
        self.robot, self.motion, self.watch, self.interrupt = robot, motion, watch, interrupt
        self.about = robot.about()
        self.path = PathInTime(motion, self.about.rate)
        self.rows = RecordedRows(int((motion.duration + 3.0) * 1000.0), len(motion.joints))
        self.began = np.nan
        self.stopping: Stopping | None = None
        self.why = Ended.DONE, ""
        self._apart_since = np.inf

    def refused(self, why: str) -> Recording:
        return self.rows.recording(self.motion, self.about, Ended.REFUSED, why, self.began)

    def play(self) -> Recording:
        try:
            self._send()
            while self._cycle():
                pass
        except KeyboardInterrupt:
            self.why = Ended.INTERRUPTED, "Ctrl-C"
        except Exception as error:  # of the supervisor, or of a message: nothing of it may end in motion
            self.why = Ended.FAULT, f"{type(error).__name__}: {error}"
        if self.why[0] is not Ended.DONE and self.stopping is None:
            with contextlib.suppress(Exception):
                self._stop(self.rows.newest)
        recording = self.rows.recording(self.motion, self.about, *self.why, self.began)
        return replace(recording, reached=min(recording.reached, self.motion.duration))

    def _send(self) -> None:
        first = self.robot.where()
        self.began = first.t + STARTS_AFTER
        motion = self.motion
        self.robot.topics.send(Points(self.began, motion.joints, motion.t, motion.q, motion.qd, motion.qdd))

    def _cycle(self) -> bool:
        sample = self.robot._sample(self.about.silence)
        if sample is None:
            self._end(Ended.LOST, f"no joint state for {self.about.silence:g} s", self.rows.newest)
            return False
        at, reference = self._planned_at(sample.t)
        sample = replace(sample, asked=reference, at=at)
        if sample.t > self.rows.newest:
            self.rows.add(sample)
        reaction = self.watch(sample)
        if self.stopping is None:
            self._judge(sample, reaction)
        ends = self.motion.duration if self.stopping is None else self.leaves + self.stopping.span
        return sample.t - self.began < ends + SETTLES

    def _judge(self, sample: Sample, reaction: Reaction) -> None:
        if self.interrupt.why:
            self._end(Ended.INTERRUPTED, self.interrupt.why, sample.t)
        elif reaction is not Reaction.GO:
            held = reaction is Reaction.HOLD
            self._end(Ended.STOPPED, "the controller cannot be held" if held else "", sample.t)
        elif self._does_not_follow(sample):
            self._end(Ended.FAULT, "the controller does not follow the motion that was sent", sample.t)

    def _end(self, ended: Ended, reason: str, t: float) -> None:
        self.why = ended, reason
        if self.stopping is None:
            self._stop(t)

    def _stop(self, t: float) -> None:
        """Leaves the motion a little later than t, where both trajectories agree."""
        self.leaves = min(max(t - self.began + BRANCHES_AFTER, 0.0), self.motion.duration)
        self.stopping = Stopping(self.path.at(self.leaves), acceleration_limits(self.motion, self.about))
        times = np.append(np.arange(0.0, self.stopping.span, 1.0 / self.about.rate), self.stopping.span)
        points = [self.stopping.at(float(u)) for u in times]
        q, qd, qdd = (np.array([getattr(point, name) for point in points]) for name in ("q", "qd", "qdd"))
        self.robot.topics.send(Points(self.began + self.leaves, self.motion.joints, times, q, qd, qdd))

    def _planned_at(self, t: float) -> tuple[float, Array]:
        """(trajectory time, set-point) that is in force at a time of the robot's clock."""
        s = t - self.began
        if self.stopping is not None and s > self.leaves:
            return self.leaves, self.stopping.at(s - self.leaves).q
        s = min(max(s, 0.0), self.motion.duration)
        return s, self.path.at(s).q

    def _does_not_follow(self, sample: Sample) -> bool:
        """Whether the reference that the controller reports has differed for long."""
        reference = self.robot.topics.reference()
        if reference is None:
            return False
        _, planned = self._planned_at(reference.t)
        apart = np.abs(self.robot._ordered(reference, reference.q) - planned).max() > FOLLOWS
        self._apart_since = min(self._apart_since, sample.t) if apart else np.inf
        return sample.t - self._apart_since > FOR_S


def _domain(settings: Mapping[str, Any]) -> int:
    return int(settings.get("domain", os.environ.get("ROS_DOMAIN_ID", "0")))
