"""Attitudes of PX4 logs, turned from north-east-down to forward-left-up."""

from __future__ import annotations

import numpy as np
import ulog_examples as ulogs

from etude_quadrotor.logs.ulog import turned


def test_a_level_vehicle_that_looks_north() -> None:
    """Forward is north, the second axis of east, north, up; left is west, up is up."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_quat(turned(np.array([[1.0, 0.0, 0.0, 0.0]]))[:, [1, 2, 3, 0]]).as_matrix()[0]
    np.testing.assert_allclose(R, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)


def test_attitudes_are_turned_as_rotations_are() -> None:
    """Against SciPy's rotations, and back: what the example's writer turns is turned back."""
    from scipy.spatial.transform import Rotation

    R = Rotation.random(50, rng=np.random.default_rng(0)).as_matrix()
    q = turned(ulogs.WRITER.ned_frd(R))
    np.testing.assert_allclose(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix(), R, atol=1e-12)
