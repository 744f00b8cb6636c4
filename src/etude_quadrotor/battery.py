"""Battery voltage as an input: a discharged battery needs a larger fraction of full scale.

Under load the voltage falls at once, so a quick dip is caused by the command. Only its slow part may be an
input. Within a single flight, this part is equivalent to time.
"""

from __future__ import annotations

import numpy as np

from etude.types import Array, Log, Samples
from etude_quadrotor.channels import BATTERY
from etude_quadrotor.physics.linear_inverse import OPTIONAL, physical_features

SLOW_S = 10.0
"""s over which the voltage is averaged: longer than what a motion does to it."""
VARIES = 0.01
"""Of the voltage: what a model can learn from."""
SHRINKAGE = 1e-3
"""Of the weights, per sample."""


def slow_voltage(log: Log) -> Log:
    """The log with its voltage averaged over `SLOW_S` about each instant; unchanged without a voltage."""
    if BATTERY.name not in log:
        return log
    total = np.concatenate([[0.0], np.cumsum(log[BATTERY.name][:, 0])])
    first = np.searchsorted(log.t, log.t - 0.5 * SLOW_S, side="left")
    last = np.searchsorted(log.t, log.t + 0.5 * SLOW_S, side="right")
    return log.put(BATTERY, ((total[last] - total[first]) / (last - first))[:, None])


def usual_voltage(samples: Samples) -> float | None:
    """Median voltage for plans, V; None if the voltage is not an input.

    It is not an input if a flight lacks it, if it does not vary, or if it does not help. It helps if linear
    regression on physical features predicts each flight from the others better with it, in sum and on most
    flights. A single flight cannot show this.
    """
    if BATTERY.name not in samples.log:
        return None
    voltage = samples.log[BATTERY.name][:, 0]
    usual = float(np.median(voltage))
    if usual <= 0.0 or np.ptp(voltage) < VARIES * usual or len(np.unique(samples.group)) < 2:
        return None
    uses = tuple(name for name in OPTIONAL if name in samples.log)
    without = physical_features(samples.log, uses)
    charge = (voltage / usual - 1.0)[:, None]
    beside = np.hstack([without, charge, charge * samples.log["specific_force"][:, 2:]])
    plain, more = _errors(without, samples), _errors(beside, samples)
    helps = more.sum() < plain.sum() and (more < plain).mean() > 0.5
    return usual if helps else None


def _errors(features: Array, samples: Samples) -> Array:
    """Squared error (G,) of each flight, predicted from the others, in variances of the commands."""
    # a command that never changes stays as it is, instead of 0 / 0
    y = samples.command / np.maximum(samples.command.std(axis=0), 1e-300)
    spread = features.std(axis=0)
    X = np.column_stack([np.ones(len(y)), features / np.where(spread > 0.0, spread, 1.0)])
    errors = []
    for number in np.unique(samples.group):
        held_out = samples.group == number
        A, b = X[~held_out], y[~held_out]
        weights = np.linalg.solve(A.T @ A + SHRINKAGE * len(A) * np.eye(A.shape[1]), A.T @ b)
        errors.append(float(np.sum((y[held_out] - X[held_out] @ weights) ** 2)))
    return np.array(errors)
