"""A log of the proposal is aligned with it; a log of anything else is refused, with the likely cause."""

from __future__ import annotations

import numpy as np
import pytest
from log_examples import CHANNELS, LIMITS, MOTION, SCALE, Sines, at, make_log, with_values

from etude.errors import DataError
from etude.logs import align, clean_log
from etude.logs.alignment.alignment import likely_delays
from etude.protocols import Trajectory
from etude.types import Log

LOG = make_log(start=-2.0)


def aligned(log: Log, trajectory: Trajectory = MOTION) -> Log:
    return align(log, trajectory, CHANNELS, "q", SCALE)


@pytest.mark.parametrize("shift", [0.0, 2.0, 7.3, 1.7e9])
def test_the_start_is_found(shift: float) -> None:
    log = aligned(clean_log(at(LOG, LOG.t + shift), CHANNELS, LIMITS))
    np.testing.assert_allclose(log.t, LOG.t, atol=2e-3)
    np.testing.assert_allclose(log["q_des"], MOTION.motion(log.t).orders[0], atol=1e-12)
    np.testing.assert_array_equal(log["qd_des"][:200], 0.0)
    assert "qdd_des" in log
    assert bool(log.repairs) == (shift != 0.0)


def test_a_lagging_joint_and_one_that_sticks_still_match() -> None:
    q = LOG["q"].copy()
    q[:, 2] = 0.3 * q[:, 2]
    q[:, 0] = np.roll(q[:, 0], 8)
    assert len(aligned(with_values(LOG, q=q))) == len(LOG)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q: q * [1, -1, 1], "lift_joint moves in the opposite direction"),
        (lambda q: q * [1, 1, 57.2958], "elbow_joint looks like degrees"),
        (lambda q: q[:, [1, 0, 2]], "pan_joint follows the proposal for lift_joint"),
        (lambda q: q[::-1] * [0.7, 0.2, -0.9], "not the log of the proposed trajectory|another motion"),
    ],
)
def test_another_motion_is_refused(change, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError, match=words) as refused:
        aligned(with_values(LOG, q=change(LOG["q"])))
    assert ("[log.columns]" in refused.value.next_step) == ("joint" in words)


@pytest.mark.parametrize("other", [Sines((0.35, 0.15, 0.25)), Sines((0.2, 0.45, 0.1), (0.3, 0.8, 0.9))])
def test_the_log_of_another_proposal_is_refused(other: Sines) -> None:
    with pytest.raises(DataError, match=r"another motion|not the log of the proposed"):
        aligned(LOG, other)


def test_half_a_log_is_not_enough() -> None:
    with pytest.raises(DataError, match=r"holds .* of the proposal's 20 s"):
        aligned(LOG.take(np.arange(500, 1200)))
    assert aligned(LOG.take(np.arange(1400))).t[0] == pytest.approx(-2.0, abs=2e-3)


def test_another_number_of_joints_is_refused() -> None:
    with pytest.raises(DataError, match="3 coordinates, the proposal 2"):
        aligned(LOG, Sines((0.1, 0.2), (1.0, 1.0)))


@pytest.mark.parametrize("lag", [-0.31, 0.0, 0.0137, 0.4])
def test_delay_is_measured_below_a_sample(lag: float) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    a, b = MOTION.motion(t).orders[0], 3.0 * MOTION.motion(t - lag).orders[0] - 5.0
    found = likely_delays(a, b, 100.0)[0]
    assert found.seconds == pytest.approx(lag, abs=1e-3)
    assert found.correlation == pytest.approx(1.0, abs=1e-3)


def test_delay_respects_its_bounds_and_reports_a_bad_fit() -> None:
    rng = np.random.default_rng(0)
    found = likely_delays(rng.standard_normal((500, 2)), rng.standard_normal((400, 2)), 100.0, (-0.5, 0.2))[0]
    assert -0.5 <= found.seconds <= 0.2
    assert abs(found.correlation) < 0.5


def test_a_marked_start_is_kept_however_late_the_robot_follows() -> None:
    late = with_values(LOG, q=np.roll(LOG["q"], 30, axis=0))
    np.testing.assert_array_equal(aligned(late).t, LOG.t)
    unmarked = at(late, late.t + 2.0)
    np.testing.assert_allclose(aligned(unmarked).t, LOG.t - 0.3, atol=2e-3)


def test_a_recorder_with_another_zero_is_not_believed() -> None:
    np.testing.assert_allclose(aligned(at(LOG, LOG.t - 4.0)).t, LOG.t, atol=2e-3)


def test_the_planned_motion_counts_if_the_log_has_it() -> None:
    late = with_values(LOG, q=np.roll(LOG["q"], 30, axis=0), q_des=MOTION.motion(LOG.t).orders[0])
    np.testing.assert_allclose(aligned(at(late, late.t + 2.0)).t, LOG.t, atol=2e-3)


def test_without_its_path_a_log_is_taken_at_its_word() -> None:
    log = at(LOG.without("q"), LOG.t + 9.0)
    assert aligned(log).t[0] == 0.0


def test_rows_outside_may_be_cut() -> None:
    log = align(LOG, MOTION, CHANNELS, "q", SCALE, rest=False)
    assert log.t[0] == pytest.approx(0.0, abs=1e-9)
    assert len(log) == 2000


def test_where_nothing_fits_the_least_misfit_is_told() -> None:
    """A motion against its mirror image has no positive correlation at small lags."""
    t = np.arange(0.0, 20.0, 0.05)
    delays = likely_delays(np.sin(t)[:, None], -np.sin(t)[:, None], 20.0, (-0.2, 0.2))
    assert delays
    assert all(delay.correlation < 0.0 and abs(delay.seconds) <= 0.2 for delay in delays)
