from __future__ import annotations

import pytest

from etude.design import DesignConfig
from etude.errors import UsageError


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "entropy"}, "there is no criterion 'entropy'.*Known: mean_variance, ivr, log_ivr"),
        ({"sampler": "grid"}, "'scaled' or 'uniform', not 'grid'"),
        ({"candidates": 0}, "candidates must be >= 1, not 0"),
        ({"points": 0}, "points must be >= 1"),
        ({"reference_points": 0}, "reference_points must be >= 1"),
        ({"steps": -1}, "steps must be >= 0"),
        ({"refine": -1}, "refine must be >= 0"),
        ({"inducing": -1}, "inducing must be >= 0"),
        ({"random_share": 1.5}, "random_share"),
        ({"random_share": float("nan")}, "random_share"),
    ],
)
def test_bad_options(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        DesignConfig(**options)


def test_a_criterion_may_be_named_in_full() -> None:
    assert DesignConfig(criterion="my_package.mine:entropy").criterion == "my_package.mine:entropy"
