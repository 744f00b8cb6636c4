"""The stick mask as a smooth weight: samples of a joint that stands still will be thrown away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def stick_gains(qd: Array, stick_velocity: Array) -> tuple[Array, Array]:
    """Signed gains d = v/sqrt(v^2 + vm^2) and their derivatives in v.

    The noise of a slow sample is sn^2 (1 + (vm/v)^2) = sn^2/d^2. The sign cancels in every criterion and
    keeps the gain smooth through v = 0.

    Args:
        qd: (T, dof) rad/s.
        stick_velocity: (dof,) vm >= 0, speed below which a sample is masked, rad/s; 0 for no mask.

    Returns:
        gains (T, dof) in (-1, 1), derivatives (T, dof) in s/rad.
    """
    free = stick_velocity == 0.0
    reach = np.sqrt(qd**2 + np.where(free, 1.0, stick_velocity) ** 2)
    gain = np.where(free, 1.0, qd / reach)
    return gain, np.where(free, 0.0, stick_velocity**2 / reach**3)
