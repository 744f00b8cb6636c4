"""Runs of confirmation motions: measured, stored, and shown; no model learns from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.campaign.ingest.ingest_result import How, IngestResult, aligned_with, read
from etude.campaign.ingest.questions import answers_of, questions_of
from etude.campaign.ingest.recordings import Evidence, evidence_in, planned_log
from etude.campaign.record.confirmation import FEEDFORWARD, RUNS, errors, moving, without_it
from etude.campaign.record.events import Confirmed, Figures
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import RESTORE, stored_bytes, stored_trajectory
from etude.deploy.trajectory_files import read_table
from etude.errors import DataError, UsageError, typed
from etude.logs.readers.log_file import log_bytes
from etude.protocols import Trajectory
from etude.storage import write_atomic
from etude.types import Array, Log


def take_run(
    campaign: Campaign, state: State, path: Path, digest: str, number: int | None, how: How
) -> IngestResult:
    """Measure and store a run of a confirmation motion. The caller holds the lock. Errors as `tell`."""
    run = how["confirm"]
    if run not in RUNS:
        raise UsageError(f"--confirm {run}: there is no such run", next_step=f"Runs: {', '.join(RUNS)}.")
    numbers = [r.number for r in reversed(state.confirmations)]
    if not numbers or (number is not None and number not in numbers):
        raise UsageError(
            "there is no such confirmation motion",
            where=str(campaign.path),
            next_step=f"etude ask {typed(campaign.path)} --confirm.",
        )
    repeats = [
        n for n in numbers if run in state.rounds[n].runs and state.rounds[n].runs[run].sha256 == digest
    ]
    if repeats:
        return IngestResult(repeats[0], True, False, (), (), run=run)
    answers = answers_of(state, how.get("accept", ()), how.get("repair", ()))
    questions = questions_of(campaign, state, answers)
    log = read(
        campaign, path, degrees=how.get("degrees", False), topics=how.get("topics", ()), questions=questions
    )
    evidence = evidence_in(campaign, path)
    if evidence is None:
        number, aligned = _identify_motion(campaign, log, numbers if number is None else [number])
    else:
        number, aligned = _identify_recording(campaign, evidence, log, numbers, path)
    sent = Sent.of(campaign, number)
    confirmed = measured_run(campaign, aligned, stored_trajectory(campaign, number), run, sent)
    place = campaign.run_file(number).with_suffix(f".{run}.parquet")
    write_atomic(place, log_bytes(replace(aligned, source=path.name)))
    confirmed = replace(confirmed, sha256=digest, source=path.name, repairs=aligned.repairs)
    campaign.commit(confirmed, number, [place])
    return IngestResult(
        number, False, False, aligned.repairs, (), findings=tuple(questions.accepted), run=run
    )


def _identify_motion(campaign: Campaign, log: Log, numbers: Sequence[int]) -> tuple[int, Log]:
    """The first of these motions that matches the log. DataError: none does."""
    refused: DataError | None = None
    for number in numbers:
        try:
            return number, aligned_with(campaign, log, stored_trajectory(campaign, number))
        except DataError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _identify_recording(
    campaign: Campaign, evidence: Evidence, log: Log, numbers: Sequence[int], path: Path
) -> tuple[int, Log]:
    """The motion of a recording. DataError: it is none of these, or the recording is incomplete."""
    number = evidence.answers(campaign)
    if number is None or number not in numbers:
        raise DataError(
            "this is not a recording of a whole confirmation motion",
            where=str(path),
            next_step="Give recordings of the motion that etude ask --confirm writes, run from start to end.",
        )
    return number, planned_log(campaign, evidence, log)


def check_may_teach(campaign: Campaign, state: State, log: Log, path: Path) -> None:
    """Raise DataError for a run of a confirmation or weighing motion, which must not be used for training."""
    numbers = [r.number for r in reversed((*state.confirmations, *state.weighings))]
    if not numbers or campaign.kind.path not in log:
        return
    try:
        number = _identify_motion(campaign, log, numbers)[0]
    except DataError:
        return
    if state.rounds[number].weighs:
        raise DataError(
            f"this is a run of trajectory {number}, a payload motion that is never used for training",
            where=str(path),
            next_step=f"etude payload {typed(campaign.path)} --log {typed(path)}",
        )
    raise DataError(
        f"this is a run of trajectory {number}, a confirmation motion that is never used for training",
        where=str(path),
        next_step="State the run: --confirm without the feedforward, or --confirm with it.",
    )


def measured_run(
    campaign: Campaign, log: Log, trajectory: Trajectory, run: str, sent: Sent | None = None
) -> Confirmed:
    """Result of a confirmation run: mean absolute tracking error of each axis, and its unit.

    If the motion has a feedforward, also "moving", the error while the axis moves (None: it hardly moves).
    For the run without feedforward, also the parts due to lag and noise (`record.confirmation.Without`).

    Raises:
        DataError: the log has no positions along the motion.
    """
    path = campaign.kind.path
    inside = (log.t >= 0.0) & (log.t <= trajectory.duration)
    if path not in log or not inside.any():
        raise DataError(
            "the log of a confirmation motion needs positions", where=log.source, next_step=f"Log {path}."
        )
    log = log.take(inside)
    units = campaign.channel(path).units
    figures = {"error": errors(log, path, trajectory, np.ones((len(log), len(units)), dtype=bool))}
    if sent is not None:
        use = moving(trajectory, log.t, sent.trained)
        figures["moving"] = errors(log, path, trajectory, use)
        figures |= vars(without_it(log, path, trajectory, use, sent.at(log.t))) if run == RUNS[0] else {}
    shown = {name: _to_display_units(values, units) for name, values in figures.items()}
    return Confirmed(
        run=run,
        error=shown["error"],
        units=tuple("deg" if u == "rad" else u for u in units),
        moving=shown.get("moving"),
        late=shown.get("late"),
        noise=shown.get("noise"),
    )


@dataclass(frozen=True, eq=False)
class Sent:
    """The feedforward of a motion: t (T,) s, command (T, k); top speeds in training, trained (k,)."""

    t: Array
    command: Array
    trained: Array

    @classmethod
    def of(cls, campaign: Campaign, number: int) -> Sent | None:
        """The feedforward of a proposal; None if the motion has no forecast."""
        proposal = campaign.round(number).asked
        if proposal is None or proposal.trained_speeds is None:
            return None
        trained = proposal.trained_speeds
        rows = read_table(_sent_table(campaign, number))[1]
        return cls(rows[:, 0], rows[:, -len(trained) :], np.asarray(trained))

    def at(self, t: Array) -> Array:
        """(T, k) commands."""
        return np.stack([np.interp(t, self.t, column) for column in self.command.T], axis=1)


def _sent_table(campaign: Campaign, number: int) -> bytes:
    """The table that was sent. UsageError: it is missing or was changed."""
    path = campaign.proposal(number) / FEEDFORWARD
    try:
        return stored_bytes(campaign, path)
    except FileNotFoundError as error:
        raise UsageError(str(error), where=str(campaign.path), next_step=RESTORE) from None


def _to_display_units(values: Array, units: Sequence[str]) -> Figures:
    """In degrees where the unit is rad; None for NaN."""
    scaled = [math.degrees(v) if u == "rad" else float(v) for v, u in zip(values, units, strict=True)]
    return tuple(None if math.isnan(v) else v for v in scaled)
