"""Speeds and places in space: against closed forms, dense samples, and MuJoCo's own velocities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from clearance_examples import planar_spec, random_chain

from etude.errors import UsageError
from etude.limits import SPEED, certify
from etude.trajectories import FourierTrajectory, PointToPoint, Splined
from etude_arm import ArmSpec, Axis
from etude_arm.clearance.skeleton import bent
from etude_arm.loading.load import load_arm
from etude_arm.motions import limits
from etude_arm.robot_file import parse_robot, robot_to_toml
from etude_arm.space.space_limit import SpaceLimit, space_of
from etude_arm.space.table import Cartesian

ALL = Cartesian(
    (0.02, 0.0, 0.01),
    1.0,
    1.5,
    lower=(-3.0, -3.0, -3.0),
    upper=(3.0, 3.0, 3.0),
    radius=3.0,
    centre=(0.1, 0.0),
)


def of(spec: ArmSpec, table: Cartesian = ALL) -> SpaceLimit:
    found = space_of(replace(spec, cartesian=table))
    assert found is not None
    return found


def chain_spec(folder: Path, seed: int) -> ArmSpec:
    """A tree of hinges and slides with shapes anywhere."""
    loaded = random_chain(np.random.default_rng(seed), 4)
    path = folder / f"chain{seed}.xml"
    masses = loaded.xml.replace("<joint ", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint ')
    path.write_text(masses)
    axes = tuple(Axis(name, -1.5, 1.5, 2.0, 4.0, 100.0) for name in loaded.joints)
    return ArmSpec("chain", axes, "N m", 100.0, path)


def swing(rng: np.random.Generator, dof: int) -> FourierTrajectory:
    return FourierTrajectory(rng.uniform(-0.7, 0.7, (5, dof)), 1.1, 5.7)


@pytest.mark.parametrize("seed", range(2))
def test_rows_hold_what_dense_samples_show_and_little_more(tmp_path: Path, seed: int) -> None:
    spec, rng = chain_spec(tmp_path, seed), np.random.default_rng(seed)
    limit, motion = of(spec), swing(rng, spec.dof)
    t = np.linspace(0.0, motion.duration, 5_001)
    moves = PointToPoint(rng.uniform(-1.0, 1.0, (3, spec.dof)), 1.5, 0.2, 3.0, 20.0)
    ends = np.array([0.0, 0.6, 1.5])
    quintic = Splined(ends, motion.motion(ends, 3).orders)
    cubic = Splined(ends, motion.motion(ends, 2).orders)
    for piece, loose in ((motion, 0.03), (moves, 0.05), (quintic, 0.05), (cubic, 1.0)):
        found = limit.of_motion(piece.motion(np.minimum(t, piece.duration), 3))
        rows = limit.prove(piece)
        assert found.shape[1] == len(rows) == len(limit.rows)
        for row, values in zip(rows, found.T, strict=True):
            assert values.max() <= row.proved_upper <= values.max() + loose * (row.upper - row.lower)
            assert row.proved_lower <= values.min()


@pytest.mark.parametrize("seed", range(3))
def test_corners_are_at_least_as_fast_as_any_shape(tmp_path: Path, seed: int) -> None:
    """Velocities of the shapes' own corners by MuJoCo, and of the tool's point by differences."""
    spec, rng = chain_spec(tmp_path, seed), np.random.default_rng(seed)
    limit, motion = of(spec), swing(rng, spec.dof)
    model = load_arm(spec).model()
    data, places = mujoco.MjData(model), [model.joint(name).qposadr[0] for name in spec.names]
    t, step = np.linspace(0.1, 5.0, 9), 1e-6
    found = limit.of_motion(motion.motion(t, 2))
    quantities = [quantity for _, quantity, _, _ in limit.rows]
    links = found[:, [i for i, q in enumerate(quantities) if q == "link speed"]].max(axis=1)
    for now, most in zip(t, links, strict=True):
        at = []
        for time in (now - step, now + step):
            data.qpos[places] = motion.motion(np.array([time]), 1).orders[0, 0]
            mujoco.mj_kinematics(model, data)
            at.append((data.geom_xpos.copy(), data.geom_xmat.copy().reshape(-1, 3, 3)))
        sizes = np.where(model.geom_size > 0.0, model.geom_size, model.geom_size[:, :1])  # of capsules
        local = sizes[:, None] * rng.uniform(-0.57, 0.57, (50, 3))  # inside of every kind
        moved = [x[:, None] + np.einsum("gij,gvj->gvi", R, local) for x, R in at]
        assert (np.linalg.norm(moved[1] - moved[0], axis=2) / (2.0 * step)).max() <= most + 1e-4
    place = [limit.of_motion(motion.motion(t + sign * step, 2))[:, 1:4] for sign in (-1.0, 1.0)]
    speeds = np.linalg.norm(place[1] - place[0], axis=1) / (2.0 * step)
    np.testing.assert_allclose(found[:, 0], speeds, rtol=1e-4, atol=1e-5)


def test_a_pendulum_bends_as_its_formula_says() -> None:
    """One hinge: |p''| <= L (A + V^2), |p'''| <= L (J + 3 A V + V^3); two: products count the outer reach."""
    one = bent(np.array([0.5]), [0], [np.array([2.0]), np.array([3.0]), np.array([4.0])])
    np.testing.assert_allclose(one, [0.5 * (3.0 + 4.0), 0.5 * (4.0 + 18.0 + 8.0)])
    L, V, A, J = (np.array(v) for v in ((2.0, 0.5), (1.0, 3.0), (2.0, 5.0), (1.0, 7.0)))
    two = bent(L, [0, 1], [V, A, J])
    second = L @ A + L[0] * V[0] ** 2 + L[1] * (V[1] ** 2 + 2.0 * V[0] * V[1])
    third = sum(
        L[max(i, j, k)] * V[i] * V[j] * V[k] for i in range(2) for j in range(2) for k in range(2)
    ) + 3.0 * sum(L[max(i, j)] * A[i] * V[j] for i in range(2) for j in range(2))
    np.testing.assert_allclose(two, [second, L @ J + third])


def test_searches_draw_motions_home_until_they_are_slow_enough(tmp_path: Path) -> None:
    spec = chain_spec(tmp_path, 1)
    motion = swing(np.random.default_rng(1), spec.dof)
    (row,) = of(spec, Cartesian(speed=9.0)).prove(motion)
    assert (row.axis, row.quantity, row.status) == ("tool", "tool speed", "proved")
    for part, kept in ((1.05, True), (0.9, False)):
        limit = of(spec, Cartesian(speed=part * row.proved_upper))
        assert limit.keeps(motion) == kept
        found = certify(motion, [limit])
        assert found.ok == kept
        assert SPEED not in found.not_verified
        assert any("links" in sentence for sentence in found.not_verified)
    assert "cartesian" in [limit.name for limit in limits(replace(spec, cartesian=ALL), {})]


def test_the_table_is_read_written_and_refused(tmp_path: Path) -> None:
    spec = replace(planar_spec(tmp_path), cartesian=ALL)
    assert parse_robot(robot_to_toml(spec), where="x", folder=tmp_path) == spec
    assert space_of(replace(spec, cartesian=Cartesian(point=(0.0, 0.0, 0.1)))) is None
    for wrong in ({"speed": 0.0}, {"lower": (0.0, 0.0, 0.0)}, {"lower": (1.0,) * 3, "upper": (0.0,) * 3}):
        with pytest.raises(UsageError):
            Cartesian(**wrong)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="no model_file"):
        space_of(replace(spec, model_file=None))
