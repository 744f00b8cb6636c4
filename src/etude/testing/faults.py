"""Faults of robots, to inject into any stream: `Faulty(stream, "frozen", after=1.2)`.

Each fault says how a motion under a supervisor has to end. What a single sample shows is a glitch of the bus,
and must not end it; neither must a pause of 50 ms or a late cycle.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import numpy as np

from etude.drivers import About, Control, Ended, Sample, Stream
from etude.types import Array


@dataclass(frozen=True)
class RobotFault:
    """One of them.

    Attributes:
        words: what is wrong.
        sample: what becomes of the sample of a robot that has it; None: the sample is as it is.
        ends: how a motion may end that it strikes.
        at_once: it is there from the beginning, and not from a time of the motion on.
        strikes: done to the robot when the fault begins: its own attributes and methods are needed for that.
        needs: names of these; a robot without them cannot have the fault.
    """

    words: str
    sample: Callable[[Faulty, Sample], Sample] | None = None
    ends: tuple[Ended, ...] = (Ended.STOPPED,)
    at_once: bool = False
    strikes: Callable[[Faulty], None] | None = None
    needs: tuple[str, ...] = ()


class Faulty:
    """A Stream that has a fault.

    Args:
        stream: the sound robot. fault: one of `FAULTS`.
        after: s after the first set-point at which the fault begins, by the robot's clock.
        joint: that it is of. size: of a push or a jump, in the unit of that.

    Attributes:
        struck: the robot's own time when it began; NaN: not yet.
    """

    def __init__(self, stream: Stream, fault: str, after: float, joint: int = 0, size: float = 1.0) -> None:
        self.stream, self.fault, self.after = stream, FAULTS[fault], after
        self.joint, self.size = joint, size
        self.struck = np.nan
        self.count = 0
        self.frozen: Sample | None = None
        self._began = np.nan
        self._newest = 0.0

    def about(self) -> About:
        return self.stream.about()

    def __enter__(self) -> Self:
        self.stream.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stream.__exit__(kind, error, trace)

    def state(self) -> Sample:
        sample = self.stream.state()
        self._newest = sample.t
        if np.isnan(self.struck) and (self.fault.at_once or sample.t - self._began >= self.after):
            self.struck, self.frozen = sample.t, sample
            if self.fault.strikes is not None:
                self.fault.strikes(self)
        if np.isnan(self.struck):
            return sample
        self.count += 1
        return sample if self.fault.sample is None else self.fault.sample(self, sample)

    def ready(self, control: Control) -> None:
        if self.fault is FAULTS["refused"]:
            raise ConnectionRefusedError("the brakes are on")
        self.stream.ready(control)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        if np.isnan(self._began):
            self._began = self._newest
        if self.fault is FAULTS["send raises"] and not np.isnan(self.struck):
            raise ConnectionResetError("the cable is out")
        self.stream.send(q, qd, qdd, effort)

    def stop(self, kill: bool = False) -> None:
        self.stream.stop(kill)


def _at(values: Array, joint: int, by: float) -> Array:
    changed = np.array(values, dtype=float)
    changed[joint] += by
    return changed


def _frozen(faulty: Faulty, sample: Sample) -> Sample:
    assert faulty.frozen is not None
    return replace(sample, q=faulty.frozen.q, qd=faulty.frozen.qd)


def _silent(span: float) -> Callable[[Faulty, Sample], Sample]:
    def stale(faulty: Faulty, sample: Sample) -> Sample:
        assert faulty.frozen is not None
        return faulty.frozen if sample.t - faulty.struck < span else sample

    return stale


def _on_first_sample(change: Callable[[Faulty, Sample], Sample]) -> Callable[[Faulty, Sample], Sample]:
    return lambda faulty, sample: change(faulty, sample) if faulty.count == 1 else sample


def _jumped(faulty: Faulty, sample: Sample) -> Sample:
    return replace(sample, q=_at(sample.q, faulty.joint, faulty.size))


def _no_number(faulty: Faulty, sample: Sample) -> Sample:
    return replace(sample, q=_at(sample.q, faulty.joint, np.nan))


def _raises(faulty: Faulty, sample: Sample) -> Sample:  # noqa: ARG001
    raise ConnectionResetError("the cable is out")


def _block(faulty: Faulty) -> None:
    faulty.stream.blocked[faulty.joint] = True  # type: ignore[attr-defined]


def _push(faulty: Faulty) -> None:
    faulty.stream.push[faulty.joint] = faulty.size  # type: ignore[attr-defined]


def _stall(faulty: Faulty) -> None:
    faulty.stream.stall(0.02)  # type: ignore[attr-defined]


def _signal(number: signal.Signals) -> Callable[[Faulty], None]:
    return lambda faulty: os.kill(os.getpid(), number)  # noqa: ARG005


_DONE = (Ended.DONE,)
_AT_THE_START = (Ended.REFUSED, Ended.STOPPED)
FAULTS: Mapping[str, RobotFault] = {
    "none": RobotFault("nothing", ends=_DONE),
    "frozen": RobotFault("all encoders are frozen", _frozen),
    "one NaN": RobotFault("one position is no number once", _on_first_sample(_no_number), _DONE),
    "NaN": RobotFault("one position is no number any more", _no_number),
    "one jump": RobotFault("one position is elsewhere once", _on_first_sample(_jumped), _DONE),
    "jump": RobotFault("one position is elsewhere for good", _jumped),
    "permuted": RobotFault(
        "joints are in another order", lambda _, s: replace(s, q=s.q[::-1]), _AT_THE_START, at_once=True
    ),
    "degrees": RobotFault(
        "positions are in degrees", lambda _, s: replace(s, q=np.degrees(s.q)), _AT_THE_START, at_once=True
    ),
    "sign": RobotFault(
        "positions have the other sign", lambda _, s: replace(s, q=-s.q), _AT_THE_START, at_once=True
    ),
    "clock jumps": RobotFault("the clock jumps by 3 s", lambda _, s: replace(s, t=s.t + 3.0)),
    "clock back": RobotFault("the clock goes back by 1 s", lambda _, s: replace(s, t=s.t - 1.0)),
    "clock drifts": RobotFault(
        "the clock runs 30 % fast", lambda own, s: replace(s, t=s.t + 0.3 * (s.t - own.struck))
    ),
    "silence 50 ms": RobotFault("no new sample for 50 ms", _silent(0.05), _DONE),
    "silence 1 s": RobotFault("no new sample for 1 s", _silent(1.0), (Ended.LOST,)),
    "silence": RobotFault("no new sample any more", _silent(np.inf), (Ended.LOST,)),
    "refused": RobotFault("it does not start", ends=(Ended.REFUSED,), at_once=True),
    "reflex": RobotFault("it stops by itself", lambda _, s: replace(s, fault="reflex"), (Ended.FAULT,)),
    "state raises": RobotFault("its state cannot be read", _raises, (Ended.FAULT,)),
    "send raises": RobotFault("set-points cannot be sent", ends=(Ended.FAULT,)),
    "blocked": RobotFault("one joint is blocked", strikes=_block, needs=("blocked",)),
    "push": RobotFault("something soft pushes one joint", strikes=_push, needs=("push",)),
    "20 ms": RobotFault("one cycle takes 20 ms", strikes=_stall, ends=_DONE, needs=("stall",)),
    "SIGINT": RobotFault("Ctrl-C", strikes=_signal(signal.SIGINT), ends=(Ended.INTERRUPTED,)),
    "SIGTERM": RobotFault("SIGTERM", strikes=_signal(signal.SIGTERM), ends=(Ended.INTERRUPTED,)),
}
"""By name. Those with `needs` strike a `FakeRobot`, the others any stream."""
