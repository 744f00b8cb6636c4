"""The robots of the study of many joints are what they say, and finished cells are not run again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etude_studies import more_joints
from etude_studies.more_joints import FIGURES, cell, measured
from etude_studies.two_arms import MOST, counts, two_arms


@pytest.mark.parametrize("joints", [6, 7, 10, 14])
def test_a_robot_has_as_many_joints_as_are_asked_for(joints: int) -> None:
    world = two_arms(joints)
    names = [f"{name}{i + 1}" for name, _, count in counts(joints) for i in range(count)]
    assert list(world.spec.names) == names
    assert len(names) == joints <= MOST
    assert world.robot.begin(np.zeros(joints)) is not None


def test_what_one_arm_does_the_other_does_not_feel() -> None:
    rng = np.random.default_rng(0)
    motion = rng.uniform(-1.0, 1.0, (3, 20, 14))
    both, alone = two_arms(14).robot, two_arms(7).robot
    np.testing.assert_allclose(both.inverse(*motion)[:, :7], alone.inverse(*motion[..., :7]), atol=1e-9)
    assert np.abs(both.inverse(*motion)[:, 7:]).max() > 10.0


def test_a_finished_cell_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = dict.fromkeys(FIGURES, 1.5)
    monkeypatch.setattr(more_joints, "measured", lambda *_: facts)
    assert cell(6, 0, tmp_path) == facts
    monkeypatch.setattr(more_joints, "measured", lambda *_: pytest.fail("measured again"))
    assert cell(6, 0, tmp_path) == facts


@pytest.mark.slow
def test_learning_six_joints_tracks_better_than_feedback() -> None:
    found = measured(two_arms(6), 0)
    assert set(found) == set(FIGURES)
    assert found["error_learned"] < 0.2 * found["error_pd"]
    assert found["error_perfect"] < found["error_learned"]
