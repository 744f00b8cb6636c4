"""How many seeds would settle a part with power 80 %, the mean and spread of today's taken as the truth."""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.special import nctdtr, stdtrit

POWER = 0.8
MOST = 100_000
"""Seeds beyond which a part counts as one that no number settles."""


def difference_power(n: int, mean: float, sd: float, level: float) -> float:
    """Chance that the two-sided paired t test of n seeds rejects a mean of 0 on the side of `mean`."""
    bound = float(stdtrit(n - 1, 1.0 - 0.5 * level))
    return 1.0 - _below(bound, n, abs(mean) / sd)


def equivalence_power(n: int, mean: float, sd: float, margin: float, level: float) -> float:
    """Chance that both one-sided tests pass; the sum of their misses is taken off, so at least this much."""
    bound = float(stdtrit(n - 1, 1.0 - level))
    lower = 1.0 - _below(bound, n, (mean + margin) / sd)
    upper = 1.0 - _below(bound, n, (margin - mean) / sd)
    return max(0.0, lower + upper - 1.0)


def seeds_for_difference(mean: float, sd: float, level: float) -> int | None:
    """Seeds at which a difference is found by the t test and can be found by sign flips; None: no number."""
    if mean == 0.0:
        return None
    fewest = _flips(level / 2.0)
    if sd == 0.0:
        return fewest
    return _least(lambda n: difference_power(n, mean, sd, level), fewest)


def seeds_for_equivalence(mean: float, sd: float, margin: float, level: float = 0.05) -> int | None:
    """Seeds at which two one-sided tests find the mean within +-margin; None for one that is not within."""
    if abs(mean) >= margin:
        return None
    fewest = _flips(level)
    if sd == 0.0:
        return fewest
    return _least(lambda n: equivalence_power(n, mean, sd, margin, level), fewest)


def _flips(tail: float) -> int:
    """Fewest seeds whose 2^n signs leave one outcome no likelier than `tail`."""
    return max(2, math.ceil(math.log2(1.0 / tail)))


def _below(bound: float, n: int, effect: float) -> float:
    """P(T <= bound), T noncentral t with n - 1 degrees of freedom."""
    return float(nctdtr(n - 1, effect * math.sqrt(n), bound))


def _least(power: Callable[[int], float], fewest: int) -> int | None:
    """Least n from `fewest` to MOST with enough power, which grows with n."""
    if power(fewest) >= POWER:
        return fewest
    low, high = fewest, 2 * fewest
    while power(min(high, MOST)) < POWER:
        if high >= MOST:
            return None
        low, high = high, 2 * high
    high = min(high, MOST)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle) >= POWER else (middle, high)
    return high
