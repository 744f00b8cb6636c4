"""Earlier runs in the journal: the robot's identity, the slow speeds passed by each control, and the measured
tracking errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.campaign.ingest.recordings import is_even
from etude.campaign.record.controls import FEEDBACK, LEARNED
from etude.campaign.record.events import Event, Figures, Ingested, MotionEnded, RunBegan
from etude.campaign.record.folder import Campaign
from etude.drivers import Ended, identity_with, read_recording
from etude.limits.tracking_margins import LOGS_CONSIDERED, factor
from etude.types import Array

FULL = 100  # per cent
CAREFUL = {FEEDBACK: (25, 50, 100), LEARNED: (50,)}
"""Per cent at which the beginning of a motion is run before a whole one under that control."""
FAILED = (Ended.STOPPED.value, Ended.FAULT.value, Ended.LOST.value)


@dataclass(frozen=True)
class SpeedStep:
    """How the next motion under a control is run: speed, per cent, and whether its beginning alone."""

    speed: int
    first: bool


def slowest(control: str) -> int:
    """Per cent of the first beginning of a motion under that control."""
    return CAREFUL.get(control, CAREFUL[FEEDBACK])[0]


def next_step(events: Sequence[Event], control: str) -> SpeedStep:
    """One step up after each motion that ended well, one down after each stopped motion or transfer. The last
    step is a whole motion at full speed.
    """
    steps = [SpeedStep(speed, True) for speed in CAREFUL.get(control, CAREFUL[FEEDBACK])] + [
        SpeedStep(FULL, False)
    ]
    at = 0
    ended = [e.fact for e in events if isinstance(e.fact, MotionEnded)]
    for fact in (fact for fact in ended if fact.control == control):
        if fact.part == "motion" and fact.ended == Ended.DONE.value:
            at = min(at + 1, len(steps) - 1)
        elif fact.ended in FAILED:
            at = max(at - 1, 0)
    return steps[at]


def pending_recordings(campaign: Campaign) -> list[tuple[int, Path]]:
    """Recordings of open proposals that were not ingested, since a run was killed or a log was refused.

    They are of whole motions that ended well. Those with late set-points are left out: their motions run
    again.
    """
    events = campaign.events()
    waiting = {proposal.number for proposal in campaign.state().proposals}
    ingested = {e.fact.sha256 for e in events if isinstance(e.fact, Ingested)}
    recordings = [
        (e.number, campaign.path / e.fact.recording)
        for e in events
        if isinstance(e.fact, MotionEnded) and e.number in waiting and e.fact.recording_sha256 not in ingested
        if e.fact.part == "motion" and _is_whole(e.fact)
    ]
    stored = [(number, path) for number, path in recordings if number is not None and path.is_file()]
    return [(number, path) for number, path in stored if is_even(read_recording(path))]


def last_identity(events: Sequence[Event]) -> str:
    """Identity and payload of the robot of the last run; "" before any run."""
    last = next((e.fact for e in reversed(events) if isinstance(e.fact, RunBegan)), None)
    return "" if last is None else identity_with(last.identity, last.told.get("payload"))


@dataclass(frozen=True, eq=False)
class MeasuredErrors:
    """The largest values (k,) of the last recordings at full speed, and the factor for their number."""

    largest: Array
    factor: float

    @property
    def expected(self) -> Array:
        """(k,) bound that the next motion is expected to meet, computed as for margins."""
        return self.factor * self.largest


def measured_errors(events: Sequence[Event], control: str) -> MeasuredErrors | None:
    """Largest |measured - asked| over time; None before a recording of a whole motion under that control."""
    return _largest([fact.worst_error for fact in _whole_motions(events, control)])


def measured_residuals(events: Sequence[Event], control: str) -> MeasuredErrors | None:
    """As `measured_errors`, for |command - predicted|, means over 0.1 s. Transfers count too: at their start,
    stiction holds the robot anywhere in its band. None before a whole motion.
    """
    of_whole = _largest([fact.residual for fact in _whole_motions(events, control)])
    motions = [e.fact for e in events if isinstance(e.fact, MotionEnded)]
    done = [f.residual for f in motions if f.control == control and f.ended == Ended.DONE.value]
    of_all = _largest(done)
    if of_whole is None or of_all is None:
        return None
    return replace(of_whole, largest=np.maximum(of_whole.largest, of_all.largest))


def _largest(rows: Sequence[Figures]) -> MeasuredErrors | None:
    figures = np.array([row for row in rows if row and None not in row], dtype=float)[-LOGS_CONSIDERED:]
    return MeasuredErrors(figures.max(axis=0), factor(len(figures))) if len(figures) else None


def _motions(events: Sequence[Event], control: str) -> list[MotionEnded]:
    motions = [e.fact for e in events if isinstance(e.fact, MotionEnded)]
    return [fact for fact in motions if fact.part == "motion" and fact.control == control]


def _whole_motions(events: Sequence[Event], control: str) -> list[MotionEnded]:
    """Those at full speed that ended well: a beginning sags less than poses that come later."""
    return [fact for fact in _motions(events, control) if _is_whole(fact)]


def whole_numbers(events: Sequence[Event], control: str) -> list[int]:
    """Numbers of the whole motions that ended well at full speed under that control, oldest first."""
    whole = _whole_motions(events, control)
    numbers = [e.number for e in events if any(e.fact is fact for fact in whole)]
    return list(dict.fromkeys(number for number in numbers if number is not None))


def _is_whole(fact: MotionEnded) -> bool:
    return not fact.first and fact.speed == FULL and fact.ended == Ended.DONE.value
