"""Held-out blocks and the linear baseline."""

from __future__ import annotations

import numpy as np
import pytest
from etude.models.blocks import held_out_blocks, linear_regression, split_blocks
from etude.models.dataset import Dataset

from etude.errors import DataError


def dataset(n: int, seed: int = 0) -> Dataset:
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.standard_normal((3, n, 2))
    tau = q @ [[1.0, 2.0], [0.0, 1.0]] + 3.0 * qd - 0.5 * qdd + [4.0, -1.0]
    none = np.zeros((n, 2), dtype=bool)
    return Dataset(np.linspace(5.0, 25.0, n), q, qd, qdd, tau, none, np.zeros(n, dtype=np.int64))


def test_every_fifth_block_is_held_out() -> None:
    assert held_out_blocks() == (3, 8, 13, 18)
    data = dataset(2000)
    train, test = split_blocks(data)
    assert len(train) + len(test) == len(data)
    middles = [run.mean() for run in np.split(test.t, np.flatnonzero(np.diff(test.t) > 1.0) + 1)]
    np.testing.assert_allclose(middles, [8.5, 13.5, 18.5, 23.5], atol=0.02)  # 1 s a block, from 5 s on
    assert len(test) == 400


def test_a_part_can_be_split_again() -> None:
    train, _ = split_blocks(dataset(2000))
    inner, held = split_blocks(train)
    assert len(held) == 320
    assert set(held.t) < set(train.t)
    assert not set(held.t) & set(inner.t)


def test_the_order_of_samples_does_not_matter() -> None:
    data = dataset(500)
    shuffled = data.take(np.random.default_rng(0).permutation(500))
    assert set(split_blocks(shuffled)[1].t) == set(split_blocks(data)[1].t)


def test_too_short_a_log_is_refused() -> None:
    with pytest.raises(DataError, match="too short"):
        split_blocks(dataset(1))


def test_linear_regression_is_exact_on_linear_data() -> None:
    train, test = split_blocks(dataset(300))
    np.testing.assert_allclose(linear_regression(train, test), test.tau, atol=1e-10)
