"""Adaptive control of an arm whose structure is known and whose parameters are not, run after run.

The laws of Slotine and Li (1987) and of Craig, Hsu and Sastry (1987) on the identified model's regressor, as
feedforward of an arm under its own feedback. What differs from the papers:

- The robot's own PD stays on underneath, and the laws add what they would add to it. It is the K_D s of
  Slotine and Li where its stiffness is the bandwidth times its damping; a stiffer one pulls harder still.
- A command is computed before the robot measures, so it uses the measurement of one tick earlier.
- Rates, and the accelerations that the second law needs, are differences of the tracking error, smoothed by a
  pole for each derivative; the papers take both as measured. It is this noise that limits how fast the
  second law may learn.
- Estimates stay in a box (a projection, with which the proofs hold), leak (with which errors are bounded, not
  zero), and rest where the command saturates.

Slotine and Li, "On the adaptive control of robot manipulators", IJRR 6(3), 1987, and Craig, Hsu and Sastry,
"Adaptive control of mechanical manipulators", IJRR 6(2), 1987. In both, every command has parameters of its
own, in its own unit, since the gains of the motors are unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Motion, Row
from etude_arm.physics.mean import ArmPhysics
from etude_arm.physics.reference_regressor import Reference, ReferenceRegressor
from etude_arm.physics.rigid_body import RigidBodyModel
from etude_arm.spec import COMMAND, PATH, PLAN, ArmSpec

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
        bandwidth = self.adaptation.bandwidth
        return plan[1] + bandwidth * tracking.e, plan[2] + bandwidth * tracking.ed

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
        bandwidth = self.adaptation.bandwidth
        return 2.0 * bandwidth * tracking.ed + bandwidth**2 * tracking.e


def dominant(inertia: Array, floor: Array) -> Array:
    """The matrix (J, J) itself if its diagonal is above `floor` (J,) and dominates every row.

    Otherwise the diagonal is raised to the floor, and the rest of a row made smaller until it does.
    """
    diagonal = np.maximum(np.diag(inertia), floor)
    off_diagonal = inertia - np.diag(np.diag(inertia))
    room = DOMINANCE * diagonal
    part = room / np.maximum(room, np.abs(off_diagonal).sum(axis=1))
    return np.asarray(np.diag(diagonal) + part[:, None] * off_diagonal)


SLOTINE_LI = Adaptation(bandwidth=3.0, rate=5.0, smoothing=0.1)
CRAIG_HSU_SASTRY = Adaptation(bandwidth=2.0, rate=0.5, smoothing=0.2, leak=0.0)
"""Settings that learn within a minute on the simulated arm; the second, slower by far, needs no leak."""
INERTIA_FLOOR = 0.02
"""Least estimated inertia as a part of the command limit over the acceleration limit."""


@dataclass(eq=False)
class AdaptiveController:
    """A law at work (implements `protocols.Controller`): estimates are carried from run to run.

    What it remembers of a motion is forgotten where time does not go on, so the same object may run again.

    Attributes:
        spec: its command limits clip.
        regressor, law: what it learns, and how.
        weights: (J, n) the estimates, in deviations before any data; they move.
    """

    spec: ArmSpec
    regressor: ReferenceRegressor
    law: Law
    weights: Array
    _time: float = field(default=np.inf, init=False, repr=False)
    _tracking: Tracking | None = field(default=None, init=False, repr=False)
    _at: Reference | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.weights.shape != self.regressor.zero.shape or not np.isfinite(self.weights).all():
            raise UsageError(
                f"weights of shape {self.weights.shape} cannot be used as a start",
                where=self.spec.name,
                next_step=f"Give finite ones of shape {self.regressor.zero.shape}.",
            )
        self.weights = self._boxed(self.weights)

    def planned(self, motion: Motion) -> Array | None:  # noqa: ARG002
        """None: commands depend on measurements, tick by tick."""
        return None

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The estimated command (J,) at one instant, clipped, and zeros as its deviation."""
        if t <= self._time:
            self._tracking = None
        self._time = t
        tracking = self._tracking or Tracking.still(np.zeros(self.spec.dof))
        plan = np.stack([row[name] for name in PLAN])
        q, qd = plan[0] - tracking.e, plan[1] - tracking.ed
        self._at = self.regressor.at(q, qd, *self.law.reference(plan, tracking))
        command = np.sum(self._at.features * self.weights, axis=1)
        return np.clip(command, -self.spec.command, self.spec.command), np.zeros(self.spec.dof)

    def observe(self, t: float, row: Row) -> None:  # noqa: ARG002
        """Learns from the measured position and the command that was applied, rows as of `command`."""
        e, step = row[PLAN[0]] - row[PATH[0]], 1.0 / self.spec.rate
        settings = self.law.adaptation
        before = self._tracking or Tracking.still(e)
        self._tracking = before.after(e, step, settings.smoothing)
        if self._at is None:
            return
        free = np.abs(row[COMMAND]) < self.spec.command
        slope = free[:, None] * self.law.slope(self._tracking, self._at, self.weights)
        self.weights = self._boxed(self.weights + step * (slope - settings.leak * self.weights))

    def _boxed(self, weights: Array) -> Array:
        bound = self.law.adaptation.bound
        return np.clip(weights, -bound, bound)


def slotine_li(
    physics: ArmPhysics, adaptation: Adaptation = SLOTINE_LI, start: RigidBodyModel | None = None
) -> AdaptiveController:
    """The law of Slotine and Li for this robot, from zero or from an identified model.

    Raises:
        UsageError: a robot without a model file, or another robot's model.
    """
    regressor = ReferenceRegressor.of(physics)
    spec = physics.spec
    home = 0.5 * (spec.lower + spec.upper)
    still = np.zeros(spec.dof)
    speed = np.abs(regressor.at(home, still, still, still).moment) @ spec.velocity
    gain = adaptation.rate / (regressor.count * spec.command * speed)
    return _started(regressor, SlotineLi(gain, adaptation), start)


def craig_hsu_sastry(
    physics: ArmPhysics, adaptation: Adaptation = CRAIG_HSU_SASTRY, start: RigidBodyModel | None = None
) -> AdaptiveController:
    """The law of Craig, Hsu and Sastry for this robot, from zero or from an identified model.

    Raises:
        UsageError: a robot without a model file, or another robot's model.
    """
    regressor = ReferenceRegressor.of(physics)
    spec = physics.spec
    floor = INERTIA_FLOOR * spec.command / spec.acceleration
    gain = adaptation.rate * floor / (regressor.count * spec.command * spec.velocity)
    return _started(regressor, CraigHsuSastry(gain, floor, adaptation), start)


def _started(regressor: ReferenceRegressor, law: Law, start: RigidBodyModel | None) -> AdaptiveController:
    weights = regressor.zero if start is None else regressor.weights(start)
    return AdaptiveController(regressor.physics.spec, regressor, law, weights)
