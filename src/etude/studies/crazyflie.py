"""The real flights of `examples/crazyflie` as an inverse model of the four motor set-points.

Inputs are specific force, rates and angular acceleration: the logs tell neither altitude nor velocity. The
flights pass what a campaign passes: reader, lag, rate, ladder. Held out are blocks of each stretch, or a
whole manoeuvre: flight 16 yaws, which flights 10 (thrust) and 15 (roll, pitch) hardly do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.logs.flight_lag import command_lag, without_lag
from etude.logs.flight_log import FlightLog
from etude.logs.flight_table import read_flight
from etude.models.blocks import block_masks
from etude.models.calibration import NORMAL_95
from etude.models.flight_config import FlightModelConfig
from etude.models.flight_dataset import FlightDataset
from etude.models.flight_ladder import train_flight_ladder
from etude.models.flight_lesson import fitted_physics, lesson
from etude.models.flight_preprocess import FlightDataConfig, build_flight_dataset, joined
from etude.models.guard import linear_fit, linear_inputs
from etude.robots.flight_spec import FlightSpec
from etude.robots.toml_file import load_robot
from etude.studies.real_accuracy import say
from etude.studies.real_logs import EXAMPLES
from etude.studies.rows import Row

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOLDER = "crazyflie"
FILES = {
    10: ("log10_thrust.csv",),
    15: ("log15_roll_pitch.csv",),
    16: ("log16_yaw_first.csv", "log16_yaw_second.csv"),
}
UNSEEN = 16
GAP_S = 0.1
"""Training samples this near to a test sample are left out: longer than the means and the lowpass of the
gyroscope's derivative, 12.5 Hz."""
YAW = np.array([1.0, -1.0, 1.0, -1.0])
"""Set-points that turn about the vertical: neighbouring rotors turn against each other."""


@dataclass(frozen=True)
class Outcome:
    """Predictions of held-out samples, command units; all arrays are (n, 4).

    Attributes:
        group: (n,) number of each sample's flight.
        command: set-points as the model sees them. raw: at the same times as they were recorded.
        mean, variance: of the rung that the ladder chose. latent: the variance that its processes have before
            calibration and noise. linear: linear regression. rigid: the rigid-body map.
        lag: s by which the flights were corrected. chosen: kind of the model.
    """

    group: NDArray[np.int64]
    command: Array
    raw: Array
    mean: Array
    variance: Array
    latent: Array
    linear: Array
    rigid: Array
    lag: float
    chosen: str


def crazyflie_rows(rng: np.random.Generator, quick: bool = False) -> list[Row]:
    """Errors by block and on the manoeuvre that is missing, lag, calibration, and where the model doubts.

    Args:
        rng: of the thinning of the training samples.
        quick: leaves out what has no lag corrected, a third of the work.
    """
    flights = crazyflie_flights()
    if not flights:
        say(f"crazyflie_nmse left out: examples/{FOLDER} is incomplete; install etude again.")
        return []
    block, unseen = by_block(flights, rng), by_manoeuvre(flights, rng)
    every, missing = np.ones(len(block.group), dtype=np.bool_), in_flight(unseen)
    rows = _error_rows("crazyflie_nmse", block, every)
    if not quick:
        late = by_block(flights, rng, lag=0.0)
        rows.append(
            Row("crazyflie_nmse_no_lag", nmse(late.command, late.mean), "1", "lag corrected", rows[0].value)
        )
    return [
        *rows,
        *_calibration_rows("crazyflie", block, every),
        *_error_rows("crazyflie_nmse_unseen", unseen, missing),
        *_calibration_rows("crazyflie_unseen", unseen, missing),
        *_doubt_rows(unseen, missing),
        *_lag_rows(flights, block),
    ]


def crazyflie_flights() -> dict[int, list[FlightLog]]:
    """The stretches of each flight by its number; empty where the examples are not all there."""
    folder = EXAMPLES / FOLDER
    files = [folder / name for names in FILES.values() for name in names]
    if not all(path.is_file() for path in (*files, _robot())):
        return {}
    spec = crazyflie()
    return {number: [read_flight(folder / name, spec) for name in names] for number, names in FILES.items()}


def crazyflie() -> FlightSpec:
    """The vehicle of the example."""
    spec = load_robot(_robot()).flight
    assert spec is not None
    return spec


def _robot() -> Path:
    return EXAMPLES / FOLDER / "crazyflie.toml"


def by_block(
    flights: dict[int, list[FlightLog]], rng: np.random.Generator, lag: float | None = None
) -> Outcome:
    """Blocks 3, 8, 13 and 18 of 20 of every stretch, predicted from the others.

    Args:
        lag: s; None measures it on the training blocks.
    """
    if lag is None:
        lag = command_lag(*training_pieces([log for logs in flights.values() for log in logs]))
    return _outcome(flights, (), lag, rng)


def by_manoeuvre(flights: dict[int, list[FlightLog]], rng: np.random.Generator) -> Outcome:
    """Flight 16 whole, and the held-out blocks of flights 10 and 15, from the other blocks of these two."""
    seen = [log for number, logs in flights.items() if number != UNSEEN for log in logs]
    return _outcome(flights, (UNSEEN,), command_lag(*training_pieces(seen)), rng)


def in_flight(found: Outcome, number: int = UNSEEN) -> Mask:
    """(n,) samples of that flight."""
    return np.asarray(found.group == number)


