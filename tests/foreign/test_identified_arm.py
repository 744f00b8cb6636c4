"""What was identified on pinocchio's arm: intervals that hold its truth, and files that pinocchio plays."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

plant = pytest.importorskip("pinocchio_arm", reason="pinocchio has no wheel for this Python or system")

from measure_parameters import coverage, learned, printed  # noqa: E402
from pinocchio_arm import pin  # noqa: E402
from small_arm import URDF  # noqa: E402

import etude  # noqa: E402

CAMPAIGNS = 10


@pytest.fixture(scope="module")
def arm() -> plant.Arm:
    return plant.arm_of_urdf(URDF, seed=5)


@pytest.fixture(scope="module")
def first(arm: plant.Arm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return learned(tmp_path_factory.mktemp("first"), arm, 0).path


@pytest.mark.slow
def test_intervals_hold_the_truth_in_ten_campaigns(arm: plant.Arm, first: Path, tmp_path: Path) -> None:
    others = [learned(tmp_path / str(seed), arm, seed) for seed in range(1, CAMPAIGNS)]
    found = coverage([printed(one, arm) for one in (etude.open_campaign(first), *others)])
    assert 0.90 <= found.inside.mean() <= 0.98
    assert np.median(found.width) <= 1.5


def by_pinocchio(path: Path, states: np.ndarray) -> np.ndarray:
    model = pin.buildModelFromUrdf(str(path))
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert moments[0] > 0.0
        assert moments[2] <= moments[0] + moments[1]
    return torques(model, states)


def by_mujoco(path: Path, states: np.ndarray) -> np.ndarray:
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = 0.0, 0.0, 0.0
    data, found = mujoco.MjData(model), np.zeros((len(states), 3))
    for i, (q, qd, qdd) in enumerate(states):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        found[i] = data.qfrc_inverse
    return found


def torques(model: object, states: np.ndarray) -> np.ndarray:
    data = model.createData()  # type: ignore[attr-defined]
    return np.stack([pin.rnea(model, data, *row) for row in states])


@pytest.mark.slow
@pytest.mark.parametrize(("to", "played"), [("urdf", by_pinocchio), ("mjcf", by_mujoco)])
def test_the_written_file_plays_the_real_arms_torques(arm: plant.Arm, first: Path, to: str, played) -> None:
    written = etude.export(first, to)
    rng = np.random.default_rng(3)
    q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper, (300, 3))
    states = np.stack([q, 0.5 * rng.normal(size=q.shape), 2.0 * rng.normal(size=q.shape)], axis=1)
    rigid = arm.true.copy()
    rigid.armature = np.zeros(3)
    real, file = torques(rigid, states), torques(arm.believed, states)
    new = played(written.folder / written.files[0], states)
    wrong, left = (np.sqrt(np.mean((x - real) ** 2, axis=0)) for x in (file, new))
    assert np.all(left < 0.3 * wrong)


@pytest.mark.slow
def test_with_the_cogging_that_was_found_the_file_errs_less_than_the_physics(
    arm: plant.Arm, first: Path
) -> None:
    """Gravity takes up cogging in physics that do not know it; of the file it is told apart, and written."""
    written = etude.export(first, "mjcf")
    played = {one: np.array(list(own.values())) for one, own in written.facts["played"].items()}
    assert np.all(played["drives"] < 0.5 * played["physics"]), "1.02 was asked for"
    rows = np.genfromtxt(written.folder / "cogging.csv", delimiter=",", names=True, dtype=None, encoding=None)
    q = np.linspace(0.8 * arm.lower, 0.8 * arm.upper, 200)
    true, found = arm.drives.ripple(q), np.zeros_like(q)
    for row in rows:
        j = arm.names.index(row["joint"])
        found[:, j] -= row["amplitude"] * np.sin(row["periods"] * q[:, j] + row["phase"])
    assert np.all(np.std(found - true, axis=0) < 0.2 * np.std(true, axis=0))
