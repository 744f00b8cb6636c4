"""What a log is asked before it is learned: what is false is refused, what is likely is a question.

A question is answered by its check's name: accepted, the log is taken as it is; repaired, it is put right
with a sentence. Answers stand in the journal, and hold for later logs of which the same is found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from etude.campaign.record.config import preset_config
from etude.campaign.record.events import Given
from etude.campaign.record.state import State
from etude.errors import DataError, UsageError
from etude.logs.checks import exact
from etude.logs.checks.filtered_motion import Seen
from etude.logs.checks.finding_texts import Excludable, Mendable
from etude.logs.checks.plausibility import (
    REPAIRS,
    judge_commands,
    judge_motion,
    repaired,
)
from etude.logs.cleaning.ranges import check_consistency
from etude.logs.cleaning.repairs import check_commanded
from etude.protocols import Kind, Mean
from etude.types import Finding, Log

CHECKS = (
    *exact.NAMES,
    *("time", "direction", "degrees", "velocity", "swapped", "sign", "scale", "gravity"),
    *("ground", "brake", "jump"),
    *("gyroscope", "accelerometer", "motor_delay"),
)
"""What may be accepted."""


@dataclass(frozen=True)
class Answers:
    """What a user says to questions.

    Attributes:
        accept, repair: names of checks.
        before: answers that earlier logs of the campaign were told with.
    """

    accept: tuple[str, ...] = ()
    repair: tuple[str, ...] = ()
    before: tuple[Given, ...] = ()

    def to(self, finding: Finding) -> str:
        """ "accept", "repair" or "": not answered."""
        if finding.check in self.accept:
            return "accept"
        if finding.check in self.repair:
            return "repair"
        return next((what for what, check, by in self.before if (check, by) == _what(finding)), "")


def answers_of(state: State, accept: Sequence[str], repair: Sequence[str]) -> Answers:
    """The answers given now, and those in the journal.

    Raises:
        UsageError: there is no such check, or nothing repairs it.
    """
    for flag, given, known in (("--accept", accept, CHECKS), ("--repair", repair, tuple(REPAIRS))):
        for check in set(given) - set(known):
            raise UsageError(
                f"there is no check '{check}'", where=flag, next_step=f"Known: {', '.join(known)}."
            )
    rounds = sorted(state.rounds.values(), key=lambda r: -r.number)  # the newest answer counts
    before = tuple(own for r in rounds if r.ingested and not r.abandoned for own in r.ingested.answers)
    return Answers(tuple(accept), tuple(repair), before)


@dataclass(frozen=True, eq=False)
class LogQuestions:
    """The questions of one log as it is read.

    Attributes:
        given: collects the answers that were of use. accepted: what was found and is taken as it is.
    """

    kind: Kind
    spec: Any
    answers: Answers
    given: list[Given] = field(default_factory=list)
    accepted: list[Finding] = field(default_factory=list)

    def motion(self, log: Log) -> Log:
        """The log whose clock and the motion's units are settled; rows in order, ranges not yet looked at.

        Raises:
            DataError: what is found is certain, or a question that nobody answered.
        """
        known = self.kind.expected(self.spec)

        def judged(log: Log) -> Sequence[Finding]:
            channels = self.kind.channels(self.spec)
            return judge_motion(log, self.kind.path, channels, known.limits, known.rate)

        log = self._settled(log, lambda log: exact.judge_numbers(log, known.limits))
        log = self._settled(log, judged)
        velocities = [n for n, c in log.channels.items() if c.derivative_of == self.kind.path]
        check_consistency(log.without(*velocities))
        return log

    def whole(self, log: Log) -> Log:
        """The same with its commands settled, before exchanged ones exceed each other's limits."""
        moved = check_commanded(self.motion(log))
        return self._settled(moved, lambda log: judged_commands(self.kind, self.spec, log))

    def cleaned(self, log: Log) -> Log:
        """The cleaned log with what the kind looks for. Errors as in `motion`.

        What a vehicle does on the ground at either end is cut, and where an arm's drives are off, unless that
        was accepted.
        """
        found = [f for f in self.kind.checks(self.spec, log) if f.light in ("red", "yellow")]
        for finding in [f for f in found if f.light == "red"]:
            if finding.check not in self.answers.accept:
                raise refusal([finding], log.source)
            self._taken(finding)
        idle = [
            f for f in found if isinstance(f, Excludable) and f.check not in self.answers.accept and f.spans
        ]
        for finding in idle:
            log = finding.cut(log)
        return log.repaired(*(f.sentence for f in found if f not in idle))

    def _settled(self, log: Log, judged: Callable[[Log], Sequence[Finding]]) -> Log:
        """Repairs what is to be, one finding at a time, since one spoils the next; then asks the rest."""
        tried: set[str] = set()
        while True:
            open_ = [f for f in judged(log) if f.flag or f.light == "red" or _is_free(f)]
            mended = next((f for f in open_ if f.check not in tried and self._repairs(f)), None)
            if mended is None:
                break
            log = repaired(log, mended)
            tried.add(mended.check)
            if not _is_free(mended):
                self._note("repair", mended)
        for finding in [f for f in open_ if (f.flag or _is_free(f)) and self.answers.to(f) == "accept"]:
            self._note("accept", finding)
            log = log.repaired(self._taken(finding).sentence)
            open_.remove(finding)
        asked = [f for f in open_ if not _is_free(f)]
        if asked:
            raise refusal(asked, log.source)
        return log

    def _repairs(self, finding: Finding) -> bool:
        """Whether a finding is repaired: unasked unless accepted, or as the answer says."""
        answer = self.answers.to(finding)
        return answer != "accept" if _is_free(finding) else bool(finding.flag) and answer == "repair"

    def _taken(self, finding: Finding) -> Finding:
        """What stays beside the log of a question that was answered so: news, but no question any more."""
        sentence = f"{finding.sentence} Taken as it is, as asked."
        self.accepted.append(Finding(finding.check, "yellow", sentence, spans=finding.spans))
        return self.accepted[-1]

    def _note(self, what: str, finding: Finding) -> None:
        self.given.append((what, *_what(finding)))


def _what(finding: Finding) -> tuple[str, tuple[float, ...]]:
    return finding.check, finding.by if isinstance(finding, Mendable) else ()


def _is_free(finding: Finding) -> bool:
    return isinstance(finding, Mendable) and finding.free


def refusal(found: Sequence[Finding], where: str) -> DataError:
    """All that speaks against a log as one error."""
    facts = " ".join(f.sentence for f in found).rstrip(".")
    return DataError(facts, where=where, next_step=" ".join(f.step for f in found))


def judged_commands(kind: Kind, spec: Any, log: Log, motion: Seen | None = None) -> tuple[Finding, ...]:
    """The truth tests of the commands, with the model file's word where there is one for forces."""
    if not any(c.acts_on for c in log.channels.values()):
        return ()
    return judge_commands(log, body_of(kind, spec), kind.limit(spec), motion)


def body_of(kind: Kind, spec: Any) -> Mean | None:
    """What the model file says of the commands by itself; None without one, or for other units."""
    found = kind.physics(spec, preset_config(kind, "default"))
    return found["nominal"](None) if "nominal" in found else None
