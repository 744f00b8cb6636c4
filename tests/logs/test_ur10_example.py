"""The real robot's log in examples/ur10: read, matched, differentiated, and as predictable as known."""

from __future__ import annotations

import hashlib
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.log import RobotLog
from etude.logs.read import read_log
from etude.models.preprocess import DataConfig, build_dataset, preset
from etude.robots.model_file import load_mujoco_model
from etude.robots.spec import RobotSpec
from etude.robots.toml_file import load_robot

FOLDER = Path(__file__).parents[2] / "examples" / "ur10"
CSV = FOLDER / "ur10_exciting.csv"


@pytest.fixture(scope="module")
def spec() -> RobotSpec:
    return load_robot(FOLDER / "ur10.toml")


@pytest.fixture(scope="module")
def log(spec: RobotSpec) -> RobotLog:
    return read_log(CSV, spec)


def test_the_log_is_read_without_repairs(log: RobotLog) -> None:
    assert log.q.shape == (3441, 6)
    assert log.qd is not None
    assert log.repairs == ()
    assert log.t[-1] == pytest.approx(27.52)


def test_differentiated_positions_agree_with_the_drivers_velocity(log: RobotLog, spec: RobotSpec) -> None:
    data = build_dataset(log, spec, preset("default"))
    assert log.qd is not None
    reported = log.qd[np.searchsorted(log.t, data.t - 1e-6)]
    np.testing.assert_allclose(data.qd, reported, atol=0.02)
    # A sine is slower than 5 % of its top speed 3 % of the time; a sum of them more often.
    assert data.stuck.mean() < 0.15


def test_linear_regression_reaches_the_published_level(log: RobotLog, spec: RobotSpec) -> None:
    """Test on blocks 3, 8, 13, 18 of 20: ordinary least squares has a normalised squared error of 0.26."""
    data = build_dataset(log, spec, DataConfig(rate_hz=1e3, stick_fraction=0.0))
    held_out = np.isin(np.arange(len(data)) * 20 // len(data), [3, 8, 13, 18])
    X = np.column_stack([data.q, data.qd, data.qdd, np.ones(len(data))])
    weights = np.linalg.lstsq(X[~held_out], data.tau[~held_out], rcond=None)[0]
    error = data.tau[held_out] - X[held_out] @ weights
    assert np.mean((error**2).mean(0) / data.tau[held_out].var(0)) == pytest.approx(0.264, abs=0.03)


def test_the_rigid_body_model_explains_the_shoulder(log: RobotLog, spec: RobotSpec) -> None:
    import mujoco

    model = load_mujoco_model(spec)
    state = mujoco.MjData(model)
    data = build_dataset(log, spec, DataConfig(rate_hz=4.0))
    torque = np.empty(len(data))
    for i in range(len(data)):
        state.qpos[:], state.qvel[:], state.qacc[:] = data.q[i], data.qd[i], data.qdd[i]
        mujoco.mj_inverse(model, state)
        torque[i] = state.qfrc_inverse[1]
    slope = float(torque @ data.tau[:, 1] / (torque @ torque))
    assert slope == pytest.approx(1.0, abs=0.1)  # masses and lengths are right; friction is not in the model
    assert np.corrcoef(torque, data.tau[:, 1])[0, 1] > 0.9


def test_degrees_are_noticed(log: RobotLog, spec: RobotSpec, tmp_path: Path) -> None:
    header = CSV.read_text().split("\n", 1)[0]
    values = np.column_stack([log.t, np.rad2deg(log.q), log.tau])
    names = [name for name in header.split(",") if "velocity" not in name]
    np.savetxt(tmp_path / "deg.csv", values, delimiter=",", header=",".join(names), comments="")
    with pytest.raises(DataError, match="look like degrees"):
        read_log(tmp_path / "deg.csv", spec)


def test_the_files_are_what_their_readme_says() -> None:
    text = (FOLDER / "README.md").read_text()
    assert hashlib.sha256(CSV.read_bytes()).hexdigest() in text
    assert "BSD-3-Clause" in text
    assert "Redistribution and use" in (FOLDER / "LICENSE").read_text()
    assert CSV.stat().st_size < 700_000


def test_the_model_file_is_what_its_script_makes() -> None:
    found = importlib.util.spec_from_file_location("make_urdf", FOLDER / "make_urdf.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    import sys

    sys.modules["make_urdf"] = module  # dataclasses look their module up by name
    try:
        found.loader.exec_module(module)
        assert module.urdf() == (FOLDER / "ur10.urdf").read_text()
    finally:
        del sys.modules["make_urdf"]
