"""Every door says what `predict` says, over the whole legal range, inside and outside of what was trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_doors import (
    JOINTS,
    LOWER,
    TORQUE,
    UPPER,
    Array,
    asked,
    body,
    built,
    lab,
    legal,
    pin,
    swings,
    urdf,
    write_table,
)
from pinocchio_arm import Reference, arm_of_urdf
from pinocchio_arm import run as play

import etude
from etude.types import Motion
from etude_online import open_online

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.as_logged]
UNTRAINED = 4
SMALL = 1e-12
"""Of each command's limit."""
EVERYDAY = {
    "physics": {"rung": "identified+gp", "candidates": ["default", "slow"]},
    "process": {"rung": "gp", "candidates": ["default"]},
}
STRUCTURES: dict[str, dict[str, Any]] = {
    "auto": {},
    "nominal": {"rung": "nominal+gp", "candidates": ["default"]},
    "linear": {"rung": "linear"},
    "Lagrangian": {"rung": "gp", "candidates": ["default", "gip_lin", "all_lin"]},
    "dictionary": {"rung": "identified+gp", "process": "dictionary_variance", "points": 60},
    "thesis dictionary": {
        "rung": "gp",
        "kernel": "ard_se",
        "process": "thesis_dictionary_variance",
        "points": 60,
    },
    "fitc": {"rung": "identified+gp", "process": "fitc", "basis": 40},
    "vfe": {"rung": "gp", "process": "vfe", "basis": 40},
    "sparse spectrum": {"rung": "identified+gp", "kernel": "ard_se", "process": "ssgp_fixed", "basis": 40},
    "sogp": {"rung": "gp", "kernel": "ard_se", "process": "sogp", "basis": 40},
}


def states(orders: Array, t: Array | None = None) -> dict[str, Array]:
    found = dict(zip(("q", "qd", "qdd"), orders, strict=True))
    return found if t is None else {"t": t, **found}


def within(command: Array) -> Array:
    return np.clip(command, -TORQUE, TORQUE)


def exported_c(folder: Path, output: Path) -> Path:
    """The receiver's program with the C of that campaign."""
    etude.export(folder, "c", output, name="small")
    return built(output)


def same_in_c(folder: Path, program: Path) -> None:
    """One motion inside what was learned, then legal states anywhere."""
    model = etude.load_model(folder)
    _, orders = swings(6.0, 50.0, seed=3)
    whole = np.concatenate([orders, legal(150)], axis=1)
    t = np.arange(whole.shape[1]) / 50.0
    flags, (mean, instant, gravity) = asked(program, whole)
    wanted = model.predict(states(whole, t))
    alone = model.predict(states(whole))
    for found, told in ((mean, wanted.mean), (instant, alone.mean), (gravity, model.gravity(whole[0]))):
        assert np.abs((found - within(told)) / TORQUE).max() <= SMALL
    beyond = model.outside(states(whole, t)).any(axis=1)
    np.testing.assert_array_equal(flags & UNTRAINED > 0, beyond)


@pytest.fixture(scope="module", params=["physics", pytest.param("process", marks=pytest.mark.slow)])
def learned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab(tmp_path_factory.mktemp(request.param.replace(" ", "_")), **EVERYDAY[request.param])


@pytest.fixture(scope="module")
def program(learned: Path) -> Path:
    return exported_c(learned, learned.parent / "c")


def test_c_says_what_predict_says_at_every_legal_state(learned: Path, program: Path) -> None:
    same_in_c(learned, program)


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURES)
def test_c_of_every_structure_says_what_predict_says(name: str, tmp_path: Path) -> None:
    folder = lab(tmp_path, **STRUCTURES[name])
    same_in_c(folder, exported_c(folder, tmp_path / "c"))


def test_a_file_the_graph_and_the_online_folder_say_the_same(learned: Path, tmp_path: Path) -> None:
    model = etude.load_model(learned)
    t, orders = swings(2.0, 50.0, seed=3)
    outside = legal(40)
    whole = np.concatenate([orders, outside], axis=1)
    t = 1000.0 + np.arange(whole.shape[1]) / 50.0
    wanted = model.predict(states(whole, t)).mean
    table = etude.predict(learned, write_table(tmp_path / "motion.csv", t, whole))
    np.testing.assert_array_equal(table.t, t)
    assert np.abs((table["command"] - wanted) / TORQUE).max() <= SMALL
    np.testing.assert_array_equal(table["outside"] > 0.0, model.outside(states(whole, t)))
    assert np.abs((graph(learned, tmp_path, whole) - wanted) / TORQUE).max() <= SMALL
    etude.export(learned, "online", tmp_path / "online")
    online = open_online(tmp_path / "online")
    shares = online.outside(Motion(t, whole))
    beyond = model.outside(states(whole, t)).mean(axis=0)
    assert shares == dict(zip(JOINTS, beyond.tolist(), strict=True))
    if model.chosen == ("gp",) * 3:  # beside physics that explain all to the noise nothing is outside
        assert max(shares.values()) > 0.0
    ticks = [online.command(i / 50.0, states(row))[0] for i, row in enumerate(np.swapaxes(whole, 0, 1))]
    assert np.abs((np.stack(ticks) - within(wanted)) / TORQUE).max() <= SMALL


