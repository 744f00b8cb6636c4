"""Questions about a log before training: a certain fault is refused, a likely one is a question.

The user answers a question with the name of its check. If accepted, the log is used unchanged; if repaired,
it is corrected and a sentence is added. The journal stores the answers, and they apply to later logs with the
same finding. Commands are judged over all logs of the robot together (`command_decisions`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from etude.abilities import SupportsFileDoubt
from etude.campaign.ingest.command_decisions import Step, decided, ingested_logs
from etude.campaign.record.config import preset_config
from etude.campaign.record.events import Given
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.errors import DataError, UsageError
from etude.logs.checks import exact
from etude.logs.checks.command_units import SCALE
from etude.logs.checks.filtered_motion import Seen, joints
from etude.logs.checks.finding_texts import Doubt, Excludable, Mendable, OfRecorder
from etude.logs.checks.plausibility import (
    REPAIRS,
    judge_motion,
    judge_unit,
    repaired,
)
from etude.logs.cleaning.ranges import check_consistency
from etude.logs.cleaning.repairs import check_commanded
from etude.protocols import Kind, Mean
from etude.types import Channel, Finding, Log

CHECKS = (
    *exact.NAMES,
    *("time", "direction", "degrees", "velocity", "delay", "swapped", "sign", "scale"),
    *("gravity", "zero", "reversed", "gear", "contradiction", "mounting"),
    *("ground", "brake", "jump"),
    *("gyroscope", "accelerometer", "motor_delay"),
)
"""Checks whose findings may be accepted."""


@dataclass(frozen=True)
class Answers:
    """A user's answers to questions.

    Attributes:
        accept, repair: names of checks.
        before: answers that were given with earlier logs of the campaign.
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
        UsageError: there is no such check, or no repair for it.
    """
    for flag, names, checks in (("--accept", accept, CHECKS), ("--repair", repair, tuple(REPAIRS))):
        for check in set(names) - set(checks):
            raise UsageError(
                f"there is no check '{check}'", where=flag, next_step=f"Known: {', '.join(checks)}."
            )
    rounds = sorted(state.rounds.values(), key=lambda r: -r.number)  # the newest answer counts
    before = tuple(answer for r in rounds if r.ingested and not r.abandoned for answer in r.ingested.answers)
    return Answers(tuple(accept), tuple(repair), before)


@dataclass(frozen=True, eq=False)
class LogQuestions:
    """The questions of one log as it is read.

    Attributes:
        steps: decisions on the log's commands, if it was judged with others; None: judged separately.
        earlier: logs that were ingested before, by number.
        used: collects the answers that were used. accepted: collects the accepted findings.
    """

    kind: Kind
    spec: Any
    answers: Answers
    steps: Callable[[Log], Sequence[Step]] | None = None
    earlier: Callable[[], Mapping[int, Log]] = dict
    used: list[Given] = field(default_factory=list)
    accepted: list[Finding] = field(default_factory=list)

    def motion(self, log: Log) -> Log:
        """The log after checks of its clock and of the motion's units; rows in order, ranges not yet checked.

        Raises:
            DataError: a finding is certain, or is an unanswered question.
        """
        expected = self.kind.expected(self.spec)

        def judge(log: Log) -> Sequence[Finding]:
            channels = self.kind.channels(self.spec)
            return judge_motion(log, self.kind.path, channels, expected.limits, expected.rate)

        log = self._settle(log, lambda log: exact.judge_numbers(log, expected.limits))
        log = self._settle(log, judge)
        log = self._settle(log, lambda log: clock_by_file_of(self.kind, self.spec, log))
        velocities = [n for n, c in log.channels.items() if c.derivative_of == self.kind.path]
        check_consistency(log.without(*velocities))
        return log

    def prepared(self, log: Log) -> Log:
        """The same log, before decisions on its commands. Errors as in `motion`."""
        return check_commanded(self.motion(log))

    def whole(self, log: Log) -> Log:
        """The same log after decisions on its commands. Exchanged ones would exceed each other's limits."""
        log = self.prepared(log)
        for step in self._decide_alone(log) if self.steps is None else self.steps(log):
            log = self._apply_step(log, step)
        units: list[Finding] = []

        def judge_units(log: Log) -> Sequence[Finding]:
            units[:] = unit_findings(self.kind, self.spec, log)
            return units

        log = self._settle(log, judge_units)
        by_file = file_findings_of(self.kind, self.spec, log, self.earlier())
        log = self._settle(log, lambda _: by_file)
        notes = [f"{f.sentence} {f.step}" for f in units if f.light == "yellow" and not f.flag]
        return log.repaired(*notes, *(f.sentence for f in by_file if f.light == "yellow" and not f.flag))

    def _decide_alone(self, log: Log) -> Sequence[Step]:
        return decided([log], {}, self.answers.to, *judge_of(self.kind, self.spec))[0]

    def _apply_step(self, log: Log, step: Step) -> Log:
        """The log after one decision. DataError: the decision is an open question."""
        if step.what == "open":
            raise refusal([step.finding], log.source)
        if step.what != "note":
            self._note_answer(step.what, step.finding)
        if step.what == "accept":
            return log.repaired(self._accept(step.finding).sentence)
        return repaired(log, step.finding)

    def cleaned(self, log: Log, *, own: bool = False) -> Log:
        """The cleaned log after the checks of the kind; own: a recording of Étude's. Errors as in `motion`.

        Removes rows of a vehicle on the ground at either end, and rows of an arm whose drives are off, unless
        the user accepted the latter.
        """
        all_findings = checks_of(self.kind, self.spec, log, own=own)
        findings = [f for f in all_findings if f.light in ("red", "yellow")]
        for finding in [f for f in findings if f.light == "red"]:
            if finding.check not in self.answers.accept:
                raise refusal([finding], log.source)
            self._accept(finding)
        idle = [
            f
            for f in findings
            if isinstance(f, Excludable) and f.check not in self.answers.accept and f.spans
        ]
        for finding in idle:
            log = finding.cut(log)
        return log.repaired(*(f.sentence for f in findings if f not in idle))

    def _settle(self, log: Log, check: Callable[[Log], Sequence[Finding]]) -> Log:
        """Apply repairs one at a time, since one fault distorts the next check; then raise open questions."""
        tried: set[str] = set()
        while True:
            open_ = [f for f in check(log) if f.flag or f.light == "red" or _is_free(f)]
            mended = next((f for f in open_ if f.check not in tried and self._repairs(f)), None)
            if mended is None:
                break
            log = repaired(log, mended)
            tried.add(mended.check)
            if not _is_free(mended):
                self._note_answer("repair", mended)
        for finding in [f for f in open_ if (f.flag or _is_free(f)) and self.answers.to(f) == "accept"]:
            self._note_answer("accept", finding)
            log = log.repaired(self._accept(finding).sentence)
            open_.remove(finding)
        questions = [f for f in open_ if not _is_free(f)]
        if questions:
            raise refusal(questions, log.source)
        return log

    def _repairs(self, finding: Finding) -> bool:
        """Whether a finding is repaired: free repairs unless accepted, others only if requested."""
        answer = self.answers.to(finding)
        return answer != "accept" if _is_free(finding) else bool(finding.flag) and answer == "repair"

    def _accept(self, finding: Finding) -> Finding:
        """The finding to be stored with the log after the question was accepted; no question any more."""
        sentence = f"{finding.sentence} Used without a repair, as asked."
        self.accepted.append(Finding(finding.check, "yellow", sentence, spans=finding.spans))
        return self.accepted[-1]

    def _note_answer(self, what: str, finding: Finding) -> None:
        self.used.append((what, *_what(finding)))


