"""robot.toml gets another payload or mounting after a log was learned: commands are those of the new body.

What was learned of the old one proves nothing. Torques on the certificate hold for pinocchio's arm with the
new body, and efforts of the old one do not leave.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

plant = pytest.importorskip("pinocchio_arm", reason="pinocchio has no wheel for this Python or system")

from pinocchio_arm import pin  # noqa: E402
from small_arm import URDF, campaign_of_small_arm  # noqa: E402

import etude  # noqa: E402
from etude.campaign import ask_to_confirm, open_campaign  # noqa: E402
from etude.errors import UsageError  # noqa: E402

pytestmark = pytest.mark.as_logged
MASS, CENTRE = 3.0, (0.1, 0.0, 0.0)
INERTIA = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]
PAYLOAD = f"\n[payload]\nmass = {MASS}\ncentre = {list(CENTRE)}\ninertia = {INERTIA}\n"
WALL = (0.0, np.pi / 2, 0.0)
MOUNTING = f"\n[mounting]\nposition = [0.0, 0.0, 3.0]\nrotation = {list(WALL)}\n"


def loaded(arm: plant.Arm) -> object:
    model = arm.believed.copy()
    inertia = pin.Inertia(MASS, np.array(CENTRE), 0.01 * np.eye(3))
    model.appendBodyToJoint(model.getJointId(arm.names[-1]), inertia, pin.SE3.Identity())
    return model


def turned(arm: plant.Arm) -> object:
    model = arm.believed.copy()
    model.gravity.linear = pin.rpy.rpyToMatrix(*WALL).T @ np.array([0.0, 0.0, -9.81])
    return model


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a campaign with the log of its first motion."""
    folder = tmp_path_factory.mktemp("before")
    campaign = campaign_of_small_arm(folder)
    found = etude.ask(campaign)
    arm = plant.arm_of_urdf(URDF, seed=5, wrong=1.0)
    run = plant.run(arm, plant.reference_of_table((found.folder / "trajectory.csv").read_bytes(), arm.names))
    (folder / "run.csv").write_bytes(run.log())
    etude.tell(campaign, folder / "run.csv")
    return folder


def edited(learned: Path, folder: Path, text: str) -> Path:
    shutil.copytree(learned / "lab", folder / "lab")
    with (folder / "lab" / "robot.toml").open("a") as file:
        file.write(text)
    return folder / "lab"


def torques(model: object, reference: plant.Reference) -> np.ndarray:
    data = model.createData()  # type: ignore[attr-defined]
    rows = zip(reference.q, reference.qd, reference.qdd, strict=True)
    return np.stack([pin.rnea(model, data, *row) for row in rows])


@pytest.mark.parametrize(("text", "body"), [(PAYLOAD, loaded), (MOUNTING, turned)], ids=["payload", "wall"])
def test_torques_are_those_of_the_new_body(learned: Path, tmp_path: Path, text: str, body) -> None:
    lab = edited(learned, tmp_path, text)
    arm = plant.arm_of_urdf(URDF, seed=5, wrong=1.0)
    found = etude.ask(open_campaign(lab), new=True)
    reference = plant.reference_of_table((found.folder / "trajectory.csv").read_bytes(), arm.names)
    wanted = torques(body(arm), reference)
    rows = [row for row in found.certificate.rows if row.quantity == "torque"]
    assert len(rows) == len(arm.names)
    limit = arm.torque
    for j, row in enumerate(rows):
        assert row.proved_lower - 0.01 * limit[j] <= wanted[:, j].min()
        assert wanted[:, j].max() <= row.proved_upper + 0.01 * limit[j]
    assert any(
        "robot.toml changed after the training on log 1" in sentence
        for sentence in found.certificate.not_verified
    )
    with pytest.raises(UsageError, match="is of another robot") as refused:
        etude.ask(open_campaign(lab), formats=["ros2_csv"], effort=True)
    assert "--changed new" in refused.value.next_step
    with pytest.raises(UsageError, match="is of another robot"):
        ask_to_confirm(open_campaign(lab))
    for target in ("c", "urdf"):
        with pytest.raises(UsageError, match="is of another robot"):
            etude.export(open_campaign(lab), target)
    assert not (lab / "exports").exists()


def test_other_edits_change_nothing(learned: Path, tmp_path: Path) -> None:
    lab = edited(learned, tmp_path, "")
    robot = lab / "robot.toml"
    text = robot.read_text()
    robot.write_text(text.replace("velocity = 2.0", "velocity = 1.9"))
    assert robot.read_text() != text
    found = etude.ask(open_campaign(lab), new=True)
    assert not any("robot.toml changed" in sentence for sentence in found.certificate.not_verified)


@pytest.mark.slow
def test_the_advice_for_a_wrong_description_can_be_followed(learned: Path, tmp_path: Path) -> None:
    lab = edited(learned, tmp_path, PAYLOAD)
    etude.untell(open_campaign(lab), 1)
    etude.tell(open_campaign(lab), learned / "run.csv")
    found = etude.ask(open_campaign(lab), new=True)
    assert not any("robot.toml changed" in sentence for sentence in found.certificate.not_verified)


@pytest.mark.slow
def test_the_advice_for_a_changed_robot_can_be_followed(learned: Path, tmp_path: Path) -> None:
    lab = edited(learned, tmp_path, PAYLOAD)
    asked = etude.ask(open_campaign(lab), new=True)
    arm = plant.arm_of_urdf(URDF, seed=5, wrong=1.0)
    arm = replace(arm, true=loaded(arm))
    run = plant.run(arm, plant.reference_of_table((asked.folder / "trajectory.csv").read_bytes(), arm.names))
    (tmp_path / "run.csv").write_bytes(run.log())
    etude.tell(open_campaign(lab), tmp_path / "run.csv", changed="new")
    campaign = open_campaign(lab)
    assert [r.number for r in campaign.state().learned] == [2]
    found = etude.ask(campaign, new=True)
    assert not any("robot.toml changed" in sentence for sentence in found.certificate.not_verified)
