"""BLAS threads: one for small matrices, the user's number for large ones and afterwards."""

from __future__ import annotations

import numpy as np
import scipy.linalg.lapack  # noqa: F401  its own BLAS
import threadpoolctl

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
