from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.trajectories import FourierTrajectory
from etude.types import Motion
from etude_quadrotor.flatness import FlatMotion, flat_motion, roll_pitch_yaw
from etude_quadrotor.vehicle import GRAVITY

DRAGS = [(0.0, 0.0, 0.0), (0.57, 0.57, 0.57), (0.6, 0.4, 0.1)]
EVERY_DRAG = pytest.mark.parametrize("drag", DRAGS)


def flight(seed: int = 0, harmonics: int = 3, size: float = 2.0) -> FourierTrajectory:
    table = size * np.random.default_rng(seed).standard_normal((2 * harmonics + 1, 3))
    return FourierTrajectory(table, 0.5, 4.0 * np.pi)


def flown(t: np.ndarray, drag, seed: int = 0) -> FlatMotion:
    return flat_motion(flight(seed).motion(t, 5), drag)


def hat(w: np.ndarray) -> np.ndarray:
    """(T, 3) to (T, 3, 3) cross-product matrices."""
    return np.cross(w[:, None, :], np.eye(3)[None]).swapaxes(1, 2)


def still(count: int = 4, **parts) -> Motion:
    """`count` samples at rest, with some derivatives replaced by one vector."""
    orders = np.zeros((5, count, 3))
    for name, value in parts.items():
        orders[("position", "velocity", "acceleration", "jerk", "snap").index(name)] = value
    return Motion(np.arange(count, dtype=float), orders)


@EVERY_DRAG
def test_newton_holds_with_the_drag_given(drag) -> None:
    flat = flown(np.linspace(0.0, 12.0, 200), drag)
    R, m = flat.R_world_body, flat.motion
    thrust = flat.thrust[:, None] * R[:, :, 2]
    vjp = np.einsum("tij,j,tkj,tk->ti", R, np.array(drag), R, m.orders[1])
    np.testing.assert_allclose(thrust - vjp - [0.0, 0.0, GRAVITY], m.orders[2], atol=1e-12)


