"""Newton-Euler backwards gives what the regressor gives, which is held against MuJoCo elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from etude import load_robot
from etude_arm import ArmPhysics
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.newton_euler import nominal_commands


@pytest.mark.parametrize("robot", ["arm4", "mobile_arm"])
def test_commands_are_those_of_the_regressor(robot: str) -> None:
    """Slides, hinges and drives between two bodies."""
    spec, rng = load_robot(robot), np.random.default_rng(1)
    geometry = read_geometry(spec)
    assert geometry is not None
    states = [rng.uniform(-1.0, 1.0, (7, spec.dof)) * scale for scale in (spec.upper, spec.velocity, 5.0)]
    wanted = ArmPhysics(spec, nominal=True)(None).model.predict(*states)
    assert np.abs(wanted).max() > 1.0
    np.testing.assert_allclose(nominal_commands(geometry, *states), wanted, rtol=1e-9, atol=1e-9)
