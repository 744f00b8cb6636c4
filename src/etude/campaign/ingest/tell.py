"""tell: ingest of one or many logs at any time. Each is stored or refused separately, and all are learned
in one training. untell and abandon undo this."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack, overload

import numpy as np

from etude.campaign.ingest.command_decisions import MOST_NEW, Survey, ingested_logs
from etude.campaign.ingest.confirmation_runs import check_may_teach, take_run
from etude.campaign.ingest.ingest_result import (
    How,
    IngestResult,
    answered_proposal,
    read,
    read_settled,
)
from etude.campaign.ingest.questions import Answers, LogQuestions, answers_of, judge_of, questions_of
from etude.campaign.ingest.recordings import Evidence, evidence_in, placed
from etude.campaign.ingest.robot_changed import answer, change_of_robot
from etude.campaign.propose.constraints import start_in_words, with_tracking_errors
from etude.campaign.record.controls import required
from etude.campaign.record.events import Abandoned, Ingested, Untold
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.state import Round, State
from etude.campaign.record.stored_files import (
    FULL,
    require_description,
    stored_trajectory,
    take_up,
)
from etude.campaign.record.stored_models import mixed, stored_log
from etude.campaign.training import Learner, learn_pending
from etude.codes import Notice
from etude.deploy.trajectory_files import PLANNED
from etude.errors import DataError, EtudeError, UsageError, typed
from etude.logs.alignment.alignment import holds_enough
from etude.logs.cleaning.filters import median_rate
from etude.logs.columns.units import start_at_zero
from etude.logs.readers.log_file import bytes_of_log, log_bytes, sha256_of_log
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.trajectories.chain import segment_starts
from etude.types import Array, Finding, Log


def tell_one(
    campaign: Campaign,
    path: Path,
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestResult:
    """Store the log in `path` and learn it; also learn pending logs of an interrupted run.

    A log whose robot differs from that of the model in use is stored, but not learned until `changed` gives
    an answer, now or later.

    Args:
        campaign: the folder.
        path: the log file; recognised by its content if it was ingested before under any name.
        number: the proposal that was run; otherwise the newest open one that matches the motion.
        changed: the answer to whether the robot has changed: "new" learns only from this log and later ones,
            "forget" excludes it, "same" learns it with the others; "": no answer.
        learner: training function, replaced only in tests.
        say: receives one sentence per step.
        how: see `How`.

    Raises:
        DataError: the log cannot be used, is of another trajectory, or raises an unanswered question; nothing
            is stored.
        UsageError: there is no such proposal, it has a log already, or there is no such check.
    """
    with campaign.writing():
        ingested = take(campaign, Path(path), number, **how)
        return finished(campaign, [ingested], changed, learner, say)[0]


def finished(
    campaign: Campaign, ingested: Sequence[IngestResult], changed: str, learner: Learner | None, say: Say
) -> list[IngestResult]:
    """The same results after recording the answer and one training. The caller holds the lock."""
    if changed:
        answer(campaign, campaign.state(), changed, [one.number for one in ingested])
    done = tuple(learn_pending(campaign, learner, say))
    if ingested or done:
        take_up(campaign)
    state = campaign.state()
    waiting, warnings = {r.number for r in state.awaiting_answer}, newest_warnings(campaign, state)
    excluded = {number for number, r in state.rounds.items() if r.excluded}
    return [
        replace(
            one,
            learned=done,
            warnings=warnings,
            awaits_answer=one.number in waiting,
            excluded=one.number in excluded,
        )
        for one in ingested
    ]


def check_same_number(earlier: Round, number: int | None, path: Path) -> None:
    if number is not None and number != earlier.number:
        raise UsageError(
            f"this log was ingested before, as the answer to trajectory {earlier.number}, not {number}",
            where=str(path),
            next_step=f"To remove it: etude untell FOLDER {earlier.number}.",
        )


def check_answerable(state: State, number: int) -> None:
    proposal = state.rounds.get(number)
    if proposal is None or proposal.asked is None:
        proposals = ", ".join(str(r.number) for r in state.rounds.values() if r.asked) or "none"
        raise UsageError(f"there is no trajectory {number}", next_step=f"Asked for: {proposals}.")
    if proposal.confirms:
        raise UsageError(
            f"trajectory {number} is a confirmation motion, which is never used for training",
            next_step="State the run of the log: --confirm without, or --confirm with.",
        )
    if proposal.weighs:
        raise UsageError(
            f"trajectory {number} is a payload motion, which is never used for training",
            next_step="Use its log with: etude payload FOLDER --log LOG.",
        )
    if proposal.ingested is not None and not proposal.abandoned:
        raise UsageError(
            f"trajectory {number} has a log already",
            next_step=f"To replace it: etude untell FOLDER {number}, then etude tell the new log.",
        )


def free_number(state: State, number: int | None) -> int:
    if number is None:
        return state.next_number
    if number in state.rounds:
        raise UsageError(
            f"number {number} is taken", next_step=f"The next free number is {state.next_number}."
        )
    return number


CHECK = "repeats"
ALREADY_VISITED = 0.05
"""Fraction of the range of a planned position, velocity or acceleration within which two states count as
equal: the shortest initial length scale of a process with such inputs is five times as long."""
SHARE = 0.8
"""Fraction of equal states above which a log repeats another one."""
MOST_COMPARED = 50
"""Number of logs that a new one is compared with: reading thousands would take as long as learning."""
COMPARED_HZ = 25.0  # rows a second are enough to tell two motions apart


def repeated(campaign: Campaign, state: State, number: int, log: Log) -> tuple[int, float] | None:
    """The earlier log that this one repeats most, and the fraction; None if it repeats none of the last
    `MOST_COMPARED`.

    Planned states are compared, since a different tracking error makes no different motion. A log without a
    plan counts as a different motion.
    """
    states = planned_states(campaign, log)
    if states is None:
        return None
    shares: list[tuple[float, int]] = []
    for other in state.ingested[-MOST_COMPARED:]:
        other_states = None if other.number == number else _stored_states(campaign, other.number)
        if other_states is not None and other_states.shape[1] == states.shape[1]:
            shares.append((share_within(states, other_states), other.number))
    share, earlier = max(shares, key=lambda pair: (pair[0], -pair[1]), default=(0.0, 0))
    return (earlier, share) if share > SHARE else None


def _stored_states(campaign: Campaign, number: int) -> Array | None:
    """Planned states of an ingested log; None if its file is damaged, which training reports."""
    try:
        return planned_states(campaign, stored_log(campaign, number))
    except EtudeError:
        return None


def share_within(states: Array, reference: Array) -> float:
    """Fraction of the states (n, D) within 1 of one of the known states (m, D) in every coordinate."""
    from scipy.spatial import cKDTree

    if not len(states) or not len(reference):
        return 0.0
    distance, _ = cKDTree(reference).query(states, p=math.inf, distance_upper_bound=1.0)
    return float(np.mean(np.isfinite(distance)))


def planned_states(campaign: Campaign, log: Log) -> Array | None:
    """(n, D) planned path and rates during motion, scaled so that 1 counts as near; None without a plan."""
    name = campaign.kind.path + PLANNED
    limits = campaign.kind.expected(campaign.spec).limits
    columns: list[Array] = []
    while name in log:
        values = log[name]
        lower, upper = limits.get(name.removesuffix(PLANNED), (values.min(axis=0), values.max(axis=0)))
        columns.append(values / np.maximum(ALREADY_VISITED * (upper - lower), np.finfo(float).tiny))
        name = next((c.name for c in log.channels.values() if c.derivative_of == name), "")
    if not columns:
        return None
    step = max(1, round(median_rate(log.t) / COMPARED_HZ))
    moving = np.any(np.abs(np.concatenate(columns[1:] or columns, axis=1)) > 0.0, axis=1)
    return np.concatenate(columns, axis=1)[moving][::step]


def warning(earlier: int, share: float) -> Finding:
    """The finding that the log repeats an earlier one."""
    return Finding(
        CHECK,
        "yellow",
        f"it repeats log {earlier}: {100 * share:.0f} % of its planned states are in that log. It adds "
        "little to training, and nothing to cross-validation",
        "Run another motion, as etude ask proposes it.",
    )


@threads_for(0)
def take(
    campaign: Campaign,
    path: Path,
    number: int | None = None,
    survey: Survey | None = None,
    **how: Unpack[How],
) -> IngestResult:
    """Store the log in `path` without training. The caller holds the lock. Errors as `tell`.

    Args:
        survey: of the files that are ingested with it.
    """
    digest = sha256_of_log(path)
    state = campaign.state()
    require_description(campaign)
    if how.get("confirm"):
        return take_run(campaign, state, path, digest, number, how)
    earlier = state.round_of_log(digest)
    if earlier is not None:
        check_same_number(earlier, number, path)
        before = earlier.ingested
        repairs, findings = (before.repairs, before.findings) if before else ((), ())
        return IngestResult(earlier.number, True, earlier.asked is None, repairs, (), findings=findings)
    evidence = evidence_in(campaign, path)
    control = how.get("control", "") or ("" if evidence is None else evidence.control)
    required(control)
    answers = answers_of(state, how.get("accept", ()), how.get("repair", ()))
    questions = questions_of(campaign, state, answers, None if survey is None else survey.of(path))
    log, number, answers_it, speed = _align(campaign, state, path, number, evidence, questions, how)
    group = np.zeros(len(log), dtype=np.int64)  # a log without samples is refused
    samples = campaign.kind.samples(campaign.spec, campaign.config, [log], [group])
    change, repeat = change_of_robot(campaign, state, log, samples), repeated(campaign, state, number, log)
    warnings = (change, None if repeat is None else warning(*repeat))
    findings = (*questions.accepted, *(one for one in warnings if one is not None))
    fact = Ingested(
        sha256=digest,
        source=path.name,
        robot_seconds=_seconds(log),
        rows=len(log),
        repairs=log.repairs,
        foreign=not answers_it,
        speed=speed,
        answers=tuple(questions.used),
        findings=findings,
        repeats=None if repeat is None else repeat[0],
    )
    if answers_it:
        fact = _with_motion(campaign, number, log, fact, control)
    _store(campaign, number, log, path, fact)
    start = start_in_words(campaign, fact)
    return IngestResult(number, False, not answers_it, log.repairs, (), findings=findings, start=start)


def _align(
    campaign: Campaign,
    state: State,
    path: Path,
    number: int | None,
    evidence: Evidence | None,
    questions: LogQuestions,
    how: How,
) -> tuple[Log, int, bool, int]:
    """The aligned log in `path`, its number, whether it answers that proposal, and its speed in percent."""
    log = read(
        campaign, path, degrees=how.get("degrees", False), topics=how.get("topics", ()), questions=questions
    )
    if evidence is not None:
        log, answered = placed(campaign, evidence, log)
        speed, number = FULL, None
        if answered is not None:
            check_answerable(state, answered)
    else:
        log, answered, speed = _identify(campaign, state, path, number, how.get("foreign", False), log)
    if answered is None:
        return log, free_number(state, number), False, speed
    if holds_enough(log, stored_trajectory(campaign, answered, speed).duration):
        return log, answered, True, speed
    log = log.repaired(
        f"The log holds less than half of proposal {answered}, which stays open: run it again, or close it "
        f"with etude abandon {typed(campaign.path)} {answered}."
    )
    return log, free_number(state, None), False, speed


def newest_warnings(campaign: Campaign, state: State) -> tuple[Notice, ...]:
    """Warnings of the newest training, and a warning if it learned from two robots."""
    warnings = state.newest.warnings if state.newest else ()
    return (*warnings, *mixed(campaign, state))


def _identify(
    campaign: Campaign, state: State, path: Path, number: int | None, foreign: bool, log: Log
) -> tuple[Log, int | None, int]:
    """The aligned log, its proposal (None: no proposal), and the speed of the run."""
    refused: DataError | None = None
    if number is not None and not foreign:
        check_answerable(state, number)
    try:
        answered = None if foreign else answered_proposal(campaign, state, log, number)
    except DataError as error:
        answered, refused = None, error
    if answered is not None:
        return answered
    if number is None or foreign:
        check_may_teach(campaign, state, log, path)
    if refused is None or (number is None and not state.proposals):
        return start_at_zero(log), None, FULL
    raise refused


def _with_motion(campaign: Campaign, number: int, log: Log, fact: Ingested, control: str) -> Ingested:
    """The fact with the starts of the log's segments, its control, and its deviation from the plan."""
    trajectory = stored_trajectory(campaign, number, fact.speed)
    starts = segment_starts(trajectory)
    fact = replace(fact, segments=tuple(starts)) if len(starts) > 1 else fact
    return with_tracking_errors(campaign, number, log, trajectory, fact, control)


