"""Downsampling by stride and by count."""

from __future__ import annotations

import numpy as np
import pytest
from dictionary_examples import motion, outputs, process

from etude.errors import DataError, UsageError
from etude.models.dataset import Dataset
from etude.models.gp.downsampled import DownsampledGP
from etude.models.selection import every_nth


def dataset(lengths: list[int]) -> Dataset:
    n = sum(lengths)
    zeros = np.zeros((n, 1))
    group = np.repeat(np.arange(len(lengths)), lengths)
    return Dataset(np.arange(n) / 100.0, zeros, zeros, zeros, zeros, zeros > 0, group)


def test_every_twelfth_of_each_trajectory() -> None:
    data = dataset([6000, 3000, 5])
    use = np.ones(len(data), dtype=bool)
    kept = every_nth(data, use, 12, np.random.default_rng(0))
    assert [int(np.sum(data.group[kept] == g)) for g in range(3)] == [500, 250, 1]
    for g in range(2):
        assert set(np.diff(kept[data.group[kept] == g])) == {12}
    firsts = {int(every_nth(data, use, 12, np.random.default_rng(s))[0]) for s in range(40)}
    assert len(firsts) > 8
    assert max(firsts) < 12


def test_only_what_may_be_used() -> None:
    data = dataset([100])
    use = np.arange(100) % 2 == 0
    assert np.all(every_nth(data, use, 3, np.random.default_rng(1)) % 2 == 0)
    assert len(every_nth(data, np.zeros(100, dtype=bool), 3, np.random.default_rng(1))) == 0
    with pytest.raises(UsageError, match="at least 1"):
        every_nth(data, use, 0, np.random.default_rng(1))


def test_the_process_on_what_is_kept() -> None:
    rng = np.random.default_rng(2)
    X = motion(rng, 240, 3, rate=4.0)
    y, gp = outputs(X, rng), process(3, 1e-2)
    thinned = DownsampledGP(gp, offset=5)
    np.testing.assert_array_equal(thinned.condition(X, y).X, X[5::12])
    # a strided view and a copy may be summed in another order
    direct = gp.log_marginal_likelihood(X[5::12], y[5::12])[0]
    assert thinned.log_marginal_likelihood(X, y)[0] == pytest.approx(direct, rel=1e-12)
    counted = DownsampledGP(gp, every=None, count=50)
    kept = counted.keep(240)
    assert len(set(kept.tolist())) == 50
    assert set(np.diff(kept)) == {4, 5}
    assert counted.keep(7).tolist() == list(range(7))
    assert DownsampledGP(gp, offset=5).keep(3).tolist() == [2]


def test_bad_input() -> None:
    gp = process(3, 1e-2)
    for options in ({"every": None}, {"count": 3}, {"every": 0}, {"every": None, "count": 0}, {"offset": 12}):
        with pytest.raises(UsageError):
            DownsampledGP(gp, **options)
    with pytest.raises(DataError, match="training needs"):
        DownsampledGP(gp).condition(np.zeros((0, 3)), np.zeros(0))
