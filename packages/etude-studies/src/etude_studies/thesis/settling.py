"""Number of seeds that decide a part with power 80 %, given today's mean and spread."""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.special import nctdtr, stdtrit

POWER = 0.8
HALF = 0.5
"""Power that a tie needs to find a difference of the margin."""
MOST = 100_000
"""Seeds beyond which a part counts as one that no number settles."""


def difference_power(n: int, mean: float, sd: float, level: float) -> float:
    """Chance that the two-sided paired t test of n seeds rejects a mean of 0 on the side of `mean`.

    0 where sign flips of n seeds cannot reach the level.
    """
    if n < _flips(level / 2.0) or sd == 0.0:
        return float(n >= _flips(level / 2.0) and mean != 0.0)
    bound = float(stdtrit(n - 1, 1.0 - 0.5 * level))
    return 1.0 - _below(bound, n, abs(mean) / sd)


def equivalence_power(n: int, mean: float, sd: float, margin: float, level: float) -> float:
    """Chance that both one-sided tests pass; the sum of their misses is taken off, so at least this much.

    0 where sign flips of n seeds cannot reach the level.
    """
    if n < _flips(level) or sd == 0.0:
        return float(n >= _flips(level) and abs(mean) < margin)
    bound = float(stdtrit(n - 1, 1.0 - level))
    lower = 1.0 - _below(bound, n, (mean + margin) / sd)
    upper = 1.0 - _below(bound, n, (margin - mean) / sd)
    return max(0.0, lower + upper - 1.0)


def seeds_for_difference(mean: float, sd: float, level: float, power: float = POWER) -> int | None:
    """Seeds at which a difference is found by the t test and can be found by sign flips; None: no number."""
    if mean == 0.0:
        return None
    return _least(lambda n: difference_power(n, mean, sd, level), _flips(level / 2.0), power)


def seeds_for_equivalence(mean: float, sd: float, margin: float, level: float = 0.05) -> int | None:
    """Seeds at which two one-sided tests find the mean within +-margin; None for one that is not within."""
    if abs(mean) >= margin:
        return None
    return _least(lambda n: equivalence_power(n, mean, sd, margin, level), _flips(level), POWER)


def _flips(tail: float) -> int:
    """Fewest seeds whose 2^n signs leave one outcome no likelier than `tail`."""
    return max(2, math.ceil(math.log2(1.0 / tail)))


def _below(bound: float, n: int, effect: float) -> float:
    """P(T <= bound), T noncentral t with n - 1 degrees of freedom."""
    return float(nctdtr(n - 1, effect * math.sqrt(n), bound))


def _least(power: Callable[[int], float], fewest: int, enough: float) -> int | None:
    """Least n from `fewest` to MOST with enough power, which grows with n."""
    if power(fewest) >= enough:
        return fewest
    low, high = fewest, 2 * fewest
    while power(min(high, MOST)) < enough:
        if high >= MOST:
            return None
        low, high = high, 2 * high
    high = min(high, MOST)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle) >= enough else (middle, high)
    return high
