"""tell: takes in a log, whenever it comes, and learns it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.campaign.ask import speed_folder, stored_trajectory
from etude.campaign.folder import Campaign, Say
from etude.campaign.learn import Learner, learn_pending
from etude.campaign.questions import Answers, Asked, Given, answers_of
from etude.campaign.state import Round, State
from etude.contracts import Log, Trajectory
from etude.deploy.trajectory_files import COEFFICIENTS, SPEEDS
from etude.errors import DataError, UsageError
from etude.logs.fingerprint import sha256_of_log
from etude.logs.identity import align
from etude.logs.log_file import log_bytes
from etude.logs.read import read_log
from etude.logs.units import start_at_zero
from etude.storage import write_atomic


@dataclass(frozen=True)
class Told:
    """What became of a log.

    Attributes:
        number: the trajectory it answers, or its own number if it answers none.
        repeated: it had been told before; nothing was stored again.
        foreign: it answers no proposal.
        repairs: one sentence for each repair made while reading it.
        learned: numbers of the logs that were learned now.
        warnings: what the newest training has to say: inputs that logs lack, for example.
    """

    number: int
    repeated: bool
    foreign: bool
    repairs: tuple[str, ...]
    learned: tuple[int, ...]
    warnings: tuple[str, ...] = ()


def tell(
    campaign: Campaign,
    path: Path,
    *,
    number: int | None = None,
    foreign: bool = False,
    degrees: bool = False,
    accept: Sequence[str] = (),
    repair: Sequence[str] = (),
    topics: Sequence[str] = (),
    learner: Learner | None = None,
    say: Say = lambda _: None,
) -> Told:
    """Stores the log in `path` and learns it; also learns what an interrupted run left.

    Args:
        campaign: the folder.
        path: the log file; recognised by its content if it was told before under any name.
        number: the proposal that was run; else the newest open one that the motion fits.
        foreign: the log answers no proposal.
        degrees: the file's angles are degrees.
        accept, repair: checks whose questions are answered so: the log is taken as it is, or put right.
        topics: of a file that holds several; none: those that campaign.toml names.
        learner: how logs are learned; only tests give another one.
        say: receives one sentence per step.

    Raises:
        DataError: the log cannot be used, is of another trajectory, or raises a question that nobody
            answered; nothing is stored.
        UsageError: there is no such proposal, it has a log already, or there is no such check.
    """
    path = Path(path)
    digest = sha256_of_log(path)
    with campaign.writing():
        state = campaign.state()
        known = state.round_of_log(digest)
        if known is not None:
            _check_same_number(known, number, path)
            done = learn_pending(campaign, learner, say)
            repairs = tuple((known.told or {}).get("repairs", ()))
            warnings = _warnings(campaign)
            return Told(known.number, True, known.asked is None, repairs, tuple(done), warnings)
        given: list[Given] = []
        answers = answers_of(state, accept, repair)
        log = read(campaign, path, degrees=degrees, topics=topics, answers=answers, given=given)
        log, answered, speed = _identify(campaign, state, path, number, foreign, log)
        number = answered if answered is not None else _free_number(state, number)
        _store(campaign, number, log, path, digest, answered is None, speed, given)
        done = learn_pending(campaign, learner, say)
        return Told(number, False, answered is None, log.repairs, tuple(done), _warnings(campaign))


def _warnings(campaign: Campaign) -> tuple[str, ...]:
    """Of the newest training; the oldest journals have none."""
    trained = campaign.state().trained
    facts = trained[-1].trained if trained else None
    return tuple((facts or {}).get("warnings", ()))


def _identify(
    campaign: Campaign, state: State, path: Path, number: int | None, foreign: bool, log: Log
) -> tuple[Log, int | None, int]:
    """The aligned log, the proposal that it answers (None: no proposal) and the speed it was run at."""
    open_numbers = [r.number for r in state.proposals]
    if number is not None and not foreign:
        _check_asked(state, number)
        candidates = [number]
    else:
        given_up = [r.number for r in state.rounds.values() if r.asked and r.abandoned]
        candidates = [] if foreign else [*reversed(open_numbers), *reversed(given_up)]
    refused: DataError | None = None
    for candidate in candidates:
        for speed in SPEEDS[::-1]:
            if not (speed_folder(campaign, candidate, speed) / COEFFICIENTS).exists():
                continue
            try:
                trajectory = stored_trajectory(campaign, candidate, speed)
                return _aligned(campaign, log, trajectory), candidate, speed
            except DataError as error:
                refused = refused or error
            except UsageError:
                # a proposal that was given up because its file is damaged must not stop all other logs
                if candidate in open_numbers or candidate == number:
                    raise
    if refused is None or (number is None and not open_numbers):
        return start_at_zero(log), None, 100
    raise DataError(
        refused.fact,
        where=refused.where or str(path),
        next_step=f"{refused.next_step} If it answers no proposal at all, tell it with --foreign.".strip(),
    )


def _aligned(campaign: Campaign, log: Log, trajectory: Trajectory) -> Log:
    expected = campaign.kind.expected(campaign.spec)
    path = campaign.kind.path
    return align(log, trajectory, campaign.channels, path, expected.scale, rest=expected.rest)


def read(
    campaign: Campaign,
    path: Path,
    *,
    degrees: bool = False,
    topics: Sequence[str] = (),
    answers: Answers | None = None,
    given: list[Given] | None = None,
) -> Log:
    """The cleaned log in a file, by its own clock.

    Args:
        answers: to the questions that it raises; `given` takes those that were of use.

    Raises:
        DataError: it cannot be used; by the doctor of all logs, by the truth tests, or by what the kind
            looks for.
    """
    expected = campaign.kind.expected(campaign.spec)
    given = [] if given is None else given
    asked = Asked(campaign.kind, campaign.spec, answers or Answers(), given)
    log = read_log(
        path,
        campaign.channels,
        rate=expected.rate,
        degrees=degrees,
        limits=expected.limits,
        topics=topics,
        config=campaign.config.log,
        own_clock=True,
        settle=asked.whole,
    )
    return asked.cleaned(log)


def _store(
    campaign: Campaign,
    number: int,
    log: Log,
    path: Path,
    digest: str,
    foreign: bool,
    speed: int,
    given: Sequence[Given],
) -> None:
    """Writes the cleaned log and its origin, then commits; refuses a log that gives no samples."""
    group = np.zeros(len(log), dtype=np.int64)
    campaign.kind.samples(campaign.spec, campaign.config, [log], [group])
    write_atomic(campaign.run_file(number), log_bytes(replace(log, source=path.name)))
    origin = {
        "path": str(path.resolve()),
        "sha256": digest,
        "bytes": path.stat().st_size,
        "repairs": list(log.repairs),
    }
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in origin.items())
    write_atomic(campaign.source_file(number), text.encode())
    files = [campaign.run_file(number), campaign.source_file(number)]
    facts = {
        "sha256": digest,
        "source": path.name,
        "foreign": foreign,
        "speed": speed,
        "robot_seconds": _seconds(log),
        "rows": len(log),
        "repairs": list(log.repairs),
    }
    if given:
        facts["answers"] = [[what, check, list(by)] for what, check, by in given]
    campaign.commit("told", number, files, **facts)


def _seconds(log: Log) -> float:
    """Recorded motion, s: what was logged before the start is none."""
    moving = log.t[log.t >= 0.0]
    return float(moving[-1] - moving[0]) if len(moving) else 0.0


def _check_same_number(known: Round, number: int | None, path: Path) -> None:
    if number is not None and number != known.number:
        raise UsageError(
            f"this log was told before, as the answer to trajectory {known.number}, not {number}",
            where=str(path),
            next_step=f"To take that back: etude abandon FOLDER {known.number}.",
        )


def _check_asked(state: State, number: int) -> None:
    found = state.rounds.get(number)
    if found is None or found.asked is None:
        known = ", ".join(str(r.number) for r in state.rounds.values() if r.asked) or "none"
        raise UsageError(f"trajectory {number} was never asked for", next_step=f"Asked for: {known}.")
    if found.told is not None and not found.abandoned:
        raise UsageError(
            f"trajectory {number} has a log already",
            next_step=f"To replace it: etude abandon FOLDER {number}, then tell again.",
        )


def _free_number(state: State, number: int | None) -> int:
    if number is None:
        return state.next_number
    if number in state.rounds:
        raise UsageError(f"number {number} is taken", next_step=f"The next free one is {state.next_number}.")
    return number
