"""Task motions from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign

from etude.campaign.ask import ask, stored_trajectory
from etude.campaign.folder import Campaign
from etude.campaign.tasks import load_tasks
from etude.errors import UsageError


def table(path: Path, header: str, rows: np.ndarray) -> Path:  # type: ignore[type-arg]
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def test_a_trajectory_file_is_a_task(campaign: Campaign) -> None:
    (motion,) = load_tasks(ask(campaign).folder / "trajectory.json", campaign.spec)
    assert motion == stored_trajectory(campaign, 1)


def test_a_table_is_a_smooth_task(campaign: Campaign, tmp_path: Path) -> None:
    t = np.linspace(5.0, 7.0, 201)
    path = table(tmp_path / "t.csv", "q_knee,time,q_hip", np.column_stack([np.cos(t), t, np.sin(t)]))
    (motion,) = load_tasks(path, campaign.spec)
    assert (motion.dof, motion.duration) == (2, pytest.approx(2.0))
    at = np.array([0.5, 1.0, 1.5])
    s = motion.sample(at)
    np.testing.assert_allclose(s.q, np.column_stack([np.sin(5 + at), np.cos(5 + at)]), atol=1e-7)
    np.testing.assert_allclose(s.qd, np.column_stack([np.cos(5 + at), -np.sin(5 + at)]), atol=1e-5)
    np.testing.assert_allclose(s.qdd, -s.q, atol=1e-3)
    outside = motion.sample(np.array([-1.0, 3.0]))
    np.testing.assert_allclose(outside.q, motion.sample(np.array([0.0, 2.0])).q)
    assert not outside.qd.any()


def test_the_tasks_are_kept_with_the_proposal(campaign: Campaign, tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    path = table(tmp_path / "t.csv", "time,q_hip,q_knee", rows)
    proposal = ask(campaign, tasks=path)
    assert (proposal.folder / "tasks.csv").read_bytes() == path.read_bytes()
    assert "proposals/0001/tasks.csv" in campaign.events()[-1].files


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no column time, q_hip, q_knee"),
        ("time,q_hip\n1,2\n", "no column q_knee"),
        ("time,q_hip,q_knee\n1,2,x\n", "not a number"),
        ("time,q_hip,q_knee\n1,2\n", "not a number"),
        ("time,q_hip,q_knee\n" + "1,2,3\n" * 5, "increasing time"),
        ("time,q_hip,q_knee\n1,2,3\n", "4 finite rows"),
        ("time,q_hip,q_knee\n1,2,3\n2,nan,3\n3,1,1\n4,1,1\n", "4 finite rows"),
    ],
)
def test_tables_that_are_no_tasks(campaign: Campaign, tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    with pytest.raises(UsageError, match=message):
        load_tasks(path, campaign.spec)


def test_tasks_of_another_robot(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path)
    motion = ask(campaign).folder / "trajectory.json"
    from etude.robots.toml_file import load_robot

    with pytest.raises(UsageError, match="the task moves 2 joints, the robot has 4"):
        load_tasks(motion, load_robot("arm4"))
