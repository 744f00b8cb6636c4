"""Figures on the real Crazyflie flights: errors, lag, calibration, and where the model doubts itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.models import NORMAL_95
from etude.progress import counted
from etude.threads import threads_for
from etude.types import Array, Log, Mask
from etude_studies.crazyflie_flights import (
    Outcome,
    by_block,
    by_manoeuvre,
    crazyflie,
    crazyflie_flights,
    in_flight,
    lag_of,
    nmse,
)
from etude_studies.real_accuracy import say
from etude_studies.rows import Row, mean_rows, rows_json, table

SEEDS = 8
ALL_POINTS = 5000
"""More than there are: conditions on every sample, where the default keeps 1200 of some 1500."""
YAW = np.array([1.0, -1.0, 1.0, -1.0])
"""Set-points that turn about the vertical: neighbouring rotors turn against each other."""


def run(*, json: bool = False, seed: int = 0, quick: bool = False) -> list[Row]:
    """Measures and prints all rows: a table, or with `json` the one line of `rows_json`."""
    with threads_for(0):
        rows = crazyflie_rows(np.random.default_rng(seed), quick)
    if json:
        print(rows_json(rows, "etude bench crazyflie" + " --quick" * quick + " --json"))  # noqa: T201
    else:
        table(rows, "Crazyflie: motor set-points from motion")
    return rows


def crazyflie_rows(rng: np.random.Generator, quick: bool = False) -> list[Row]:
    """Errors by block and on the manoeuvre that is missing, lag, calibration, and where the model doubts.

    By block the mean over `SEEDS` thinnings of the training samples; all else is of the first.

    Args:
        rng: of the thinning.
        quick: one thinning, and nothing without lag corrected.
    """
    flights = crazyflie_flights()
    if not flights:
        say("crazyflie_nmse left out: examples/crazyflie is incomplete; install etude again.")
        return []
    blocks = [by_block(flights, seed_rng) for seed_rng in counted(rng.spawn(1 if quick else SEEDS))]
    block, unseen = blocks[0], by_manoeuvre(flights, rng)
    every, missing = np.ones(len(block.group), dtype=np.bool_), in_flight(unseen)
    errors = [nmse(outcome.command, outcome.mean) for outcome in blocks]
    linear = [nmse(block.command, block.linear)]
    rows = mean_rows("crazyflie_nmse", errors, "1", f"linear regression; chosen: {block.chosen}", linear)
    if not quick:
        rows.append(Row("crazyflie_nmse_worst_seed", max(errors), "1", "the best", min(errors)))
        every_point = by_block(flights, rng, config=replace(crazyflie().config.model, points=ALL_POINTS))
        error = nmse(every_point.command, every_point.mean)
        rows.append(Row("crazyflie_nmse_all_points", error, "1", "default, first seed", errors[0]))
        late = by_block(flights, rng, lag=0.0)
        without = nmse(late.command, late.mean)
        rows.append(Row("crazyflie_nmse_no_lag", without, "1", "lag corrected", errors[0]))
    return [
        *rows,
        *_error_rows("crazyflie_nmse", block, every)[1:],
        *_calibration_rows("crazyflie", block, every),
        *_error_rows("crazyflie_nmse_unseen", unseen, missing),
        *_calibration_rows("crazyflie_unseen", unseen, missing),
        *_doubt_rows(unseen, missing),
        *_lag_rows(flights, block),
    ]


def _error_rows(name: str, outcome: Outcome, mask: Mask) -> list[Row]:
    linear, rigid, mine = (
        nmse(outcome.command[mask], p[mask]) for p in (outcome.linear, outcome.rigid, outcome.mean)
    )
    return [
        Row(name, mine, "1", f"linear regression; chosen: {outcome.chosen}", linear),
        Row(f"{name}_rigid_body", rigid, "1", "linear regression", linear),
        Row(f"{name}_raw", nmse(outcome.raw[mask], outcome.mean[mask]), "1", "set-points averaged", mine),
    ]


def _calibration_rows(name: str, outcome: Outcome, mask: Mask) -> list[Row]:
    ratio = (outcome.command - outcome.mean)[mask] / np.sqrt(outcome.variance[mask])
    return [
        Row(f"{name}_z2", float(np.mean(ratio**2)), "1", "calibrated", 1.0),
        Row(f"{name}_coverage", float(np.mean(np.abs(ratio) <= NORMAL_95)), "1", "95 %", 0.95),
    ]


def _doubt_rows(outcome: Outcome, missing: Mask) -> list[Row]:
    """Deviations on the missing manoeuvre over those on held-out blocks of known ones; errors likewise."""
    rows = []
    for name, weights in (("", np.eye(4)), ("_yaw", YAW[:, None] / 2.0)):
        error = (outcome.command - outcome.mean) @ weights
        deviation = np.sqrt(outcome.variance @ weights**2)
        latent = np.sqrt(outcome.latent @ weights**2)
        real = _rms(error[missing]) / _rms(error[~missing])
        stated = float(deviation[missing].mean() / deviation[~missing].mean())
        before = float(latent[missing].mean() / latent[~missing].mean())
        rows += [
            Row(f"crazyflie_unseen_deviation_ratio{name}", stated, "1", "ratio of the real errors", real),
            Row(f"crazyflie_unseen_latent_ratio{name}", before, "1", "noise and calibration left out"),
            Row(
                f"crazyflie_unseen_z2{name or '_all'}",
                float(np.mean((error / deviation)[missing] ** 2)),
                "1",
                "on held-out blocks of the known manoeuvres",
                float(np.mean((error / deviation)[~missing] ** 2)),
            ),
        ]
    return rows


def _lag_rows(flights: dict[int, list[Log]], block: Outcome) -> list[Row]:
    rows = [Row("crazyflie_lag_ms", 1e3 * block.lag, "ms", "training blocks of all flights")]
    for number in (10, 15):
        lag_ms = 1e3 * lag_of(flights[number])
        rows.append(Row(f"crazyflie_lag_flight_{number}_ms", lag_ms, "ms", "that flight alone"))
    return rows


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
