"""exp of many exponents: the bits of the same loop in Python, and the C library's results to a rounding."""

from __future__ import annotations

import numpy as np
import pytest

from etude._runtime.loop_compiler import fused_in_one_instruction
from etude.models.gp.exponential import _exponentials, exponentials_in_place
from etude.types import Array

ALL = slice(None)


def exponents(seed: int) -> Array:
    draw = np.random.default_rng(seed)
    return np.concatenate([-draw.exponential(5.0, (20, 30)), draw.uniform(-760.0, 700.0, (20, 30))])


def test_results_are_within_a_rounding_of_exp() -> None:
    x = np.random.default_rng(0).uniform(-745.0, 699.0, (400, 500))
    K = x.copy()
    exponentials_in_place(K, 700.0, ALL, ALL)
    exact = np.exp(x)
    assert (np.abs(K - exact) <= np.spacing(exact)).all()


@pytest.mark.skipif(not fused_in_one_instruction(), reason="this processor has no fused products")
def test_the_compiled_loop_gives_the_bits_that_python_gives() -> None:
    K = exponents(1)
    expected, others, counted = K.copy(), np.zeros(1), np.zeros(1)
    most = np.array([3.0])
    _exponentials(K, 2, 40, 1, 30, most, others)
    _exponentials.function(expected, 2, 40, 1, 30, most, counted)
    np.testing.assert_array_equal(K, expected)
    assert others[0] == counted[0] > 0.0
    np.testing.assert_allclose(K[2:20, 1:], np.exp(exponents(1)[2:20, 1:]), rtol=3e-16)


def test_only_the_part_changes_and_exponents_above_the_most_are_the_most() -> None:
    K = exponents(2)
    expected = K.copy()
    expected[3:25, 5:7] = np.exp(np.minimum(K[3:25, 5:7], -0.5))
    exponentials_in_place(K, -0.5, slice(3, 25), slice(5, 7))
    np.testing.assert_allclose(K, expected, rtol=3e-16)
    assert K[3:25, 5:7].max() == np.exp(-0.5)


@pytest.mark.parametrize("most", [0.0, 705.0])
def test_what_is_no_normal_number(most: float) -> None:
    K = np.array([[np.nan, -np.inf, -745.0, -1e308, 0.0, -0.0, 5e-324]])
    exponentials_in_place(K, most, ALL, ALL)
    np.testing.assert_array_equal(K, [[np.nan, 0.0, np.exp(-745.0), 0.0, 1.0, 1.0, 1.0]])


def test_a_matrix_without_rows_stays_empty() -> None:
    whole = np.full((3, 2), -1.0)
    exponentials_in_place(whole[:0], 0.0, ALL, ALL)
    exponentials_in_place(np.zeros((3, 0)), 0.0, ALL, ALL)
    exponentials_in_place(whole, 0.0, slice(0, 0), ALL)
    assert (whole == -1.0).all()
