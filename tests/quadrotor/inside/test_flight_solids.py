"""What is drawn of a vehicle in space: its rotors where they are, leaning as it must to accelerate."""

from __future__ import annotations

import numpy as np

from etude.types import Motion
from etude_quadrotor import KIND
from etude_quadrotor.flatness import flat_motion


def test_it_leans_as_flatness_says_and_is_level_where_nothing_is_known() -> None:
    spec = KIND.spec(KIND.built_in()["quadrotor"])
    orders = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 7, 3))
    motion = Motion(np.arange(7.0), orders)
    placed = KIND.placed(spec, motion)
    np.testing.assert_allclose(placed[:, 0, :, :3], flat_motion(motion).R_world_body, atol=1e-12)
    np.testing.assert_array_equal(placed[:, 0, :, 3], orders[0])
    still = KIND.placed(spec, Motion(motion.t, orders[:1]))
    np.testing.assert_allclose(still[:, 0, :, :3], np.tile(np.eye(3), (7, 1, 1)))


def test_every_rotor_is_drawn() -> None:
    for name, path in KIND.built_in().items():
        spec = KIND.spec(path)
        (solid,) = KIND.solids(spec)
        assert spec.airframe is not None
        for rotor in spec.airframe.rotors:
            assert np.linalg.norm(solid.points[:, :2] - rotor, axis=1).min() < 1e-9, name
        assert solid.faces.max() < len(solid.points)
