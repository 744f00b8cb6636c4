"""What the screen says of a file is of the bytes on the disk, after any edit of what people may edit, or not.

A small arm, its campaign, and random edits of robot.toml, campaign.toml and every stored file. After each edit
one command is run. Where it ends well, each certificate that it showed is held against the files that it named:
against certificate.json, and against a proof of the motion's own bytes under the two files as they lie there.
Where it does not, it has said which file, and no committed file was touched.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from etude.campaign.ask import ask
from etude.campaign.folder import Campaign, open_campaign
from etude.campaign.create import create_campaign
from etude.campaign.journal import damaged_files
from etude.campaign.kept import kept_then
from etude.campaign.predict import predict
from etude.campaign.promote import promote
from etude.campaign.status import status
from etude.campaign.stored_files import require_runs
from etude.campaign.tell import tell
from etude.errors import EtudeError, UsageError
from etude.limits.certificate import Certificate, certify
from etude.report.build import render
from etude.report.record import read_record
from etude.trajectories.json_text import from_json

URDF = """<robot name="two">
<link name="base"/>
<link name="upper"><inertial><mass value="1"/><origin xyz="0 0 .1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 .1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></collision></link>
<link name="fore"><inertial><mass value="1.5"/><origin xyz="0.2 0 0"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 .3"/>
<axis xyz="0 0 1"/><limit lower="-1.2" upper="1.1" velocity="1.5" effort="50"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 .3"/>
<axis xyz="0 1 0"/><limit lower="-0.8" upper="0.9" velocity="1.2" effort="60"/></joint>
</robot>
"""
SHORT = {"candidates = 24": "candidates = 1", "refine = 2": "refine = 0", "duration = 60.0": "duration = 8.0"}
EDITS, ALL, LOT = 16, 1000, 50
"""Edits a day, all of them, and how many are one test of the slow ones: each lot can be run by itself."""
KINDS = ("robot", "config", "stored", "journal")


@pytest.fixture(scope="session")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with a log that was learned, and an open proposal in all its forms."""
    folder = tmp_path_factory.mktemp("screen_and_disk")
    (folder / "two.urdf").write_text(URDF)
    path = create_campaign(folder / "lab", str(folder / "two.urdf"))[0].path
    text = (path / "campaign.toml").read_text()
    for old, new in SHORT.items():
        assert old in text
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text)
    campaign = open_campaign(path)
    first = ask(campaign, go_on=True)
    _tell(campaign, folder, first.number)
    promote(campaign, force=True, reason="a test")
    _shown(open_campaign(path))
    return path


def _tell(campaign: Campaign, folder: Path, number: int) -> None:
    """The log of a robot that follows the motion; its commands are smooth."""
    motion = from_json((campaign.proposal(number) / "trajectory.json").read_bytes())
    t = np.arange(0.0, motion.duration, 1.0 / campaign.spec.rate)
    q, qd, qdd = motion.motion(t, 2).orders[:3] if len(motion.motion(t, 2).orders) > 2 else motion.motion(t, 3).orders[:3]
    rng = np.random.default_rng(number)
    command = 2.0 * qdd + 1.5 * qd + 3.0 * np.sin(q) + 0.05 * rng.standard_normal(q.shape)
    names = [f"{what}_{axis}" for what in ("q", "qd", "tau") for axis in campaign.axes]
    table = pl.DataFrame(dict(zip(["time", *names], np.column_stack([t, q, qd, command]).T, strict=True)))
    table.write_csv(folder / f"log_{number}.csv")
    tell(campaign, folder / f"log_{number}.csv", accept=("sign", "scale", "power"))


def _shown(campaign: Campaign) -> Iterator[tuple[Path, str, Certificate]]:
    """Everything that one `ask` shows: folder, stem and certificate."""
    found = ask(campaign, go_on=True, start="home", formats=("ros2_csv",), effort=False)
    yield found.folder, "trajectory", found.certificate
    slow = ask(campaign, go_on=True, speed=50)
    yield slow.folder, "trajectory", slow.certificate
    assert found.way is not None
    for stem, own in found.way.certificates.items():
        yield found.way.folder, stem, own
    for one in found.exported:
        yield one.files[-1].parent, "", one.certificate
