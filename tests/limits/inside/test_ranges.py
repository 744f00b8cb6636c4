"""Slabs of a limit that leaves nothing are refused, not turned round."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UnsafeTrajectoryError
from etude.limits.motion_limits import slabs


def test_a_slab_holds_what_is_within_half_of_its_middle() -> None:
    cone = slabs("hip, position", np.eye(2), np.array([0.5, -0.5]), 2.0)
    np.testing.assert_allclose(cone.rows[0], np.eye(2) / 2.0)
    np.testing.assert_allclose(cone.offset[0], [0.25, -0.25])


@pytest.mark.parametrize("half", [0.0, -0.3, np.nan])
def test_a_limit_that_leaves_no_room_is_named_with_what_is_left(half: float) -> None:
    with pytest.raises(UnsafeTrajectoryError, match=rf"limit of hip, position: {half:.3g} remains"):
        slabs("hip, position", np.eye(2), np.zeros(2), half)
