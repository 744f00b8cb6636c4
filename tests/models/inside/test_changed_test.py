"""The sequential test of a changed robot: golden numbers, Wald's ratio, scores, what samples are worth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, t

from etude.models import first_alarm
from etude.models.change.change_detection import (
    ALARM,
    FREEDOM,
    KAPPA2,
    MOST_FREEDOM,
    different_outputs,
    evidence,
    independence,
    scores,
    student_freedom,
)

GOLDEN = [0.0, 0.40342640972, 1.74435281944, 1.44465422916, 2.26995563888]


def test_golden_numbers() -> None:
    z = np.array([[1.0], [2.0], [3.0], [0.5], [2.5]])
    np.testing.assert_allclose(evidence(z, np.array([0.5])), GOLDEN, atol=1e-10)


def test_a_step_is_the_logarithm_of_the_likelihood_ratio() -> None:
    z = np.array([[3.1, 2.2]])
    ratio = norm.logpdf(z, scale=np.sqrt(KAPPA2)) - norm.logpdf(z)
    assert evidence(z, np.ones(2))[0] == pytest.approx(ratio.sum(), rel=1e-12)


def test_scores_are_as_improbable_as_the_errors() -> None:
    z = np.array([[-9.0, -1.2, 0.0], [0.3, 2.0, 40.0]])
    np.testing.assert_allclose(norm.sf(np.abs(scores(z, 3.0))), t.sf(np.abs(z), 3.0), rtol=1e-9)
    np.testing.assert_array_equal(np.sign(scores(z, 3.0)), np.sign(z))
    assert np.isfinite(scores(np.array([1e300, -np.inf]), MOST_FREEDOM)).all()


def test_tails_are_those_of_held_out_errors_and_never_quite_normal() -> None:
    rng = np.random.default_rng(0)
    heavy = np.where(rng.uniform(size=(4000, 2)) < 0.5, t.rvs(3.0, size=(4000, 2), random_state=rng), np.nan)
    assert 2.0 < student_freedom(heavy) < 5.0
    assert student_freedom(rng.standard_normal((4000, 2))) == MOST_FREEDOM
    assert student_freedom(np.full((4, 2), np.nan)) == FREEDOM


def test_what_says_nothing_does_not_count() -> None:
    z = np.array([[9.0, 9.0], [9.0, 9.0]])
    use = np.array([[True, False], [False, False]])
    found = evidence(z, np.ones(2), use)
    assert found[0] == found[1] == pytest.approx(evidence(z[:1, :1], np.ones(1))[0])


def test_heavy_tails_are_no_other_robot_and_a_doubled_deviation_is() -> None:
    rng = np.random.default_rng(0)
    same, worth = t.rvs(5.0, size=(2000, 4), random_state=rng), np.full(4, 0.2)
    assert first_alarm(evidence(same, worth), ALARM) is not None
    assert first_alarm(evidence(scores(same, student_freedom(same)), worth), ALARM) is None
    found = evidence(scores(2.0 * same, student_freedom(same)), worth)
    at = first_alarm(found, ALARM)
    assert at is not None
    assert found[at] > ALARM >= found[at - 1]


def test_motors_of_one_axis_err_alike_and_count_once() -> None:
    """Eight motors that share four errors: chance passes as rarely as with the four, in 400 runs."""
    rng, mix = np.random.default_rng(1), np.linalg.qr(np.random.default_rng(0).standard_normal((8, 4)))[0]
    mix /= np.linalg.norm(mix, axis=1)[:, None]
    runs, worth = rng.standard_normal((400, 60, 4)), np.ones(8)
    share = different_outputs((runs @ mix.T).reshape(-1, 8), MOST_FREEDOM)
    assert 0.3 < share <= 0.5
    alarms = [first_alarm(evidence(z @ mix.T, share * worth), 5.0) is not None for z in runs]
    naive = [first_alarm(evidence(z @ mix.T, worth), 5.0) is not None for z in runs]
    single = [first_alarm(evidence(z, np.ones(4)), 5.0) is not None for z in runs]
    assert sum(alarms) <= 2 * sum(single) < sum(naive)


def test_outputs_that_err_by_themselves_all_count_and_equal_ones_once() -> None:
    z = np.random.default_rng(2).standard_normal((4000, 6))
    assert different_outputs(z, MOST_FREEDOM) == pytest.approx(1.0, abs=0.01)
    assert different_outputs(np.repeat(z[:, :3], 2, axis=1), MOST_FREEDOM) == pytest.approx(0.5, abs=0.01)
    assert different_outputs(-(10.0 ** np.arange(6)) * z[:, :1], MOST_FREEDOM) > 1.0 / 6.0 - 1e-9
    assert different_outputs(np.full((4, 6), np.nan), MOST_FREEDOM) == 1.0


class TestIndependence:
    """Of errors in eight trajectories of 600 samples of two outputs."""

    rng = np.random.default_rng(3)
    t = np.tile(np.arange(600) * 0.1, 8)
    group = np.repeat(np.arange(8), 600)
    white = rng.standard_normal((4800, 2))
    use = np.ones((4800, 2), dtype=bool)

    def worth(self, z: np.ndarray, use: np.ndarray | None = None) -> np.ndarray:
        return independence(z, MOST_FREEDOM, self.t, self.group, self.use if use is None else use)

    def test_errors_that_are_independent_are_worth_themselves(self) -> None:
        np.testing.assert_allclose(self.worth(self.white), 1.0, atol=0.15)

    def test_of_ten_equal_errors_each_is_worth_a_tenth(self) -> None:
        np.testing.assert_allclose(self.worth(np.repeat(self.white[::10], 10, axis=0)), 0.1, rtol=0.25)

    def test_bursts_of_errors_are_alike_though_their_signs_are_not(self) -> None:
        size = np.repeat(np.abs(self.white[::10]), 10, axis=0)
        flickering = size * np.sign(self.white)
        assert abs(np.mean(flickering[1:] * flickering[:-1])) < 0.05
        np.testing.assert_allclose(self.worth(flickering), 0.1, rtol=0.25)

    def test_samples_that_were_not_held_out_add_nothing_and_those_at_rest_are_not_asked(self) -> None:
        thinned = np.where(np.arange(4800)[:, None] % 10 == 0, self.white, np.nan)
        np.testing.assert_allclose(self.worth(thinned), 0.1, rtol=0.2)
        moving = self.use & (np.arange(4800)[:, None] % 2 == 0)
        np.testing.assert_allclose(self.worth(thinned, moving), 0.2, rtol=0.2)

    def test_where_nothing_was_held_out_a_sample_is_worth_itself(self) -> None:
        np.testing.assert_array_equal(self.worth(np.full_like(self.white, np.nan)), 1.0)

    def test_a_level_of_the_errors_that_is_a_trajectorys_own_is_no_dependence(self) -> None:
        level = 1.0 + 0.5 * self.group[:, None]
        assert self.worth(level * self.white)[0] > 0.8
