"""Memoized physics: commands and their fallbacks evaluate the same mean function once an instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from etude.models.learned_model import LearnedModel
from etude.protocols import Mean
from etude.types import Array, Code, Log


@dataclass(eq=False)
class MemoizedMean:
    """A mean function that remembers its answer to the last single instant (implements `protocols.Mean`)."""

    original: Mean
    _key: list[bytes] = field(default_factory=list)
    _value: Array | None = None

    def predict(self, log: Log) -> Array:
        """As of the original mean."""
        if len(log) != 1:
            return self.original.predict(log)
        key = [name.encode() + values.tobytes() for name, values in log.values.items()]
        if self._value is None or key != self._key:
            self._key, self._value = key, self.original.predict(log)
        return self._value.copy()

    def static(self, log: Log) -> Array:
        """As of the original mean."""
        return self.original.static(log)

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """As of the original mean."""
        return self.original.parameters()

    def arrays(self) -> Mapping[str, Array]:
        """As of the original mean."""
        return self.original.arrays()

    def c(self, name: str) -> Code | None:
        """As of the original mean."""
        return self.original.c(name)


def with_memoized_means(model: LearnedModel) -> LearnedModel:
    """The same model, its mean functions remembering their last instant."""
    memoized: dict[int, MemoizedMean] = {}
    for candidate in model.candidates:
        mean = candidate.mean
        if mean is not None:
            memoized.setdefault(id(mean), mean if isinstance(mean, MemoizedMean) else MemoizedMean(mean))
    return replace(
        model,
        candidates=tuple(
            c if c.mean is None else replace(c, mean=memoized[id(c.mean)]) for c in model.candidates
        ),
    )
