"""PX4's and the Crazyflie's glue, compiled against stand-ins, add what the model says that motion takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_models import ARM, QUADROTOR, arm_model, arm_spec, averaged, quadrotor_model

from compilers import run, tool
from etude import plugins
from etude.deploy import log_of, planned
from etude.errors import UsageError
from etude.types import Array, Motion
from etude_quadrotor import FlightFeedforward
from etude_quadrotor.flatness import flat_motion
from etude_quadrotor.physics.drag import _fitted

CRAZYFLIE, PX4 = (plugins.load("etude.targets", name) for name in ("crazyflie", "px4"))
HERE = Path(__file__).parents[2] / "deploy"
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


@pytest.fixture(scope="module")
def dragged(model: Any) -> Any:
    """The same, of a vehicle that knows a drag that is not linear."""
    rng = np.random.default_rng(3)
    velocity = rng.uniform(-2.0, 2.0, (60, 3))
    force = -velocity[:, :2] * [0.4, 0.6] - 0.1 * np.abs(velocity[:, :2]) * velocity[:, :2]
    force += 0.02 * rng.standard_normal(force.shape)
    lateral = _fitted(velocity, force, (True, True))
    assert all(posterior is not None for posterior in lateral.residual)
    inputs = replace(model.inputs, drag=lateral.coefficients, lateral=lateral)
    return replace(model, inputs=inputs)


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
    states = dict(flat_motion(own, model.inputs.drag).states)
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
    said = [
        np.clip(model.posterior(log_of(plan.channels, values, "golden"))[0], plan.least, plan.most)
        for values in inside
    ]
    return said[0] - said[1], X


def build(folder: Path, target: Any, model: Any, name: str, stubs: str, *flags: str) -> None:
    delivered = target(model, QUADROTOR, spec(), {"name": "vehicle", "rate": 100})
    for file, data in delivered.files.items():
        (folder / file).write_bytes(data)
    sources = ["vehicle.c", "vehicle_lean.c", "vehicle_flight.c", name, str(HERE / f"{target.name}_drive.c")]
    run([tool("gcc"), *STRICT, *flags, f"-I{HERE / stubs}", "-I.", *sources, "-lm", "-o", "drive"], folder)


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


HOVER = 0.45
"""PX4's own, not the model's."""
OFFBOARD = 14.0


def px4_rows(own: Motion, yaw: float = 0.5 * np.pi, motors: float = 0.5, leans: float = 0.0) -> Array:
    """Lines of the drive; the last numbers are flight mode, the set-point's age, hover thrust, leans."""
    ned = own.orders[:4] @ ENU.T
    count = len(own.t)
    columns = [np.full((count, 1), DT), np.zeros((count, 1)), *ned, np.full((count, 1), yaw)]
    columns.append(np.full((count, 4), motors))
    return np.concatenate([*columns, np.tile([OFFBOARD, 0.0, HOVER, leans], (count, 1))], axis=1)


def collective(told: Array) -> Array:
    """(T, 1) beyond hover thrust, as PX4's PositionControl makes it of accelerations (T, 3), z up."""
    upright = np.hypot(np.hypot(told[:, 0], told[:, 1]), 9.81) / 9.81
    return (HOVER * ((9.81 + told[:, 2]) / 9.81 * upright - 1.0))[:, None]


