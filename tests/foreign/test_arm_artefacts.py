"""What leaves for an arm, run as its receiver runs it: exported bytes in, tracking error and limits out.

The arm is pinocchio's, with friction, cogging, delay, and masses that are wrong in the file that was told.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

plant = pytest.importorskip("pinocchio_arm", reason="pinocchio has no wheel for this Python or system")

from small_arm import URDF, campaign_of_small_arm  # noqa: E402
from trajectory_controller import Parameters, message_of, play  # noqa: E402

from compilers import tool  # noqa: E402
from etude import ask, export, predict, tell  # noqa: E402
from etude.campaign import Campaign  # noqa: E402
from etude.trajectories import from_json  # noqa: E402

pytestmark = pytest.mark.slow
"""Every day `test_exported_model` holds the C against `predict`, `tests/deploy` the efforts of ROS 2."""
BEFORE, AFTER = 2.0, 4.0
"""Seconds that the first and the last row are held; `test_played_by_receiver` holds them longer."""
GAIN = 0.6
"""Part of the tracking error under feedback and the file's gravity that the learned command may leave."""


@dataclass(frozen=True)
class Lab:
    """One log learned, an open proposal, and the plant."""

    campaign: Campaign
    arm: plant.Arm
    folder: Path

    @property
    def motion(self) -> plant.Reference:
        """The open proposal, read from its table as a user would."""
        table = (self.campaign.proposal(2) / "trajectory.csv").read_bytes()
        return plant.reference_of_table(table, self.campaign.axes)

    def tracked(self, effort: np.ndarray | None) -> plant.Run:
        """The motion, held before and after, under the plant's own PD and this effort."""
        own = self.motion
        sent = plant.held(plant.Reference(own.t, own.q, own.qd, own.qdd, effort), BEFORE, AFTER)
        return plant.run(self.arm, sent, "pd_gravity" if effort is None else "pd", seed=9)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Lab:
    folder = tmp_path_factory.mktemp("artefacts")
    campaign, arm = campaign_of_small_arm(folder, 24.0), plant.arm_of_urdf(URDF, seed=4, wrong=1.3)
    ask(campaign)
    table = (campaign.proposal(1) / "trajectory.csv").read_bytes()
    run = plant.run(arm, plant.reference_of_table(table, campaign.axes), seed=1)
    assert max(run.left().values()) <= 0.0
    (folder / "log.csv").write_bytes(run.log())
    tell(campaign, folder / "log.csv")
    found = ask(campaign, formats=["ros2_yaml", "ros2_csv"], effort=True, go_on=True)
    assert found.number == 2
    return Lab(campaign, arm, folder)


@pytest.fixture(scope="module")
def feedback(lab: Lab) -> np.ndarray:
    """(J,) tracking error without anything learned."""
    return np.asarray(lab.tracked(None).tracking)


def require_kept(run: plant.Run) -> None:
    """All limits of the file, before and after the motion too; rest at the end."""
    assert max(run.left().values()) <= 0.0, run.left()
    assert run.saturated == 0.0
    assert np.abs(run.qd[-1000:]).max() < 0.01, "it moves after the end"
    assert np.abs(run.q[-1] - run.reference.q[-1]).max() < 0.02


@pytest.mark.parametrize("name", ["ros2_yaml", "ros2_csv"])
def test_the_effort_of_a_joint_trajectory(name: str, lab: Lab, feedback: np.ndarray) -> None:
    place = lab.campaign.proposal(2) / f"{name}_effort"
    files = {file.name: file.read_bytes() for file in place.iterdir()}
    parameters = Parameters(lab.campaign.axes, effort_interface=True)
    found = play(message_of(name, files), parameters, None, BEFORE, AFTER)
    run = plant.run(
        lab.arm, plant.Reference(found.t, found.q, found.qd, found.qdd, found.effort), "pd", seed=9
    )
    require_kept(run)
    assert np.linalg.norm(run.tracking) < GAIN * np.linalg.norm(feedback)


