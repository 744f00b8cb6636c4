"""BLAS threads: one for small matrices, the user's number for large ones and afterwards."""

from __future__ import annotations

import numpy as np
import scipy.linalg.lapack  # noqa: F401  its own BLAS
import threadpoolctl

from etude.models import ExactPosterior, SquaredExponential
from etude.threads import SMALL, threads_for


def in_use() -> set[int]:
    assert np.dot is not None  # NumPy's BLAS is loaded
    return {one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}


def test_large_matrices_inside_a_block_of_small_ones_get_the_users_threads() -> None:
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        with threads_for(SMALL + 1):
            assert in_use() == {2}
        with threads_for(SMALL):
            assert in_use() == {1}
            with threads_for(SMALL + 1):
                assert in_use() == {2}
            assert in_use() == {1}
        assert in_use() == {2}


def test_it_decorates_a_function_that_is_called_twice_and_may_fail() -> None:
    @threads_for(0)
    def found(fails: bool) -> set[int]:
        if fails:
            raise ValueError
        return in_use()

    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        for _ in range(2):
            try:
                found(True)
            except ValueError:
                assert in_use() == {2}
            assert found(False) == {1}
            assert in_use() == {2}


def test_means_are_predicted_by_one_thread(monkeypatch) -> None:
    seen = []
    sums = SquaredExponential.sums

    def watched(self, theta, Z, alpha):
        of = sums(self, theta, Z, alpha)
        return lambda X: (seen.append(in_use()), of(X))[1]

    monkeypatch.setattr(SquaredExponential, "sums", watched)
    X = np.linspace(0.0, 1.0, 12).reshape(6, 2)
    posterior = ExactPosterior(SquaredExponential((0, 1)), np.zeros(3), 0.01, X, X[:, 0])
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        posterior.mean(X)
        assert in_use() == {2}
    assert seen == [{1}]