def turn(angle: float) -> Array:
    """About z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


ORDER = [0, 2, 1, 3]
"""Motors of the commands m1, m3, m2, m4."""


def part(count: int = COUNT) -> Array:
    return np.minimum(1.0, np.arange(1, count + 1) * DT / FADE)[:, None]


def test_px4_motors_get_what_motion_takes(model: Any, px4: Path) -> None:
    """Beyond what PX4 makes of the acceleration by itself, so that no force is commanded twice."""
    found = drive(px4, px4_rows(motion()))
    extra, X = expected(model, motion())
    np.testing.assert_allclose(found[:, 5:-3], X, atol=2e-4 * np.abs(X).max())
    np.testing.assert_allclose(found[:, 5 : 5 + X.shape[1] - 6], X[:, : X.shape[1] - 6], atol=1e-5)
    assert np.abs(extra).max() > 0.01
    own = extra - collective(motion().orders[2])
    np.testing.assert_allclose(found[:, 1:5][:, ORDER], 0.5 + part() * own, atol=1e-4)


def test_px4_holds_against_the_drag_without_a_jerk_and_adds_nothing_where_none_was_learned(
    dragged: Any, px4: Path, tmp_path: Path
) -> None:
    build(tmp_path, PX4, dragged, "vehicle_px4.c", "px4_stubs")
    own = motion()
    rows = px4_rows(own)
    rows[:, 11:14] = np.nan
    flat = Motion(own.t, np.concatenate([own.orders[:3], 0.0 * own.orders[3:]]))
    answers = FlightFeedforward(drag=dragged.inputs.lateral).accelerations(
        ahead(flat, 1.0 / spec().attitude_gain)
    )
    assert answers is not None
    answers[:, :2] += spec().velocity_damping * own.orders[2, :, :2]
    np.testing.assert_allclose(drive(tmp_path, rows)[:, -3:] @ ENU.T, answers, atol=1e-4)
    np.testing.assert_allclose(drive(px4, px4_rows(own))[:, -3:] @ ENU.T, own.orders[2], atol=1e-5)


def ahead(own: Motion, lag: float) -> Motion:
    """Horizontal velocity and acceleration of `lag` s later, to first order: PX4 turns the vehicle first."""
    orders = own.orders.copy()
    orders[1:3, :, :2] += lag * own.orders[2:4, :, :2]
    return Motion(own.t, orders)


@pytest.mark.parametrize("leans", [0.0, 1.0])
def test_px4_holds_against_the_learned_drag(dragged: Any, tmp_path: Path, leans: float) -> None:
    """Set-points that Etude wrote hold the drag already; of others the glue finds it. Both are one flight."""
    build(tmp_path, PX4, dragged, "vehicle_px4.c", "px4_stubs")
    own = motion()
    told = FlightFeedforward(drag=dragged.inputs.lateral).accelerations(own)
    assert told is not None
    sent = Motion(own.t, np.concatenate([own.orders[:2], told[None], own.orders[3:]])) if leans else own
    found = drive(tmp_path, px4_rows(sent, leans=leans))
    extra, X = expected(dragged, own)
    np.testing.assert_allclose(found[:, 5:-9], X[:, :-6], atol=1e-5 if not leans else 2e-4)
    wanted = 0.5 + part() * (extra - collective(told))
    np.testing.assert_allclose(found[:, 1:5][:, ORDER], wanted, atol=1e-4 if not leans else 1e-3)
    if not leans:
        later = ahead(own, 1.0 / spec().attitude_gain)
        answers = FlightFeedforward(drag=dragged.inputs.lateral).accelerations(later)
        assert answers is not None
        answers[:, :2] += spec().velocity_damping * own.orders[2, :, :2]
        np.testing.assert_allclose(found[:, -3:] @ ENU.T, answers, atol=1e-4)
        assert np.abs(told - own.orders[2]).max() > 0.15


@pytest.mark.parametrize(("column", "value"), [(-4, 3.0), (-3, 0.6), (-3, np.nan)])
def test_px4_adds_nothing_in_another_mode_or_to_an_old_set_point(
    px4: Path, column: int, value: float
) -> None:
    rows = px4_rows(motion())
    rows[60:, column] = value
    found = drive(px4, rows)
    assert np.abs(found[59, 1:5] - 0.5).max() > 1e-3
    np.testing.assert_allclose(found[80:, 1:5], 0.5, atol=1e-7)


def test_px4_heading_turns_the_world(px4: Path) -> None:
    """Flown along a turned path with the heading turned as much, the body feels the same."""
    angle = 0.7
    own = motion()
    rows = px4_rows(Motion(own.t, own.orders @ turn(angle).T), yaw=0.5 * np.pi - angle)
    found, straight = drive(px4, rows), drive(px4, px4_rows(own))
    np.testing.assert_allclose(found[:, :-3], straight[:, :-3], atol=2e-4)


def test_px4_without_a_set_point_it_fades_and_stopped_motors_stay(px4: Path) -> None:
    rows = px4_rows(motion())
    rows[60:, 9] = np.nan  # no acceleration
    rows[30:35, 16] = np.nan  # PX4 stopped its second motor
    found = drive(px4, rows)
    assert np.isnan(found[30:35, 2]).all()
    assert np.isfinite(np.delete(found[:, :-3], 2, axis=1)).all()
    assert (found[:60, 0] == 0).all()
    assert (found[60:, 0] == 1).all()
    left = 1.0 - np.arange(21) * DT / FADE
    np.testing.assert_allclose(found[59:80, 1:5] - 0.5, left[:, None] * (found[59, 1:5] - 0.5), atol=1e-6)
    np.testing.assert_allclose(found[80:, 1:5], 0.5, atol=1e-7)


NORTH, EAST, DOWN = 8, 9, 10
"""Columns of the acceleration; velocity stands three before, jerk three behind."""
REJECTED = {
    "no thrust": {DOWN: 8.0},
    "thrust downwards": {DOWN: 30.0},
    "far outside": {NORTH: 20.0},
    "squares to infinity": {NORTH: 1e20},
    "infinite over nothing": {NORTH: 1e20, DOWN: 9.81},
    "infinite": {EAST: np.inf},
    "fast": {NORTH - 3: 60.0},
    "faster than squares": {NORTH - 3: 1e20},
    "turns at once": {NORTH + 3: 1e30},
    "nowhere": {2: np.nan},
    "stamp of the future": {-3: -3600.0},
    "stamp a little ahead": {-3: -0.05},
}


@pytest.fixture(scope="module")
def fast_px4(model: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As some build firmware: comparisons with NaN then mean nothing."""
    folder = tmp_path_factory.mktemp("fast")
    build(folder, PX4, model, "vehicle_px4.c", "px4_stubs", "-O2", "-ffast-math")
    return folder


