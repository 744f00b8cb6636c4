"""Input and output of the closed loop as arrays, the same for every engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from etude.types import Array


@dataclass(frozen=True)
class LoopInputs:
    """A closed loop to simulate, on the control grid, from rest at q_des[0].

    Attributes:
        q_des, qd_des: (T, dof) desired motion, rad and rad/s.
        tau_ff: (T, dof) feedforward in the command unit.
        noise: (T, dof) encoder noise before quantisation, rad; drawn by the caller so that every engine
            sees the same.
        substeps: physics steps per control tick.
        qdd_des: (T, dof) desired acceleration, for drives that go on between two set-points.
    """

    q_des: Array
    qd_des: Array
    tau_ff: Array
    noise: Array
    substeps: int
    qdd_des: Array | None = None

    def tick(self, k: int, tau_ff: Array) -> LoopInputs:
        """The inputs of tick k alone, with this feedforward (dof,)."""
        one = slice(k, k + 1)
        bend = None if self.qdd_des is None else self.qdd_des[one]
        return LoopInputs(
            self.q_des[one], self.qd_des[one], tau_ff[None], self.noise[one], self.substeps, bend
        )


@dataclass(frozen=True)
class Trace:
    """Outputs at each control tick, (T, dof): measured and true position, command, feedback."""

    q: Array
    q_true: Array
    tau: Array
    tau_fb: Array

    @classmethod
    def joined(cls, parts: Sequence[Trace]) -> Trace:
        """The concatenation of several traces."""
        return cls(*(np.concatenate([getattr(p, f) for p in parts]) for f in cls.__dataclass_fields__))


class Running(Protocol):
    """A robot whose closed loop is advanced a few control ticks at a time."""

    def advance(self, inputs: LoopInputs) -> Trace:
        """Continues from its state over the ticks of `inputs`; (T, dof) as for a whole run."""
        ...

    def change(self, parameters: Any) -> None:
        """From the next tick on the robot has these physical parameters; its state stays."""
        ...
