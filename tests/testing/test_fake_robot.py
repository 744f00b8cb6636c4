"""The robot without hardware obeys mechanics: its logs are evidence like those of others."""

from __future__ import annotations

import numpy as np
import pytest

from etude.testing import FakeRobot


@pytest.mark.parametrize("stall", [0.0, 0.06])
def test_its_command_is_the_mean_force_of_a_cycle(stall: float) -> None:
    """Masses of 1 kg: force times time is the change of velocity, however late a cycle is."""
    robot = FakeRobot(rate=50.0)
    for n in range(20):
        before, began = robot.qd.copy(), robot.t
        robot.stall(stall if n % 5 == 0 else 0.0)
        path = 0.3 * np.sin([0.04 * n, 0.06 * n])
        robot.send(path, np.zeros(2), np.zeros(2), None)
        np.testing.assert_allclose(robot.command * (robot.t - began), robot.qd - before, atol=1e-12)