def _store(campaign: Campaign, number: int, log: Log, path: Path, fact: Ingested) -> None:
    """Writes the cleaned log and its origin, then commits the fact."""
    _keep_earlier(campaign, number)
    write_atomic(campaign.run_file(number), log_bytes(replace(log, source=path.name)))
    origin = {
        "path": str(path.resolve()),
        "sha256": fact.sha256,
        "bytes": bytes_of_log(path),
        "repairs": list(log.repairs),
    }
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in origin.items())
    write_atomic(campaign.source_file(number), text.encode())
    files = [campaign.run_file(number), campaign.source_file(number)]
    campaign.commit(fact, number, files)


def _keep_earlier(campaign: Campaign, number: int) -> None:
    """Copy the files of a retracted log, before another log of that number overwrites them."""
    before = campaign.state().rounds.get(number)
    for path in (campaign.run_file(number), campaign.source_file(number)):
        if before is not None and path.exists():
            content = path.read_bytes()
            write_atomic(path.with_name(f"{hashlib.sha256(content).hexdigest()[:12]}.{path.name}"), content)


def _seconds(log: Log) -> float:
    """Recorded motion, s, without rows before the start."""
    moving = log.t[log.t >= 0.0]
    return float(moving[-1] - moving[0]) if len(moving) else 0.0


