"""Ingest of one log: its options, the log as read and aligned with the proposal, and the outcome."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from etude.campaign.ingest.questions import Answers, LogQuestions
from etude.campaign.ingest.recordings import evidence_in, log_of
from etude.campaign.record.folder import Campaign
from etude.codes import Notice
from etude.logs.alignment.alignment import align
from etude.logs.cleaning.read import Settle, clean_log, read_log
from etude.protocols import Trajectory
from etude.types import Finding, Log


class How(TypedDict, total=False):
    """How a log is to be taken in; every word may be left out.

    Attributes:
        foreign: the log answers no proposal.
        degrees: the file's angles are degrees.
        accept, repair: checks whose questions are answered so: the log is taken as it is, or put right.
        topics: of a file that holds several; none: those that campaign.toml names.
        confirm: which run of a motion that confirms it is: "without" or "with" the feedforward; it is
            measured and not learned from.
        control: that the proposal was run under, `campaign.controls`; "": what it was asked for.
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
    """What became of a log.

    Attributes:
        number: the trajectory it answers, or its own number if it answers none.
        repeated: it had been told before; nothing was stored again.
        foreign: it answers no proposal.
        repairs: one sentence for each repair made while reading it.
        learned: numbers of the logs that were learned now.
        warnings: what the newest training has to say: inputs that logs lack, for example.
        findings: what is wrong with the log, or with the robot; they stand in the journal beside it.
        awaits_answer: it is stored and waits for an answer before it is learned.
        excluded: it is kept and nothing learns from it: the robot had changed.
        run: of a motion that confirms, "without" or "with" the feedforward; nothing learns from it.
        start: a sentence about its start transient, which is in no margin; "" without one.
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
    """The log by the trajectory's clock, with its plan. DataError: it is of another motion."""
    expected = campaign.kind.expected(campaign.spec)
    path = campaign.kind.path
    return align(log, trajectory, campaign.channels, path, expected.scale, rest=expected.rest)


def read(
    campaign: Campaign,
    path: Path,
    *,
    degrees: bool = False,
    topics: Sequence[str] = (),
    asked: LogQuestions | None = None,
) -> Log:
    """The cleaned log in a file, by its own clock.

    Args:
        topics: of a file that holds several; none: those that campaign.toml names.
        asked: the questions that it may raise, with their answers; it keeps those that were of use.

    Raises:
        DataError: it cannot be used; by the doctor of all logs, by the truth tests, or by what the kind
            looks for.
    """
    asked = asked or LogQuestions(campaign.kind, campaign.spec, Answers())
    return asked.cleaned(read_settled(campaign, path, asked.whole, degrees=degrees, topics=topics))


def read_settled(
    campaign: Campaign, path: Path, settle: Settle, *, degrees: bool = False, topics: Sequence[str] = ()
) -> Log:
    """The log in a file after the doctor of all logs, who asks `settle`. Arguments and errors as `read`."""
    expected = campaign.kind.expected(campaign.spec)
    evidence = evidence_in(campaign, path)
    if evidence is not None:
        log = log_of(campaign, evidence, path.name)
        return clean_log(log, campaign.channels, expected.limits, log.channels, settle)
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
