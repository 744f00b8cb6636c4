"""A load that a second log shows is named in kg; what a first log did not visit is no other robot."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from small_robot import random_motion
from test_learning import CONFIG

from etude import tell
from etude.campaign import Campaign, create_campaign, open_campaign
from etude.campaign.ingest.questions import body_of
from etude.protocols import Trajectory
from etude.types import Array, Log

pytestmark = pytest.mark.as_logged

LINK = """<link name="{name}"><inertial><origin xyz="{far} 0 0"/><mass value="{mass}"/>
<inertia ixx="0.002" iyy="{spin}" izz="{spin}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{above}"/><child link="{below}"/>
<origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="-1.2" upper="1.2" velocity="2" effort="80"/></joint>"""
ARM = "\n".join(
    [
        '<robot name="arm"><link name="base"/>',
        LINK.format(name="column", far=0.0, mass=3.0, spin=0.02),
        LINK.format(name="upper", far=0.2, mass=2.5, spin=0.05),
        LINK.format(name="lower", far=0.15, mass=1.2, spin=0.02),
        JOINT.format(name="turn", above="base", below="column", at="0 0 0.3", axis="0 0 1"),
        JOINT.format(name="lift", above="column", below="upper", at="0 0 0.1", axis="0 -1 0"),
        JOINT.format(name="bend", above="upper", below="lower", at="0.4 0 0", axis="0 -1 0"),
        "</robot>",
    ]
)
KG = 0.8
TIMES = 2  # that a motion of 10 s is run


def arm(folder: Path) -> Campaign:
    path = folder / "arm.urdf"
    path.write_text(ARM)
    lab = create_campaign(folder / "lab", str(path), seed=3)[0].path
    (lab / "campaign.toml").write_text(f'kind = "arm"\nseed = 3\n{CONFIG}')
    return open_campaign(lab)


def written(
    path: Path,
    campaign: Campaign,
    motion: Trajectory,
    kg: float = 0.0,
    rub: float = 1.0,
    seed: int = 0,
    times: int = TIMES,
) -> Path:
    """The arm along a motion, again and again, with a load at its last link and so much of its friction."""
    t = np.arange(0.0, times * motion.duration, 0.02)
    q, qd, qdd = motion.motion(t % motion.duration, 3).orders
    body = body_of(campaign.kind, campaign.spec)
    assert body is not None
    states = Log(t, {}, {}, "states")
    for channel, values in zip(campaign.channels, (q, qd, qdd), strict=False):
        states = states.put(channel, values)
    friction = rub * np.array([3.0, 4.0, 2.0]) * np.tanh(qd / 0.05)
    command = body.predict(states) + kg * body.links(states)[:, :, -1, 0] + friction  # type: ignore[attr-defined]
    return saved(path, t, q, command, seed)


def saved(path: Path, t: Array, q: Array, command: Array, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    noisy = q + 1e-4 * rng.standard_normal(q.shape), command + 0.02 * rng.standard_normal(q.shape)
    names = ("turn", "lift", "bend")
    header = ",".join(["t", *(f"{word}_{name}" for word in ("q", "tau") for name in names)])
    np.savetxt(path, np.column_stack([t, *noisy]), delimiter=",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def one_log(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("one")
    campaign = arm(folder)
    tell(campaign, written(folder / "1.csv", campaign, random_motion(campaign, 1)), foreign=True)
    return campaign


@pytest.fixture
def fresh(one_log: Campaign, tmp_path: Path) -> Campaign:
    shutil.copytree(one_log.path, tmp_path / "lab")
    return open_campaign(tmp_path / "lab")


def test_a_load_in_the_second_log_is_named_in_kg(fresh: Campaign, tmp_path: Path) -> None:
    log = written(tmp_path / "2.csv", fresh, random_motion(fresh, 1), kg=KG, seed=2)
    told = tell(fresh, log, foreign=True)
    assert told.awaits_answer
    (finding,) = told.findings
    value = float(finding.sentence.split(" +- ")[0].split(", ")[-1])
    assert "kg at the last link" in finding.sentence
    assert value == pytest.approx(KG, rel=0.1)


def test_friction_in_the_second_log_is_named_with_its_factor(fresh: Campaign, tmp_path: Path) -> None:
    log = written(tmp_path / "2.csv", fresh, random_motion(fresh, 1), rub=1.6, seed=2)
    (finding,) = tell(fresh, log, foreign=True).findings
    assert "friction has changed" in finding.sentence
    factor = float(finding.sentence.split(" times what was learned")[0].split(", ")[-1])
    assert factor == pytest.approx(1.6, rel=0.15)


def test_a_load_on_another_motion_is_seen_by_the_model_file(fresh: Campaign, tmp_path: Path) -> None:
    log = written(tmp_path / "2.csv", fresh, random_motion(fresh, 2), kg=3.0 * KG, seed=2)
    told = tell(fresh, log, foreign=True)
    assert told.awaits_answer
    (finding,) = told.findings
    (kg,) = re.findall(r"([\d.]+)(?: \+- [\d.]+)? kg (?:more )?at the last link", finding.sentence)
    assert float(kg) == pytest.approx(3.0 * KG, rel=0.15)


@pytest.mark.parametrize("seed", [2, *(pytest.param(own, marks=pytest.mark.slow) for own in (3, 4))])
def test_another_motion_of_the_same_arm_is_learned(fresh: Campaign, tmp_path: Path, seed: int) -> None:
    log = written(tmp_path / "2.csv", fresh, random_motion(fresh, seed), seed=seed)
    told = tell(fresh, log, foreign=True)
    assert (told.awaits_answer, told.findings) == (False, ())
