"""The statistics of the study for anybody's numbers."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from etude_studies.method_comparison import compare, compared_rows
from etude_studies.thesis import statistics
from etude_studies.thesis.ledger import Entry, Row


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


def test_rows_of_a_table_are_compared_with_the_one_it_names_over_seeds_that_both_have() -> None:
    rows = tuple(Row(name, name) for name in ("A1", "M1:near", "M1:far", "M2"))
    entry = Entry(
        "beyond-x", "", "beyond", "table", "error", "deg", (3, 6), ("mean",), "fourier", 20, rows=rows
    )
    rng = np.random.default_rng(3)
    base = rng.normal(0.0, 1.0, 20)
    told = {
        "A1": by_seed(base),
        "M1:near": by_seed((base - 0.4 + rng.normal(0.0, 0.1, 20))[:15]),
        "M1:far": by_seed(base + 0.4 + rng.normal(0.0, 0.1, 20)),
    }

    class Told:
        def values(self, source, measure, k, test, part):
            assert (measure, k, test, part) == ("error", 6, "fourier", "mean")
            return told.get(source, {})

    found = compared_rows(msgspec.structs.replace(entry, against="A1"), Told())
    assert [(name, part.word, part.seeds) for name, part in found.items()] == [
        ("M1:near", "holds", 15),
        ("M1:far", "reversed", 20),
    ]
    assert compared_rows(entry, Told()) == {}
