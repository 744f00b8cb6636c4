"""Task motions from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign

from etude import ask
from etude.campaign import Campaign, stored_trajectory
from etude.campaign.propose.typical_motions import load_tasks
from etude.errors import UsageError
from etude.types import Channel


def table(path: Path, header: str, rows: np.ndarray) -> Path:  # type: ignore[type-arg]
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def test_a_trajectory_file_is_a_task(campaign: Campaign) -> None:
    (motion,) = load_tasks(ask(campaign).folder / "trajectory.json", campaign.channel("q"))
    assert motion == stored_trajectory(campaign, 1)


def test_a_table_is_a_smooth_task(campaign: Campaign, tmp_path: Path) -> None:
    t = np.linspace(5.0, 7.0, 201)
    path = table(tmp_path / "t.csv", "q_knee,time,q_hip", np.column_stack([np.cos(t), t, np.sin(t)]))
    (motion,) = load_tasks(path, campaign.channel("q"))
    assert motion.duration == pytest.approx(2.0)
    at = np.array([0.5, 1.0, 1.5])
    q, qd, qdd, jerk, snap = motion.motion(at, 5).orders
    np.testing.assert_allclose(q, np.column_stack([np.sin(5 + at), np.cos(5 + at)]), atol=1e-10)
    np.testing.assert_allclose(qd, np.column_stack([np.cos(5 + at), -np.sin(5 + at)]), atol=1e-8)
    np.testing.assert_allclose(qdd, -q, atol=1e-6)
    np.testing.assert_allclose(jerk, -qd, atol=1e-4)
    np.testing.assert_allclose(snap, q, atol=1e-2)
    outside = motion.motion(np.array([-1.0, 3.0]), 3).orders
    np.testing.assert_allclose(outside[0], motion.motion(np.array([0.0, 2.0]), 1).orders[0])
    assert not outside[1:].any()


def test_a_recorded_task_is_only_a_task(campaign: Campaign, tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(8.0), np.zeros((8, 2))])
    (motion,) = load_tasks(table(tmp_path / "t.csv", "time,q_hip,q_knee", rows), campaign.channel("q"))
    (short,) = load_tasks(table(tmp_path / "short.csv", "t,hip,knee", rows), campaign.channel("q"))
    t = np.linspace(0.0, motion.duration, 9)
    np.testing.assert_array_equal(short.motion(t, 1).orders, motion.motion(t, 1).orders)
    for refused in (lambda: motion.bound(0, 1), lambda: motion.slowed(2.0), motion.to_json):
        with pytest.raises(UsageError, match="a recorded motion"):
            refused()


def test_the_tasks_are_kept_with_the_proposal(campaign: Campaign, tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(8.0), np.zeros((8, 2))])
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
        ("time,q_hip,q_knee\n" + "1,2,3\n" * 8, "increasing time"),
        ("time,q_hip,q_knee\n1,2,3\n", "6 finite rows"),
        ("time,q_hip,q_knee\n1,2,3\n2,nan,3\n3,1,1\n4,1,1\n", "6 finite rows"),
    ],
)
def test_tables_that_are_no_tasks(campaign: Campaign, tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    with pytest.raises(UsageError, match=message):
        load_tasks(path, campaign.channel("q"))


def test_tasks_of_another_robot(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path)
    motion = ask(campaign).folder / "trajectory.json"
    with pytest.raises(UsageError, match="the task moves 2 axes, the robot has 4"):
        load_tasks(motion, Channel("q", ("a", "b", "c", "d"), ("rad",) * 4))


def test_a_path_in_space_has_the_columns_of_its_table(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 20)
    path = table(tmp_path / "t.csv", "time,x,y,z", np.column_stack([t, t, t**2, t**3]))
    (motion,) = load_tasks(path, Channel("position", ("x", "y", "z"), ("m",) * 3))
    np.testing.assert_allclose(motion.motion(np.array([0.5]), 2).orders[1], [[1.0, 1.0, 0.75]], atol=1e-9)