def checks_of(kind: Kind, spec: Any, log: Log, *, own: bool) -> list[Finding]:
    """Findings of the checks of the kind of robot; own: a recording of Étude's."""
    return [f for f in kind.checks(spec, log) if not (own and isinstance(f, OfRecorder))]


def questions_of(
    campaign: Campaign, state: State, answers: Answers, steps: Sequence[Step] | None = None
) -> LogQuestions:
    """The questions of a log of a campaign; its commands are judged with those of the logs so far.

    Args:
        steps: earlier decisions on its commands.
    """

    @cache
    def earlier() -> Mapping[int, Log]:
        return ingested_logs(campaign, state)

    def decide(log: Log) -> Sequence[Step]:
        if steps is not None:
            return steps
        return decided([log], earlier(), answers.to, *judge_of(campaign.kind, campaign.spec))[0]

    return LogQuestions(campaign.kind, campaign.spec, answers, decide, earlier)


def _what(finding: Finding) -> tuple[str, tuple[float, ...]]:
    return finding.check, finding.by if isinstance(finding, Doubt) else ()


def _is_free(finding: Finding) -> bool:
    return isinstance(finding, Mendable) and finding.free


def refusal(findings: Sequence[Finding], where: str) -> DataError:
    """All findings against a log as one error."""
    facts = " ".join(f.sentence for f in findings).rstrip(".")
    return DataError(facts, where=where, next_step=" ".join(f.step for f in findings))