def untell(
    campaign: Campaign, number: int, *, learner: Learner | None = None, say: Say = lambda _: None
) -> bool:
    """Retract the log of `number` by an event, delete nothing, and train the model without it.

    A proposal waits for its log again; use `abandon` to close it. A retracted log can be ingested again like
    a new one. Returns False if it was retracted before.

    Raises:
        UsageError: there is no such number, or it has no log.
        DataError, NumericalError: the remaining logs cannot be learned together; they wait.
    """
    with campaign.writing():
        before = campaign.round(number)
        if before.ingested is None and not before.untold:
            raise UsageError(
                f"no log of trajectory {number} was ingested",
                where=str(campaign.path),
                next_step=f"To close the trajectory: etude abandon {typed(campaign.path)} {number}.",
            )
        if before.ingested is not None:
            campaign.commit(Untold(sha256=before.ingested.sha256), number)
        learn_pending(campaign, learner, say)
        return before.ingested is not None


def abandon(
    campaign: Campaign, number: int, *, learner: Learner | None = None, say: Say = lambda _: None
) -> bool:
    """Abandon trajectory `number`; if its log was learned, the model is trained again without it.

    The files stay. Ingesting a log of it later reverts this. Returns False if it was abandoned before.

    Raises:
        UsageError: there is no such trajectory.
    """
    with campaign.writing():
        before = campaign.round(number)
        if not before.abandoned:
            campaign.commit(Abandoned(had_log=before.ingested is not None), number)
        learn_pending(campaign, learner, say)
        return not before.abandoned


