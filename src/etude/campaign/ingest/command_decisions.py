"""Decisions on the commands of new logs, taken together with the commands of earlier logs.

Findings are treated one after the other: repaired logs are judged again, until there is no finding or a
question is open. A decision applies to all logs that it concerns, or to none: if one of them was learned
already, nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_models import stored_log
from etude.errors import EtudeError
from etude.logs.checks.filtered_motion import joints
from etude.logs.checks.finding_texts import Doubt, Mendable
from etude.logs.checks.plausibility import repaired
from etude.protocols import Mean
from etude.types import Channel, Finding, Log

if TYPE_CHECKING:
    from etude.logs.evidence.joint_evidence import Decision

MOST_INGESTED, MOST_NEW = 12, 48
"""Logs that are judged together: the newest ingested ones, and the first new ones."""
ROUNDS = 8  # of repairs, each of which is judged again
FORCES = ("N m", "N")
Answer = Callable[[Finding], str]


@dataclass(frozen=True)
class Step:
    """One decision on the commands: a finding and its outcome. logs: the new ones that it concerns."""

    what: Literal["note", "repair", "accept", "open"]
    finding: Finding
    logs: frozenset[int]


def decided(
    new: Sequence[Log], earlier: Mapping[int, Log], answer: Answer, body: Mean | None, described: bool
) -> tuple[list[Step], Decision | None]:
    """The steps of new logs, and the last decision; none where commands act on no joint.

    Args:
        new: new logs, after repairs of their motion. earlier: logs by number, as they are stored.
        answer: "accept", "repair" or "" to a finding.
        body: commands predicted by the model file alone.
        described: whether there is a file, even one that judges no commands.
    """
    path = joints(new[0]) if new else None
    if path is None:
        return [], None
    from etude.logs.evidence.command_signs import sign_decision
    from etude.logs.evidence.contradictions import CONTRADICTS
    from etude.logs.evidence.findings import finding_of

    numbers = [number for number, log in earlier.items() if joints(log) is not None]
    old = [earlier[number] for number in numbers]
    logs, sources = list(new), [*(f"log {n}" for n in numbers), *(log.source for log in new)]
    force = all(unit in FORCES for c in new[0].channels.values() if c.acts_on for unit in c.units)
    fresh = range(len(old), len(old) + len(new))
    steps: list[Step] = []
    for _ in range(ROUNDS):
        accepted = {step.finding.check for step in steps if step.what == "accept"}
        decision = sign_decision(
            [*old, *logs], path, body, fresh=fresh, force=force, accepted=accepted, described=described
        )
        changes = [] if CONTRADICTS in accepted else _changes(logs, path, body, answer, decision)
        steps += changes
        if any(step.what == "open" for step in changes):
            return steps, decision if decision.level == "silent" else None
        if changes:
            continue
        if decision.level == "silent":
            return steps, decision
        finding = finding_of(decision, path.parts, sources, old)
        indices = frozenset(i - len(old) for i in decision.logs if i >= len(old))
        if not indices and isinstance(finding, Doubt):  # the answer concerns these logs, not their contents
            finding = replace(finding, by=(*finding.by, *(float(numbers[i]) for i in decision.logs)))
        is_repeated = any(step.finding == finding for step in steps)
        whole = len(indices) == len(decision.logs) and isinstance(finding, Mendable)
        what = "open" if is_repeated else _outcome_of(decision, answer(finding), whole)
        steps.append(Step(what, finding, indices or frozenset(range(len(new)))))
        if what == "open":
            return steps, decision
        if what != "accept":
            logs = [repaired(log, finding) if i in indices else log for i, log in enumerate(logs)]
    return steps, decision


def _changes(
    logs: Sequence[Log], path: Channel, body: Mean | None, answer: Answer, decision: Decision
) -> list[Step]:
    """Steps of what changes within single logs, where it explains more than the decision on whole logs.

    Of two robots or loads only logs tell whose order, signs and clock are right.
    """
    from etude.logs.evidence.contradictions import change_finding, change_within

    steps = []
    for i, log in enumerate(logs):
        change = change_within(log, path, body)
        if (
            change is None
            or change.odds <= decision.odds
            or (decision.level != "silent" and change.kind != "sign")
        ):
            continue
        finding = change_finding(change, log, path.parts)
        what: Literal["accept", "open"] = "accept" if answer(finding) == "accept" else "open"
        steps.append(Step(what, finding, frozenset({i})))
    return steps


def _outcome_of(decision: Decision, answer: str, whole: bool) -> Literal["note", "repair", "accept", "open"]:
    """Outcome of a decision. whole: a repair corrects every log that the decision concerns."""
    if decision.level == "note":
        return "accept" if answer == "accept" else "note"
    if answer == "repair" and not whole:
        return "open"
    return "repair" if answer == "repair" else "accept" if answer == "accept" else "open"


def ingested_logs(campaign: Campaign, state: State) -> dict[int, Log]:
    """The newest ingested logs, by number; damaged ones are left out, and training reports them."""
    if not any(c.acts_on for c in campaign.channels):
        return {}
    logs = {}
    for ingested in state.ingested[-MOST_INGESTED:]:
        try:
            logs[ingested.number] = stored_log(campaign, ingested.number)
        except EtudeError:
            continue
    return logs


@dataclass(frozen=True, eq=False)
class Survey:
    """Files that are ingested together, checked before any of them is stored.

    Attributes:
        logs: by file, after repairs of their motion. earlier, answer, body, described: as in `decided`.
    """

    logs: Mapping[Path, Log]
    earlier: Mapping[int, Log]
    answer: Answer
    body: Mean | None
    described: bool

    @cached_property
    def _steps(self) -> list[Step]:
        steps = decided(list(self.logs.values()), self.earlier, self.answer, self.body, self.described)[0]
        odd = None if any(step.what == "open" for step in steps) else self._contradiction(steps)
        if odd is None:
            return steps
        what: Literal["accept", "open"] = "accept" if self.answer(odd) == "accept" else "open"
        return [*steps, Step(what, odd, frozenset(range(len(self.logs))))]

    def _contradiction(self, steps: Sequence[Step]) -> Finding | None:
        """Finding if the repaired logs are not of one robot."""
        logs = [self._put_right(i, log, steps) for i, log in enumerate(self.logs.values())]
        path = joints(logs[0]) if len(logs) > 1 else None
        if path is None:
            return None
        from etude.logs.evidence.contradictions import contradiction, contradiction_without_file

        sources = [log.source for log in logs]
        if self.body is None:
            return contradiction_without_file(logs, path, sources)
        return contradiction(logs, path, self.body, sources)

    @staticmethod
    def _put_right(number: int, log: Log, steps: Sequence[Step]) -> Log:
        for step in steps:
            if number in step.logs and step.what in ("note", "repair"):
                log = repaired(log, step.finding)
        return log

    def of(self, path: Path) -> list[Step]:
        """The steps of one of the files; for any other file, the steps common to all."""
        paths = list(self.logs)
        if path in self.logs:
            return [step for step in self._steps if paths.index(path) in step.logs]
        return [step for step in self._steps if len(step.logs) == len(paths)]
