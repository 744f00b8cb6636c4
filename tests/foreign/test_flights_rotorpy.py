"""What leaves a campaign of a vehicle, flown in a plant and by controllers of others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rotorpy", reason="rotorpy is not installed: pip install 'rotorpy>=2.1'")

from flight_lab import exported, from_rest, learned_lab, run, table_of
from onboard import onboard
from rotorpy_vehicle import Airframe, Array, Cascade, Geometric, fly

from etude import plugins
from etude.trajectories import from_json

pytestmark = pytest.mark.slow
"""Every day `test_px4_flights` and `test_flight_feedforward` fly, in faster plants."""
FRAME = Airframe(curve=1.0)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Learned from one flight; the second proposal is open."""
    found, _ = learned_lab(tmp_path_factory.mktemp("rotorpy"), 1, frame=FRAME, quick=True)
    run("ask", found, "--format", "px4")
    return found


def eight(folder: Path) -> Path:
    """A motion at up to 4 m/s, 2 m above the ground, from rest to rest, and its file."""
    velocity = np.zeros((6, 3))
    velocity[[0, 1], 0], velocity[[3, 4], 1], velocity[[3, 5], 2] = (2.0, -2.0), (2.0, -1.0), (0.3, -0.1)
    path = folder / "eight.json"
    path.write_text(from_rest(velocity).to_json())
    return path


def test_a_motion_of_ones_own_leaves_with_the_learned_drag(lab: Path, tmp_path: Path) -> None:
    """In the receiver's controller the exported set-points leave a third of what the motion's own leave."""
    table, drag = exported(lab, eight(tmp_path), tmp_path / "out")
    assert np.abs(drag).max() > 1.0
    plain = table.copy()
    plain[:, 6:9] -= drag
    told, own = (
        fly(rows[:350], frame=FRAME, controller=Geometric, seed=7).error(3.0) for rows in (table, plain)
    )
    assert told <= 0.10
    assert told < 0.4 * own


def test_the_certificate_is_of_the_motion_and_says_so(lab: Path, tmp_path: Path) -> None:
    exported(lab, eight(tmp_path), tmp_path / "out")
    proof = json.loads((tmp_path / "out" / "px4" / "certificate.json").read_text())
    said, receiver, beside = proof["notes"]
    assert "commands, not the motion" in said
    assert "PX4's cascade" in receiver
    assert "If the learned drag is wrong" in beside
    rows = [row for row in proof["rows"] if "learned is wrong" in row["quantity"]]
    assert [row["axis"] for row in rows] == ["x", "y", "z"]
    assert proof["ok"]
    files = {"setpoints.csv": (tmp_path / "out" / "px4" / "setpoints.csv").read_bytes()}
    played = plugins.load("etude.exporters", "px4").back(files)
    motion = from_json((tmp_path / "out" / "trajectory.json").read_bytes())
    np.testing.assert_allclose(played.points, motion.motion(played.times, 3).orders, atol=1e-5)


def test_asked_set_points_hold_against_the_drag_once_it_is_learned(lab: Path) -> None:
    _, before = table_of(lab / "proposals" / "0001" / "px4" / "setpoints.csv")
    table, after = table_of(lab / "proposals" / "0002" / "px4" / "setpoints.csv")
    assert not before.any()
    assert np.abs(after).max() > 0.3
    lateral = np.einsum("ij,ij->i", table[:, 3:5], after[:, :2])
    moving = np.linalg.norm(table[:, 3:5], axis=1) > 1.0
    assert (lateral[moving] > 0.0).all()  # against the drag is along the velocity


def test_the_commands_along_a_motion_hold_the_accelerations_too(lab: Path, tmp_path: Path) -> None:
    table, _ = exported(lab, eight(tmp_path), tmp_path / "out")
    rows = np.genfromtxt(tmp_path / "out" / "commands.csv", delimiter=",", names=True)
    told = np.column_stack([rows[f"a{axis}_command"] for axis in "xyz"])
    moves = table[: len(told), 3:6].any(axis=1)  # rows at rest are held, and are rest to the bit
    assert moves.mean() > 0.99
    np.testing.assert_allclose(told[moves], table[: len(told), 6:9][moves], atol=2e-5)


def up_and_down() -> Array:
    """z = 2 + 0.6 sin 2t, as set-points: what PX4 turns into collective thrust by itself."""
    t = np.arange(0.0, 6.0, 0.02)
    rows = np.zeros((len(t), 9))
    for k in range(3):
        rows[:, 3 * k + 2] = 0.6 * 2.0**k * np.sin(2.0 * t + 0.5 * np.pi * k)
    rows[:, 2] += 2.0
    return rows


@pytest.mark.parametrize(("controller", "curve"), [(Geometric, 1.0), (Cascade, 0.0)])
def test_on_board_no_force_is_commanded_twice(
    lab: Path, tmp_path: Path, controller: type[Cascade], curve: float
) -> None:
    """The exported C in the allocator, in a loop with PX4's hover thrust: never worse than without it.

    The model was learned with a thrust curve of 1. Flown with 0 its motors are others: it is not to make
    that worse. Two per cent are the noise of the sensors.
    """
    added = onboard(lab, tmp_path / "px4", decouple=controller is Cascade)
    frame = Airframe(curve=curve)
    rows = up_and_down()
    own, with_it = (
        fly(rows, frame=frame, controller=controller, seed=3, onboard=extra).error(3.0)
        for extra in (None, added)
    )
    assert with_it <= 1.02 * own


def test_px4s_own_cascade_follows_them_better_than_the_motions_own(tmp_path: Path) -> None:
    """The part for the cascade is most of it: against the drag alone the delay remains."""
    lab, _ = learned_lab(tmp_path, 1, frame=FRAME, controller=Cascade, quick=True)
    table, added = exported(lab, eight(tmp_path), tmp_path / "out")
    _, cascade = table_of(tmp_path / "out" / "px4" / "setpoints.csv", ("cascade",))
    plain, held = table.copy(), table.copy()
    plain[:, 6:9] -= added
    held[:, 6:9] -= cascade
    told, against_drag, own = (
        fly(rows[:350], frame=FRAME, controller=Cascade, seed=7).error(3.0) for rows in (table, held, plain)
    )
    print(f"{own:.3f} m with the motion's own, {against_drag:.3f} with the drag, {told:.3f} as exported")
    assert told < 0.5 * against_drag
    assert told < 0.3 * own
