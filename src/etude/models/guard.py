"""The guard: no output of a model may err more than linear regression does on motion held out.

A process can be worse: it returns to its mean outside the data, where a linear trend goes on, and it can
diverge where its hyperparameters were taught by too few samples. It then learns what linear regression
leaves, and is left out where even that does not help.

Stretches of a single trajectory are no evidence for that: they are all near each other, and a regression that
fits them best may err without bound on the next motion. Then the process stays, with a warning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Role = Literal["process", "unsure", "linear+process", "linear"]

OUTCOMES: dict[Role, str] = {
    "unsure": ", but one trajectory is too little to fall back to that; tell another one",
    "linear+process": ", so the process now learns only what linear regression leaves",
    "linear": ", so this output is predicted by linear regression alone",
}
ROUNDING = 1e-20
"""Part of the mean square of the target below which an error is rounding: both are right."""


@dataclass(frozen=True)
class Guard:
    """What became of the outputs; one entry for each.

    Attributes:
        roles: "process": as trained; "unsure": as trained, though linear regression predicted stretches of
            the only trajectory better; "linear+process": the process learns what linear regression leaves;
            "linear": linear regression alone, and the process only says where no data are.
        weights: (3 dof + 1, dof) of `linear_inputs`; zero for the first two.
        process_error, linear_error: (dof,) held-out mean squared errors that decided: of the process alone
            and of linear regression; NaN where nothing could be held out.
    """

    roles: tuple[Role, ...]
    weights: Array
    process_error: Array
    linear_error: Array

    @property
    def alone(self) -> NDArray[np.bool_]:
        """(dof,) which outputs are linear regression alone."""
        return np.array([role == "linear" for role in self.roles])

    @property
    def active(self) -> bool:
        """Whether there is something to say of an output."""
        return any(role != "process" for role in self.roles)

    def linear(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Linear parts (n, dof) of the commands; 0 for outputs that need none."""
        return linear_inputs(q, qd, qdd) @ self.weights

    def messages(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """A sentence for each guarded output; `names` are the axes'."""
        found = []
        for j, role in enumerate(self.roles):
            if role == "process":
                continue
            linear = self.linear_error[j]
            worse = float(np.sqrt(self.process_error[j] / linear)) if linear > 0.0 else np.inf
            found.append(
                f"{names[j]}: on motion held out the process erred {worse:.3g} times as much as linear "
                f"regression{OUTCOMES[role]}."
            )
        return tuple(found)


def linear_inputs(q: Array, qd: Array, qdd: Array) -> Array:
    """(n, 3 dof + 1): q, qd, qdd and a constant."""
    return np.hstack([q, qd, qdd, np.ones((len(q), 1))])


def linear_fit(L: Array, y: Array) -> Array:
    """Weights of least squares of y (n,) or (n, k) in L (n, m); of least norm where L lacks rank."""
    weights, *_ = np.linalg.lstsq(L, y, rcond=None)
    return np.asarray(weights)


def linear_errors(L: Array, y: Array, groups: Index, rows: Index) -> Array:
    """Errors (len(rows),) of linear regression at `rows`, each predicted from all samples of other groups."""
    errors = np.empty(len(rows))
    for number in np.unique(groups[rows]):
        own, other = groups[rows] == number, groups != number
        at = rows[own]
        errors[own] = y[at] - L[at] @ linear_fit(L[other], y[other])
    return errors


def residual_errors(
    learn: Callable[[Array, int, Index], tuple[Array, Array]], L: Array, y: Array, groups: Index, rows: Index
) -> tuple[Array, Array]:
    """Errors and variances at `rows` of linear regression and a process on what it leaves.

    Each group is left out of both: `learn(residual, group, at)` predicts mean and variance of the residual at
    `at` from the samples of the other groups.
    """
    errors, variances = np.empty(len(rows)), np.empty(len(rows))
    for number in np.unique(groups[rows]):
        own, other = groups[rows] == number, groups != number
        at = rows[own]
        residual = y - L @ linear_fit(L[other], y[other])
        mean, variances[own] = learn(residual, int(number), at)
        errors[own] = residual[at] - mean
    return errors, variances


def is_worse(error: Array, linear: Array, y: Array) -> bool:
    """Whether `error` is larger than that of linear regression, in the mean square, beyond rounding of y."""
    return bool(np.mean(error**2) > np.mean(linear**2) + ROUNDING * np.mean(y**2))
