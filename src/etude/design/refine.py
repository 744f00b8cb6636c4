"""Local refinement of a candidate: L-BFGS over variables whose every value is a certified trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.design.objective import Objective
from etude.robots.spec import RobotSpec
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import FourierTrajectory, rest_constraints
from etude.trajectories.gauge import CertifiedRows

Array = NDArray[np.float64]

CORNER = 30
"""p of the smooth corner at the edge of the limits; the final step takes back the few per cent it costs."""


def refine(
    objective: Objective,
    rows: CertifiedRows,
    spec: RobotSpec,
    family: TrajectoryFamily,
    start: FourierTrajectory,
    steps: int,
) -> tuple[FourierTrajectory, float, int]:
    """The best certified trajectory met in `steps` iterations from `start`, its value, and evaluations."""
    from scipy.optimize import minimize

    search = Search(objective, rows, Variables.of(spec, family, start.omega0))
    first = search.variables.pack(start.coefficients, start.omega0)
    best = Best(-np.inf, first)

    def cost(y: Array) -> tuple[float, Array]:
        value, gradient = search.value_and_gradient(y)
        best.offer(value, y)
        return -value, -gradient

    bounds = [(None, None)] * (len(first) - 1) + [(0.0, 1.0)]
    options = {"maxiter": steps, "maxcor": 20, "maxls": 10}
    minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    coefficients, omega0 = search.certified(best.y)
    coefficients, value = _to_the_edge(objective, rows, coefficients, omega0, best.value)
    return family.trajectory(coefficients, omega0), value, best.count + spec.dof


def _to_the_edge(
    objective: Objective, rows: CertifiedRows, coefficients: Array, omega0: float, value: float
) -> tuple[Array, float]:
    """Each joint in turn enlarged to the exact edge of its limits, where that raises the value."""
    full = rows.scale_to(coefficients, omega0, enlarge=True)
    for joint in range(full.shape[1]):
        trial = coefficients.copy()
        trial[:, joint] = full[:, joint]
        trial_value = objective.value(trial, omega0)
        if trial_value > value:
            coefficients, value = trial, trial_value
    return coefficients, value


@dataclass
class Best:
    """The best point seen, because a line search may end elsewhere."""

    value: float
    y: Array
    count: int = 0

    def offer(self, value: float, y: Array) -> None:
        self.count += 1
        if value > self.value:
            self.value, self.y = value, y.copy()


@dataclass(frozen=True)
class Variables:
    """Coefficients and omega0 as one vector of numbers of order one.

    Attributes:
        scale: (2N+1, dof) size of each coefficient at which some limit is reached by it alone.
        free: (dof, 2N+1, P) basis of the scaled coefficients that keep the family's rest equalities.
        middle: (dof,) rad, centre of the position limits.
        low, high: range of omega0, rad/s.
    """

    scale: Array
    free: Array
    middle: Array
    low: float
    high: float

    @classmethod
    def of(cls, spec: RobotSpec, family: TrajectoryFamily, omega0: float) -> Variables:
        w = omega0 * np.arange(1, family.harmonics + 1)[:, None]
        half = 0.5 * (spec.upper - spec.lower)
        size = np.minimum(np.minimum(half * w, spec.velocity), spec.acceleration / w)
        scale = np.vstack([half, size, size])
        free = [np.eye(len(scale))] * spec.dof
        if family.rest == "nullspace":
            rows = rest_constraints(family.harmonics)
            free = [np.linalg.svd(rows * scale[:, j])[2][2:].T for j in range(spec.dof)]
        low, high = family.omega0_range if family.omega0_is_free else (omega0, omega0)
        return cls(scale, np.array(free), 0.5 * (spec.upper + spec.lower), low, high)

    def pack(self, coefficients: Array, omega0: float) -> Array:
        """The vector (dof P + 1,) of a member of the family."""
        table = coefficients.copy()
        table[0] -= self.middle
        y = np.einsum("jcp,cj->jp", self.free, table / self.scale)
        share = (omega0 - self.low) / (self.high - self.low) if self.high > self.low else 0.0
        return np.append(y.ravel(), share)

    def unpack(self, y: Array) -> tuple[Array, float]:
        """Coefficients relative to rest in the middle (2N+1, dof), and omega0."""
        parts = y[:-1].reshape(len(self.middle), -1)
        table: Array = np.einsum("jcp,jp->cj", self.free, parts) * self.scale
        return table, self.low + float(y[-1]) * (self.high - self.low)

    def pull(self, in_coefficients: Array, in_omega0: float) -> Array:
        """Gradient in the vector from gradients in the coefficients and omega0."""
        y = np.einsum("jcp,cj->jp", self.free, in_coefficients * self.scale)
        return np.append(y.ravel(), in_omega0 * (self.high - self.low))


@dataclass(frozen=True)
class Search:
    """The objective on variables that cannot leave the limits.

    A joint that uses its limits by g is drawn towards rest in the middle by (1 + g^p)^(-1/p), which is nearly
    1 inside and 1/g outside, and always enough: g is the smooth gauge, never below the true one. So every
    evaluation is of a certified trajectory and the search has no corners.
    """

    objective: Objective
    rows: CertifiedRows
    variables: Variables

    def certified(self, y: Array) -> tuple[Array, float]:
        """Coefficients inside the limits and omega0."""
        offset, omega0 = self.variables.unpack(y)
        centre = self.rows.centre((len(offset) - 1) // 2)
        use, _, _ = self.rows.smooth_gauge(centre + offset, omega0)
        return centre + offset * _shrink(use), omega0

    def value_and_gradient(self, y: Array) -> tuple[float, Array]:
        """Value at the certified trajectory of y, and its gradient in y."""
        offset, omega0 = self.variables.unpack(y)
        centre = self.rows.centre((len(offset) - 1) // 2)
        use, use_gradient, use_slope = self.rows.smooth_gauge(centre + offset, omega0)
        shrink = _shrink(use)
        value, gradient, slope = self.objective.value_and_gradient(
            centre + offset * shrink, omega0, with_omega0=self.variables.high > self.variables.low
        )
        in_use = -np.einsum("cj,cj->j", offset, gradient) * shrink**2 * (use * shrink) ** (CORNER - 1)
        in_offset = gradient * shrink + use_gradient * in_use
        return value, self.variables.pull(in_offset, slope + float(use_slope @ in_use))


def _shrink(use: Array) -> Array:
    """(1 + use^p)^(-1/p) without overflow."""
    larger = np.maximum(use, 1.0)
    rest = (1.0 / larger) ** CORNER + (use / larger) ** CORNER
    return np.asarray(rest ** (-1.0 / CORNER) / larger)