@pytest.mark.thinned(2)
@pytest.mark.parametrize("hostile", list(REJECTED.values()), ids=list(REJECTED))
def test_px4_of_a_rejected_set_point_nothing_is_added(
    px4: Path, fast_px4: Path, hostile: dict[int, float]
) -> None:
    """What fades is the last good answer with the acceleration that it answered."""
    rows = px4_rows(motion())
    for column, value in hostile.items():
        rows[60:, column] = value
    left = 1.0 - np.minimum(20, np.arange(61)) * DT / FADE
    for folder in (px4, fast_px4):
        found = drive(folder, rows)
        assert (found[60:, 0] != 0).all()
        last = found[59, 1:5] - 0.5
        assert np.abs(last).max() > 1e-3
        np.testing.assert_allclose(found[59:, 1:5], 0.5 + left[:, None] * last, atol=2e-6)
    rows[:, list(hostile)] = list(hostile.values())
    np.testing.assert_allclose(drive(px4, rows)[:, 1:5], 0.5, atol=1e-7)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("hover", [np.inf, -np.inf, np.nan, 3.0, -0.2])
def test_px4_a_hover_thrust_that_is_none_is_the_models_own(px4: Path, fast_px4: Path, hover: float) -> None:
    rows = px4_rows(motion())
    rows[:, -2] = np.nan
    wanted = drive(px4, rows)[:, 1:5]
    assert np.isfinite(wanted).all()
    rows[60:, -2] = hover
    for folder in (px4, fast_px4):
        np.testing.assert_allclose(drive(folder, rows)[:, 1:5], wanted, atol=1e-5)


def test_px4_a_stamp_ahead_by_less_than_clocks_differ_is_no_fault(px4: Path) -> None:
    rows = px4_rows(motion())
    wanted = drive(px4, rows)
    rows[:, -3] = -0.004
    np.testing.assert_array_equal(drive(px4, rows), wanted)


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


PID = np.array(
    [36000 - 200 - 150 + 120, 36000 - 200 + 150 - 120, 36000 + 200 + 150 + 120, 36000 + 200 - 150 - 120]
)


def crazyflie_rows(own: Motion, yaw: float = 0.0) -> Array:
    wishes = np.tile([400.0, -300.0, 120.0, 36000.0, 1.0], (COUNT, 1))
    return np.concatenate([wishes, *own.orders[:4], np.tile([yaw, 0.0], (COUNT, 1))], axis=1)


@pytest.mark.parametrize("flags", [("-DCOMPENSATED",), pytest.param((), marks=pytest.mark.slow)])
def test_what_a_crazyflies_motors_get_is_what_was_learned(
    model: Any, tmp_path: Path, flags: tuple[str, ...]
) -> None:
    """The glue and the firmware's thrust curve and battery compensation behind it, which a Bolt has not.

    The log has the duty behind both, so that is what was learned, and what has to arrive, to 1 %.
    """
    build(tmp_path, CRAZYFLIE, model, "controller_vehicle.c", "crazyflie_stubs", *flags)
    own = motion()
    rows = crazyflie_rows(own)
    rows[100:, 3] = 0.0  # the motors are to stand
    found = drive(tmp_path, rows)
    extra, _ = expected(model, own)
    wanted = part(100) * extra[:100]
    assert (found[:100, 0] == 2).all()
    assert (found[100:, 0] == 0).all()
    got = (found[:100, 5:9] - found[:100, 9:13])[:, ORDER]
    assert np.abs(wanted).max() > 0.01
    np.testing.assert_allclose(got, wanted, atol=0.01 * np.abs(wanted).max())
    if flags:
        assert (
            np.abs((found[:100, 1:5] - PID / 65535.0)[:, ORDER] - wanted).max() > 0.1 * np.abs(wanted).max()
        )


