"""RobotLog: one recorded motion, time-stamped, in SI units, with its provenance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RobotLog:
    """A recorded motion; every array has one row per time and one column per axis, in `names` order.

    Attributes:
        names: axis names.
        command_unit: unit of `tau`, as in the RobotSpec.
        t: (T,) s, strictly increasing.
        q: (T, dof) measured position, rad.
        tau: (T, dof) applied command, after clipping and rounding, in the command unit.
        qd, qdd: measured (or driver-supplied) velocity and acceleration, if the log has them.
        q_des, qd_des, qdd_des: desired motion, if known.
        tau_ff, tau_fb: feedforward and feedback parts of the command, if known.
        q_true: noise-free position; only simulated robots know it.
        source: where the log came from, for messages and provenance.
        repairs: one sentence for each repair made while reading.
    """

    names: tuple[str, ...]
    command_unit: str
    t: Array
    q: Array
    tau: Array
    qd: Array | None = None
    qdd: Array | None = None
    q_des: Array | None = None
    qd_des: Array | None = None
    qdd_des: Array | None = None
    tau_ff: Array | None = None
    tau_fb: Array | None = None
    q_true: Array | None = None
    source: str = ""
    repairs: tuple[str, ...] = ()

    @property
    def dof(self) -> int:
        return len(self.names)
