"""What every design criterion owes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.design.criteria import Criterion, Output, evaluate, value_of
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import Kernel, SquaredExponential, structured
from etude.testing.differences import central, close
from etude.types import Array

WIDTH, INSTANTS = 8, 7
CHANNELS = (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
COLUMNS = [(c, part, "1", op) for c, op in CHANNELS for part in ("a", "b")]
KERNELS: dict[str, Kernel] = {
    "squared exponential": SquaredExponential(tuple(range(WIDTH))),
    "structured": structured(COLUMNS, ("a",)),
}


class CriterionSuite:
    """Laws of a design criterion. Set `criterion` (a staticmethod)."""

    criterion: ClassVar[Criterion]
    averaged: ClassVar[bool] = False
    """True for a criterion that divides by the number of planned samples."""

    def outputs(self, kernel: str = "structured", unit: float = 1.0) -> list[Output]:
        """Two outputs of a model, of different size."""
        rng, made = np.random.default_rng(0), []
        for size in (unit, 12.0 * unit):
            X = rng.uniform(-1.0, 1.0, (25, WIDTH))
            gp = ExactGP(KERNELS[kernel], KERNELS[kernel].initial(np.ones(WIDTH), size), np.log(0.1 * size))
            posterior = gp.condition(X, rng.standard_normal(25))
            made.append(Output.of(posterior, rng.uniform(-1.0, 1.0, (11, WIDTH))))
        return made

    def planned(self) -> tuple[Array, Array]:
        """Inputs (T, D) and gains (T, 2)."""
        rng = np.random.default_rng(1)
        return rng.uniform(-1.0, 1.0, (INSTANTS, WIDTH)), rng.uniform(-0.9, 0.9, (INSTANTS, 2))

    def value(self, outputs: list[Output], X: Array, gains: Array) -> float:
        return value_of(type(self).criterion, outputs, X, gains)

    def test_gradients(self) -> None:
        for kernel in KERNELS:
            self._check_gradients(self.outputs(kernel), *self.planned())

    def _check_gradients(self, made: list[Output], X: Array, gains: Array) -> None:
        value, in_X, in_gains = evaluate(type(self).criterion, made, X, gains)
        assert abs(value - self.value(made, X, gains)) <= 1e-11 * max(abs(value), 1e-9)
        close(in_X, central(lambda Z: self.value(made, Z, gains), X), 1e-6, "gradient in X")
        close(in_gains, central(lambda g: self.value(made, X, g), gains), 1e-6, "gradient in the gains")

    def test_the_value_is_a_finite_number(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        value = self.value(made, X, gains)
        assert isinstance(value, float), f"the value is a {type(value).__name__}, not a float"
        assert np.isfinite(value), "the value is no number"

    def test_a_stuck_sample_says_nothing(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        gains[3] = 0.0
        kept = np.arange(INSTANTS) != 3
        value, in_X, _ = evaluate(type(self).criterion, made, X, gains)
        without = self.value(made, X[kept], gains[kept])
        if self.averaged:
            without *= (INSTANTS - 1) / INSTANTS
        assert abs(value - without) <= 1e-9 * max(abs(value), 1e-9), "a sample of weight 0 counts"
        assert np.abs(in_X[3]).max() < 1e-12, "a sample of weight 0 pulls"

    def test_the_sign_of_a_gain_does_not_matter(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        flipped = gains * np.array([1, -1, 1, 1, -1, -1, 1])[:, None]
        value = self.value(made, X, gains)
        assert abs(self.value(made, X, flipped) - value) <= 1e-9 * max(abs(value), 1e-9)

    def test_a_louder_sample_never_says_more(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        assert self.value(made, X, 0.7 * gains) < self.value(made, X, gains), (
            "noise does not make it worth less"
        )

    def test_units_of_an_output_do_not_matter(self) -> None:
        X, gains = self.planned()
        values = [self.value(self.outputs("squared exponential", unit), X, gains) for unit in (1.0, 1000.0)]
        assert abs(values[1] - values[0]) <= 1e-7 * max(abs(values[0]), 1e-9), (
            "N m and mN m are designed alike"
        )
