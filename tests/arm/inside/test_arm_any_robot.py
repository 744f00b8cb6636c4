"""Robots that nobody here made go the whole way: from their URDF to a report, on a stand-in of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mutants import laws
from robots_of_others import FILES, campaign_of, file_of, robot_of

from etude import status
from etude.campaign import Campaign, open_campaign, simulate
from etude.errors import UsageError
from etude.report import build_report
from etude.testing import RobotSuite
from etude_arm import KIND, motions
from etude_arm.rehearsal.rehearsed_robot import rehearsed

ARMS = (
    *("panda", "ur3", "ur5", "ur10", "iiwa", "xarm6", "xarm7"),
    *("so100", "so101", "z1", "kinova", "tiago"),
)
QUICK = """\
kind = "arm"
seed = 3
[trajectory]
duration = 10.0
[model]
rung = "identified"
"""


def errors_of(campaign: Campaign, baseline: str, test: str = "fourier") -> np.ndarray:
    """The newest of that controller along the axes."""
    found = [e for _, e in campaign.state().evaluated if (e.baseline, e.test) == (baseline, test)]
    return np.array(found[-1].errors)


def row_of(name: str, campaign: Campaign) -> str:
    """A line of the table in docs/results/rehearsal.md."""
    who = ("pd", "rigid_body", "", "perfect")
    means = " | ".join(f"{errors_of(campaign, one).mean():.3g}" for one in who)
    moves = " | ".join(f"{errors_of(campaign, one, 'moves').mean():.3g}" for one in who)
    return f"| {name} | {len(campaign.axes)} | {means} | {moves} |"


@pytest.mark.slow
def test_a_ur5_learns_in_one_short_motion_of_its_stand_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motions, "MOVES", 1)
    monkeypatch.setattr(motions, "TEST_DURATION", 8.0)
    campaign, said = campaign_of("ur5", tmp_path, QUICK), []
    assert len(list(simulate(campaign, 1, say=said.append))) == 1
    assert any(s.startswith("shoulder_lift_joint: armature 0.4") for s in said)
    pd, learned, perfect = (errors_of(campaign, name) for name in ("pd", "", "perfect"))
    assert (pd < 3.0).all()
    assert (perfect < 0.15 * pd).all()
    assert learned.mean() < 0.3 * pd.mean()
    assert status(campaign)["trajectories"]
    page = build_report(campaign.path).read_text(encoding="utf-8")
    assert "ur5" in page
    assert 'class="stage"' in page


def test_who_cannot_carry_its_own_weight_is_told_so() -> None:
    """Baxter's springs are not in its file."""
    with pytest.raises(UsageError, match=r"'left_s1' can carry 8\d % of its own weight.*counterbalanced"):
        rehearsed(robot_of("baxter"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_the_whole_loop_of_an_arm(name: str, tmp_path: Path) -> None:
    campaign = campaign_of(name, tmp_path)
    list(simulate(campaign, 2))
    print(row_of(name, campaign))
    pd, learned, perfect = (errors_of(campaign, who) for who in ("pd", "", "perfect"))
    assert (pd < 3.0).all()  # 1.5 deg is what the gains are chosen for
    assert learned.mean() < 0.2 * pd.mean()
    assert perfect.mean() < 0.05 * pd.mean()
    assert build_report(campaign.path).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "ur5"])
@pytest.mark.parametrize("friction", ["coulomb", "none"])
def test_the_whole_loop_beside_another_friction(name: str, friction: str, tmp_path: Path) -> None:
    """MuJoCo's own constraint turns round at once and holds nothing at rest; without any there is none to
    find."""
    campaign = campaign_of(name, tmp_path, simulated=f'friction = "{friction}"')
    list(simulate(campaign, 2))
    print(row_of(f"{name}, {friction}", campaign))
    for test in ("fourier", "moves"):
        pd, learned = (errors_of(campaign, who, test) for who in ("pd", ""))
        assert learned.mean() < 0.1 * pd.mean()


def ignoring(campaign: Campaign, one: str, other: str) -> Campaign:
    """The campaign with one more pair of links whose distance is not looked at, as its robot file advises."""
    robot = campaign.path / "robot.toml"
    text = robot.read_text(encoding="utf-8")
    assert f"{one} and {other}" in text  # the advice
    robot.write_text(text.replace("ignore = [", f'ignore = [["{one}", "{other}"], '), encoding="utf-8")
    return open_campaign(campaign.path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "joints"), [("talos", 16), ("mobile_arm", 7)])
def test_an_upper_body_and_a_mobile_manipulator_learn_like_an_arm(
    name: str, joints: int, tmp_path: Path
) -> None:
    """Each joint in its own unit: the base of the mobile one slides in m."""
    campaign = campaign_of(name, tmp_path)
    if (
        name == "talos"
    ):  # its hip and chest overlap in 78 % of the poses: `init` says so, and to name the pair
        campaign = ignoring(campaign, "base_link", "torso_2_link")
    assert len(campaign.axes) == joints
    list(simulate(campaign, 2))
    print(row_of(name, campaign))
    pd, learned, identified = (errors_of(campaign, who) for who in ("pd", "", "rigid_body"))
    assert (learned < 0.5 * pd).all()
    assert (learned / pd).mean() < 0.2
    assert (identified / pd).mean() < 0.3
    assert 'class="stage"' in build_report(campaign.path).read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("robot_name", ["ur5", "mobile_arm"])
def test_the_stand_in_keeps_the_laws_of_a_robot(robot_name: str) -> None:
    described = str(file_of(robot_name)) if robot_name in FILES else robot_name

    class Suite(RobotSuite):
        kind = KIND
        robot = described

    assert not any(laws(Suite()).values())
