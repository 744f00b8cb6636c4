"""Locally weighted projection regression (Vijayakumar, D'Souza and Schaal 2005): options and learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.models.gp.exact import checked_data
from etude.types import Array
from etude_sparse.lwpr.posterior import LWPRPosterior

if TYPE_CHECKING:
    from etude_sparse.lwpr.fields import ReceptiveFields

ACTIVE = 1e-3
"""Fields that a sample activates less learn nothing from it."""


@dataclass(frozen=True)
class LWPR:
    """Locally weighted projection regression with its knobs (keeps `protocols.Regressor.condition`).

    Choose it for very many samples, when no hyperparameters can be trained beforehand and outputs look
    locally linear. The cost of a sample does not depend on their number. It is no Gaussian process: a process
    with as many samples errs less, as Nguyen-Tuong, Seeger and Peters (2009) find too. Its variance is a
    confidence bound of local linear regressions, and it has no covariance between inputs.

    Inputs and outputs are scaled to unit variance inside; the numbers below refer to those. A direction is
    added at a gain of a tenth; the paper's example requires a half. A robot's log has many inputs that each
    explain a little.

    Attributes:
        metric: D of a new field is this times the identity; None derives it from the spread of the inputs.
        generate: a sample that activates no field by more than this gets a field of its own (w_gen).
        prune: of two fields that a sample activates by more than this, the worse goes (w_prune).
        add: a further direction is added while the newest leaves less than this part of the squared error.
        rate: of the gradient steps of the metric; 0 keeps it as it began. Steps that are too large halve it.
        penalty: gamma, on sum(D²) / inputs: without it fields shrink without end as samples come.
        forget, forget_last, annealing: the forgetting factor begins at the first and approaches the second,
            by 1 - annealing a sample.
        full: learn all of the metric, not its diagonal alone.
        directions: most directions of a field; None for as many as inputs.
        passes: times that `condition` goes through the data, each time in another order.
        noise_floor: least noise deviation, output units.
    """

    metric: float | None = None
    generate: float = 0.1
    prune: float = 0.7
    add: float = 0.9
    rate: float = 250.0
    penalty: float = 1e-6
    forget: float = 0.999
    forget_last: float = 0.9999
    annealing: float = 0.9999
    full: bool = False
    directions: int | None = None
    passes: int = 10
    noise_floor: float = 0.0

    def __post_init__(self) -> None:
        for name in ("metric", "directions", "passes"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise UsageError(f"{name} must be a positive number", where=f"lwpr.{name} = {value}")
        for name in ("rate", "penalty", "noise_floor"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} must be a number >= 0", where=f"lwpr.{name} = {value}")
        if not 0.0 < self.generate < self.prune <= 1.0:
            raise UsageError("0 < generate < prune <= 1 must hold", where=f"lwpr.generate = {self.generate}")
        for name in ("add", "forget", "forget_last", "annealing"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                raise UsageError(f"{name} must be in (0, 1]", where=f"lwpr.{name} = {value}")

    def begin(self, X: Array, y: Array) -> ReceptiveFields:
        """Fields that have learned nothing; X (n, D) and centred y (n,) give the scales alone.

        Raises DataError for unusable X or y.
        """
        from etude_sparse.lwpr.fields import ReceptiveFields, Scales
        from etude_sparse.lwpr.updates import Rule

        X, y = checked_data(X, y)
        rule = Rule(
            generate=self.generate,
            prune=self.prune,
            active=ACTIVE,
            add=self.add,
            penalty=self.penalty,
            rate=self.rate,
            forget=self.forget,
            forget_last=self.forget_last,
            annealing=self.annealing,
            full=self.full,
        )
        most = X.shape[1] if self.directions is None else self.directions
        return ReceptiveFields(rule, Scales.of(X, y, self.metric), most, self.noise_floor)

    def condition(self, X: Array, y: Array) -> LWPRPosterior:
        """The posterior after `passes` passes through X (n, D), centred y (n,), in random but fixed orders.

        Raises DataError for unusable X or y.
        """
        fields = self.begin(X, y)
        order = np.random.default_rng(0)
        for _ in range(self.passes):
            now = order.permutation(len(y))
            fields.observe(np.asarray(X)[now], np.asarray(y)[now])
        return fields.posterior()