def test_a_crazyflies_heading_turns_the_world_and_old_set_points_fade(model: Any, tmp_path: Path) -> None:
    build(tmp_path, CRAZYFLIE, model, "controller_vehicle.c", "crazyflie_stubs")
    own, angle = motion(), 0.7
    rows = crazyflie_rows(own)
    found = drive(tmp_path, rows)
    turned = Motion(own.t, np.einsum("oti,ji->otj", own.orders, turn(angle)))
    yawed = drive(tmp_path, crazyflie_rows(turned, float(np.rad2deg(angle))))
    np.testing.assert_allclose(yawed, found, atol=5e-4, rtol=1e-4)
    old, nowhere = rows.copy(), rows.copy()
    old[20:, -1] = 0.6
    nowhere[20:, 4] = 0.0  # no position is asked for
    for other in (old, nowhere):
        late = drive(tmp_path, other)[60:100]
        np.testing.assert_allclose(late[:, 1:5], np.tile(PID / 65535.0, (40, 1)), atol=2e-5)
        np.testing.assert_allclose(late[:, -2:], np.tile([1.0, 2.0], (40, 1)), atol=1e-4)


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("column", "value"),
    [(11, 1e20), (13, -9.0), (14, 1e30), (17, np.nan)],
    ids=["slide", "drop", "jerk", "heading"],
)
def test_of_a_set_point_that_a_crazyflie_rejects_nothing_is_added(
    dragged: Any, tmp_path: Path, column: int, value: float
) -> None:
    """Motors and lean go back evenly from what the last good one had."""
    build(tmp_path, CRAZYFLIE, dragged, "controller_vehicle.c", "crazyflie_stubs")
    rows = crazyflie_rows(motion())
    rows[40:100, column] = value
    found = drive(tmp_path, rows)[:100]
    added = found[:, 1:5] - PID / 65535.0
    lean = found[:, -2:] - [1.0, 2.0]
    assert np.abs(lean[39]).max() > 0.5
    left = (1.0 - np.minimum(20, np.arange(61)) * DT / FADE)[:, None]
    np.testing.assert_allclose(lean[39:], left * lean[39], atol=1e-4)
    np.testing.assert_allclose(added[39:], left * added[39], atol=2e-5)


def test_a_crazyflie_leans_as_the_motion_and_the_drag_need(dragged: Any, tmp_path: Path) -> None:
    """Its PID makes no attitude of accelerations; it is given an attitude that lacks the lean."""
    build(tmp_path, CRAZYFLIE, dragged, "controller_vehicle.c", "crazyflie_stubs")
    own = motion()
    found = drive(tmp_path, crazyflie_rows(own))
    z = flat_motion(own, dragged.inputs.drag).R_world_body[:, :, 2]
    lean = np.rad2deg(np.column_stack([np.arcsin(z[:, 1]), np.arctan2(z[:, 0], z[:, 2])]))
    np.testing.assert_allclose(found[:, -2:] - [1.0, 2.0], part() * lean, atol=2e-3)
    # to fly forward the nose goes down: the PID believes that it is up, and corrects
    forward = own.orders[2, :, 0] > 0.4
    assert (found[forward, -1] > 2.0).all()


def test_who_has_no_numbered_motors_is_refused(model: Any) -> None:
    named = spec(("front", "back", "left", "right"))
    with pytest.raises(UsageError, match="the motors cannot be identified"):
        PX4(quadrotor_model("", points=12, spec=named), QUADROTOR, named, {})
    with pytest.raises(UsageError, match="the model reads q, which set-points do not contain"):
        PX4(arm_model("exact", "ard_se", points=12), ARM, arm_spec(), {})
    with pytest.raises(UsageError, match="evaluated at 100, 250, 500 Hz, not 400"):
        CRAZYFLIE(model, QUADROTOR, spec(), {"rate": 400})


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("given", "offered"),
    [
        ({}, ["--single", "model.points"]),
        ({"single": True}, ["model.points"]),
        ({"real": "double"}, ["--real float", "--single", "model.points"]),
        ({"real": "double", "single": True}, ["--real float", "model.points"]),
    ],
)
def test_what_takes_less_is_offered_to_whom_it_was_not_given(
    model: Any, given: Any, offered: list[str]
) -> None:
    both = averaged(model, quadrotor_model("", points=12, spec=spec()))
    slow = replace(CRAZYFLIE, chip=replace(CRAZYFLIE.chip, hertz=1e5))
    with pytest.raises(UsageError, match="of its time at 100 Hz") as refused:
        slow(both, QUADROTOR, spec(), {"name": "own", **given})
    approaches = ("--rate", "--real float", "--single", "--no-fade", "model.points")
    assert [way for way in approaches if way in refused.value.next_step] == offered


def test_a_slower_rate_is_offered_where_one_fits(model: Any) -> None:
    slow = replace(CRAZYFLIE, chip=replace(CRAZYFLIE.chip, hertz=2e7))
    with pytest.raises(UsageError, match="of its time at 500 Hz") as refused:
        slow(model, QUADROTOR, spec(), {"name": "own", "rate": 500.0})
    rate = float(refused.value.next_step.split("--rate ")[1].split(",")[0])
    assert slow(model, QUADROTOR, spec(), {"name": "own", "rate": rate}).facts["rate"] == rate
