"""Common parts of all players: start poses, recordings, interruptions by a person."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import FrameType

import numpy as np

from etude.drivers.contract import About, Ended, PlannedMotion, Player, Recording, Sample

STANDS = 1e-3
"""rad or m between the first point and the set-point in force, where the robot says that."""
STANDS_MEASURED = 0.02
"""The same of the measured position, where it does not."""


def why_not(player: Player, motion: PlannedMotion) -> str:
    """Reason why the motion cannot start: limits, a fault, or another start pose; "" if it can."""
    problems = player.check(motion)
    if problems:
        return problems[0]
    try:
        sample = player.where()
    except Exception as error:
        return f"the robot does not report its position: {type(error).__name__}: {error}"
    if sample.fault:
        return f"the robot reports: {sample.fault}"
    stands, near = (sample.q, STANDS_MEASURED) if sample.asked is None else (sample.asked, STANDS)
    off = np.abs(stands - motion.q[0])
    if not np.all(off <= near):
        joint = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        return f"{motion.joints[joint]} is {off[joint]:.3g} away from the first point of the motion"
    return ""


@dataclass
class Interrupt:
    """Called by the person who stops a motion, from any thread or signal handler.

    Attributes:
        why: "" as long as nobody did. killed: at once.
    """

    why: str = ""
    killed: bool = False

    def __call__(self, why: str, kill: bool = False) -> None:
        self.why = self.why or why
        self.killed = self.killed or kill


class RecordedRows:
    """Samples in arrays that are there beforehand; they double for a motion that waits."""

    def __init__(self, length: int, joints: int) -> None:
        self.n = 0
        self.has_qd = True
        self.times = np.full((length, 2), np.nan)  # filled once, since the first access to memory takes time
        self.values = np.full((length, 4, joints), np.nan)
        self.extra: list[Mapping[str, float]] = []

    @property
    def newest(self) -> float:
        """Time of the last row, s of the robot's clock."""
        return float(self.times[self.n - 1, 0]) if self.n else -np.inf

    def add(self, sample: Sample) -> None:
        """Add a sample with `asked` and `at`."""
        if self.n == len(self.times):
            self.times = np.concatenate([self.times, np.empty_like(self.times)])
            self.values = np.concatenate([self.values, np.empty_like(self.values)])
        self.times[self.n] = sample.t, np.nan if sample.at is None else sample.at
        row = self.values[self.n]
        row[0], row[3] = sample.q, sample.asked
        row[1] = np.nan if sample.qd is None else sample.qd
        row[2] = np.nan if sample.command is None else sample.command
        self.has_qd = self.has_qd and sample.qd is not None
        self.extra.append(sample.extra)
        self.n += 1

    def recording(
        self, motion: PlannedMotion, about: About, ended: Ended, reason: str, began: float
    ) -> Recording:
        """The recording so far."""
        times, values = self.times[: self.n].copy(), self.values[: self.n].transpose(1, 0, 2).copy()
        return Recording(
            motion=motion,
            ended=ended,
            reason=reason,
            began=began,
            t=times[:, 0],
            at=times[:, 1],
            q=values[0],
            qd=values[1] if self.has_qd and self.n else None,
            command=values[2],
            asked=values[3],
            reached=float(np.nanmax(times[:, 1])) if self.n else 0.0,
            identity=about.identity,
            command_unit=about.command_unit,
            extra={
                name: np.array([row.get(name, np.nan) for row in self.extra])
                for name in dict.fromkeys(name for row in self.extra for name in row)
            },
        )


def own_arrays(sample: Sample) -> Sample:
    """A copy of the sample, whose arrays the driver does not overwrite."""
    q, qd, command, asked = (
        None if value is None else np.array(value, dtype=float)
        for value in (sample.q, sample.qd, sample.command, sample.asked)
    )
    assert q is not None
    return replace(sample, q=q, qd=qd, command=command, asked=asked)


@contextlib.contextmanager
def interrupts(interrupt: Interrupt) -> Iterator[None]:
    """Ctrl-C and SIGTERM stop the motion; the second one kills, the third one is Python's own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}

    def handle(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        if interrupt.killed:
            raise KeyboardInterrupt
        interrupt(names[signal.Signals(number)], kill=bool(interrupt.why))

    before = {number: signal.signal(number, handle) for number in names}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
