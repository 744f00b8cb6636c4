"""The kernels' own promises, beyond what the conformance suite asks of all."""

from __future__ import annotations

import numpy as np
import pytest
from arm_kernel import structured_kernel

from etude.errors import UsageError
from etude.models import Linear, SquaredExponential
from etude.models.gp.kernels import OWN_SHARE, Product, Sum


def test_squared_exponential_is_its_formula() -> None:
    X, Z = np.array([[0.0, 1.0]]), np.array([[2.0, 0.0]])
    value = SquaredExponential((0, 1)).value(np.log([3.0, 2.0, 0.5]), X, Z)
    assert value[0, 0] == pytest.approx(9.0 * np.exp(-0.5 * (1.0 + 4.0)))


def test_rounding_never_lifts_a_covariance_above_the_amplitude() -> None:
    X = np.random.default_rng(0).uniform(-1.0, 1.0, size=(50, 3))
    K = SquaredExponential((0, 1, 2)).value(np.log([2.0, 1e-10, 1e-10, 1e-10]), X, X)
    assert K.max() <= 4.0 * (1.0 + 1e-15)


def test_linear_is_its_formula() -> None:
    value = Linear((1, 0)).value(np.log([2.0, 3.0]), np.array([[5.0, 7.0]]), np.array([[1.0, -1.0]]))
    assert value[0, 0] == pytest.approx(4.0 * 7.0 * -1.0 + 9.0 * 5.0 * 1.0)


def test_sums_and_products_flatten() -> None:
    a, b, c = SquaredExponential((0,)), Linear((1,)), SquaredExponential((2,), unit=True)
    assert (a + b) + c == Sum((a, b, c))
    assert a * (b * c) == Product((a, b, c))
    assert a + b * c == Sum((a, Product((b, c))))


def test_structured_kernel_has_the_terms_it_says() -> None:
    kernel = structured_kernel(3, 1)
    assert isinstance(kernel, Sum)
    posture, own, friction, motion, everything = kernel.parts
    assert posture == SquaredExponential((0, 1, 2))
    assert own == SquaredExponential((1,), share=OWN_SHARE)
    assert friction == Linear((10,)) * SquaredExponential((1,), unit=True, share=OWN_SHARE)
    assert motion == Linear(tuple(range(3, 12)))
    assert everything == SquaredExponential(tuple(range(12)))
    assert kernel.size == 4 + 2 + 2 + 9 + 13
    two = structured_kernel(3, 1, frictions=2)
    assert two.parts[2] == Linear((10, 13)) * SquaredExponential((1,), unit=True, share=OWN_SHARE)
    assert two.parts[4] == SquaredExponential(tuple(range(15)))
    with pytest.raises(UsageError, match="command's own position"):
        structured_kernel(3, 3)


@pytest.mark.parametrize("dims", [(), (0, 0), (-1, 2)])
def test_impossible_columns_are_refused(dims: tuple[int, ...]) -> None:
    for kind in (SquaredExponential, Linear):
        with pytest.raises(UsageError, match="active dimensions"):
            kind(dims)
