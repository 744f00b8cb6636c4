"""Diagnosis of a change by the errors of a changed robot: load, friction, a broken or frozen sensor; and
its size: kg at the last link, a factor of the friction, a factor of a command.

Of a size, one number fits the errors of all outputs together by least squares, each weighed by its predicted
deviation. So it says little where the cause is another one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.types import Array, Log, Mask, Samples

NAMED = 0.5
"""Most of the errors' squares that a cause may leave to be named."""
AHEAD = 0.5
"""Most that it may leave of what another leaves."""
ALONE = 0.8
"""Least share of the squares in one output that makes it the only one, and of those that go with gravity."""
SLOW = 0.05
"""Of the largest velocity, within which friction turns round."""

SHARES = tuple(0.4 * 1.7**-k for k in range(8))
"""Of a position's range, offsets of its encoder that are tried: from two fifths down to one per cent."""

Cause = Literal["load", "friction", "offset", "gain", "encoder", "stuck", "unknown"]
SENSOR: tuple[Cause, ...] = ("offset", "gain", "encoder", "stuck")
"""Causes that are a sensor's."""


@dataclass(frozen=True, eq=False)
class ExpectedCommands:
    """What the model says of the commands, by which the errors of a broken sensor are known.

    Attributes:
        mean: (n, J) predicted commands; errors of a sensor that is out of scale are in proportion to them.
        ranges: (k,) of the positions.
        without: (i, d) -> (n, J) commands predicted if position i were d less: what is true if its encoder
            reads d too much.
        carried: (n, J) commands for each kg at the last link, by a model file; None without one.
    """

    mean: Array
    ranges: Array
    without: Callable[[int, float], Array]
    carried: Array | None = None


def cause(
    error: Array,
    deviation: Array,
    use: Mask,
    motion: tuple[Array, Array, Array],
    expected: ExpectedCommands | None = None,
) -> Cause:
    """What the errors (n, J) of a changed robot follow most, or "unknown" where two are alike.

    Friction follows the sign of the velocity and the velocity, an offset is constant. A load follows gravity
    and acceleration; in poses much alike its gravity is constant, too. Then it is taken for a load if several
    outputs are off at once, all with gravity or all against it, and else for an offset. A command's sensor
    that is out of scale errs in proportion to one command alone, an encoder with an offset in all commands as
    they change with that position. Each has one number where load and friction have several.

    Args:
        deviation: (n, J) predicted, by which outputs are weighed.
        use: (n, J) samples that say something.
        motion: static part (n, J), velocity (n, J) and acceleration (n, J).
        expected: None: no scale and no encoder is looked at.
    """
    left, squares, along = np.zeros(3), np.zeros(use.shape[1]), np.zeros(use.shape[1])
    for j, mask in enumerate(use.T):
        static, velocity, acceleration = (part[mask, j] for part in motion)
        one = np.ones_like(velocity)
        rub = [np.tanh(velocity / (SLOW * _top(velocity))), velocity]
        z = error[mask, j] / deviation[mask, j]
        models = [one, static, acceleration], rub, [one]
        left += [_rss(z, np.column_stack(columns) / deviation[mask, j, None]) for columns in models]
        squares[j], along[j] = z @ z, np.sign(z @ (static / deviation[mask, j]))
    total = squares.sum()
    load, friction, constant = left / total if total > 0.0 else np.ones(3)
    at_link = (
        np.inf
        if expected is None or expected.carried is None or total <= 0.0
        else (_rss((error / deviation)[use], (expected.carried / deviation)[use][:, None]) / total)
    )
    if expected is not None and total > 0.0:
        sensor, leaves = _sensor(error, deviation, use, expected, squares)
        leaves, best = leaves / total, min(load, friction, at_link)
        if leaves <= NAMED and leaves <= AHEAD * best:
            return sensor
        if best > AHEAD * leaves:
            return "unknown"
    if at_link <= NAMED and at_link <= AHEAD * friction:
        return "load"  # one number for all outputs
    if friction <= NAMED and friction <= AHEAD * load:
        return "friction"
    if load > NAMED or load > AHEAD * friction:
        return "unknown"
    several = squares.max() < ALONE * total and abs(along @ squares) >= ALONE * total
    return "load" if several or load <= AHEAD * constant else "offset"


def _sensor(
    error: Array, deviation: Array, use: Mask, expected: ExpectedCommands, squares: Array
) -> tuple[Cause, float]:
    """Which sensor's fault leaves least of the squares, and what it leaves."""
    j, total = int(np.argmax(squares)), float(squares.sum())
    faults: list[tuple[float, Cause]] = [(_encoder(error, deviation, use, expected), "encoder")]
    if squares[j] >= ALONE * total:
        mask = use[:, j]
        scale = (expected.mean[mask, j] / deviation[mask, j])[:, None]
        left = _rss(error[mask, j] / deviation[mask, j], scale)
        faults.append((total - float(squares[j]) + left, "gain"))
    leaves, name = min(faults)
    return name, leaves


def _encoder(error: Array, deviation: Array, use: Mask, expected: ExpectedCommands) -> float:
    """What the likeliest offset of one encoder leaves."""
    if not (expected.ranges > 0.0).any():
        return np.inf
    return _rss_without(error, deviation, use, expected, *encoder_offset(error, deviation, use, expected))