def judged_commands(
    kind: Kind | None,
    spec: Any,
    log: Log,
    motion: Seen | None = None,
    earlier: Mapping[int, Log] | None = None,
) -> tuple[Finding, ...]:
    """Findings on the commands of one log: assignment to joints, signs, delay and unit.

    Args:
        kind: None for a robot without a description.
        motion: the filtered motion of the log, if it was computed already.
        earlier: logs of the robot, by number.
    """
    judge = (None, False) if kind is None else judge_of(kind, spec)
    steps, last = decided([log], earlier or {}, lambda _: "", *judge)
    findings = [step.finding for step in steps]
    if any(step.what == "open" for step in steps) or last is None:
        return tuple(findings)
    from etude.logs.evidence.findings import green

    path = joints(log)
    assert path is not None
    by_file = () if kind is None else file_findings_of(kind, spec, log, earlier or {})
    unit = () if kind is None else unit_findings(kind, spec, log, motion)
    checks = {one.check for one in (*findings, *by_file)}
    others = [one for one in (*green(last, path.parts), *unit) if one.check not in checks]
    return (*findings, *others, *by_file)


MADE_UP = (
    "The inertias in the model file look like placeholders, so units and signs are not checked against it."
)


def unit_findings(kind: Kind, spec: Any, log: Log, motion: Seen | None = None) -> tuple[Finding, ...]:
    """The unit of the commands, by a model file; nothing without one, or where they act on no joint."""
    if not any(c.acts_on for c in log.channels.values()) or body_of(kind, spec) is None:
        return ()
    body = judging_body(kind, spec)
    if body is None:
        return (
            Finding(
                SCALE,
                "cannot tell",
                MADE_UP,
                "Correct the masses of the model file, or check signs and units.",
            ),
        )
    finding = judge_unit(log, body, kind.limit(spec), motion)
    return () if finding is None else (finding,)


def clock_by_file_of(kind: Kind, spec: Any, log: Log) -> tuple[Finding, ...]:
    """Findings that times are too long or too short, by the model file; for robots driven by forces."""
    path_body = path_and_body(kind, spec, log)
    if path_body is None:
        return ()
    from etude.logs.evidence.file_hypotheses import clock_by_file

    finding = clock_by_file(log, *path_body)
    return () if finding is None else (finding,)


MOST_BY_FILE = 3  # of the logs that were told, the newest


def file_findings_of(kind: Kind, spec: Any, log: Log, earlier: Mapping[int, Log]) -> tuple[Finding, ...]:
    """Findings of the model file on the log and earlier ones, for robots driven by forces."""
    path_body = path_and_body(kind, spec, log)
    if path_body is None:
        return ()
    from etude.logs.evidence.file_hypotheses import file_findings

    before = [one for one in earlier.values() if joints(one) is not None][-MOST_BY_FILE:]
    return file_findings([*before, log], *path_body, kind.limit(spec))


def path_and_body(kind: Kind, spec: Any, log: Log) -> tuple[Channel, Mean] | None:
    """The positions that commands act on, and the model file's prediction of these commands; None without."""
    path = joints(log)
    body = None if path is None else judging_body(kind, spec)
    return None if path is None or body is None else (path, body)


def body_of(kind: Kind, spec: Any) -> Mean | None:
    """The model file's prediction of the commands; None without a file, or for other units."""
    means = kind.physics(spec, preset_config(kind, "default"))
    return means["nominal"](None) if "nominal" in means else None


def judge_of(kind: Kind, spec: Any) -> tuple[Mean | None, bool]:
    """`judging_body`, and whether there is a file, even one that judges no log."""
    body = judging_body(kind, spec)
    return body, body is not None or body_of(kind, spec) is not None


def judging_body(kind: Kind, spec: Any) -> Mean | None:
    """The same where it may judge a log: None of a file whose masses look like placeholders."""
    if isinstance(kind, SupportsFileDoubt) and kind.made_up(spec):
        return None
    return body_of(kind, spec)
