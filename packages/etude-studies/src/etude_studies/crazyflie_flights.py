"""The real flights of `examples/crazyflie`, learned as a campaign learns, predicted where they were held out.

Inputs are specific force, rates and angular acceleration: the logs tell neither altitude nor velocity. Held
out are blocks of each stretch, or a whole manoeuvre: flight 16 yaws, which flights 10 (thrust) and 15 (roll,
pitch) hardly do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.campaign import label
from etude.logs import median_rate, without_lag
from etude.models import LinearPhysics, ModelConfig, block_masks
from etude.types import Array, Index, Log, Mask, Samples, joined_samples
from etude_quadrotor import common_lag, on_even_grid, with_states
from etude_studies.real_logs import EXAMPLES
from etude_studies.world import World

FOLDER = "crazyflie"
FILES = {
    10: ("log10_thrust.csv",),
    15: ("log15_roll_pitch.csv",),
    16: ("log16_yaw_first.csv", "log16_yaw_second.csv"),
}
ROBOT = "crazyflie.toml"
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
        mean, variance: of the chosen structure. latent: the variance that its processes have before
            calibration and noise. linear: linear regression. rigid: the rigid-body map.
        lag: s by which the flights were corrected. chosen: kind of the model.
    """

    group: Index
    command: Array
    raw: Array
    mean: Array
    variance: Array
    latent: Array
    linear: Array
    rigid: Array
    lag: float
    chosen: str


def crazyflie_flights() -> dict[int, list[Log]]:
    """The stretches of each flight by its number, with the states that they tell; empty where the examples
    are not all there.
    """
    folder = EXAMPLES / FOLDER
    files = [folder / name for names in FILES.values() for name in names]
    if not all(path.is_file() for path in (*files, folder / ROBOT)):
        return {}
    world = crazyflie()
    return {
        number: [with_states(on_even_grid(world.read(folder / name))) for name in names]
        for number, names in FILES.items()
    }


def crazyflie() -> World:
    """The vehicle of the example."""
    return World.of(EXAMPLES / FOLDER / ROBOT)


def by_block(
    flights: dict[int, list[Log]],
    rng: np.random.Generator,
    lag: float | None = None,
    config: ModelConfig | None = None,
) -> Outcome:
    """Blocks 3, 8, 13 and 18 of 20 of every stretch, predicted from the others.

    Args:
        lag: s; None measures it on the training blocks.
        config: of the ladder, if not the preset's.
    """
    if lag is None:
        lag = lag_of([log for logs in flights.values() for log in logs])
    return _outcome(flights, (), lag, rng, config)


def by_manoeuvre(flights: dict[int, list[Log]], rng: np.random.Generator) -> Outcome:
    """Flight 16 whole, and the held-out blocks of flights 10 and 15, from the other blocks of these two."""
    training = [log for number, logs in flights.items() if number != UNSEEN for log in logs]
    return _outcome(flights, (UNSEEN,), lag_of(training), rng)


def lag_of(logs: Sequence[Log]) -> float:
    """Seconds by which the motion lags behind the commands, by the training blocks of these logs."""
    world = crazyflie()
    return common_lag(training_pieces(logs), world.spec, world.config.data)


def in_flight(outcome: Outcome, number: int = UNSEEN) -> Mask:
    """(n,) samples of that flight."""
    return np.asarray(outcome.group == number)


def training_pieces(logs: Sequence[Log]) -> list[Log]:
    """What lies between the held-out blocks of each log, as logs of their own."""
    pieces = []
    for log in logs:
        training = np.flatnonzero(block_masks(log.t, GAP_S)[0])
        for run in np.split(training, np.flatnonzero(np.diff(training) > 1) + 1):
            pieces.append(log.take(run))
    return pieces


def nmse(command: Array, mean: Array) -> float:
    """Squared error over the variance of each set-point, mean of the four."""
    return float(np.mean(np.mean((command - mean) ** 2, axis=0) / np.var(command, axis=0)))


def _samples(log: Log, number: int, lag: float, start: float = 0.0) -> tuple[Samples, Array]:
    """The samples of a stretch, the first at `start` s, and the set-points (n, 4) recorded `lag` before the
    middle of each.
    """
    world = crazyflie()
    data = world.samples(log, data=replace(world.config.data, lag_s=lag))
    recorded = without_lag(log, lag)
    first = recorded.t[0] + 0.5 * (1.0 / median_rate(data.t) - 1.0 / median_rate(log.t))
    raw = np.column_stack([np.interp(first + data.t, recorded.t, c) for c in recorded["command"].T])
    group = np.full_like(data.group, number)
    return replace(data, log=replace(data.log, t=start + data.t), group=group), raw


def _divided(
    flights: dict[int, list[Log]], unseen: tuple[int, ...], lag: float
) -> tuple[Samples, Samples, Array]:
    """Training and test samples, and the test's recorded set-points; flights of `unseen` are test alone."""
    train, test, raw = [], [], []
    for number, logs in flights.items():
        start = 0.0
        for log in logs:
            data, recorded = _samples(log, number, lag, start)
            training, held = block_masks(data.t, GAP_S)
            if number in unseen:
                training, held = np.zeros_like(training), np.ones_like(held)
            train.append(data.take(training))
            test.append(data.take(held))
            raw.append(recorded[held])
            start = float(data.t[-1]) + 1.0  # a pause: the recording goes on later
    return joined_samples(train), joined_samples(test), np.concatenate(raw)


def _outcome(
    flights: dict[int, list[Log]],
    unseen: tuple[int, ...],
    lag: float,
    rng: np.random.Generator,
    config: ModelConfig | None = None,
) -> Outcome:
    train, test, raw = _divided(flights, unseen, lag)
    world = crazyflie()
    model = world.learned(train, config or world.config.model, rng).model
    mean, variance = model.posterior(test.log)
    latent, X = np.zeros_like(mean), model.inputs.of_log(test.log)
    for candidate in model.candidates:
        assert candidate.process is not None
        command_variance = candidate.weights * candidate.units[1] ** 2 * candidate.process.predict(X)[1]
        latent[:, list(candidate.commands)] += command_variance
    return Outcome(
        group=test.group,
        command=test.command,
        raw=raw,
        mean=mean,
        variance=variance,
        latent=latent,
        linear=LinearPhysics(model.inputs)(train).predict(test.log),
        rigid=world.kind.physics(world.spec, world.config)["identified"](train).predict(test.log),
        lag=lag,
        chosen=label(model.in_use),
    )
