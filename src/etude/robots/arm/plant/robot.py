"""SimulatedRobot: anything that turns a sampled trajectory and a feedforward into a RobotLog."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.logs.log import RobotLog
from etude.robots.arm.plant.trace import LoopInputs, Running, Trace
from etude.robots.arm.spec import ArmSpec
from etude.trajectories.samples import TrajectorySamples

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gains:
    """PD gains of the robot's own controller, (dof,) each: command unit per rad, and per rad/s."""

    kp: Array
    kd: Array


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot made of functions; an engine supplies the closed loop, a plant its exact inverse.

    Attributes:
        name: the plant's name.
        spec: what its owner would know of it.
        gains: of its feedback controller.
        timestep: of its physics, s; the control period must be a multiple of it.
        encoder_noise: standard deviation before quantisation, rad.
        closed_loop: LoopInputs -> Trace.
        inverse_model: (q, qd, qdd), (T, dof) each -> command (T, dof) that produces this motion.
        begin: angles q (dof,) at rest -> the closed loop to be advanced tick by tick; None where the engine
            runs only as a whole.
    """

    name: str
    spec: ArmSpec
    gains: Gains
    timestep: float
    encoder_noise: float
    closed_loop: Callable[[LoopInputs], Trace]
    inverse_model: Callable[[Array, Array, Array], Array]
    begin: Callable[[Array], Running] | None = None

    def run(
        self,
        samples: TrajectorySamples,
        tau_ff: Array,
        rng: np.random.Generator | None,
        lead_in: float = 2.0,
    ) -> RobotLog:
        """Follows the trajectory by PD control plus the given feedforward.

        The robot starts at rest in the first desired position and holds it during the lead-in, with the
        first row of the feedforward; the log keeps the lead-in at t < 0.

        Args:
            samples: the trajectory on the control grid, one row per 1/rate.
            tau_ff: (T, dof) feedforward in the command unit.
            rng: source of the encoder noise, the same for every engine; None for an encoder without noise.
            lead_in: s.

        Raises:
            UsageError: another dof, values that are not finite, or another grid than the control grid.
        """
        self._check(samples, tau_ff, lead_in)
        held = round(lead_in * self.spec.rate)
        q_des, qd_des, qdd_des, ff = (
            _prepend(first, rows, held)
            for first, rows in (
                (samples.q[0], samples.q),
                (np.zeros(self.spec.dof), samples.qd),
                (np.zeros(self.spec.dof), samples.qdd),
                (tau_ff[0], tau_ff),
            )
        )
        noise = np.zeros_like(q_des) if rng is None else rng.normal(0.0, self.encoder_noise, q_des.shape)
        trace = self.closed_loop(LoopInputs(q_des, qd_des, ff, noise, self.substeps))
        return RobotLog(
            names=self.spec.names,
            command_unit=self.spec.command_unit,
            t=np.concatenate([samples.t[0] - np.arange(held, 0, -1) / self.spec.rate, samples.t]),
            q=trace.q,
            tau=trace.tau,
            q_des=q_des,
            qd_des=qd_des,
            qdd_des=qdd_des,
            tau_ff=ff,
            tau_fb=trace.tau_fb,
            q_true=trace.q_true,
            source=f"simulated {self.name}",
        )

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The exact inverse model: the command (T, dof) that keeps up this motion (T, dof each).

        Friction is at its steady state for the given velocity, with sign(0) = 0, so a joint at rest is
        described only up to its static friction.
        """
        for name, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
            self._check_rows(name, rows, len(q))
        return self.inverse_model(q, qd, qdd)

    @property
    def substeps(self) -> int:
        """Physics steps per control tick."""
        return round(1.0 / (self.spec.rate * self.timestep))

    def _check(self, samples: TrajectorySamples, tau_ff: Array, lead_in: float) -> None:
        count = len(samples.t)
        for name, rows in (("q", samples.q), ("qd", samples.qd), ("qdd", samples.qdd), ("tau_ff", tau_ff)):
            self._check_rows(name, rows, count)
        period = 1.0 / self.spec.rate
        if not np.isfinite(samples.t).all() or np.any(np.abs(np.diff(samples.t) - period) > 1e-3 * period):
            raise UsageError(
                "the trajectory is not sampled on the robot's control grid",
                where=f"{self.name}, t",
                next_step=f"Sample it every {period:g} s.",
            )
        if not 0.0 <= lead_in < np.inf:
            raise UsageError(f"the lead-in is {lead_in} s", where=self.name, next_step="Give 0 s or more.")

    def _check_rows(self, name: str, rows: Array, count: int) -> None:
        if np.shape(rows) != (count, self.spec.dof) or count == 0:
            raise UsageError(
                f"{name} has shape {np.shape(rows)}, not ({max(count, 1)}, {self.spec.dof})",
                where=self.name,
                next_step=f"Give one row per time and one column per joint: {', '.join(self.spec.names)}.",
            )
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0]
            raise UsageError(
                f"{name} is {rows[row, column]}",
                where=f"{self.name}, row {row}, joint {self.spec.names[column]}",
                next_step="Every desired value and every feedforward must be a finite number.",
            )


def _prepend(first: Array, rows: Array, count: int) -> Array:
    """Rows with `count` copies of `first` before them, contiguous."""
    return np.concatenate([np.repeat(first[None, :], count, axis=0), rows]).astype(np.float64)