def _rss_without(
    error: Array, deviation: Array, use: Mask, expected: ExpectedCommands, i: int, d: float
) -> float:
    z = (error - expected.without(i, d) + expected.mean) / deviation
    return float(np.sum(z[use] ** 2))


def encoder_offset(
    error: Array, deviation: Array, use: Mask, expected: ExpectedCommands
) -> tuple[int, float]:
    """The position whose encoder is likeliest to read too much, and by how much. Some position moves.

    Commands may be no straight line within it (a ripple), so offsets are tried, and the best is refined.
    """
    from scipy.optimize import minimize_scalar

    def left(i: int, d: float) -> float:
        return _rss_without(error, deviation, use, expected, i, d)

    moved = np.flatnonzero(expected.ranges > 0.0).tolist()
    tried = [(i, s * share * float(expected.ranges[i])) for i in moved for share in SHARES for s in (1, -1)]
    i, d = min(tried, key=lambda pair: left(*pair))
    # SHARES are 1.7 times apart: the best of them is refined within 1.5 times its size
    ends = sorted((d / 1.5, d * 1.5))
    return i, float(minimize_scalar(lambda x: left(i, x), bounds=ends, method="bounded").x)


def alone(error: Array, deviation: Array, use: Mask) -> int | None:
    """The output that holds nearly all of the errors' squares; None if there is none."""
    squares = np.where(use, (error / deviation) ** 2, 0.0).sum(axis=0)
    first = int(np.argmax(squares))
    return first if squares[first] >= ALONE * squares.sum() > 0.0 else None


def _rss(z: Array, features: Array) -> float:
    """Squares of z (n,) that no combination of the features (n, p) explains."""
    size = np.linalg.norm(features, axis=0)
    columns = features[:, size > 0.0] / size[size > 0.0]
    left = z - columns @ np.linalg.lstsq(columns, z, rcond=None)[0] if columns.size else z
    return float(np.sum(left**2))


def _top(velocity: Array) -> float:
    return max(float(np.abs(velocity).max(initial=0.0)), np.finfo(float).tiny)


def rate_of(log: Log, name: str) -> str:
    """The channel that is the rate of that one; "" if there is none."""
    rates = (n for n, c in log.channels.items() if name and c.derivative_of == name)
    return next(rates, "")


FROZEN_S = 3.0
"""s of motion without any change."""
SAME = 1e-9
"""Of the largest value, within which two samples are the same."""
GOES_ON = 0.05
"""Of its own range, that a plan moves while its position does not."""


def frozen_sensor(samples: Samples) -> tuple[int, int] | None:
    """The output and the sample at which it was certain; None if nothing is, or positions are not known.

    A command that stays the same while its joint moves; a position that stays the same while its plan moves.
    """
    path = samples.log.channels["command"].acts_on
    if not path or path not in samples.log:
        return None
    frozen = _first(samples.t, samples.command, samples.moving)
    plan = samples.log.get(f"{path}_des")
    if plan is None or plan.shape != samples.command.shape:
        return frozen
    held = _first(samples.t, samples.log[path], np.ones_like(samples.moving), plan)
    return min((one for one in (frozen, held) if one is not None), key=lambda one: one[1], default=None)


def _first(t: Array, values: Array, use: Mask, plan: Array | None = None) -> tuple[int, int] | None:
    """Output and sample of the first stretch that is long enough."""
    earliest: tuple[int, int] | None = None
    for j, column in enumerate(values.T):
        same = np.abs(np.diff(column)) <= SAME * max(float(np.abs(column).max(initial=0.0)), SAME)
        same &= use[1:, j] & use[:-1, j]
        begin = None
        for i, held in enumerate(same.tolist(), start=1):
            begin = (i - 1 if begin is None else begin) if held else None
            if begin is None or t[i] - t[begin] < FROZEN_S:
                continue
            if plan is None or np.ptp(plan[begin : i + 1, j]) > GOES_ON * np.ptp(plan[:, j]):
                earliest = (j, i) if earliest is None or i < earliest[1] else earliest
                break
    return earliest


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
    others = squares.sum() - squares
    is_positive = others > 0.0
    if is_positive.sum() < 2:
        return 0.0
    without = (products.sum() - products)[is_positive] / others[is_positive]
    return float(np.sqrt((is_positive.sum() - 1) * without.var()))


def _friction(mean: Array, use: Mask, motion: tuple[Array, Array, Array]) -> Array:
    """(n, J) the part of the predicted commands that follows the sign of the velocity and the velocity."""
    friction = np.zeros_like(mean)
    for j, mask in enumerate(use.T):
        static, velocity, acceleration = (part[:, j] for part in motion)
        if not mask.any():
            continue
        top = max(float(np.abs(velocity[mask]).max()), np.finfo(float).tiny)
        rub = np.column_stack([np.tanh(velocity / (SLOW * top)), velocity])
        others = np.column_stack([static, acceleration, np.ones_like(static)])
        weights = np.linalg.lstsq(np.hstack([rub, others])[mask], mean[mask, j], rcond=None)[0]
        friction[:, j] = rub @ weights[:2]
    return friction
