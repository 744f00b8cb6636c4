"""The study of confirmation: what its rows count, and the motion of which joints go a part of the way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from etude_studies.confirm import Partly, rows_of
from etude_studies.world import World


def test_rows_are_quantiles_of_what_was_said() -> None:
    cells: list[Any] = [[[0.5, 1.0], [None, None], [1.0, 1.0]], [[2.0, 1.0], [9.0, 0.0], [None, None]]]
    rows = {row.metric: row for row in rows_of("arm", cells)}
    assert (rows["inside_arm"].value, rows["inside_arm"].reference) == (3.0, "of 4; nothing said of 2")
    found = [rows[f"{name}_arm"].value for name in ("least", "median", "most")]
    assert found == [0.5, 1.5, 9.0]
    assert rows["q90_arm"].value == pytest.approx(2.0 + 0.7 * 7.0)


def test_each_joint_goes_its_part_of_the_way() -> None:
    motion = World.of("arm4").motion(np.random.default_rng(0))
    part = Partly(motion, np.array([0.0, 0.02, 0.2, 1.0]))
    t = np.linspace(0.0, motion.duration, 400)
    (q, qd, qdd), (whole, rate, bend) = part.motion(t).orders[:3], motion.motion(t).orders[:3]
    np.testing.assert_allclose(q[0], whole[0], rtol=1e-12)
    np.testing.assert_allclose(np.ptp(q, axis=0), np.ptp(whole, axis=0) * part.factors, atol=1e-12)
    np.testing.assert_allclose(qd, rate * part.factors)
    np.testing.assert_allclose(qdd, bend * part.factors)
    assert part.duration == motion.duration
