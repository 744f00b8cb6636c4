"""How well a quadrotor's set-points can be predicted from its motion: the flights of `examples/crazyflie`.

Inputs are specific force, rates and angular acceleration, outputs the four motor set-points of full scale.
The motion lags the set-points, because motors take time to change speed: the lag is measured on the flights
other than the unseen one, and corrected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.logs.crazyflie import Flight, read_flights
from etude.logs.derivatives import median_rate, resample, smooth, uniform_grid
from etude.models.blocks import linear_regression, split_blocks
from etude.models.dataset import Dataset, concatenate
from etude.models.guard import linear_fit, linear_inputs
from etude.models.model_config import ModelConfig
from etude.models.output_process import OutputProcess, train_output
from etude.studies.real_accuracy import accuracy_rows, say
from etude.studies.real_logs import EXAMPLES
from etude.studies.rows import Row

Array = NDArray[np.float64]

FILE = "crazyflie/crazyflie_flights.csv"
CUTOFF_HZ = 10.0
"""Of the zero-phase low-pass of motion and set-points alike."""
RATE_HZ = 25.0
LAGS_S = np.arange(0.0, 0.1201, 0.005)
UNSEEN = 16
"""The flight with yaw, which the other two hardly have."""
CONFIG = ModelConfig(kind="gp", kernel="ard_se")


def crazyflie_rows(rng: np.random.Generator) -> list[Row]:
    """`nmse_crazyflie` on held-out blocks, `nmse_crazyflie_unseen` on a whole flight, and the motors' lag."""
    path = EXAMPLES / FILE
    if not path.is_file():
        say(f"nmse_crazyflie left out: there is no {FILE}; install etude again.")
        return []
    flights = read_flights(path)
    lag = motor_lag([flight for flight in flights if flight.number != UNSEEN])
    seen = [samples(flight, lag) for flight in flights if flight.number != UNSEEN]
    unseen = concatenate([samples(flight, lag) for flight in flights if flight.number == UNSEEN])
    whole = [*seen, unseen]
    parts = [split_blocks(flight, gap_s=1.0 / CUTOFF_HZ) for flight in whole]
    train, test = (concatenate([part[side] for part in parts]) for side in (0, 1))
    rows = _rows("crazyflie", train, test, _raw(flights, test, lag), rng)
    rows += _rows("crazyflie_unseen", concatenate(seen), unseen, _raw(flights, unseen, lag), rng)
    return [*rows, Row("crazyflie_motor_lag_ms", 1e3 * lag, "ms")]


def samples(flight: Flight, lag: float) -> Dataset:
    """Filtered motion beside the set-points `lag` seconds earlier, at `RATE_HZ`, ends trimmed.

    The three kinds of input take the places of q, qd and qdd, (n, 3) each; tau is (n, 4).
    """
    rate = median_rate(flight.t)
    grid = uniform_grid(flight.t, rate)
    force, rates, command = (
        smooth(grid, resample(flight.t, signal, grid), CUTOFF_HZ)
        for signal in (flight.specific_force, flight.rates, flight.command)
    )
    trim = 1.0 / CUTOFF_HZ
    inside = np.flatnonzero((grid >= grid[0] + trim + LAGS_S[-1]) & (grid <= grid[-1] - trim))
    keep = inside[:: round(rate / RATE_HZ)]
    return Dataset(
        grid[keep],
        force.value[keep],
        rates.value[keep],
        rates.first[keep],
        resample(grid, command.value, grid[keep] - lag),
        np.zeros((len(keep), flight.command.shape[1]), dtype=np.bool_),
        np.full(len(keep), flight.number, dtype=np.int64),
    )


def motor_lag(flights: list[Flight]) -> float:
    """Seconds by which the motion lags the set-points: where linear regression leaves least of these."""
    return float(min(LAGS_S, key=lambda lag: _left(concatenate([samples(f, float(lag)) for f in flights]))))


def _left(data: Dataset) -> float:
    """Part of the set-points' variance that linear regression leaves, mean of the motors."""
    L = linear_inputs(data.q, data.qd, data.qdd)
    error = data.tau - L @ linear_fit(L, data.tau)
    return float(np.mean(error.var(axis=0) / data.tau.var(axis=0)))


def _rows(name: str, train: Dataset, test: Dataset, raw: Array, rng: np.random.Generator) -> list[Row]:
    X, at = (np.hstack([data.q, data.qd, data.qdd]) for data in (train, test))
    mean = np.empty_like(test.tau)
    for motor in range(test.tau.shape[1]):
        learned = train_output(train, X, train.tau[:, motor], motor, 1.0, CONFIG, rng, None)
        mean[:, motor] = _predict(learned, at, test)
        if learned.role != "process":
            say(f"{name}, motor_{motor + 1} fell back to {learned.role}: linear regression predicted better.")
    moving = np.ones(test.tau.shape, dtype=np.bool_)
    return accuracy_rows(name, test.tau, mean, linear_regression(train, test), moving, raw)


def _predict(learned: OutputProcess, at: Array, test: Dataset) -> Array:
    linear = linear_inputs(test.q, test.qd, test.qdd) @ learned.weights
    if learned.role == "linear":
        return np.asarray(linear)
    return np.asarray(linear + learned.offset + learned.posterior.predict(at)[0])


def _raw(flights: list[Flight], test: Dataset, lag: float) -> Array:
    """(n, 4) set-points as recorded, `lag` before the test samples."""
    raw = np.full(test.tau.shape, np.nan)
    for number in np.unique(test.group):
        own = [flight for flight in flights if flight.number == number]
        t, command = (np.concatenate([getattr(f, name) for f in own]) for name in ("t", "command"))
        at = test.group == number
        raw[at] = resample(t, command, test.t[at] - lag)
    return raw
