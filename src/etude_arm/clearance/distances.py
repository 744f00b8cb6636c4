"""Distances between shapes, and from shapes to the surroundings, for many poses at once, in C."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from etude.types import Array, Index
from etude_arm.clearance.skeleton import Shape, Skeleton
from etude_arm.clearance.surroundings import Column, Wall

CUTOFF = 0.3
"""m: distances are cut off here, and stay lower bounds. A larger value costs time for far pairs; a smaller
one shortens the steps of the proof."""
BATCH = 256
"""Poses that are evaluated at once."""
TOLERANCE = 1e-4
"""m, by which MuJoCo's distances may be too large."""


@dataclass(frozen=True)
class Gap:
    """A checked distance from a shape of the robot to another shape, to a box, or to planes.

    Attributes:
        one, other: numbers of the shapes; other is -1 for planes and the column.
        names: of both, for users.
        row: of the certificate: two rigid parts, or a part and an object of the surroundings.
    """

    one: int
    other: int
    names: tuple[str, str]
    row: tuple[str, str]

    @property
    def text(self) -> str:
        """Both names, as in the certificate."""
        return f"{self.names[0]} and {self.names[1]}"


@dataclass(frozen=True, eq=False)
class Gaps:
    """All checked distances, in the order of `list`: gaps with sensors first, then gaps to planes.

    Attributes:
        skeleton: the robot; its model has one sensor for each of the first gaps.
        sensed: gaps between geoms. walled: gaps to planes or to a column.
        planes: of `walled`.
        cached_margins: margins of rows, by home and margin; a cache of `Clearance`.
    """

    skeleton: Skeleton
    sensed: tuple[Gap, ...]
    walled: tuple[Gap, ...]
    planes: tuple[tuple[Wall, ...] | Column, ...]
    cached_margins: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @property
    def list(self) -> tuple[Gap, ...]:
        """The n gaps."""
        return (*self.sensed, *self.walled)

    @cached_property
    def reach(self) -> Array:
        """Reach P (n, k): |d(q') - d(q)| <= P |q' - q| by joint; 0 for a joint that moves both shapes or
        none.
        """
        L, skeleton = self.skeleton.reaches, self.skeleton
        bounds = np.zeros((len(self.list), L.shape[1]))
        for row, gap in zip(bounds, self.list, strict=True):
            if gap.other < 0:
                row[:] = L[gap.one]
            else:
                parts = (skeleton.shapes[i].part for i in (gap.one, gap.other))
                row[:] = np.where(skeleton.between(*parts), L[gap.one] + L[gap.other], 0.0)
        return bounds

    @cached_property
    def geoms(self) -> Index:
        """Numbers of the sensed gaps' geoms in the model, (number of sensed gaps, 2)."""
        numbers = np.array([shape.geom for shape in self.skeleton.shapes], dtype=np.int64)
        return numbers[np.array([(gap.one, gap.other) for gap in self.sensed], dtype=np.int64).reshape(-1, 2)]

    @cached_property
    def _thickness(self) -> Array:
        """Excess of the shapes over the geoms that represent them, (number of sensed gaps,) m."""
        shapes = self.skeleton.shapes
        return np.array([shapes[gap.one].thickness + shapes[gap.other].thickness for gap in self.sensed])

    @cached_property
    def _batch(self) -> Any:
        from mujoco.batch import Batch

        batch = Batch(self.skeleton.model, BATCH, nthread=1)
        for name in ("sensordata", "geom_xpos", "geom_xmat"):
            batch.bind(name)  # outputs are copied out only if bound before
        return batch

    def of_poses(self, poses: Array) -> Array:
        """Distances (T, n) m at poses (T, k), at most `CUTOFF`; negative for overlap."""
        distances = np.empty((len(poses), len(self.list)))
        for first in range(0, len(poses), BATCH):
            distances[first : first + BATCH] = self._of_some(poses[first : first + BATCH])
        return distances

    def to_walls(self, poses: Array) -> Array:
        """Distances (T, number of walled gaps) m at poses (T, k), without the other gaps."""
        import mujoco

        data = mujoco.MjData(self.skeleton.model)
        places, turns = [], []
        for pose in poses:
            data.qpos[self.skeleton.addresses] = pose
            mujoco.mj_kinematics(self.skeleton.model, data)
            places.append(data.geom_xpos.copy())
            turns.append(data.geom_xmat.copy())
        return self._to_walls(np.array(places), np.array(turns))

    def ends(self, poses: Array, gaps: Index) -> Array:
        """Nearest points (T, L, 2, 3) m, in the world, of gaps (T, L) at poses (T, k), consistent with
        `of_poses`.

        NaN for gaps of `CUTOFF` or wider.
        """
        import mujoco

        model, data = self.skeleton.model, mujoco.MjData(self.skeleton.model)
        points = np.full((*gaps.shape, 2, 3), np.nan)
        pairs, ends = self.geoms.tolist(), np.zeros(6)
        for lines, pose, numbers in zip(points, poses, gaps.tolist(), strict=True):
            data.qpos[self.skeleton.addresses] = pose
            mujoco.mj_kinematics(model, data)
            for line, gap in zip(lines, numbers, strict=True):
                if gap >= len(pairs):
                    line[:] = self._end_at_wall(gap - len(pairs), data.geom_xpos, data.geom_xmat)
                elif mujoco.mj_geomDistance(model, data, *pairs[gap], CUTOFF, ends) < CUTOFF:
                    line[:] = ends.reshape(2, 3)
        return points

    def _end_at_wall(self, number: int, places: Array, turns: Array) -> Array:
        """The point of a shape nearest to its planes or column, and its foot there, (2, 3) m."""
        shape, planes = self.skeleton.shapes[self.walled[number].one], self.planes[number]
        points = shape.points @ turns[shape.geom].reshape(3, 3).T + places[shape.geom]
        if isinstance(planes, Column):
            inwards = (np.array([*planes.centre, 0.0]) - points) * [1.0, 1.0, 0.0]
            across = np.linalg.norm(inwards, axis=1)
            normals = inwards / np.maximum(across, np.finfo(float).tiny)[:, None]
            heights = planes.radius - across
        else:
            units = [unit(wall) for wall in planes]
            over = np.stack([points @ normal - offset for normal, offset in units])
            normals = np.array([normal for normal, _ in units])[over.argmin(axis=0)]
            heights = over.min(axis=0)
        i = int(heights.argmin())
        return np.asarray(points[i] - np.outer([shape.radius, heights[i]], normals[i]))

    def _of_some(self, poses: Array) -> Array:
        import mujoco

        batch, count = self._batch, len(poses)
        batch.qpos[:count, self.skeleton.addresses] = poses
        batch.forward(ids=np.arange(count), stage=mujoco.mjtStage.mjSTAGE_POS)
        sensed = batch.sensordata[:count, : len(self.sensed)] - self._thickness
        if not self.walled:
            return np.asarray(sensed)
        return np.concatenate(
            [sensed, self._to_walls(batch.geom_xpos[:count], batch.geom_xmat[:count])], axis=1
        )

    def _to_walls(self, places: Array, turns: Array) -> Array:
        """Distances (T, number of walled gaps) m from the frames of all geoms."""
        distances = np.empty((len(places), len(self.walled)))
        for i, (gap, planes) in enumerate(zip(self.walled, self.planes, strict=True)):
            shape = self.skeleton.shapes[gap.one]
            place, turn = places[:, shape.geom], turns[:, shape.geom].reshape(-1, 3, 3)
            distances[:, i] = np.minimum(_clear_of(shape, planes, place, turn), CUTOFF)
        return distances


def unit(wall: Wall) -> tuple[Array, float]:
    """Unit normal of a plane, and its distance from the origin along the normal."""
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    return normal, float(normal @ np.array(wall.point))


def _clear_of(shape: Shape, planes: tuple[Wall, ...] | Column, place: Array, turn: Array) -> Array:
    """Distances (T,) m from a shape at frames (T, 3), (T, 3, 3) to the nearest plane or the column."""
    if isinstance(planes, Column):
        across = (turn[:, :2] @ shape.points.T) + (place[:, :2] - np.array(planes.centre))[:, :, None]
        return np.asarray(planes.radius - np.hypot(across[:, 0], across[:, 1]).max(axis=1) - shape.radius)
    clear = []
    for wall in planes:
        normal, offset = unit(wall)
        lowest = ((normal @ turn) @ shape.points.T).min(axis=1)
        clear.append(place @ normal + lowest - offset - shape.radius)
    return np.asarray(np.min(clear, axis=0))
