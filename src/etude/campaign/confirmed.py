"""Runs of a motion that confirms: measured, kept, and shown; no model learns from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign.ask import stored_trajectory
from etude.campaign.folder import Campaign
from etude.campaign.questions import Asked, answers_of
from etude.campaign.state import Round, State
from etude.campaign.told import How, Told, aligned_with, read
from etude.contracts import Log, Trajectory
from etude.errors import DataError, UsageError
from etude.logs.log_file import log_bytes
from etude.storage import write_atomic

RUNS = ("without", "with")


def take_run(campaign: Campaign, state: State, path: Path, digest: str, number: int | None, how: How) -> Told:
    """Measures and stores a run of a motion that confirms. The caller holds the lock. Errors as `tell`."""
    run = how["confirm"]
    if run not in RUNS:
        raise UsageError(f"--confirm {run}: no such run", next_step=f"Runs: {', '.join(RUNS)}.")
    known = [r.number for r in reversed(state.confirmations)]
    if not known or (number is not None and number not in known):
        raise UsageError(
            "no such motion to confirm was asked for",
            where=str(campaign.path),
            next_step=f"etude ask {campaign.path} --confirm.",
        )
    again = [n for n in known if state.rounds[n].runs.get(run, {}).get("sha256") == digest]
    if again:
        return Told(again[0], True, False, (), (), run=run)
    answers = answers_of(state, how.get("accept", ()), how.get("repair", ()))
    asked = Asked(campaign.kind, campaign.spec, answers)
    log = read(campaign, path, degrees=how.get("degrees", False), topics=how.get("topics", ()), asked=asked)
    number, aligned = _confirming(campaign, log, known if number is None else [number])
    facts = run_facts(campaign, aligned, stored_trajectory(campaign, number), run)
    place = campaign.run_file(number).with_suffix(f".{run}.parquet")
    write_atomic(place, log_bytes(replace(aligned, source=path.name)))
    more = {"sha256": digest, "source": path.name, "repairs": list(aligned.repairs)}
    campaign.commit("confirmed", number, [place], **facts, **more)
    return Told(number, False, False, aligned.repairs, (), findings=tuple(asked.accepted), run=run)


def _confirming(campaign: Campaign, log: Log, numbers: Sequence[int]) -> tuple[int, Log]:
    """The first of these motions that the log is of. DataError: it is of none."""
    refused: DataError | None = None
    for number in numbers:
        try:
            return number, aligned_with(campaign, log, stored_trajectory(campaign, number))
        except DataError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def check_no_confirmation(campaign: Campaign, state: State, log: Log, path: Path) -> None:
    """DataError: it is a run of a motion that confirms, from which nothing may be learned."""
    known = [r.number for r in reversed(state.confirmations)]
    if not known or campaign.kind.path not in log:
        return
    try:
        number = _confirming(campaign, log, known)[0]
    except DataError:
        return
    raise DataError(
        f"this is a run of trajectory {number}, which confirms and is never learned from",
        where=str(path),
        next_step="Say which run: --confirm without, or --confirm with the feedforward.",
    )


def run_facts(campaign: Campaign, log: Log, trajectory: Trajectory, run: str) -> dict[str, Any]:
    """Facts of a `confirmed` event: mean absolute tracking error of each axis, and its unit.

    Raises:
        DataError: the log has no positions along the motion.
    """
    path = campaign.kind.path
    inside = (log.t >= 0.0) & (log.t <= trajectory.duration)
    if path not in log or not inside.any():
        raise DataError("a log that confirms needs positions", where=log.source, next_step=f"Log {path}.")
    wanted = trajectory.motion(log.t[inside], 1).orders[0]
    error = np.abs(log[path][inside] - wanted).mean(axis=0)
    units = campaign.channel(path).units
    shown = [math.degrees(e) if u == "rad" else float(e) for e, u in zip(error, units, strict=True)]
    return {"run": run, "error": shown, "units": ["deg" if u == "rad" else u for u in units]}


def confirmed(campaign: Campaign, one: Round) -> dict[str, Any]:
    """What is known of a motion that confirms, for `status` and the report; lists per axis, None if open."""
    asked, runs = one.asked or {}, one.runs
    without, ratio = (runs.get("without") or {}).get("error"), asked.get("forecast")
    forecast = None
    if without is not None and ratio is not None:
        forecast = [float(e * r) for e, r in zip(without, ratio, strict=True)]
    units = next((list(facts["units"]) for facts in runs.values()), None)
    return {
        "number": one.number,
        "axes": list(campaign.axes),
        "units": units,
        "without": without,
        "with": (runs.get("with") or {}).get("error"),
        "forecast": forecast,
        "forecast_ratio": ratio,
        "model_sha256": asked.get("model_sha256"),
    }
