"""A next motion is at most twice as fast as the logs of its model, which knows nothing of higher speeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from robot_runs import lab
from small_robot import write_log

from etude import ask, tell
from etude.campaign import Campaign, open_campaign, stored_trajectory
from etude.campaign.propose.constraints import constraints_now
from etude.campaign.propose.learned_velocity import ALWAYS, KNOWN, MOST_FASTER, peak_speeds

FASTEST = np.ones(2)
"""rad/s in the robot file."""


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """One log, at a quarter of the speed of its motion."""
    folder = tmp_path_factory.mktemp("slow")
    campaign = lab(folder)
    ask(campaign, speed=25)
    tell(campaign, write_log(folder / "log.csv", stored_trajectory(campaign, 1, 25)))
    return open_campaign(campaign.path)


def test_a_motion_is_at_most_twice_as_fast_as_logs(slow: Campaign) -> None:
    known = 0.25 * peak_speeds(stored_trajectory(slow, 1))
    assert np.all(MOST_FASTER * known < FASTEST), "else nothing is left to limit"
    proposal = ask(slow)
    rows = {row.axis: row.upper for row in proposal.certificate.rows if row.quantity == KNOWN}
    most = np.maximum(MOST_FASTER * known, ALWAYS * FASTEST)
    np.testing.assert_allclose([rows[axis] for axis in slow.axes], most)
    assert np.all(peak_speeds(stored_trajectory(slow, proposal.number)) <= most)


def test_a_joint_that_stood_still_may_move(slow: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.campaign.propose.learned_velocity.peak_speeds", lambda _: np.array([0.0, 4.0]))
    limits = constraints_now(slow, slow.state()).limits(slow)
    ends = [(one.names, one.upper) for one in limits if one.name == KNOWN]
    assert len(ends) == 1, "the fast joint needs no row"
    assert ends[0][0] == ("hip",)
    np.testing.assert_allclose(ends[0][1], ALWAYS)


def test_before_any_log_only_the_robot_file_limits_speeds(tmp_path: Path) -> None:
    fresh = lab(tmp_path)
    assert all(one.name != KNOWN for one in constraints_now(fresh, fresh.state()).limits(fresh))