@dataclass(frozen=True)
class IngestedFile:
    """Result for one of several files: `ingested`, or the error by which it was refused."""

    path: Path
    ingested: IngestResult | None
    refused: DataError | None = None

    @property
    def sentence(self) -> str:
        """For a table."""
        if self.ingested is None:
            assert self.refused is not None
            return f"refused: {self.refused.fact}"
        if self.ingested.run:
            return f"run {self.ingested.run} the feedforward of {self.ingested.number}, not learned"
        first = (
            "ingested before"
            if self.ingested.repeated
            else "foreign"
            if self.ingested.foreign
            else "answered"
        )
        number = (
            f"{first} {self.ingested.number}"
            if first == "answered"
            else f"{first}, as {self.ingested.number}"
        )
        excluded = "; set aside" if self.ingested.excluded else ""
        return number + ("; waits for an answer" if self.ingested.awaits_answer else excluded)


@dataclass(frozen=True)
class IngestedMany:
    """Result for several files.

    Attributes:
        files: in the order in which they were given, each file once.
        learned: numbers of the logs that were learned now, in one training.
        warnings: of that training.
    """

    files: tuple[IngestedFile, ...]
    learned: tuple[int, ...]
    warnings: tuple[Notice, ...]

    @property
    def refused(self) -> tuple[IngestedFile, ...]:
        return tuple(file for file in self.files if file.ingested is None)


