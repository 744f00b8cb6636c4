"""Thinning of many cases of one law: which of them run every day."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def daily(cases: Sequence[Mapping[str, object]], step: int = 0) -> list[int]:
    """Places of the cases that run every day.

    Args:
        cases: the value of each parameter in each case, hashable.
        step: so many cases of which one runs; 0: as few as meet each value of each parameter.
    """
    if step:
        return list(range(0, len(cases), step))
    kept, left = [], {own for case in cases for own in case.items()}
    while left:
        best = max(range(len(cases)), key=lambda i: len(left & cases[i].items()))
        kept.append(best)
        left -= cases[best].items()
    return sorted(kept)
