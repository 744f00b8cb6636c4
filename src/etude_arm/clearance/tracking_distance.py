"""Effect of tracking errors on distances: the real pose lies within e of the planned one.

Every distance falls by at most P.e, with P the reach. This holds for the worst pose and is far too large for
most. Let n be the direction from one shape to the other at this pose, and x the corners of both shapes. Then

    d(q + delta) >= min (n.x_2 - sum_j |n.dx_2/dq_j| e_j) - max (n.x_1 + sum_j |n.dx_1/dq_j| e_j) - slack

for all |delta_j| <= e_j, because no two shapes are nearer than along any direction n. The slack is of second
order: no point bends by more than L_j along two joints of which j is the outer one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude._runtime.operators import cross
from etude.types import Array, Index, Mask
from etude_arm.clearance.distances import Gaps, unit
from etude_arm.clearance.skeleton import Shape
from etude_arm.clearance.surroundings import Column

FARTHEST = 10.0
"""m: any two shapes of a robot are nearer, so that a direction is found."""
TINY = 1e-12  # m: touching shapes have no direction between them
LOOKED_WITHIN = 0.02
"""m beyond the required distance within which the pose itself is evaluated."""


def lost(gaps: Gaps, poses: Array, distances: Array, error: Array, required: Array) -> Array:
    """Largest decrease (T, n) m of the distances under tracking errors.

    Args:
        gaps: of the robot.
        poses: (T, k) rad (m). distances: (T, n) m at them.
        error: (k,) e, rad (m).
        required: (n,) m; the bound by reaches suffices where it leaves more.
    """
    decrease = np.tile(gaps.reach @ error, (len(poses), 1))
    near = (distances - decrease < required + LOOKED_WITHIN) & (distances > 0.0)
    at = np.flatnonzero(near.any(axis=1))
    if not len(at):
        return decrease
    scene = Scene.of(gaps, poses[at], near[at])
    for i in np.flatnonzero(near.any(axis=0)):
        rows = np.flatnonzero(near[at, i])
        fall = distances[at[rows], i] - scene.least(int(i), rows, error)
        decrease[at[rows], i] = np.clip(fall, 0.0, decrease[at[rows], i])
    return decrease


def all_keep(
    gaps: Gaps, poses: Array, distances: Array, error: Array, share: Array, required: Array, sought: Array
) -> bool:
    """Whether all distances less their share (n,) of `lost` are at least `sought` (n,) m.

    Other arguments as `lost`. Cheaper than `lost`: gaps that the reach alone keeps wide are not computed, and
    the first gap below ends the search.
    """
    most = gaps.reach @ error
    slack = distances - share * most - sought
    doubtful = ~(distances - share * most >= sought)
    if not doubtful.any():
        return True
    near = (distances - most < required + LOOKED_WITHIN) & (distances > 0.0)
    if np.any(doubtful & ~near) or np.any(distances < sought):
        return False
    at = np.flatnonzero(doubtful.any(axis=1))
    scene = Scene.of(gaps, poses[at], doubtful[at])
    for i in sorted(np.flatnonzero(doubtful.any(axis=0)).tolist(), key=lambda i: float(slack[:, i].min())):
        rows = np.flatnonzero(doubtful[at, i])
        apart = distances[at[rows], i]
        taken = np.clip(apart - scene.least(i, rows, error), 0.0, most[i])
        if not np.all(apart - share[i] * taken >= sought[i]):
            return False
    return True


@dataclass(frozen=True, eq=False)
class Scene:
    """Frames of a robot at M poses.

    Attributes:
        gaps: of the robot.
        places: (M, geoms, 3) m and turns: (M, geoms, 3, 3) of the geoms.
        anchors: (M, k, 3) m and axes: (M, k, 3) of the joints.
        normals: (M, n, 3) from one geom to the other, of gaps between near geoms.
    """

    gaps: Gaps
    places: Array
    turns: Array
    anchors: Array
    axes: Array
    normals: Array

    @classmethod
    def of(cls, gaps: Gaps, poses: Array, near: Mask) -> Scene:
        """The scene at poses (M, k), with normals of the gaps that are `near` (M, n)."""
        import mujoco

        skeleton, count = gaps.skeleton, len(poses)
        model, data, addresses = skeleton.model, mujoco.MjData(skeleton.model), skeleton.addresses
        sources = data.geom_xpos, data.geom_xmat, data.xanchor, data.xaxis
        frames = [np.empty((count, *part.shape)) for part in sources]
        at, of = near[:, : len(gaps.sensed)].nonzero()
        pairs, ends, first = (
            gaps.geoms[of].tolist(),
            np.zeros((len(at), 6)),
            np.searchsorted(at, range(count + 1)),
        )
        for t, pose in enumerate(poses):
            data.qpos[addresses] = pose
            mujoco.mj_kinematics(model, data)
            for part, now in zip(frames, sources, strict=True):
                part[t] = now
            for k in range(first[t], first[t + 1]):
                mujoco.mj_geomDistance(model, data, *pairs[k], FARTHEST, ends[k])
        between = ends[:, 3:] - ends[:, :3]
        normals = np.zeros((count, len(gaps.sensed), 3))
        normals[at, of] = between / np.maximum(np.linalg.norm(between, axis=1, keepdims=True), TINY)
        places, turns, anchors, axes = frames
        turns, joints = turns.reshape(count, -1, 3, 3), skeleton.joints
        return cls(gaps, places, turns, anchors[:, joints], axes[:, joints], normals)

    def least(self, i: int, at: Index, error: Array) -> Array:
        """Least distance (len(at),) m of gap number `i` at those poses under any errors; -inf: unknown."""
        gap, sensed = self.gaps.list[i], len(self.gaps.sensed)
        moving = np.where(self.gaps.reach[i] > 0.0, error, 0.0)
        if i < sensed:
            normal = self.normals[at, i]
            one, other = (
                self._lowest(gap.one, -normal, at, moving),
                self._lowest(gap.other, normal, at, moving),
            )
            return one + other
        planes = self.gaps.planes[i - sensed]
        if isinstance(planes, Column):
            return np.full(len(at), -np.inf)
        heights = []
        for wall in planes:
            normal, offset = unit(wall)
            heights.append(self._lowest(gap.one, np.tile(normal, (len(at), 1)), at, moving) - offset)
        return np.asarray(np.min(heights, axis=0))

    def _lowest(self, number: int, normal: Array, at: Index, error: Array) -> Array:
        """Least n.x (len(at),) of a shape under errors (k,), with a normal (len(at), 3) for each pose."""
        skeleton = self.gaps.skeleton
        shape = skeleton.shapes[number]
        joints = [j for j in skeleton.chain(shape.part) if error[j] > 0.0]
        height = self._along(shape, normal, np.zeros(3), at)
        for j in joints:
            axis = self.axes[at, j]
            if skeleton.slides[j]:
                height = height - error[j] * np.abs((axis * normal).sum(axis=1))[:, None]
            else:
                across = cross(normal, axis)
                height = height - error[j] * np.abs(self._along(shape, across, self.anchors[at, j], at))
        L, before, slack = skeleton.reaches[number], 0.0, 0.0
        for j in joints:
            slack += L[j] * error[j] * (0.5 * error[j] + before)
            before += error[j]
        return np.asarray(height.min(axis=1) - shape.radius - slack)

    def _along(self, shape: Shape, direction: Array, origin: Array, at: Index) -> Array:
        """direction.(x - origin), (len(at), V), of a shape's points x at those poses."""
        local = (direction[:, None] @ self.turns[at, shape.geom])[:, 0]
        start = (direction * (self.places[at, shape.geom] - origin)).sum(axis=1)
        return np.asarray(local @ shape.points.T + start[:, None])