@EVERY_DRAG
def test_attitude_is_a_rotation_of_zero_heading(drag) -> None:
    R = flown(np.linspace(0.0, 12.0, 50), drag).R_world_body
    np.testing.assert_allclose(R.swapaxes(1, 2) @ R, np.tile(np.eye(3), (50, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(R[:, 1, 0], 0.0, atol=1e-15)
    assert np.all(R[:, 0, 0] > 0.0)


@EVERY_DRAG
def test_rates_and_angular_acceleration_are_derivatives(drag) -> None:
    t, h = np.linspace(0.5, 12.0, 60), 1e-5
    here, ahead, behind = flown(t, drag), flown(t + h, drag), flown(t - h, drag)
    turned = (ahead.R_world_body - behind.R_world_body) / (2 * h)
    np.testing.assert_allclose(here.R_world_body @ hat(here.states["rates"]), turned, atol=1e-6)
    faster = (ahead.states["rates"] - behind.states["rates"]) / (2 * h)
    np.testing.assert_allclose(here.states["angular_acceleration"], faster, atol=1e-6)


@EVERY_DRAG
def test_states_are_the_motion_seen_from_the_body(drag) -> None:
    flat = flown(np.linspace(0.0, 12.0, 30), drag)
    m, s, back = flat.motion, flat.states, flat.R_world_body.swapaxes(1, 2)
    np.testing.assert_array_equal(s["altitude"][:, 0], m.orders[0, :, 2])
    np.testing.assert_allclose(s["body_velocity"], (back @ m.orders[1][:, :, None])[:, :, 0], atol=1e-13)
    np.testing.assert_allclose(s["body_acceleration"], (back @ m.orders[2][:, :, None])[:, :, 0], atol=1e-13)
    # an accelerometer reads thrust and drag, along the body's axes
    expected = -np.array(drag) * s["body_velocity"]
    expected[:, 2] += flat.thrust
    np.testing.assert_allclose(s["specific_force"], expected, atol=1e-12)


def test_angles_are_those_of_the_rotation() -> None:
    R = flown(np.linspace(0.0, 12.0, 50), DRAGS[2]).R_world_body
    turned = Rotation.from_euler("Z", 0.4).as_matrix() @ R
    for frame in (R, turned):
        angles = Rotation.from_matrix(frame).as_euler("ZYX")[:, ::-1]
        np.testing.assert_allclose(roll_pitch_yaw(frame), angles, atol=1e-14)


def test_without_drag_specific_force_is_thrust_alone() -> None:
    states = flown(np.linspace(0.0, 12.0, 30), DRAGS[0]).states
    np.testing.assert_allclose(states["specific_force"][:, :2], 0.0, atol=1e-13)


def test_fast_level_flight_leans_as_far_as_drag_asks() -> None:
    """10 m/s with 0.5 1/s: 27.0 degrees (maths 5.5); without drag, level."""
    level = still(velocity=(10.0, 0.0, 0.0))
    for drag, expected in (((0.5, 0.5, 0.5), np.arctan2(5.0, GRAVITY)), ((0.0, 0.0, 0.0), 0.0)):
        R = flat_motion(level, drag).R_world_body
        np.testing.assert_allclose(np.arccos(np.clip(R[:, 2, 2], -1.0, 1.0)), expected, atol=1e-12)
    assert np.degrees(np.arctan2(5.0, GRAVITY)) == pytest.approx(27.0, abs=0.05)


def test_hover() -> None:
    flat = flat_motion(still(position=(1.0, 2.0, 3.0)), (0.5, 0.4, 0.3))
    np.testing.assert_allclose(flat.R_world_body, np.tile(np.eye(3), (4, 1, 1)))
    np.testing.assert_allclose(flat.thrust, GRAVITY)
    np.testing.assert_allclose(flat.states["specific_force"], [[0.0, 0.0, GRAVITY]] * 4)
    assert not flat.states["rates"].any()
    assert not flat.states["angular_acceleration"].any()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(DRAGS))
def test_pull_is_the_derivative_of_any_function_of_the_states(seed: int, drag) -> None:
    rng = np.random.default_rng(seed)
    motion = flight(seed, size=0.5).motion(np.linspace(0.0, 12.0, 7), 6)
    weights = {
        name: rng.standard_normal(part.shape)
        for name, part in flat_motion(motion, drag, check=False).states.items()
    }

    def total(orders: np.ndarray) -> float:
        states = flat_motion(Motion(motion.t, orders), drag, check=False).states
        return sum(float(np.sum(weights[name] * part)) for name, part in states.items())

    pulled = flat_motion(motion, drag, check=False).vjp(weights)
    for order in range(6):
        direction, h = np.zeros(motion.orders.shape), 1e-5
        direction[order] = rng.standard_normal((7, 3))
        ahead, behind = (total(motion.orders + s * direction) for s in (h, -h))
        expected = (ahead - behind) / (2 * h)
        assert float(np.sum(pulled * direction)) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_state_that_is_missing_counts_as_zero() -> None:
    flat = flown(np.linspace(0.0, 12.0, 5), DRAGS[2])
    whole = {name: np.zeros_like(part) for name, part in flat.states.items()}
    whole["rates"] += 1.0
    np.testing.assert_array_equal(flat.vjp({"rates": whole["rates"]}), flat.vjp(whole))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"acceleration": (0.0, 0.0, -GRAVITY)},
            r"at 0 s a \+ g z \+ d v is 0 m/s\^2: thrust has no direction",
        ),
        ({"acceleration": (0.0, 5.0, -GRAVITY)}, "along the body's left axis"),
        ({"acceleration": (3.0, 0.0, -8.0)}, r"vertical part .* is 1\.81 m/s\^2"),
        ({"acceleration": (0.0, 0.0, -20.0)}, "falls or tips over"),
        ({"acceleration": (np.nan, 0.0, 0.0)}, "no direction"),
    ],
)
def test_singular_samples_are_refused_with_time_and_value(parts, message: str) -> None:
    with pytest.raises(UnsafeTrajectoryError, match=message) as caught:
        flat_motion(still(**parts))
    assert caught.value.where == "time 0 s"


def test_drag_can_make_and_remove_a_singularity() -> None:
    falling = still(velocity=(0.0, 0.0, -20.0), acceleration=(0.0, 0.0, 0.0))
    flat_motion(falling)
    with pytest.raises(UnsafeTrajectoryError, match="falls or tips over"):
        flat_motion(falling, (0.5, 0.5, 0.0))
    with pytest.raises(UnsafeTrajectoryError, match=r"thrust per mass is 1\.81"):
        flat_motion(still(velocity=(0.0, 0.0, -8.0)), (0.0, 0.0, 1.0))


def test_bad_use() -> None:
    with pytest.raises(UsageError, match="drag"):
        flat_motion(still(), (0.1, -0.1, 0.0))
    with pytest.raises(UsageError, match="3 axes"):
        flat_motion(Motion(np.zeros(1), np.zeros((5, 1, 2))))
    with pytest.raises(UsageError, match="5 orders"):
        flat_motion(Motion(np.zeros(1), np.zeros((4, 1, 3))))