def graph(folder: Path, tmp_path: Path, orders: Array) -> Array:
    """(T, J) commands of the exported ONNX, its memory carried."""
    onnxruntime = pytest.importorskip("onnxruntime", reason="graphs are run by the extra 'onnx'")
    pytest.importorskip("onnx", reason="graphs are written by the extra 'onnx'")
    etude.export(folder, "onnx", tmp_path / "onnx", name="small")
    session = onnxruntime.InferenceSession(
        str(tmp_path / "onnx" / "small.onnx"), providers=["CPUExecutionProvider"]
    )
    sizes = {value.name: value.shape[1] for value in session.get_inputs()}
    memory, found = np.zeros((1, sizes.get("memory", 0))), []
    for row in np.concatenate([*orders], axis=1):
        said = session.run(None, {"states": row[None]} | ({"memory": memory} if "memory" in sizes else {}))
        memory = said[-1]
        found.append(said[0][0])
    return np.stack(found)


def test_rows_without_times_say_that_they_count_by_themselves(learned: Path) -> None:
    model, orders = etude.load_model(learned), legal(20)
    alone = model.predict(states(orders))
    backwards = model.predict(states(orders[:, ::-1])).mean[::-1]
    np.testing.assert_allclose(alone.mean, backwards, rtol=1e-9, atol=1e-9)
    remembers = any(op == "memory" for *_, op in model.inputs.columns)
    assert any("no times" in sentence for sentence in alone.notes) == remembers
    assert model.predict(states(orders, np.arange(20.0))).notes == ()


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Physics of the model file, which is that of the robot, with a process beside it."""
    return lab(tmp_path_factory.mktemp("exact"), ideal=True, rung="nominal+gp", candidates=["default"])


@pytest.mark.slow
def test_gravity_is_right_at_every_legal_pose(exact: Path, tmp_path: Path) -> None:
    """The clamp that stood before physics froze it at the edge of what was trained."""
    orders = legal(300)
    _, (_, _, gravity) = asked(exported_c(exact, tmp_path / "c"), orders)
    own, data = body()
    wanted = np.stack([pin.computeGeneralizedGravity(own, data, q) for q in orders[0]])
    assert np.ptp(wanted, axis=0)[1:].min() > 0.1 * TORQUE[1:].min()
    assert np.abs((gravity - wanted) / TORQUE).max() < 0.01


def test_what_is_commanded_where_it_was_learned_is_what_was_learned(learned: Path) -> None:
    """The log's own states: nothing that lies inside is faded, and little of the rest.

    Where a joint turns round candidates differ by many deviations: one row in twenty of one joint.
    """
    model, (t, orders) = etude.load_model(learned), swings(24.0, 100.0)
    run = states(orders, t)  # all of it: friction remembers the way at the log's own rate
    told, seen = model.predict(run).mean, model.predict(run, fade=False).mean
    inside = ~model.outside(run)
    np.testing.assert_allclose(told[inside], seen[inside], rtol=1e-12, atol=1e-12)
    assert np.mean(np.abs(told - seen) > 1e-9, axis=0).max() <= 0.06


def test_a_joint_that_dwells_outside_is_not_pushed(learned: Path, program: Path) -> None:
    """Servos of 5 Hz hold the arm where nothing was learned, and what is exported is added to them.

    With physics it stands where the exact gravity would leave it, but for what these err. Without, a command
    there is a guess: over all poses no more than a tenth worse than none.
    """
    poses = np.random.default_rng(8).uniform(LOWER, UPPER, (60, len(JOINTS)))
    _, (_, instant, _) = asked(program, np.stack([poses, 0.0 * poses, 0.0 * poses]))
    own, data = body()
    gravity = np.stack([pin.computeGeneralizedGravity(own, data, q) for q in poses])
    assert np.sum((instant - gravity) ** 2) < 1.1 * np.sum(gravity**2)
    if "gp" in etude.load_model(learned).chosen:
        return
    plant, t = arm_of_urdf(urdf(), wrong=1.0), np.arange(1200) / 1000.0
    still = np.zeros((len(t), len(JOINTS)))
    for pose, exported, exact in zip(poses[:4], instant, gravity, strict=False):
        off = [
            np.abs(play(plant, Reference(t, still + pose, still, still, still + effort), "pd").q[-1] - pose)
            for effort in (exported, exact)
        ]
        assert off[0].max() <= off[1].max() + np.radians(0.5)