@overload
def tell(  # type: ignore[overload-overlap]  # a str is a Sequence[str], and means one file
    campaign: Campaign,
    path: str | Path,
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestResult: ...


@overload
def tell(
    campaign: Campaign,
    path: Sequence[str | Path],
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestedMany: ...


def tell(
    campaign: Campaign,
    path: str | Path | Sequence[str | Path],
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestResult | IngestedMany:
    """Store one log or several and learn them: `tell_one` or `tell_many`, depending on the argument."""
    if isinstance(path, str | Path):
        return tell_one(
            campaign,
            Path(path),
            number=number,
            changed=changed,
            learner=learner,
            say=say,
            **how,
        )
    if number is not None:
        raise UsageError("a number is for one log", next_step="Ingest that log alone.")
    paths = [Path(one) for one in path]
    return tell_many(campaign, paths, changed=changed, learner=learner, say=say, **how)


def tell_many(
    campaign: Campaign,
    paths: Sequence[Path],
    *,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestedMany:
    """Store every usable log, then learn all of them at once.

    Files are ingested in the order of their names. Logs that match no open proposal are tried again after
    the others, so that the order of the arguments has no effect. Each log is committed separately: the same
    command finishes an interrupted run. Without a file, `changed` applies to the waiting logs.

    Raises:
        UsageError: a proposal's file is missing or was changed, or `changed` applies to no log.
        DataError, NumericalError: all logs together cannot be learned; they are stored and wait.
    """
    with campaign.writing():
        files = _store_each(campaign, paths, how, say)
        places = [i for i, file in enumerate(files) if file.ingested is not None]
        ingested = [file.ingested for file in files if file.ingested is not None]
        before = {r.number for r in campaign.state().learned}
        for place, one in zip(places, finished(campaign, ingested, changed, learner, say), strict=True):
            files[place] = replace(files[place], ingested=one)
        state = campaign.state()
    learned = tuple(r.number for r in state.learned if r.number not in before)
    return IngestedMany(tuple(files), learned, newest_warnings(campaign, state))


def _store_each(campaign: Campaign, paths: Sequence[Path], how: How, say: Say) -> list[IngestedFile]:
    """Every file, stored or refused, in the order in which they were given."""
    files: dict[Path, IngestedFile] = {}
    pending = sorted(set(paths), key=lambda path: (path.name, str(path)))
    survey = surveyed(campaign, pending, how) if len(pending) > 1 else None
    while pending:
        open_before, refused = len(campaign.state().proposals), []
        for path in pending:
            files[path] = _ingest_one(campaign, path, how, survey)
            is_refused = files[path].ingested is None
            say(f"{path.name}: {'refused' if is_refused else files[path].sentence}.")
            refused += [path] if is_refused else []
        # a log that matches none of several open proposals may belong to none
        pending = refused if len(campaign.state().proposals) < open_before else []
    return [files[path] for path in dict.fromkeys(paths)]


def _ingest_one(campaign: Campaign, path: Path, how: How, survey: Survey | None) -> IngestedFile:
    try:
        return IngestedFile(path, take(campaign, path, survey=survey, **how))
    except DataError as error:
        return IngestedFile(path, None, error)


@threads_for(0)
def surveyed(campaign: Campaign, paths: Sequence[Path], how: How) -> Survey | None:
    """The new logs in these files, so that their commands are judged together; None if there are none."""
    if how.get("confirm") or not any(c.acts_on for c in campaign.channels):
        return None
    state = campaign.state()
    answers = answers_of(state, how.get("accept", ()), how.get("repair", ()))
    logs: dict[Path, Log] = {}
    for path in paths[:MOST_NEW]:
        with contextlib.suppress(DataError):  # the error is reported when the file is ingested
            if state.round_of_log(sha256_of_log(path)) is None:
                logs |= _prepare(campaign, path, how, answers)
    judge = judge_of(campaign.kind, campaign.spec)
    return Survey(logs, ingested_logs(campaign, state), answers.to, *judge)


def _prepare(campaign: Campaign, path: Path, how: How, answers: Answers) -> dict[Path, Log]:
    """The log in a file after repairs of its motion; {} if it is refused regardless of its commands."""
    logs: dict[Path, Log] = {}

    def settle(log: Log) -> Log:
        logs[path] = LogQuestions(campaign.kind, campaign.spec, answers).prepared(log)
        return logs[path]

    with contextlib.suppress(DataError):  # limits may refuse a log that is repaired later
        read_settled(campaign, path, settle, degrees=how.get("degrees", False), topics=how.get("topics", ()))
    return logs
