"""The real flights of `examples/crazyflie`, learned as a campaign learns, predicted where they were held out.

Inputs are specific force, rates and angular acceleration: the logs tell neither altitude nor velocity. Held
out are blocks of each stretch, or a whole manoeuvre: flight 16 yaws, which flights 10 (thrust) and 15 (roll,
pitch) hardly do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.logs.flight.lag import command_lag, without_lag
from etude.logs.flight.log import FlightLog
from etude.logs.flight.table import read_flight
from etude.models.blocks import block_masks
from etude.models.flight.config import PRESETS, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.ladder import train_flight_ladder
from etude.models.flight.lesson import fitted_physics, lesson
from etude.models.flight.preprocess import FlightDataConfig, build_flight_dataset, joined
from etude.models.guard import linear_fit, linear_inputs
from etude.robots.flight_spec import FlightSpec
from etude.robots.toml_file import load_robot
from etude_studies.real_logs import EXAMPLES

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
    flights: dict[int, list[FlightLog]],
    rng: np.random.Generator,
    lag: float | None = None,
    config: FlightModelConfig = PRESETS["default"],
) -> Outcome:
    """Blocks 3, 8, 13 and 18 of 20 of every stretch, predicted from the others.

    Args:
        lag: s; None measures it on the training blocks.
        config: of the ladder; inputs that the flights lack are left out.
    """
    if lag is None:
        lag = command_lag(*training_pieces([log for logs in flights.values() for log in logs]))
    return _outcome(flights, (), lag, rng, config)


def by_manoeuvre(flights: dict[int, list[FlightLog]], rng: np.random.Generator) -> Outcome:
    """Flight 16 whole, and the held-out blocks of flights 10 and 15, from the other blocks of these two."""
    seen = [log for number, logs in flights.items() if number != UNSEEN for log in logs]
    return _outcome(flights, (UNSEEN,), command_lag(*training_pieces(seen)), rng, PRESETS["default"])


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
    flights: dict[int, list[FlightLog]],
    unseen: tuple[int, ...],
    lag: float,
    rng: np.random.Generator,
    config: FlightModelConfig,
) -> Outcome:
    train, test, raw = _divided(flights, unseen, lag)
    config = config.suited_to(train.states)
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
