"""MuJoCo's distances against closed forms, and those to planes against them too."""

from __future__ import annotations

import numpy as np
import pytest

from etude_arm.clearance.distances import CUTOFF, TOLERANCE, Gaps
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.surroundings import Box, Column, Floor, Room, Surroundings, Wall
from etude_arm.loading.loaded_model import Loaded

SLIDERS = ("x", "y", "z")
BALL = 0.05


def carried(shape: str, around: Surroundings, still: str = "") -> Gaps:
    """A shape that three slides carry to any place."""
    bodies = "".join(
        f'<body name="s{n}"><joint name="{n}" type="slide" axis="{axis}"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        for n, axis in zip(SLIDERS, ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    )
    xml = (
        f'<mujoco><worldbody>{still}{bodies}<geom name="ball#0" {shape}/></body></body></body>'
        "</worldbody></mujoco>"
    )
    limit = np.full(3, 5.0)
    return gaps_of(Loaded(xml, {}, SLIDERS), -limit, limit, around)


def places(seed: int = 0, count: int = 500, size: float = 0.7) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-size, size, (count, 3))


def to_box(x: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(T,) distance of points from a box about the origin; 0 inside."""
    return np.linalg.norm(np.maximum(np.abs(x) - half, 0.0), axis=1)


def assert_as(found: np.ndarray, true: np.ndarray, tolerance: float = 0.1 * TOLERANCE) -> None:
    """Where shapes are apart, and as far as is looked."""
    apart = true > 0.0
    assert apart.sum() > 50
    assert np.abs(found - np.minimum(true, CUTOFF))[apart].max() < tolerance
    assert np.all(found[true < -1e-6] < 0.0)


def test_a_ball_and_a_ball() -> None:
    gaps = carried(f'type="sphere" size="{BALL}"', Surroundings(), '<geom name="other#0" size=".1"/>')
    x = places()
    assert_as(gaps.of_poses(x)[:, 0], np.linalg.norm(x, axis=1) - BALL - 0.1)


def test_a_ball_and_a_box_that_is_turned() -> None:
    half, turn = np.array([0.1, 0.2, 0.3]), 0.7
    box = Box("table", (0.1, -0.2, 0.05), tuple(2.0 * half), turn)
    gaps = carried(f'type="sphere" size="{BALL}"', Surroundings(box=(box,)))
    x = places(1)
    c, s = np.cos(turn), np.sin(turn)
    own = (x - np.array(box.centre)) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert_as(gaps.of_poses(x)[:, 0], to_box(own, half) - BALL)


def test_a_box_and_a_box() -> None:
    half = np.array([0.1, 0.05, 0.2])
    box = Box("table", (0.0, 0.0, 0.0), (0.4, 0.2, 0.3))
    gaps = carried('type="box" size=".1 .05 .2"', Surroundings(box=(box,)))
    x = places(2)
    true = np.linalg.norm(np.maximum(np.abs(x) - half - 0.5 * np.array(box.size), 0.0), axis=1)
    assert_as(gaps.of_poses(x)[:, 0], np.where(true > 0.0, true, 0.0))


def test_a_capsule_and_a_capsule() -> None:
    still = '<geom name="other#0" type="capsule" size=".02" fromto="-.2 0 0 .2 0 0"/>'
    gaps = carried('type="capsule" size=".03" fromto="0 -.1 0 0 .1 0"', Surroundings(), still)
    x = places(3)
    # segments along x and along y: each coordinate's gap by itself
    gap = np.maximum(np.abs(x) - np.array([0.2, 0.1, 0.0]), 0.0)
    assert_as(gaps.of_poses(x)[:, 0], np.linalg.norm(gap, axis=1) - 0.05)


@pytest.mark.parametrize(
    ("shape", "down"),
    [
        ('type="sphere" size=".05"', 0.05),
        ('type="capsule" size=".05 .2"', 0.25),
        ('type="capsule" size=".05 .2" euler="90 0 0"', 0.05),
        ('type="box" size=".1 .2 .3"', 0.3),
        ('type="box" size=".1 .2 .3" euler="45 0 0"', 0.5 / np.sqrt(2.0)),
        ('type="cylinder" size=".05 .2"', 0.2),
        ('type="cylinder" size=".05 .2" euler="90 0 0"', 0.05),
    ],
)
def test_a_floor(shape: str, down: float) -> None:
    gaps, z = carried(shape, Surroundings(floor=Floor(-0.3))), np.linspace(-0.8, 0.6, 200)
    found = gaps.of_poses(np.stack([0.0 * z, 0.0 * z, z], axis=1))[:, 0]
    true = np.minimum(z + 0.3 - down, CUTOFF)
    slack = 0.001 if "cylinder" in shape else 1e-9  # the prism around it may be a little lower
    assert np.all(found <= true + 1e-9)
    assert np.all(found >= true - slack)


def test_a_wall_a_room_and_a_column() -> None:
    around = Surroundings(
        wall=(Wall("fence", (0.5, 0.0, 0.0), (-2.0, 0.0, 0.0)),),
        room=Room((-0.6, -0.5, -0.4), (0.6, 0.7, 0.8)),
        column=Column(0.6, (0.1, 0.0)),
    )
    gaps = carried(f'type="sphere" size="{BALL}"', around)
    x = places(4)
    names = [gap.names[1] for gap in gaps.list]
    found = dict(zip(names, gaps.of_poses(x).T, strict=True))
    sides = np.minimum(x - np.array([-0.6, -0.5, -0.4]), np.array([0.6, 0.7, 0.8]) - x).min(axis=1)
    wanted = {
        "fence": 0.5 - x[:, 0],
        "room": sides,
        "column": 0.6 - np.hypot(x[:, 0] - 0.1, x[:, 1]),
    }
    assert sorted(found) == sorted(wanted)
    for name, distance in wanted.items():
        np.testing.assert_allclose(found[name], np.minimum(distance - BALL, CUTOFF), atol=1e-9)


def test_more_poses_than_fit_at_once() -> None:
    gaps = carried(f'type="sphere" size="{BALL}"', Surroundings(floor=Floor(0.0)), '<geom size=".1"/>')
    x = places(5, 700)
    whole = gaps.of_poses(x)
    np.testing.assert_array_equal(whole[300:], gaps.of_poses(x[300:]))
