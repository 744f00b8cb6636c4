"""Trajectories in which every joint has a base frequency of its own, the other reading of thesis (3.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude.protocols import Trajectory
from etude.trajectories import FourierFamily, FourierTrajectory
from etude.types import Array, Motion


@dataclass(frozen=True, eq=False)
class JointByJoint:
    """Joint j moves as joint j of the j-th of its Fourier series (a `protocols.Trajectory`).

    Attributes:
        series: one for each of the k joints, of k axes and the same duration each.
    """

    series: tuple[FourierTrajectory, ...]

    @property
    def form(self) -> str:
        return self.series[0].form

    @property
    def duration(self) -> float:
        """s."""
        return self.series[0].duration

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        """Itself, one segment from 0 s on."""
        return ((0.0, "segment", self),)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Position and derivatives (O, T, k) at times t (T,) s."""
        orders_by_joint = [series.motion(t, orders).orders[:, :, j] for j, series in enumerate(self.series)]
        return Motion(t, np.stack(orders_by_joint, axis=2))

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:
        """Of each joint that of its own series: the instants of the proof do not depend on the frequency."""
        values, sizes, kappas = zip(*(series.bound(order, degree) for series in self.series), strict=True)
        bounds = [(v[:, j], s[j]) for j, (v, s) in enumerate(zip(values, sizes, strict=True))]
        return np.stack([v for v, _ in bounds], axis=1), np.array([s for _, s in bounds]), min(kappas)

    def slowed(self, factor: float) -> JointByJoint:
        return JointByJoint(tuple(series.slowed(factor) for series in self.series))

    def to_json(self) -> str:
        """Those of all joints one after the other; no file of a campaign holds such a trajectory."""
        return "\n".join(series.to_json() for series in self.series)


@dataclass(frozen=True, eq=False)
class JointByJointFamily:
    """Members of k Fourier families that differ in omega0 alone (a `protocols.Family`)."""

    families: tuple[FourierFamily, ...]

    @classmethod
    def of(cls, family: FourierFamily) -> JointByJointFamily:
        """One family for each joint of `family`, its parameters in the same order."""
        return cls((family,) * family.basis.shape[0])

    @property
    def size(self) -> int:
        return self.families[0].size

    @property
    def duration(self) -> float:
        """s."""
        return self.families[0].duration

    def drawn(self, rng: np.random.Generator) -> JointByJointFamily:
        """Every joint with a base frequency of its own."""
        return replace(self, families=tuple(family.drawn(rng) for family in self.families))

    def trajectory(self, p: Array) -> JointByJoint:
        return JointByJoint(tuple(family.trajectory(p) for family in self.families))

    def parameters(self, trajectory: Any) -> Array:
        """(P,) of a member; coefficients of a joint stand in its own series."""
        pairs = enumerate(zip(self.families, trajectory.series, strict=True))
        return sum((self._only(j, f.parameters(s)) for j, (f, s) in pairs), np.zeros(self.size))

    def motion(self, p: Array, t: Array, orders: int = 3) -> Motion:
        orders_by_joint = [
            family.motion(p, t, orders).orders[:, :, j] for j, family in enumerate(self.families)
        ]
        return Motion(t, np.stack(orders_by_joint, axis=2))

    def vjp(self, p: Array, t: Array, gradient: Array) -> Array:
        """(P,) gradient in the parameters of sum(gradient * orders); gradient (O, T, k)."""
        pulled = np.zeros(self.size)
        for j, family in enumerate(self.families):
            joint_gradient = np.zeros_like(gradient)
            joint_gradient[:, :, j] = gradient[:, :, j]
            pulled += family.vjp(p, t, joint_gradient)
        return pulled

    def rows(self, order: int, degree: int = 1) -> tuple[Array, Array, float]:
        """`bound` of the members, linear in p: rows (k, M, P), offsets (k, M) and kappa."""
        parts = [family.rows(order, degree) for family in self.families]
        rows = np.stack([rows[j] for j, (rows, _, _) in enumerate(parts)])
        offset = np.stack([offset[j] for j, (_, offset, _) in enumerate(parts)])
        return rows, offset, min(kappa for _, _, kappa in parts)

    def _only(self, joint: int, p: Array) -> Array:
        """p with the parameters of one joint alone."""
        mine = np.abs(self.families[joint].basis[joint]).sum(axis=0) > 0.0
        return np.where(mine, p, 0.0)
