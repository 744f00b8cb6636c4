"""PX4's and the Crazyflie's glue, compiled against stand-ins, add what the model says that motion takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_models import ARM, QUADROTOR, arm_model, arm_spec, quadrotor_model

from compilers import run, tool
from etude.contracts import Array, Motion
from etude.deploy.c99.plan import planned
from etude.deploy.flight.target import CRAZYFLIE, PX4
from etude.deploy.states import log_of
from etude.errors import UsageError
from etude.robots.quadrotor.flatness import flat_motion

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-O0")
DT, FADE, COUNT = 0.01, 0.2, 120
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def spec(names: tuple[str, ...] = ("m1", "m3", "m2", "m4")) -> Any:
    own = QUADROTOR.spec(ROOT / "examples" / "crazyflie" / "crazyflie.toml")
    return replace(own, command_names=names)


@pytest.fixture(scope="module")
def model() -> Any:
    return quadrotor_model("", points=24, spec=spec())


def motion() -> Motion:
    """A slow loop in space, within what the model was trained on; five orders."""
    t = np.arange(COUNT) * DT
    size, pace = np.array([0.25, 0.2, 0.1]), np.array([1.5, 1.1, 1.9])
    phase = pace * t[:, None] + np.array([0.0, 0.7, 1.2])
    orders = [size * pace**k * np.sin(phase + 0.5 * np.pi * k) for k in range(5)]
    orders[0] = orders[0] + np.array([0.0, 0.0, 1.0])
    return Motion(t, np.stack(orders))


def expected(model: Any, own: Motion) -> tuple[Array, Array]:
    """What is added (T, 4) before it fades, and the states of the model (T, N)."""
    plan = planned(model, QUADROTOR, spec(), "vehicle")
    states = dict(flat_motion(own).states)
    rates = states["rates"]
    turning = np.zeros_like(rates)
    share = DT / (DT + 0.02)
    for i in range(1, len(rates)):
        turning[i] = turning[i - 1] + share * ((rates[i] - rates[i - 1]) / DT - turning[i - 1])
    states["angular_acceleration"] = turning
    X = np.concatenate([states[channel.name] for channel in plan.channels], axis=1)
    hover = np.zeros_like(X)
    for i, (channel, part) in enumerate(plan.parts):
        if channel.name == "altitude":
            hover[:, i] = X[:, i]
        if channel.name == "specific_force" and part == 2:
            hover[:, i] = 9.81
    inside = [np.clip(values, plan.low, plan.high) for values in (X, hover)]
    assert (inside[0] == X).all()
    said = [
        np.clip(model.posterior(log_of(plan.channels, values, "golden"))[0], plan.least, plan.most)
        for values in inside
    ]
    return said[0] - said[1], X


def build(folder: Path, target: Any, model: Any, name: str, stubs: str) -> None:
    delivered = target(model, QUADROTOR, spec(), {"name": "vehicle"})
    for file, data in delivered.files.items():
        (folder / file).write_bytes(data)
    sources = ["vehicle.c", "vehicle_flight.c", name, str(HERE / f"{target.name}_drive.c")]
    run([tool("gcc"), *STRICT, f"-I{HERE / stubs}", "-I.", *sources, "-lm", "-o", "drive"], folder)


def drive(folder: Path, rows: Array) -> Array:
    lines = "\n".join(" ".join(f"{v:.9g}" for v in row) for row in rows)
    (folder / "rows").write_text(f"{len(rows)}\n{lines}\n")
    said = run(["sh", "-c", "./drive < rows"], folder).splitlines()
    return np.array([[float(v) for v in line.split()] for line in said])


@pytest.fixture(scope="module")
def px4(model: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("px4")
    build(folder, PX4, model, "vehicle_px4.c", "px4_stubs")
    return folder


def px4_rows(own: Motion, yaw: float = 0.5 * np.pi, motors: float = 0.5) -> Array:
    ned = own.orders[:4] @ ENU.T
    count = len(own.t)
    columns = [np.full((count, 1), DT), np.zeros((count, 1)), *ned, np.full((count, 1), yaw)]
    return np.concatenate([*columns, np.full((count, 4), motors)], axis=1)


def turn(angle: float) -> Array:
    """About z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


ORDER = [0, 2, 1, 3]
"""Motors of the commands m1, m3, m2, m4."""


def part(count: int = COUNT) -> Array:
    return np.minimum(1.0, np.arange(1, count + 1) * DT / FADE)[:, None]


