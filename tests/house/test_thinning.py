"""Everyday cases of a law with many: each value of each parameter is among them."""

from __future__ import annotations

from itertools import product

import pytest

from thinning import daily


@pytest.mark.parametrize("sizes", [(3,), (2, 2, 2), (7, 2, 4), (1, 5)])
def test_each_value_is_met_by_as_few_cases_as_can(sizes: tuple[int, ...]) -> None:
    cases = [dict(zip("abc", places, strict=False)) for places in product(*map(range, sizes))]
    kept = [cases[i] for i in daily(cases)]
    for name, size in zip("abc", sizes, strict=False):
        assert {case[name] for case in kept} == set(range(size))
    assert len(kept) == max(sizes)


def test_every_third() -> None:
    assert daily([{"a": i} for i in range(8)], 3) == [0, 3, 6]
