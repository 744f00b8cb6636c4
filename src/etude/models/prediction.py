"""What a model says of states: a pair of commands and variances that also knows what holds of it."""

from __future__ import annotations

from collections.abc import Sequence

from etude.types import Array


class Prediction(tuple[Array, Array]):
    """(mean, variance), each (n, J): `mean, variance = model.predict(log)`.

    Attributes:
        unknown: (n, J) the variance without noise, at rest too.
        said: sentences about what the answer holds for, such as that rows counted by themselves.
    """

    unknown: Array
    said: tuple[str, ...]

    @classmethod
    def of(cls, mean: Array, variance: Array, unknown: Array, said: Sequence[str] = ()) -> Prediction:
        """The pair with what is beside it."""
        found = cls((mean, variance))
        found.unknown, found.said = unknown, tuple(said)
        return found

    @property
    def mean(self) -> Array:
        return self[0]

    @property
    def variance(self) -> Array:
        return self[1]
