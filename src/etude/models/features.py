"""The feature map: one map from joint motion to model inputs, for planned samples and measured logs alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError

Array = NDArray[np.float64]

FRICTION_SCALES = (1.0, 4.0, 16.0)
"""Multiples of v0 with a friction column each: a curve over speed; static may exceed kinetic friction.

With one column, identification stalls at twice the tracking error on an arm with Stribeck friction.
"""


@dataclass(frozen=True)
class FeatureMap:
    """x = [q, qd, qdd] (thesis 6.1), with tanh(qd / (s v0)) appended for each scale s of friction.

    A smooth kernel spends its data on the Coulomb step at qd = 0; the tanh columns hand it the step.

    Attributes:
        dof: number of axes.
        friction_velocity: (dof,) v0 > 0 in rad/s, or None for the thesis's plain inputs.
        friction_scales: multiples s of v0, one column for each and each axis.
    """

    dof: int
    friction_velocity: Array | None = None
    friction_scales: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if self.dof < 1:
            raise UsageError("A feature map needs at least one axis", where=f"dof = {self.dof}")
        v0 = self.friction_velocity
        if v0 is None:
            return
        v0 = np.asarray(v0, dtype=float)
        if v0.shape != (self.dof,) or not bool(np.all(np.isfinite(v0) & (v0 > 0))):
            raise UsageError(
                "Friction velocities must be one positive number (rad/s) for each axis",
                where=f"friction_velocity = {v0.tolist()}, dof = {self.dof}",
            )
        if not self.friction_scales or not all(np.isfinite(s) and s > 0 for s in self.friction_scales):
            raise UsageError(
                "Friction scales must be positive numbers", where=f"friction_scales = {self.friction_scales}"
            )
        object.__setattr__(self, "friction_velocity", v0)

    def friction_thresholds(self) -> list[Array]:
        """The velocities s v0, (dof,) each; empty without friction columns."""
        if self.friction_velocity is None:
            return []
        return [scale * self.friction_velocity for scale in self.friction_scales]

    @property
    def width(self) -> int:
        """D, the number of columns of X."""
        return self.dof * (3 + len(self.friction_thresholds()))

    def transform(self, q: Array, qd: Array, qdd: Array) -> Array:
        """X (n, D) in the layout [q, qd, qdd, tanh(qd / (s v0)) ...]; q, qd, qdd are (n, dof), SI units."""
        columns = [q, qd, qdd]
        for name, column in zip(("q", "qd", "qdd"), columns, strict=True):
            if column.ndim != 2 or column.shape[1] != self.dof or column.shape != q.shape:
                raise UsageError(
                    f"{name} must have one column for each axis and the shape of q",
                    where=f"{name} {column.shape}, q {q.shape}, dof = {self.dof}",
                )
        columns += [np.tanh(qd / threshold) for threshold in self.friction_thresholds()]
        return np.concatenate(columns, axis=1)

    def pullback(self, q: Array, qd: Array, qdd: Array, G: Array) -> tuple[Array, Array, Array]:
        """Gradients (n, dof) of sum(G * transform(q, qd, qdd)) with respect to q, qd and qdd; G is (n, D).

        q and qdd enter linearly, so only qd's value matters.
        """
        if G.shape != (len(qd), self.width) or not q.shape == qd.shape == qdd.shape:
            raise UsageError("G must be (samples, features)", where=f"G {G.shape}, D = {self.width}")
        d = self.dof
        gradient_q, gradient_qd, gradient_qdd = G[:, :d], G[:, d : 2 * d], G[:, 2 * d : 3 * d]
        for place, threshold in enumerate(self.friction_thresholds(), start=3):
            slope = (1.0 - np.tanh(qd / threshold) ** 2) / threshold
            gradient_qd = gradient_qd + G[:, place * d : (place + 1) * d] * slope
        return gradient_q, gradient_qd, gradient_qdd
