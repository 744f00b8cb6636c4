"""The sequential test of a changed robot: golden numbers, Wald's ratio, and what is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from etude.models.changed import ALARM, KAPPA2, cause, evidence, first_alarm

GOLDEN = [0.0, 0.40342640972, 1.74435281944, 1.44465422916, 2.26995563888]


def test_golden_numbers() -> None:
    z = np.array([[1.0], [2.0], [3.0], [0.5], [2.5]])
    np.testing.assert_allclose(evidence(z, np.array([0.5])), GOLDEN, atol=1e-10)


def test_a_step_is_the_logarithm_of_the_likelihood_ratio() -> None:
    z = np.array([[3.1, 2.2]])
    ratio = norm.logpdf(z, scale=np.sqrt(KAPPA2)) - norm.logpdf(z)
    assert evidence(z, np.ones(2))[0] == pytest.approx(ratio.sum(), rel=1e-12)
    assert evidence(z * 2.0, np.ones(2), scale=4.0)[0] == pytest.approx(ratio.sum(), rel=1e-12)


def test_what_says_nothing_does_not_count() -> None:
    z = np.array([[9.0, 9.0], [9.0, 9.0]])
    use = np.array([[True, False], [False, False]])
    found = evidence(z, np.ones(2), use)
    assert found[0] == found[1] == pytest.approx(evidence(z[:1, :1], np.ones(1))[0])


def test_an_unchanged_robot_does_not_alarm_and_a_changed_one_does() -> None:
    rng = np.random.default_rng(0)
    same, changed = rng.standard_normal((2000, 4)), 2.0 * rng.standard_normal((2000, 4))
    worth = np.full(4, 0.2)
    assert first_alarm(evidence(same, worth), ALARM) is None
    at = first_alarm(evidence(changed, worth), ALARM)
    assert at is not None
    assert evidence(changed, worth)[at] > ALARM >= evidence(changed, worth)[at - 1]


class TestCause:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.125)[:, None]
    rates = np.array([[0.7, 1.1, 1.7]])
    q = np.sin(t * rates) + 0.6 * np.cos(2.3 * t * rates)
    v = np.gradient(q, 0.125, axis=0)
    a = np.gradient(v, 0.125, axis=0)
    motion = (np.sin(q), v, a)
    noise = rng.standard_normal(q.shape)
    use = np.abs(v) > 0.05
    deviation = np.ones_like(q)

    @pytest.mark.parametrize(
        ("error", "name"),
        [
            (5.0 * np.sin(q) + 2.0 * a, "load"),
            (5.0 * np.sign(v), "friction"),
            (np.full_like(q, 4.0), "offset"),
            (0.0 * q, "unknown"),
            (5.0 * rng.standard_normal(q.shape), "unknown"),
            (4.0 * np.sign(v) + 6.0 * np.sin(q), "unknown"),
        ],
    )
    def test_it_is_named_only_where_it_is_clear(self, error: np.ndarray, name: str) -> None:
        assert cause(error + self.noise, self.deviation, self.use, self.motion) == name

    def test_without_samples_nothing_is_named(self) -> None:
        nothing = np.zeros_like(self.use)
        assert cause(self.noise, self.deviation, nothing, self.motion) == "unknown"
