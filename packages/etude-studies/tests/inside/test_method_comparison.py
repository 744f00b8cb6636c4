"""The statistics of the study for anybody's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from etude_studies.method_comparison import compare
from etude_studies.thesis import statistics


def by_seed(x: np.ndarray) -> dict[int, float]:
    return dict(enumerate(np.exp(x).tolist()))


def test_a_method_is_judged_against_another_over_the_same_seeds() -> None:
    rng = np.random.default_rng(1)
    base = rng.normal(0.0, 1.0, 20)
    better = base - 0.3 + rng.normal(0.0, 0.1, 20)
    found = compare({"ours": (by_seed(better), by_seed(base)), "turned": (by_seed(base), by_seed(better))})
    assert [found[name].word for name in ("ours", "turned")] == ["holds", "reversed"]
    ours = found["ours"]
    assert ours.estimate == pytest.approx(np.exp((better - base).mean()), rel=1e-5)
    assert ours.p_adjusted == pytest.approx(2.0 * statistics.paired_t(better - base), rel=1e-3)
    assert ours.power == pytest.approx(1.0, abs=0.01)


def test_equal_methods_and_a_seed_that_only_one_has() -> None:
    base = np.zeros(20)
    near = np.random.default_rng(2).normal(0.0, 0.05, 20)
    (found,) = compare({"alike": (by_seed(near), by_seed(base))}, claim="equal").values()
    assert found.word == "holds"
    (found,) = compare({"fewer": (by_seed(near[:19]), by_seed(base))}, margin=1.3).values()
    assert (found.seeds, found.failed, found.word) == (19, 1, "tie")
