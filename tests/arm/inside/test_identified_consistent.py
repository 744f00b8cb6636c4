"""Inertias that a body can have: the matrix, the divergence's derivatives, the convex problem's answer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude_arm.identified.consistent_parameters import _barrier, consistent
from etude_arm.identified.pseudo_inertia import (
    SIZE,
    basis,
    coordinates,
    is_possible,
    matrix_of,
    parameters_of,
    root_of,
)


def of_points(masses: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Inertial parameters (10,) of points, from the definition of each."""
    square = (places**2).sum(axis=1)
    inertia = np.einsum("p,pij->ij", masses, square[:, None, None] * np.eye(3)) - np.einsum(
        "p,pi,pj->ij", masses, places, places
    )
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return np.concatenate([[masses.sum()], masses @ places, inertia[rows, columns]])


def cloud(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.uniform(0.1, 1.0, 8), rng.normal(scale=0.2, size=(8, 3)) + rng.normal(scale=0.1, size=3)


def bodies(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.concatenate([of_points(*cloud(rng)) for _ in range(count)])


@given(st.integers(0, 10**6))
def test_the_matrix_is_that_of_the_points(seed: int) -> None:
    masses, places = cloud(np.random.default_rng(seed))
    phi = of_points(masses, places)
    homogeneous = np.column_stack([places, np.ones(len(places))])
    np.testing.assert_allclose(matrix_of(phi), np.einsum("p,pi,pj->ij", masses, homogeneous, homogeneous))
    np.testing.assert_allclose(parameters_of(matrix_of(phi)), phi, atol=1e-15)
    assert is_possible(phi)
    L = root_of(phi)
    np.testing.assert_allclose(L @ L.T, matrix_of(phi), rtol=1e-9, atol=1e-12)
    unit = np.einsum("kii->k", basis())
    np.testing.assert_allclose(coordinates(phi) @ unit, phi, rtol=1e-9, atol=1e-12)


def test_no_body_has_more_inertia_about_one_axis_than_about_the_others_together() -> None:
    flat = np.array([1.0, 0.0, 0.0, 0.0, 0.01, 0.01, 0.02, 0.0, 0.0, 0.0])
    assert is_possible(flat - 1e-6 * np.eye(10)[6])
    assert not is_possible(flat + 1e-6 * np.eye(10)[6])
    assert not is_possible(-flat)
    assert np.linalg.matrix_rank(root_of(flat)) == 4, "a plate may fill out"


def test_the_divergence_and_its_derivatives() -> None:
    rng = np.random.default_rng(1)
    x = np.tile(np.einsum("kii->k", basis()), 2) + 0.1 * rng.normal(size=2 * SIZE)
    value, slope, bend = _barrier(x)
    X = [np.einsum("k,kij->ij", x[k : k + SIZE], basis()) for k in (0, SIZE)]
    spectra = np.concatenate([np.linalg.eigvalsh(one) for one in X])
    assert value == pytest.approx(np.sum(spectra - np.log(spectra) - 1.0))
    assert value > 0.0
    for k, step in enumerate(1e-6 * np.eye(2 * SIZE)):
        above, below = _barrier(x + step), _barrier(x - step)
        assert (above[0] - below[0]) / 2e-6 == pytest.approx(slope[k], abs=1e-8)
        np.testing.assert_allclose((above[1] - below[1]) / 2e-6, bend[k], atol=1e-7)


def test_without_logs_the_file_stands_and_with_all_of_them_the_truth() -> None:
    rng = np.random.default_rng(5)
    file, true = bodies(rng, 3), bodies(rng, 3)
    none = consistent(np.zeros((30, 30)), np.zeros(30), file)
    np.testing.assert_allclose(none.phi, file, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(none.covariance, none.prior, rtol=1e-9, atol=1e-12)
    H = 1e10 * np.eye(30)
    whole = consistent(H, H @ true, file)
    np.testing.assert_allclose(whole.phi, true, atol=1e-7)


def test_what_the_logs_do_not_show_stays_and_what_they_show_is_met() -> None:
    rng = np.random.default_rng(6)
    file, true = bodies(rng, 2), bodies(rng, 2)
    rows = rng.normal(size=(7, 20))
    found = consistent(1e9 * rows.T @ rows, 1e9 * rows.T @ (rows @ true), file)
    np.testing.assert_allclose(rows @ found.phi, rows @ true, atol=1e-6)
    assert np.linalg.eigvalsh(rows @ found.covariance @ rows.T)[-1] < 2e-9
    assert np.any(np.diag(found.covariance) > 0.5 * np.diag(found.prior))


def test_impossible_figures_are_answered_by_a_body_at_the_edge() -> None:
    rng = np.random.default_rng(7)
    file = bodies(rng, 1)
    wanted = -file  # as least squares would give it from a log with the wrong sign
    H = 1e6 * np.eye(10)
    found = consistent(H, H @ wanted, file)
    assert is_possible(found.phi)
    assert found.phi[0] < 0.01 * file[0]


def test_a_frame_without_mass_stays_one() -> None:
    rng = np.random.default_rng(8)
    file = np.concatenate([bodies(rng, 1), np.zeros(10), bodies(rng, 1)])
    H = 1e3 * np.eye(30)
    found = consistent(H, H @ np.ones(30), file)
    np.testing.assert_array_equal(found.phi[10:20], 0.0)
    assert is_possible(found.phi[:10])
    assert is_possible(found.phi[20:])
