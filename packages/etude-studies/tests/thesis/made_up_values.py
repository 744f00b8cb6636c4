"""Numbers that nobody measured, in the place of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Key = tuple[str, str, int, str, str]


@dataclass
class MadeUp:
    """Answers only what was put in, under the very measure, test and part."""

    numbers: dict[Key, Mapping[int, float]] = field(default_factory=dict)

    def put(
        self,
        source: str,
        by_k: Mapping[int, Sequence[float] | Mapping[int, float]],
        *,
        measure: str = "error",
        test: str = "fourier",
        part: str = "mean",
    ) -> MadeUp:
        for k, own in by_k.items():
            by_seed = own if isinstance(own, Mapping) else dict(enumerate(own))
            self.numbers[source, measure, k, test, part] = by_seed
        return self

    def values(self, source: str, measure: str, k: int, test: str, part: str) -> Mapping[int, float]:
        return self.numbers.get((source, measure, k, test, part), {})


def drawn(n: int, mean: float, sd: float, seed: int = 0) -> np.ndarray:
    """(n,) of exactly that mean and standard deviation, of no special shape."""
    x = np.random.default_rng(seed).normal(size=n)
    return mean + sd * (x - x.mean()) / x.std(ddof=1)
