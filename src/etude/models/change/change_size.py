"""How large a change is, once its cause is named: kg at the last link, times the friction, times a command.

Each cause has one number, which fits the errors of all outputs together by least squares, each weighed by its
predicted deviation. So the number says little where the cause is another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.models.change.diagnosis import SLOW, Cause, ExpectedCommands, alone, encoder_offset
from etude.types import Array, Mask

APART = 5.0  # samples of a log that one independent sample is worth


@dataclass(frozen=True)
class Size:
    """A number and what it leaves.

    Attributes:
        value: of a load kg; of friction and a gain the factor; of an encoder rad or m.
        deviation: of the value. left: part of the errors' squares that the value leaves.
        joint: the position whose encoder it is, or the command that is out of scale; None of other causes.
    """

    value: float
    deviation: float
    left: float
    joint: int | None = None


def size_of(
    what: Cause,
    error: Array,
    deviation: Array,
    use: Mask,
    motion: tuple[Array, Array, Array],
    expected: ExpectedCommands,
) -> Size | None:
    """The size of a cause; arguments as of `diagnosis.cause`. None where it has none, or none can be told."""
    if what == "load" and expected.carried is not None:
        return _fitted(error, expected.carried, deviation, use)
    if what == "friction":
        return _fitted(error, _friction(expected.mean, use, motion), deviation, use, 1.0)
    if what == "gain":
        j = alone(error, deviation, use)
        only = use & (np.arange(use.shape[1]) == j)
        return None if j is None else _fitted(error, expected.mean, deviation, only, 1.0, j)
    if what == "encoder":
        i, d = encoder_offset(error, deviation, use, expected)
        step = (expected.without(i, d) - expected.mean) / -d
        return _fitted(error, step, deviation, use, joint=i)
    return None


def _fitted(
    error: Array, by: Array, deviation: Array, use: Mask, before: float = 0.0, joint: int | None = None
) -> Size | None:
    """The factor of `by` (n, J) that explains the errors best, beside the one that it had before."""
    x, z = (np.where(use, part / deviation, 0.0) for part in (by, error))
    squares, products = (x * x).sum(axis=0), (x * z).sum(axis=0)
    square, total = float(squares.sum()), float((z * z).sum())
    if not square > 0.0 or not total > 0.0:
        return None
    factor = float(products.sum()) / square
    left = float(((z - factor * x) ** 2).sum())
    spread = max(np.sqrt(APART * left / max(int(use.sum()), 1) / square), _jackknife(squares, products))
    return Size(before + factor, float(spread), left / total, joint)


def _jackknife(squares: Array, products: Array) -> float:
    """Deviation of sum(products) / sum(squares) by leaving one output out after the other: each has errors of
    its own. 0 of a single one.
    """
    rest = squares.sum() - squares
    known = rest > 0.0
    if known.sum() < 2:
        return 0.0
    without = (products.sum() - products)[known] / rest[known]
    return float(np.sqrt((known.sum() - 1) * without.var()))


def _friction(mean: Array, use: Mask, motion: tuple[Array, Array, Array]) -> Array:
    """(n, J) the part of the predicted commands that follows the sign of the velocity and the velocity."""
    found = np.zeros_like(mean)
    for j, own in enumerate(use.T):
        static, velocity, acceleration = (part[:, j] for part in motion)
        if not own.any():
            continue
        top = max(float(np.abs(velocity[own]).max()), np.finfo(float).tiny)
        rub = np.column_stack([np.tanh(velocity / (SLOW * top)), velocity])
        rest = np.column_stack([static, acceleration, np.ones_like(static)])
        weights = np.linalg.lstsq(np.hstack([rub, rest])[own], mean[own, j], rcond=None)[0]
        found[:, j] = rub @ weights[:2]
    return found
