"""Ingest of one log: its options, the log as read and aligned with the proposal, and the outcome."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from etude.campaign.ingest.questions import Answers, LogQuestions
from etude.campaign.ingest.recordings import evidence_in, is_recording, log_of
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import is_committed, speed_folder, stored_trajectory
from etude.codes import Notice
from etude.deploy.trajectory_files import COEFFICIENTS, SPEEDS
from etude.errors import DataError, UsageError
from etude.logs.alignment.alignment import align
from etude.logs.cleaning.read import Settle, clean_log, read_log
from etude.protocols import Trajectory
from etude.types import Finding, Log


class How(TypedDict, total=False):
    """Options of the ingest of a log, all optional.

    Attributes:
        foreign: the log belongs to no proposal.
        degrees: the file's angles are degrees.
        accept, repair: checks whose findings are accepted (the log is used unchanged), or repaired.
        topics: topics of a file with several; none: those in campaign.toml.
        confirm: which run of a confirmation motion it is: "without" or "with" the feedforward; it is
            measured, but not used for training.
        control: control of the run, see `record.controls`; "": the one that it was proposed for.
    """

    foreign: bool
    degrees: bool
    accept: Sequence[str]
    repair: Sequence[str]
    topics: Sequence[str]
    confirm: str
    control: str


@dataclass(frozen=True)
class IngestResult:
    """Result of the ingest of a log.

    Attributes:
        number: of its proposal, or its own number if it belongs to none.
        repeated: it was ingested before; nothing was stored again.
        foreign: it belongs to no proposal.
        repairs: one sentence for each repair made while reading it.
        learned: numbers of the logs that were learned now.
        warnings: of the newest training: inputs that logs lack, for example.
        findings: faults of the log, or of the robot; the journal has them, too.
        awaits_answer: it is stored and waits for an answer before it is learned.
        excluded: it is stored, but not used for training, since the robot had changed.
        run: of a confirmation motion, "without" or "with" the feedforward; not used for training.
        start: a sentence about its start transient, which no margin includes; "" without one.
    """

    number: int
    repeated: bool
    foreign: bool
    repairs: tuple[str, ...]
    learned: tuple[int, ...]
    warnings: tuple[Notice, ...] = ()
    findings: tuple[Finding, ...] = ()
    awaits_answer: bool = False
    excluded: bool = False
    run: str = ""
    start: str = ""


def aligned_with(campaign: Campaign, log: Log, trajectory: Trajectory) -> Log:
    """The log in the time of the trajectory, with its plan. DataError: it is of another motion."""
    expected = campaign.kind.expected(campaign.spec)
    path = campaign.kind.path
    return align(log, trajectory, campaign.channels, path, expected.scale, rest=expected.rest)


def answered_proposal(
    campaign: Campaign, state: State, log: Log, number: int | None = None
) -> tuple[Log, int, int] | None:
    """The log in the time of the proposal that it answers, the proposal's number, and the speed in percent.

    None without proposals to compare with.

    Args:
        number: of the only proposal that is tried; None: the open ones, newest first, then abandoned ones.

    Raises:
        DataError: it is of another motion; the message compares it with the first proposal tried.
    """
    abandoned = [r.number for r in state.rounds.values() if r.teaches and r.abandoned]
    opened = [r.number for r in state.proposals]
    refused: DataError | None = None
    for candidate in [*reversed(opened), *reversed(abandoned)] if number is None else [number]:
        for speed in SPEEDS[::-1]:
            if not is_committed(campaign, speed_folder(campaign, candidate, speed) / COEFFICIENTS):
                continue
            try:
                trajectory = stored_trajectory(campaign, candidate, speed)
                return aligned_with(campaign, log, trajectory), candidate, speed
            except DataError as error:
                refused = refused or error
            except UsageError:
                # an abandoned proposal with a damaged file must not block all other logs
                if candidate in opened or candidate == number:
                    raise
    if refused is None:
        return None
    foreign = "If the log belongs to no proposal, ingest it with --foreign."
    raise DataError(refused.fact, where=refused.where, next_step=f"{refused.next_step} {foreign}".strip())


def read(
    campaign: Campaign,
    path: Path,
    *,
    degrees: bool = False,
    topics: Sequence[str] = (),
    questions: LogQuestions | None = None,
) -> Log:
    """The cleaned log in a file, in its own time.

    Args:
        topics: of a file that holds several; none: those that campaign.toml names.
        questions: the possible questions with their answers; it records the answers that were used.

    Raises:
        DataError: it cannot be used, according to the general repairs, the plausibility checks, or the checks
            of the kind.
    """
    questions = questions or LogQuestions(campaign.kind, campaign.spec, Answers())
    log = read_settled(campaign, path, questions.whole, degrees=degrees, topics=topics)
    return questions.cleaned(log, own=is_recording(path))


def read_settled(
    campaign: Campaign, path: Path, settle: Settle, *, degrees: bool = False, topics: Sequence[str] = ()
) -> Log:
    """The log in a file after the general repairs, which call `settle`. Arguments and errors as `read`."""
    expected = campaign.kind.expected(campaign.spec)
    evidence = evidence_in(campaign, path)
    if evidence is not None:
        log = log_of(campaign, evidence, path.name)
        stated = {name: channel.units for name, channel in log.channels.items()}
        return clean_log(log, campaign.channels, expected.limits, stated, settle)
    return read_log(
        path,
        campaign.channels,
        rate=expected.rate,
        degrees=degrees,
        limits=expected.limits,
        topics=topics,
        config=campaign.config.log,
        own_clock=True,
        settle=settle,
    )
