"""Logs of vehicles whose columns are not what their header says: refused with what they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from etude.cli import main
from etude.types import Array, Log, Motion
from etude_quadrotor import KIND
from etude_quadrotor.flatness import flat_motion
from etude_quadrotor.sensor_consistency import DELAY, agreement_findings

ROBOT = Path(__file__).parents[3] / "examples" / "px4" / "px4_quad.toml"
RATE, SECONDS = 100.0, 30.0
HEADER = (
    "time,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z,motor_1,motor_2,motor_3,motor_4,"
    "pos_x,pos_y,pos_z,q_w,q_x,q_y,q_z"
)
TIME, FORCE, RATES, MOTORS = slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 11)
PLACE, TURN = slice(11, 14), slice(14, 18)
FRD = np.array([1.0, -1.0, -1.0])


def table(seed: int) -> Array:
    """A flight as an autopilot records it: kinematics of a flat motion, noise and biases of small sensors."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE)) / RATE
    size, pace = rng.uniform(0.6, 1.2, 3) * [2.0, 2.0, 0.8], rng.uniform(0.8, 1.4, 3) * [1.0, 1.1, 1.6]
    phase = pace * t[:, None] + rng.uniform(0.0, 6.0, 3)
    orders = [size * pace**k * np.sin(phase + 0.5 * np.pi * k) for k in range(5)]
    orders[0] = orders[0] + np.array([0.0, 0.0, 2.0])
    flat = flat_motion(Motion(t, np.stack(orders)), (0.4, 0.4, 0.0))
    force, rates = flat.states["specific_force"], flat.states["rates"]
    lagged = np.interp(t + 0.05, t, force[:, 2])  # motors come first
    motors = 0.5 + 0.05 * (lagged - 9.81)[:, None] + 0.01 * rng.standard_normal((len(t), 4))
    quaternion = Rotation.from_matrix(flat.R_world_body).as_quat()[:, [3, 0, 1, 2]]
    noisy = [
        force + 0.3 * rng.standard_normal(force.shape) + rng.normal(0.0, 0.1, 3),
        rates + 0.02 * rng.standard_normal(rates.shape) + rng.normal(0.0, 0.01, 3),
        motors,
        orders[0] + 0.004 * rng.standard_normal(force.shape),
        quaternion,
    ]
    return np.column_stack([t, *noisy])


def _ned(rows: Array) -> Array:
    """Of places."""
    return np.asarray(rows[:, [1, 0, 2]] * [1.0, 1.0, -1.0])


def _frames(own: Array) -> None:
    own[:, FORCE] *= FRD
    own[:, RATES] *= FRD


def _put(columns: slice, change: Callable[[Array], Array]) -> Callable[[Array], None]:
    def changed(own: Array) -> None:
        own[:, columns] = change(own[:, columns].copy())

    return changed


WRONG: dict[str, tuple[Callable[[Array], None], str]] = {
    "degrees": (_put(RATES, np.degrees), "the gyroscope is in degrees per second"),
    "clock x 2": (_put(TIME, lambda t: 2.0 * t), "the times are twice as long as they were"),
    "clock / 2": (_put(TIME, lambda t: 0.5 * t), "the times are half as long as they were"),
    "xyzw": (_put(TURN, lambda q: q[:, [1, 2, 3, 0]]), "the quaternion's parts are x, y, z, w"),
    "inverse": (
        _put(TURN, lambda q: q * [1.0, -1.0, -1.0, -1.0]),
        "the attitude is inverted",
    ),
    "world of NED": (_put(PLACE, _ned), "north, east, down"),
    "north, east, up": (_put(PLACE, lambda p: p[:, [1, 0, 2]]), "the position has (y, x, z)"),
    "gyroscope of FRD": (_put(RATES, lambda w: w * FRD), "the gyroscope has (x, -y, -z)"),
    "accelerometer of FRD": (
        _put(FORCE, lambda f: f * FRD),
        "the accelerometer's axes are x forward, y right, z down",
    ),
    "sign of gravity": (_put(FORCE, lambda f: -f), "-9.81 along z in hover"),
    "sensors of FRD": (_frames, "x forward, y right, z down"),
    "motors late": (
        _put(MOTORS, lambda m: np.roll(m, 50, axis=0)),
        "after their thrust and torques",
    ),
}


MIX = np.array([[1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [1.0, 1.0, 1.0, -1.0], [1.0, -1.0, -1.0, -1.0]])
"""Motors of thrust and of torques about x, y and z."""


def gentle(seed: int) -> Array:
    """A flight that hardly moves up and down, as `table`, with motors that also turn it."""
    own = table(seed)
    steps = np.random.default_rng(seed).standard_normal((len(own), 3))
    rates = own[:, RATES] + 0.01 * np.cumsum(steps, axis=0)
    rates -= rates.mean(axis=0)
    turning = np.gradient(rates, axis=0) * RATE
    asked = np.column_stack([0.02 * np.sin(0.7 * own[:, 0]), turning / np.abs(turning).max() * 0.2])
    ahead = np.roll(asked, -4, axis=0)  # they act after 0.04 s
    own[:, RATES] = rates
    own[:, MOTORS] = 0.5 + ahead @ MIX.T + 0.005 * np.random.default_rng(seed).standard_normal((len(own), 4))
    return own


def inspected(folder: Path, own: Array, *more: str) -> int:
    path = folder / "flight.csv"
    np.savetxt(path, own, delimiter=",", comments="", header=HEADER)
    return main(["inspect", str(path), "--robot", str(ROBOT), *more])


@pytest.mark.thinned(2)
@pytest.mark.parametrize("case", list(WRONG))
def test_columns_that_contradict_each_other_are_named(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = table(1)
    change, named = WRONG[case]
    change(own)
    assert inspected(tmp_path, own) == 3
    assert named in " ".join(capsys.readouterr().out.split())


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", range(4))
def test_instruments_that_agree_are_believed(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert inspected(tmp_path, table(seed)) == 0
    said = capsys.readouterr().out
    assert "matches the rotation of the attitude" in said
    assert "matches the motion of the position" in said


@pytest.mark.parametrize(("late", "told"), [(0.0, ""), (0.3, "0.26 s after"), (-0.3, "0.34 s before")])
def test_commands_are_held_against_the_torques_that_they_make(late: float, told: str) -> None:
    """Thrust alone says nothing of a gentle flight: torques do."""
    own = gentle(2)
    own[:, MOTORS] = np.roll(own[:, MOTORS], round(late * RATE), axis=0)
    spec = KIND.spec(ROBOT)
    names = ("specific_force", "rates", "command")
    channels = {c.name: c for c in KIND.channels(spec) if c.name in names}
    parts = dict(zip(names, (FORCE, RATES, MOTORS), strict=True))
    log = Log(own[:, 0], channels, {name: own[:, parts[name]] for name in names})
    said = [one.sentence for one in agreement_findings(spec, log) if one.check == DELAY]
    assert len(said) == bool(told)
    assert told in "".join(said)