def test_the_c_of_the_model(lab: Lab, feedback: np.ndarray) -> None:
    """Called once a millisecond along the motion, from the first row held to the last row held."""
    export(lab.campaign, "c", lab.folder / "c", name="arm")
    words = [tool("gcc"), "-std=c99", "-O1", "-fPIC", "-shared", "arm.c", "-lm", "-o", "arm.so"]
    subprocess.run(words, cwd=lab.folder / "c", check=True)
    library = ctypes.CDLL(str(lab.folder / "c" / "arm.so"))
    state = ctypes.create_string_buffer(1 << 16)
    library.arm_init(state)
    own = lab.motion
    rows = np.concatenate([own.q, own.qd, own.qdd], axis=1)
    command = np.zeros(own.q.shape)
    for row, out in zip(rows, command, strict=True):
        library.arm_mean(state, ctypes.c_void_p(row.ctypes.data), ctypes.c_void_p(out.ctypes.data))
    said = predict(lab.campaign, lab.campaign.proposal(2) / "trajectory.json")
    at = np.searchsorted(own.t, said.t, side="left").clip(0, len(own.t) - 1)
    close = np.abs(own.t[at] - said.t) < 1e-9
    assert close.sum() > 500
    # the table is read by cubics, and the C is called ten times as often: its memory sees a little more
    limit = lab.arm.torque
    assert (np.abs(command[at] - said["command"])[close] / limit).max() < 0.02
    run = lab.tracked(command)
    require_kept(run)
    assert np.linalg.norm(run.tracking) < GAIN * np.linalg.norm(feedback)


def test_the_graph_of_the_model(lab: Lab) -> None:
    """onnxruntime, row by row with its memory carried, says along the motion what `predict` says."""
    runtime = pytest.importorskip("onnxruntime", reason="graphs are run by the extra 'onnx'")
    pytest.importorskip("onnx", reason="graphs are written by the extra 'onnx'")
    export(lab.campaign, "onnx", lab.folder / "onnx", name="arm")
    graph = runtime.InferenceSession(str(lab.folder / "onnx" / "arm.onnx"))
    inputs = {i.name: i for i in graph.get_inputs()}
    motion = from_json((lab.campaign.proposal(2) / "trajectory.json").read_bytes())
    said = predict(lab.campaign, lab.campaign.proposal(2) / "trajectory.json")
    rows = np.concatenate(list(motion.motion(np.minimum(said.t, motion.duration), 3).orders), axis=1)
    memory = np.zeros((1, inputs["memory"].shape[1])) if "memory" in inputs else None
    found = []
    names = [o.name for o in graph.get_outputs()]
    for row in rows:
        fed = {"states": row[None]} | ({} if memory is None else {"memory": memory})
        out = dict(zip(names, graph.run(None, fed), strict=True))
        memory = out.get("memory_after")
        found.append(out["command"][0])
    assert (np.abs(np.array(found) - said["command"]) / lab.arm.torque).max() < 1e-9


def test_status_after_the_first_log(lab: Lab) -> None:
    """The first answer to a proposal has its table of blocks, and what the model is made of, in words."""
    words = [sys.executable, "-m", "etude", "status", str(lab.campaign.path)]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = json.loads(subprocess.run([*words, "--json"], capture_output=True, text=True, check=True).stdout)
    assert "nMSE within log 1, blocks 3, 8, 13, 18 of 20 from the others" in text
    assert "linear regression" in found["held_out"]["nmse"]
    assert all(0.0 < value < 1.0 for value in found["held_out"]["nmse"][found["held_out"]["chosen"]])
    assert "ingest a second log" in text
    told = [line for line in text.splitlines() if "physics identified from the logs" in line]
    assert told
    assert all("physics alone elsewhere" in line or line.endswith("the logs alone.") for line in told)
