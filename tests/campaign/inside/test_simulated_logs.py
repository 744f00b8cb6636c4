"""A robot and its stand-in are two robots: no model learns from both without being told so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude import tell
from etude.campaign import Campaign, Trained, TrainingOutcome, create_campaign, simulate
from etude.campaign import training as learning
from etude.campaign.record.stored_models import SIMULATED
from etude.codes import Notice, Warn
from etude.errors import UsageError

pytestmark = pytest.mark.as_logged

LINK = (
    '<link name="{0}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>'
    '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>'
    '<origin xyz="0.4 0 0"/><limit lower="-2" upper="2" velocity="2" effort="60"/></joint>'
)
ROBOT = f"""<robot name="made"><link name="base"/>{LINK.format("upper")}{LINK.format("fore")}
{JOINT.format("hip", "base", "upper")}{JOINT.format("knee", "upper", "fore")}</robot>"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Campaign:
    """A campaign of a robot that exists, where learning costs nothing."""

    def learn(campaign: Campaign, state: Any, number: int) -> TrainingOutcome:
        return TrainingOutcome([], Trained(chosen="gp", rungs=("gp",) * 2, robot_seconds=8.0))

    monkeypatch.setattr(learning, "learn_log", learn)
    (tmp_path / "made.urdf").write_text(ROBOT)
    return create_campaign(tmp_path / "lab", str(tmp_path / "made.urdf"), seed=4)[0]


def log(path: Path, phase: float) -> Path:
    t = np.linspace(0.0, 8.0, 801)
    q, u = np.sin(t + phase), 3.0 * np.cos(t + phase)
    columns = np.column_stack([t, q, 0.5 * q, u, 0.3 * u + 0.1 * np.sin(3.0 * t)])
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, columns, delimiter=",", header="time,q_hip,q_knee,tau_hip,tau_knee", comments="")
    return path


def told(lab: Campaign, phase: float) -> tuple[Notice, ...]:
    """The warnings of a log that is told."""
    path = log(lab.path / f"run{phase:g}.csv", phase)
    return tell(lab, path, foreign=True, accept=("sign", "gravity"), changed="same").warnings


def test_a_stand_in_does_not_run_beside_logs_of_the_robot_itself(lab: Campaign) -> None:
    assert told(lab, 0.0) == ()
    with pytest.raises(UsageError, match="log 1 is of the real robot") as refused:
        next(simulate(lab, 1))
    assert "etude init rehearsal --robot" in refused.value.next_step
    assert not (lab.path / SIMULATED).exists()
    assert not lab.state().evaluated


def test_a_log_of_the_robot_itself_beside_simulated_ones_is_told_to_be_so(lab: Campaign) -> None:
    told(lab, 0.0)
    log(lab.path / SIMULATED / "0001.parquet", 0.0)
    (warning,) = told(lab, 1.0)
    assert warning.code == Warn.TWO_ROBOTS
    assert "log 1 was simulated, log 2 is of the real robot" in warning.sentence
    assert warning.step.endswith(f"etude untell {lab.path} 1")
