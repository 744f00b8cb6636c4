"""Two laws of adaptive control: what to follow, and how the estimates move.

Slotine and Li, "On the adaptive control of robot manipulators", IJRR 6(3), 1987, and Craig, Hsu and Sastry,
"Adaptive control of mechanical manipulators", IJRR 6(2), 1987. In both, every command has parameters of its
own, in its own unit, since the gains of the motors are unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.physics.reference_regressor import Reference

DOMINANCE = 0.9
"""Largest part of an estimated inertia's diagonal that the rest of its row may reach."""


@dataclass(frozen=True)
class Adaptation:
    """How fast a law follows and learns.

    Attributes:
        bandwidth: 1/s, Lambda of Slotine and Li; of the second law sqrt(K_p) = K_v / 2 and what filters its
            error.
        rate: 1/s; with features as large as the commands, an error as fast as the velocity limit changes a
            command by this part of its limit in a second.
        bound: largest size of a weight, in deviations before any data.
        smoothing: s, time constant of each pole that smooths the error's derivatives.
        leak: 1/s, at which weights fall back to zero (sigma-modification): what a motion does not excite
            would else drift with the noise, until the loop is unstable.

    Raises:
        UsageError: a value that is not positive (smoothing and leak: below zero).
    """

    bandwidth: float
    rate: float
    bound: float = 3.0
    smoothing: float = 0.1
    leak: float = 0.005

    def __post_init__(self) -> None:
        for name in ("bandwidth", "rate", "bound"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise UsageError(f"{name} is {getattr(self, name)}", next_step="Give a positive number.")
        for name in ("smoothing", "leak"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise UsageError(f"{name} is {getattr(self, name)}", next_step="Give 0 or more.")


@dataclass(frozen=True)
class Tracking:
    """Desired less measured position, smoothed rate and acceleration of that, (J,) each."""

    e: Array
    ed: Array
    edd: Array

    @staticmethod
    def still(e: Array) -> Tracking:
        """The error e (J,), at rest."""
        return Tracking(e, np.zeros_like(e), np.zeros_like(e))

    def after(self, e: Array, step: float, smoothing: float) -> Tracking:
        """One tick of `step` s later, with the error e (J,)."""
        share = step / (step + smoothing)
        ed = self.ed + share * ((e - self.e) / step - self.ed)
        edd = self.edd + share * ((ed - self.ed) / step - self.edd)
        return Tracking(e, ed, edd)


class Law(Protocol):
    """What the two laws differ in; J joints, n features."""

    @property
    def adaptation(self) -> Adaptation: ...
    def reference(self, plan: Array, tracking: Tracking) -> tuple[Array, Array]:
        """Rate and acceleration (J,) to follow; plan (3, J), the desired motion."""
        ...

    def slope(self, tracking: Tracking, at: Reference, weights: Array) -> Array:
        """(J, n) rates of the weights, 1/s."""
        ...


@dataclass(frozen=True, eq=False)
class SlotineLi:
    """Their law: a' = -gain Y(q, qd, qd_r, qdd_r)^T s with s = qd - qd_r, qd_r = qd_des + bandwidth e.

    s is taken in the drives' coordinates, where a motor of unknown gain g_j does the work s_j g_j u_j: the
    proof holds for parameters of every command's own, each error weighted with its g_j > 0.

    Attributes:
        gain: (J,) of each command's weights.
        adaptation: bandwidth and the like.
    """

    gain: Array
    adaptation: Adaptation

    def reference(self, plan: Array, tracking: Tracking) -> tuple[Array, Array]:
        pull = self.adaptation.bandwidth
        return plan[1] + pull * tracking.e, plan[2] + pull * tracking.ed

    def slope(self, tracking: Tracking, at: Reference, weights: Array) -> Array:  # noqa: ARG002
        behind = at.moment @ (tracking.ed + self.adaptation.bandwidth * tracking.e)
        return np.asarray((self.gain * behind)[:, None] * at.features)


@dataclass(frozen=True, eq=False)
class CraigHsuSastry:
    """Their law: computed torque, and a' = gain W(q, qd, qdd)^T M^-T (ed + bandwidth e).

    W takes the measured acceleration and M is the estimated inertia, kept invertible: `dominant`.

    Attributes:
        gain: (J,) of each command's weights.
        floor: (J,) least estimated inertia, command units per rad/s^2.
        adaptation: bandwidth and the like.
    """

    gain: Array
    floor: Array
    adaptation: Adaptation

    def reference(self, plan: Array, tracking: Tracking) -> tuple[Array, Array]:
        return plan[1] - tracking.ed, plan[2] + self._servo(tracking)

    def slope(self, tracking: Tracking, at: Reference, weights: Array) -> Array:
        measured = at.features - at.inertia @ (tracking.edd + self._servo(tracking))
        inertia = dominant(np.einsum("jni,jn->ji", at.inertia, weights), self.floor)
        behind = np.linalg.solve(inertia.T, tracking.ed + self.adaptation.bandwidth * tracking.e)
        return np.asarray((self.gain * behind)[:, None] * measured)

    def _servo(self, tracking: Tracking) -> Array:
        pull = self.adaptation.bandwidth
        return 2.0 * pull * tracking.ed + pull**2 * tracking.e


def dominant(inertia: Array, floor: Array) -> Array:
    """The matrix (J, J) itself if its diagonal is above `floor` (J,) and dominates every row.

    Otherwise the diagonal is raised to the floor, and the rest of a row made smaller until it does.
    """
    diagonal = np.maximum(np.diag(inertia), floor)
    rest = inertia - np.diag(np.diag(inertia))
    room = DOMINANCE * diagonal
    part = room / np.maximum(room, np.abs(rest).sum(axis=1))
    return np.asarray(np.diag(diagonal) + part[:, None] * rest)
