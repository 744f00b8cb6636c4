from __future__ import annotations

import numpy as np
import pytest
from feasible_examples import FAMILIES

from etude.errors import UsageError
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.trajectory_file import from_json

FAMILY = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())


def test_the_thesis_has_thirteen_numbers_and_no_constant_in_x_and_y() -> None:
    family = FlightFamily()
    assert family.size == 13
    assert family.frequency == pytest.approx(2.0 * np.pi / 30.0)
    table = family.coefficients(np.arange(1.0, 14.0))
    np.testing.assert_array_equal(table[0], [0.0, 0.0, 9.0])
    assert FlightFamily(free_centre=True).size == 15


@FAMILY
def test_parameters_and_coefficients(family: FlightFamily) -> None:
    rng = np.random.default_rng(0)
    chosen = rng.standard_normal(family.size)
    table = family.coefficients(chosen)
    np.testing.assert_allclose(family.parameters(table), chosen, atol=1e-13)
    weights = rng.standard_normal(table.shape)
    numeric = [np.sum(weights * (family.coefficients(chosen + d) - table)) for d in np.eye(family.size)]
    np.testing.assert_allclose(family.pull(weights), numeric, atol=1e-12)
    trajectory = family.trajectory(chosen)
    assert from_json(trajectory.to_json()) == trajectory


def test_rest_at_both_ends_without_losing_anything_else() -> None:
    family = FAMILIES["rest, free centre"]
    motion = family.trajectory(np.random.default_rng(1).standard_normal(family.size))
    ends = motion.sample(np.array([0.0, family.duration]))
    np.testing.assert_allclose(ends.qd, 0.0, atol=1e-12)
    np.testing.assert_allclose(ends.qdd, 0.0, atol=1e-12)
    # two equalities per axis, no more
    assert family.size == 3 * (2 * family.harmonics + 1 - 2)
    assert np.linalg.matrix_rank(family.basis.reshape(-1, family.size)) == family.size


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": "falling"}, "hover"),
        ({"duration": 0.0}, "duration"),
        ({"duration": float("nan")}, "duration"),
        ({"harmonics": 0}, "harmonics >= 1"),
        ({"omega0": -1.0}, "omega0 > 0"),
        ({"centre": (float("inf"), 0.0)}, "centre"),
        ({"rest": True, "harmonics": 1}, "at least 2 harmonics"),
        ({"rest": True, "omega0": 0.3}, "whole periods"),
    ],
)
def test_bad_options(options, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        FlightFamily(**options)
