"""One law for every export of an arm: what its receiver commands is at rest, moves inside what was proved,
and is at rest again, from ten seconds before the first row to ten after the last."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from receivers import AFTER, FLOWN, RATE, RECEIVERS, SIX_JOINTS, by_rows
from small_arm import QUICK, campaign_of_small_arm
from trajectory_controller import Parameters, Played, message_of, play

from certificate_schema import valid
from etude import ask, plugins
from etude.campaign import Campaign, Proposal, RobotPart, create_campaign, open_campaign, stored_trajectory

pytestmark = pytest.mark.filterwarnings("error")
NAMES = [name for name in plugins.names("etude.exporters") if name not in (*FLOWN, *SIX_JOINTS)]
STARTS = ("", "home", "turn=1 lift=-0.5 bend=0.7")
SLACK = 1e-5
"""Part of a limit by which single precision, and curves through points, may exceed what was proved."""


@dataclass(frozen=True)
class Asked:
    """A campaign, and its proposal in every format: alone, and with its way from each start."""

    campaign: Campaign
    proposals: dict[str, Proposal]

    def files(self, name: str, start: str) -> tuple[dict[str, bytes], list[dict[str, object]]]:
        """The bytes on disk, by the names that the format gives them, and the rows of their certificate."""
        (found,) = (e for e in self.proposals[start].exported if e.format == name)
        place = found.files[-1].parent
        content = {f.relative_to(place).as_posix(): f.read_bytes() for f in found.files}
        return content, valid(content["certificate.json"])["rows"]


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    pytest.importorskip("rosbags", reason="bags are written by the extra 'ros'")
    campaign = campaign_of_small_arm(tmp_path_factory.mktemp("played"))
    return Asked(campaign, {start: ask(campaign, formats=NAMES, start=start) for start in STARTS})


def test_every_format_has_a_receiver() -> None:
    assert set(NAMES) == set(RECEIVERS), "a new format needs what plays it in receivers.py"


def require_rest(played: Played, speed: np.ndarray) -> None:
    """At rest before and after, where the motion begins and ends, and no step between."""
    before, after = played.t < 0.0, played.t > played.t[-1] - AFTER + 2.0 / RATE
    for part in (before, after):
        assert np.ptp(played.q[part], axis=0).max() == 0.0, "it moves where it should stand"
        assert not played.qd[part].any(), "a speed is commanded for ever"
        assert not played.qdd[part].any(), "an acceleration is commanded for ever"
        assert np.ptp(played.effort[part], axis=0).max() == 0.0
    jump = np.abs(np.diff(played.q, axis=0)).max(axis=0)
    assert np.all(jump <= speed * (1.0 + SLACK) / RATE + 1e-6), "a step in position"


@pytest.mark.thinned
@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("name", NAMES)
def test_from_rest_to_rest_inside_the_margins(name: str, start: str, asked: Asked) -> None:
    files, rows = asked.files(name, start)
    played = RECEIVERS[name](files, asked.campaign.axes)
    require_rest(played, np.asarray(asked.campaign.spec.velocity))
    orders = {"position": played.q, "velocity": played.qd, "acceleration": played.qdd}
    looked = 0
    for quantity, values in orders.items():
        for j, axis in enumerate(asked.campaign.axes):
            own = [
                r for r in rows if r["axis"] == axis and r["quantity"] == quantity and r["lower"] is not None
            ]
            if own:  # pieces may have margins of their own: the widest holds for all
                low, high = (f(float(r[k]) for r in own) for f, k in ((min, "lower"), (max, "upper")))  # type: ignore[arg-type]
                room = SLACK * (high - low)
                assert low - room <= values[:, j].min(), f"{quantity} of {axis}"
                assert values[:, j].max() <= high + room, f"{quantity} of {axis}"
                looked += 1
    assert looked >= len(asked.campaign.axes)
    held = [r for r in rows if str(r["axis"]).startswith("held ")]
    assert {r["axis"] for r in held} == {"held before the first row", "held after the last row"}
    assert all(float(r["proved_upper"]) <= float(r["upper"]) for r in held)  # type: ignore[arg-type]


@pytest.mark.parametrize("place", ["", "from_home", "speed_037"])
def test_the_table_ends_at_rest_where_the_motion_ends(place: str, asked: Asked) -> None:
    """The robot's rate seldom meets the end of a motion: the last row moved, and was held."""
    ask(asked.campaign, speed=37)
    folder = asked.campaign.proposal(1)
    places = [p for p in (folder, *sorted(folder.iterdir())) if p.is_dir()]
    at = next(p for p in places if not place or place in p.name)
    files = {"trajectory.csv": (at / "trajectory.csv").read_bytes()}
    played = by_rows(files, asked.campaign.axes)
    after = played.t > played.t[-1] - AFTER + 2.0 / RATE
    assert np.abs(played.qd[after]).max() <= 1e-9
    assert np.abs(played.qdd[after]).max() <= 1e-9
    assert np.abs(played.qd[played.t < 0.0]).max() <= 1e-9


def test_the_controller_takes_it_from_another_place_only_by_the_way_there(asked: Asked) -> None:
    """Asked for from a pose, the first point is that pose: from there no step is commanded."""
    files, _ = asked.files("ros2_yaml", STARTS[2])
    message = message_of("ros2_yaml", files)
    stand = np.array([1.0, -0.5, 0.7])
    played = play(message, Parameters(asked.campaign.axes), stand, rate=RATE)
    np.testing.assert_allclose(played.q[played.t < 0.0][-1], stand, atol=1e-12)
    assert np.abs(np.diff(played.q, axis=0)).max() < 2.0 / RATE


def halfway(campaign: Campaign) -> str:
    """A start between home and the motion's own: on a way that is proved, of whatever robot."""
    motion = stored_trajectory(campaign, 1).motion(np.zeros(1), 1).orders[0, 0]
    pose = 0.5 * (np.asarray(campaign.kind.home(campaign.spec)) + motion)
    return " ".join(f"{axis}={value:.6g}" for axis, value in zip(campaign.axes, pose, strict=True))


def require_all_inside(campaign: Campaign) -> None:
    """The campaign's motion in every format, alone and from two starts."""
    ask(campaign, formats=NAMES)
    starts = ("", "home", halfway(campaign))
    many = Asked(campaign, {start: ask(campaign, formats=NAMES, start=start) for start in starts})
    for name in NAMES:
        for start in starts:
            test_from_rest_to_rest_inside_the_margins(name, start, many)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_many_motions_of_other_seeds(seed: int, tmp_path: Path) -> None:
    require_all_inside(campaign_of_small_arm(tmp_path, duration=10.0 + 3.7 * seed, seed=seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("robot", ["z1", "xarm7", "kinova", "ur10", "panda"])
def test_many_motions_of_other_robots(robot: str, seed: int, tmp_path: Path) -> None:
    from measure_arms import ROBOTS, share

    file, joints = ROBOTS[robot]
    part = RobotPart(joints, {}, ())
    path = create_campaign(tmp_path / "lab", str(share() / file), seed=seed, part=part)[0].path
    (path / "campaign.toml").write_text(QUICK.format(seed=seed, duration=12.0 + 9.0 * seed))
    require_all_inside(open_campaign(path))
