"""Factor, inverse and solutions in one pass: laws of the inverse, LAPACK's three beside it, and jitter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import LowLevelCallable

from etude.errors import NumericalError
from etude.models.gp import likelihood_algebra
from etude.models.gp.likelihood_algebra import BLOCK, factor_by_lapack, factor_in_one_pass, solved

ORDERS = (1, 7, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 317)


def problem(n: int, outputs: int, noise: float = 1e-2, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, size=(n, 3))
    K = np.exp(-0.5 * np.sum((x[:, None] - x) ** 2, axis=-1)) + noise * np.eye(n)
    return np.asfortranarray(K), rng.normal(size=(n, outputs))


def whole(lower: np.ndarray) -> np.ndarray:
    assert not np.triu(lower, 1).any()
    return lower + np.tril(lower, -1).T


@pytest.mark.parametrize("outputs", [1, 3])
@pytest.mark.parametrize("n", ORDERS)
def test_it_inverts_solves_and_takes_the_determinant(n: int, outputs: int) -> None:
    K, Y = problem(n, outputs)
    use = likelihood_algebra.routines()
    assert use is not None
    found = factor_in_one_pass(K, K.diagonal(), Y, use)
    assert found is not None
    alpha = np.linalg.solve(K, Y)
    # K times (m K^-1 - Σ α αᵀ) is m I - Σ y αᵀ
    rest = K @ whole(found.weights) - (outputs * np.eye(n) - Y @ alpha.T)
    assert np.abs(rest).max() < 1e-13 * np.linalg.cond(K) * max(1.0, np.abs(Y @ alpha.T).max())
    assert found.square == pytest.approx(np.sum(Y * alpha), rel=1e-11)
    assert found.log_det == pytest.approx(np.linalg.slogdet(K)[1], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("noise", [1.0, 1e-3, 1e-6])
def test_it_is_as_good_as_lapack_s_three(noise: float) -> None:
    """Both beside extended precision; K is as ill-conditioned as kernels make it."""
    K, Y = problem(250, 1, noise)
    use = likelihood_algebra.routines()
    assert use is not None
    exact = in_extended_precision(K, Y)
    one, parts = factor_in_one_pass(K, K.diagonal(), Y, use), factor_by_lapack(K, K.diagonal(), Y)
    assert one is not None
    assert parts is not None
    off = [float(np.abs(whole(each.weights) - exact).max()) for each in (one, parts)]
    assert off[0] < 3.0 * off[1] + 1e-14 * float(np.abs(exact).max())


def in_extended_precision(K: np.ndarray, Y: np.ndarray) -> np.ndarray:
    n, A = len(K), K.astype(np.longdouble)
    L, X = np.zeros_like(A), np.zeros_like(A)
    for i in range(n):
        L[i:, i] = A[i:, i] - L[i:, :i] @ L[i, :i]
        L[i:, i] /= np.sqrt(L[i, i])
        X[i] = (np.eye(n)[i] - L[i, :i] @ X[:i]) / L[i, i]
    W = X.T @ X
    return W * Y.shape[1] - (W @ Y) @ (W @ Y).T


def test_the_lower_half_alone_is_read_and_nothing_written() -> None:
    K, Y = problem(230, 1)
    spoilt = np.asfortranarray(np.where(np.tri(230, dtype=bool), K, np.nan))
    before = spoilt.copy()
    found, clean = solved(spoilt, 0.1, Y[:, 0]), solved(K, 0.1, Y[:, 0])
    np.testing.assert_array_equal(spoilt, before)
    np.testing.assert_array_equal(found.weights, clean.weights)
    np.testing.assert_array_equal(found.weights, solved(np.ascontiguousarray(K), 0.1, Y[:, 0]).weights)


@pytest.mark.parametrize("n", [40, 250])
def test_jitter_comes_without_a_word_and_indefinite_is_refused(n: int) -> None:
    flat, y = np.ones((n, n), order="F"), np.ones(n)
    found = solved(flat, 0.0, y)
    assert np.isfinite(found.log_det)
    assert found.square == pytest.approx(1.0, rel=1e-4)  # 1ᵀ (1 1ᵀ + j I)^-1 1 = n / (n + j)
    with pytest.raises(NumericalError, match=f"of {n} points is indefinite"):
        solved(-flat + 2.0 * np.eye(n), 0.0, y)
    with pytest.raises(NumericalError, match="not finite"):
        solved(np.full((n, n), np.nan), 0.0, y)


def test_where_scipy_has_other_integers_lapack_s_three_do_it(monkeypatch: pytest.MonkeyPatch) -> None:
    K, Y = problem(220, 2)
    ours = solved(K, 0.1, Y)
    taken = LowLevelCallable.from_cython

    class OfLongIntegers:
        def __init__(self, module: object, name: str) -> None:
            self.signature = taken(module, name).signature.replace("int *", "blas_int *")

    monkeypatch.setattr(likelihood_algebra.LowLevelCallable, "from_cython", OfLongIntegers)
    likelihood_algebra.routines.cache_clear()
    try:
        assert likelihood_algebra.routines() is None
        theirs = solved(K, 0.1, Y)
    finally:
        likelihood_algebra.routines.cache_clear()
    scale = float(np.abs(theirs.weights).max())
    np.testing.assert_allclose(ours.weights, theirs.weights, rtol=0.0, atol=1e-12 * scale)
    assert (ours.square, ours.log_det) == pytest.approx((theirs.square, theirs.log_det), rel=1e-12)


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    K, Y = problem(130, 2)
    use = likelihood_algebra.routines()
    assert use is not None
    found = []
    for block in (1, 8, 29, 130):
        monkeypatch.setattr(likelihood_algebra, "BLOCK", block)
        each = factor_in_one_pass(K, K.diagonal(), Y, use)
        assert each is not None
        found.append(each.weights)
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0.0, atol=1e-12 * float(np.abs(found[0]).max()))
