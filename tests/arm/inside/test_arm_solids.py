"""What is drawn of an arm in space: the shapes that distances are taken of, and lines between them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from clearance_examples import PLANAR, clearance, planar, planar_spec

from etude.types import Motion
from etude_arm import KIND
from etude_arm.clearance.distances import TOLERANCE
from etude_arm.clearance.surroundings import Box, Collision, Column, Floor, Surroundings, Wall

AROUND = Surroundings(
    floor=Floor(0.0),
    box=(Box("shelf", (0.6, 0.0, 0.5), (0.3, 0.4, 0.2), 0.3),),
    wall=(Wall("fence", (-0.7, 0.0, 0.0), (1.0, 0.0, 0.2)),),
    column=Column(1.1, (0.1, 0.0)),
)


def poses(count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.2, 1.2, (count, 3))


def test_a_part_drawn_holds_its_geoms_and_is_where_mujoco_has_them(tmp_path: Path) -> None:
    spec, q = planar_spec(tmp_path), poses(4)
    parts = KIND.solids(spec)
    placed = KIND.placed(spec, Motion(np.arange(4.0), q[None]))
    assert [part.name for part in parts] == ["base", "upper", "fore", "hand"]
    model = mujoco.MjModel.from_xml_string(PLANAR)
    data = mujoco.MjData(model)
    for k, pose in enumerate(q):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        for part, frame in zip(parts, placed[k], strict=True):
            world = part.points @ frame[:, :3].T + frame[:, 3]
            geom = model.geom(f"{part.name}#0").id
            local = (world - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
            size = model.geom_size[geom]
            if part.name in ("base", "hand"):
                np.testing.assert_allclose(np.abs(local), np.tile(size, (8, 1)), atol=1e-9)
            else:  # a capsule: on its skin
                along = np.clip(local[:, 2], -size[1], size[1])
                apart = np.hypot(np.hypot(local[:, 0], local[:, 1]), local[:, 2] - along)
                np.testing.assert_allclose(apart, size[0], atol=1e-9)
    for part in parts:
        a, b, c = (part.points[part.faces[:, i]] for i in range(3))
        middle = part.points.mean(axis=0)
        assert np.all(np.einsum("fi,fi->f", np.cross(b - a, c - a), a - middle) > 0.0), "seen from outside"


def test_an_arm_without_shapes_has_none_and_one_whose_distances_nobody_looks_at_has(tmp_path: Path) -> None:
    spec = planar_spec(tmp_path, Surroundings(collision=Collision(look=False)))
    assert len(KIND.solids(spec)) == 4
    assert KIND.solids(replace(spec, model_file=None)) == ()
    assert len(KIND.solids(KIND.spec(KIND.built_in()["arm4"]))) == 4, "capsules that nothing collides with"
    assert KIND.solids(KIND.spec(KIND.built_in()["mobile_arm"])) == ()


def test_lines_are_as_long_as_the_limit_says_and_end_on_what_stands_around() -> None:
    limit, q = clearance(planar(AROUND)), poses(40)
    near = limit.nearby(q, 20)
    np.testing.assert_array_equal(
        near.distance, limit.of_motion(Motion(np.arange(40.0), q[None])) - TOLERANCE
    )
    assert near.pairs == limit.rows
    apart = np.linalg.norm(near.ends[:, :, 0] - near.ends[:, :, 1], axis=2)
    wanted = np.take_along_axis(near.distance, near.narrowest, axis=1) + TOLERANCE
    seen = np.isfinite(apart) & (wanted > 0.0) & (wanted < near.farthest)
    np.testing.assert_allclose(apart[seen], wanted[seen], atol=1e-3)
    assert seen.sum() > 100
    ends = {"floor": [], "fence": [], "column": [], "shelf": []}
    for k, i in np.argwhere(seen):
        other = near.pairs[near.narrowest[k, i]][1]
        if other in ends:
            ends[other].append(near.ends[k, i, 1])
    assert all(ends.values())
    np.testing.assert_allclose(np.array(ends["floor"])[:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose((np.array(ends["fence"]) - [-0.7, 0.0, 0.0]) @ [1.0, 0.0, 0.2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*(np.array(ends["column"])[:, :2] - [0.1, 0.0]).T), 1.1, atol=1e-9)


def test_the_narrowest_come_first_and_neighbours_last() -> None:
    limit = clearance(planar(AROUND))
    near = limit.nearby(poses(30), len(limit.rows))
    assert {near.pairs[i] for i in np.flatnonzero(near.neighbours)} == {("fore", "base"), ("hand", "upper")}
    spare = near.distance - near.kept
    for k, order in enumerate(near.narrowest):
        known = ~near.neighbours[order]
        assert not np.any(np.diff(known.astype(int)) > 0)
        assert np.all(np.diff(spare[k, order[known]]) >= 0.0)