def training_pieces(logs: Sequence[FlightLog]) -> list[FlightLog]:
    """What lies between the held-out blocks of each log, as logs of their own."""
    pieces = []
    for log in logs:
        known = np.flatnonzero(block_masks(log.t, GAP_S)[0])
        for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
            pieces.append(replace(log, t=log.t[run], states=log.states.take(run), command=log.command[run]))
    return pieces


def nmse(command: Array, mean: Array) -> float:
    """Squared error over the variance of each set-point, mean of the four."""
    return float(np.mean(np.mean((command - mean) ** 2, axis=0) / np.var(command, axis=0)))


def _samples(log: FlightLog, number: int, lag: float) -> tuple[FlightDataset, Array]:
    """The samples of a stretch, and the set-points (n, 4) recorded `lag` before the middle of each."""
    data = build_flight_dataset(log, crazyflie(), FlightDataConfig(lag_s=lag), number)
    shifted = without_lag(log, lag)
    middle = shifted.t[0] + data.t + 0.5 * (_step(data.t) - _step(log.t))
    return data, np.column_stack([np.interp(middle, shifted.t, column) for column in shifted.command.T])


def _step(t: Array) -> float:
    return float(np.median(np.diff(t)))


def _divided(
    flights: dict[int, list[FlightLog]], unseen: tuple[int, ...], lag: float
) -> tuple[FlightDataset, FlightDataset, Array]:
    """Training and test samples, and the test's recorded set-points; flights of `unseen` are test alone."""
    train, test, raw = [], [], []
    for number, logs in flights.items():
        start = 0.0
        for log in logs:
            data, recorded = _samples(log, number, lag)
            data = replace(data, t=start + data.t)
            known, held = block_masks(data.t, GAP_S)
            if number in unseen:
                known, held = np.zeros_like(known), np.ones_like(held)
            train.append(data.take(known))
            test.append(data.take(held))
            raw.append(recorded[held])
            start = float(data.t[-1]) + 1.0  # a pause: the recording goes on later
    return joined(train), joined(test), np.concatenate(raw)


def _outcome(
    flights: dict[int, list[FlightLog]], unseen: tuple[int, ...], lag: float, rng: np.random.Generator
) -> Outcome:
    train, test, raw = _divided(flights, unseen, lag)
    config = FlightModelConfig().suited_to(train.states)
    model = train_flight_ladder(train, None, config, rng).model
    mean, variance = model.predict(test.states)
    X = model.features.transform(test.states)
    latent = np.column_stack([posterior.predict(X)[1] for posterior in model.posteriors])
    rigid, _ = fitted_physics(lesson(train, None, config, rng), "identified")
    return Outcome(
        group=test.group,
        command=test.command,
        raw=raw,
        mean=mean,
        variance=variance,
        latent=model.deviation**2 * latent,
        linear=_linear(test) @ linear_fit(_linear(train), train.command),
        rigid=rigid.predict(test.states),
        lag=lag,
        chosen=model.kind,
    )


def _linear(data: FlightDataset) -> Array:
    states = data.states
    return linear_inputs(states.specific_force, states.rates, states.angular_acceleration)


def _error_rows(name: str, found: Outcome, own: Mask) -> list[Row]:
    linear, rigid, mine = (nmse(found.command[own], p[own]) for p in (found.linear, found.rigid, found.mean))
    return [
        Row(name, mine, "1", f"linear regression; chosen: {found.chosen}", linear),
        Row(f"{name}_rigid_body", rigid, "1", "linear regression", linear),
        Row(f"{name}_raw", nmse(found.raw[own], found.mean[own]), "1", "set-points averaged", mine),
    ]


def _calibration_rows(name: str, found: Outcome, own: Mask) -> list[Row]:
    ratio = (found.command - found.mean)[own] / np.sqrt(found.variance[own])
    return [
        Row(f"{name}_z2", float(np.mean(ratio**2)), "1", "calibrated", 1.0),
        Row(f"{name}_coverage", float(np.mean(np.abs(ratio) <= NORMAL_95)), "1", "95 %", 0.95),
    ]


def _doubt_rows(found: Outcome, missing: Mask) -> list[Row]:
    """Deviations on the missing manoeuvre over those on held-out blocks of known ones; errors likewise."""
    rows = []
    for name, weights in (("", np.eye(4)), ("_yaw", YAW[:, None] / 2.0)):
        error = (found.command - found.mean) @ weights
        deviation = np.sqrt(found.variance @ weights**2)
        latent = np.sqrt(found.latent @ weights**2)
        real = _rms(error[missing]) / _rms(error[~missing])
        told = float(deviation[missing].mean() / deviation[~missing].mean())
        before = float(latent[missing].mean() / latent[~missing].mean())
        rows += [
            Row(f"crazyflie_unseen_deviation_ratio{name}", told, "1", "ratio of the real errors", real),
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


def _lag_rows(flights: dict[int, list[FlightLog]], block: Outcome) -> list[Row]:
    rows = [Row("crazyflie_lag_ms", 1e3 * block.lag, "ms", "training blocks of all flights")]
    for number in (10, 15):
        lag = command_lag(*training_pieces(flights[number]))
        rows.append(Row(f"crazyflie_lag_flight_{number}_ms", 1e3 * lag, "ms", "that flight alone"))
    return rows


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
