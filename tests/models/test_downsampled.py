"""Downsampling by stride and by count."""

from __future__ import annotations

import numpy as np
import pytest
from dictionary_examples import motion, outputs, process

from etude.errors import DataError, UsageError
from etude_sparse import DownsampledGP


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
