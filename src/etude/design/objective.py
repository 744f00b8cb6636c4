"""A criterion as a function of a trajectory's coefficients and omega0, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from etude.design.criteria import Criterion, Output, evaluate, value_of
from etude.design.mask import stick_gains
from etude.models.contracts import Posterior
from etude.models.features import FeatureMap
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import basis, basis_omega0_derivative

Array = NDArray[np.float64]


class DesignModel(Protocol):
    """What a design asks of a model of inverse dynamics."""

    @property
    def features(self) -> FeatureMap: ...

    @property
    def posteriors(self) -> Sequence[Posterior]:
        """One Gaussian process per output."""
        ...

    @property
    def stick_velocity(self) -> Array:
        """(dof,) rad/s below which samples of that joint will be masked."""
        ...


@dataclass(frozen=True)
class Objective:
    """value(coefficients, omega0) to be maximised.

    Attributes:
        criterion: see `criteria`.
        outputs: the model's outputs with their reference states.
        features: the model's feature map.
        stick_velocity: (dof,) rad/s.
        family: gives duration and ramp.
        times: (T,) s, the planned samples.
    """

    criterion: Criterion
    outputs: tuple[Output, ...]
    features: FeatureMap
    stick_velocity: Array
    family: TrajectoryFamily
    times: Array

    def _motion(self, coefficients: Array, omega0: float) -> tuple[Array, ...]:
        rows = basis(self.times, *self._shape(coefficients, omega0))[:3]
        return (*rows, *(row @ coefficients for row in rows))

    def _shape(self, coefficients: Array, omega0: float) -> tuple[int, float, float, float]:
        harmonics = (len(coefficients) - 1) // 2
        return harmonics, omega0, self.family.duration, self.family.phase_ramp

    def inputs(self, coefficients: Array, omega0: float) -> tuple[Array, Array]:
        """Model inputs X (T, D) along the trajectory and gains (T, dof)."""
        _, _, _, q, qd, qdd = self._motion(coefficients, omega0)
        return self.features.transform(q, qd, qdd), stick_gains(qd, self.stick_velocity)[0]

    def value(self, coefficients: Array, omega0: float) -> float:
        """The criterion alone."""
        return value_of(self.criterion, self.outputs, *self.inputs(coefficients, omega0))

    def value_and_gradient(
        self, coefficients: Array, omega0: float, *, with_omega0: bool
    ) -> tuple[float, Array, float]:
        """Value, gradient in the coefficients (2N+1, dof), derivative in omega0 (0 unless asked for).

        q, qd, qdd = Bq x, Bv x, Ba x are linear in the coefficients: the chain is three transposed products.
        """
        Bq, Bv, Ba, q, qd, qdd = self._motion(coefficients, omega0)
        gains, slopes = stick_gains(qd, self.stick_velocity)
        value, in_X, in_gains = evaluate(
            self.criterion, self.outputs, self.features.transform(q, qd, qdd), gains
        )
        in_q, in_qd, in_qdd = self.features.pullback(q, qd, qdd, in_X)
        in_qd = in_qd + in_gains * slopes
        gradient = Bq.T @ in_q + Bv.T @ in_qd + Ba.T @ in_qdd
        if not with_omega0:
            return value, gradient, 0.0
        moved = basis_omega0_derivative(self.times, *self._shape(coefficients, omega0))
        weights = (in_q, in_qd, in_qdd)
        slope = sum(float(np.sum(G * (B @ coefficients))) for G, B in zip(weights, moved, strict=True))
        return value, gradient, slope