def test_px4_motors_get_what_motion_takes(model: Any, px4: Path) -> None:
    found = drive(px4, px4_rows(motion()))
    extra, X = expected(model, motion())
    np.testing.assert_allclose(found[:, 5:], X, atol=2e-4 * np.abs(X).max())
    np.testing.assert_allclose(found[:, 5 : 5 + X.shape[1] - 6], X[:, : X.shape[1] - 6], atol=1e-5)
    assert np.abs(extra).max() > 0.01
    np.testing.assert_allclose(found[:, 1:5][:, ORDER], 0.5 + part() * extra, atol=1e-4)


def test_px4_heading_turns_the_world(px4: Path) -> None:
    """Flown along a turned path with the heading turned as much, the body feels the same."""
    angle = 0.7
    own = motion()
    rows = px4_rows(Motion(own.t, own.orders @ turn(angle).T), yaw=0.5 * np.pi - angle)
    np.testing.assert_allclose(drive(px4, rows), drive(px4, px4_rows(own)), atol=2e-4)


def test_px4_without_a_set_point_it_fades_and_stopped_motors_stay(px4: Path) -> None:
    rows = px4_rows(motion())
    rows[60:, 9] = np.nan  # no acceleration
    rows[30:35, 16] = np.nan  # PX4 stopped its second motor
    found = drive(px4, rows)
    assert np.isnan(found[30:35, 2]).all()
    assert np.isfinite(np.delete(found, 2, axis=1)).all()
    assert (found[:60, 0] == 0).all()
    assert (found[60:, 0] == 1).all()
    left = 1.0 - np.arange(21) * DT / FADE
    np.testing.assert_allclose(found[59:80, 1:5] - 0.5, left[:, None] * (found[59, 1:5] - 0.5), atol=1e-6)
    np.testing.assert_allclose(found[80:, 1:5], 0.5, atol=1e-7)


def test_px4_angular_acceleration_does_not_jump_over_a_gap(px4: Path) -> None:
    rows = px4_rows(motion())
    rows[60:100, 9] = np.nan
    found = drive(px4, rows)
    turning = slice(5 + 7, 5 + 10)
    assert np.abs(found[59, turning]).max() > 0.05
    np.testing.assert_array_equal(found[100, turning], found[59, turning])


def test_px4_without_a_jerk_rates_count_as_zero(px4: Path) -> None:
    rows = px4_rows(motion())
    rows[:, 11:14] = np.nan
    found = drive(px4, rows)
    assert (found[:, 0] == 0).all()
    np.testing.assert_array_equal(found[:, 9:15], 0.0)
    np.testing.assert_array_equal(found[:, 5:9], drive(px4, px4_rows(motion()))[:, 5:9])


def test_a_crazyflie_gets_the_same(model: Any, tmp_path: Path) -> None:
    build(tmp_path, CRAZYFLIE, model, "controller_vehicle.c", "crazyflie_stubs")
    own = motion()
    wishes = np.tile([400.0, -300.0, 120.0, 36000.0, 1.0], (COUNT, 1))
    rows = np.concatenate([wishes, *own.orders[:4], np.zeros((COUNT, 1))], axis=1)
    rows[100:, 3] = 0.0  # the motors are to stand
    found = drive(tmp_path, rows)
    extra, _ = expected(model, own)
    pid = np.array(
        [36000 - 200 - 150 + 120, 36000 - 200 + 150 - 120, 36000 + 200 + 150 + 120, 36000 + 200 - 150 - 120]
    )
    assert (found[:100, 0] == 2).all()
    assert (found[100:, 0] == 0).all()
    wanted = (pid / 65535.0)[ORDER] + part(100) * extra[:100]
    np.testing.assert_allclose(found[:100, 1:][:, ORDER], wanted, atol=1e-4)
    angle = 0.7
    turned = np.einsum("oti,ji->otj", own.orders[:4], turn(angle))
    yawed = np.concatenate([wishes, *turned, np.full((COUNT, 1), np.rad2deg(angle))], axis=1)
    np.testing.assert_allclose(drive(tmp_path, yawed)[:100], found[:100], atol=2e-4)
    rows[20:, 4] = 0.0  # no position is asked for
    np.testing.assert_allclose(drive(tmp_path, rows)[60:100, 1:], np.tile(pid / 65535.0, (40, 1)), atol=1e-6)


def test_who_has_no_numbered_motors_is_refused(model: Any) -> None:
    named = spec(("front", "back", "left", "right"))
    with pytest.raises(UsageError, match="which motor is which"):
        PX4(quadrotor_model("", points=12, spec=named), QUADROTOR, named, {})
    with pytest.raises(UsageError, match="the model reads q, which no set-point tells"):
        PX4(arm_model("exact", "ard_se", points=12), ARM, arm_spec(), {})
    with pytest.raises(UsageError, match="asks at 100, 250, 500 Hz, not 400"):
        CRAZYFLIE(model, QUADROTOR, spec(), {"rate": 400})
