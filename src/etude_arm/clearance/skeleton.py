"""Rigid parts of a robot, their convex shapes, and bounds on their motion by each joint."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Index, Mask
from etude_arm.loading.parsing import free_name

if TYPE_CHECKING:
    import mujoco

BASE = "base"
"""Name of all that no joint moves, unless a link that moves is called so."""
BOX = "box: "
"""Starts the names of geoms that are boxes around the robot."""
STANDING = " of robot.toml"
"""Suffix of the name of an object in the surroundings, where a link has the same name."""
NOTHING: Mapping[str, float] = MappingProxyType({})
SIDES = 128
"""Of the prism around a cylinder, which is thicker by 0.3 thousandths."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex part of the robot: all points within `radius` of the hull of `points`; it contains its geom.

    Attributes:
        name: of its geom, "link#k" or the link's name.
        geom: number in the model. part: number of its rigid part.
        points: (V, 3) m in the geom's frame. radius: m.
        smooth: the geom has no corners, so that the points enclose it only loosely.
        thickness: m of the radius that the geom does not have: a reduced hull stands for a larger one.
        box: it is a box of the surroundings. A link may have the same name.
    """

    name: str
    geom: int
    part: int
    points: Array
    radius: float
    smooth: bool = False
    thickness: float = 0.0
    box: bool = False

    @property
    def link(self) -> str:
        """Its link in the model file, or the box; links that are fixed to one another are one part."""
        return self.name.removeprefix(BOX) if self.box else self.name.rpartition("#")[0] or self.name


def reaches(
    points: Array,
    beyond: Array,
    chain: Sequence[int],
    joints: tuple[Array, Array],
    slides: Mask,
    added: Array,
) -> Array:
    """Reach L (k,): no point is ever farther from that joint's axis; 0 for joints outside the chain.

    L is 1 for a slide. Otherwise it adds up along the chain from the joint to the points: the next anchor's
    distance from the axis, the lengths between anchors, the farthest point from the last anchor, and the
    travel of slides.

    Args:
        points: (V, 3) m in the world, in one pose. beyond: (V,) m, radii around them.
        chain: places of the joints that move them, the innermost first.
        joints: anchors and axes (k, 3) in that pose.
        slides: (k,) mask. added: (k,) m, largest travel of each slide from that pose.
    """
    anchors, axes = joints
    lengths, outside = np.zeros(len(slides)), points
    for j in chain[::-1]:
        across = np.linalg.norm(np.cross(outside - anchors[j], axes[j]), axis=1)
        lengths[j] = 1.0 if slides[j] else float((across + beyond).max())
        far = np.linalg.norm(outside - anchors[j], axis=1) + beyond
        outside, beyond = anchors[[j]], np.array([far.max() + added[j]])
    return lengths


def bent(reach: Array, chain: Sequence[int], rates: Sequence[Array]) -> Array:
    """Bounds of the second and third time derivatives of points with these reaches, m/s^2 and m/s^3.

    No point bends by more than L_j along several joints of which j is the outermost one, so

        |p''|  <= sum_j L_j A_j + sum_ij L_ij V_i V_j,
        |p'''| <= sum_j L_j J_j + 3 sum_ij L_ij A_i V_j + sum_ijk L_ijk V_i V_j V_k.

    Args:
        reach: (k,) L. chain: the innermost first.
        rates: largest |qd|, |qdd| and, for the third derivative, |qddd|, (k,) each.
    """
    L = reach[list(chain)]
    V, A = rates[0][list(chain)], rates[1][list(chain)]
    inner = np.cumsum(V) - V
    pairs = float(L @ (V * V + 2.0 * V * inner))  # of pairs, the outer one counts
    second = float(L @ A) + pairs
    if len(rates) < 3:
        return np.array([second, np.inf])
    below = np.cumsum(A) - A
    mixed = float(L @ (A * V + A * inner + below * V))
    triples = float(L @ (V**3 + 3.0 * V**2 * inner + 3.0 * V * inner**2))
    return np.array([second, float(L @ rates[2][list(chain)]) + 3.0 * mixed + triples])


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A compiled model as rigid parts between joints.

    Attributes:
        model: with one degree of freedom for each joint and no others.
        joints: (k,) numbers of the joints in the model, in the order of the robot's axes.
        lower, upper: (k,) position limits, rad (m); they bound the travel of slides.
        parts: names; part 0 is what no joint moves.
        parent: (B,) parent of each part, -1 for the first.
        moves: (B, k) whether the joint moves the part.
        shapes: of all parts.
    """

    model: mujoco.MjModel
    joints: Index
    lower: Array
    upper: Array
    parts: tuple[str, ...]
    parent: Index
    moves: Mask
    shapes: tuple[Shape, ...]

    def called(self, thing: str) -> str:
        """Name of an object of the surroundings that no link has."""
        return f"{thing}{STANDING}" if thing in self._links else thing

    @cached_property
    def _links(self) -> frozenset[str]:
        return frozenset((*self.parts, *(shape.link for shape in self.shapes if not shape.box)))

    @property
    def addresses(self) -> Index:
        """Places (k,) of the joints in qpos."""
        return np.asarray(self.model.jnt_qposadr[self.joints], dtype=np.int64)

    @cached_property
    def slides(self) -> Mask:
        """Mask (k,) of the slides."""
        import mujoco

        return np.asarray(self.model.jnt_type[self.joints] == int(mujoco.mjtJoint.mjJNT_SLIDE))

    @cached_property
    def reaches(self) -> Array:
        """Reach L (G, k): no point of that shape is ever farther from that joint's axis; else 0."""
        import mujoco

        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        anchors, axes = data.xanchor[self.joints], data.xaxis[self.joints]
        start = data.qpos[self.addresses]
        added = np.where(self.slides, np.maximum(np.abs(self.lower - start), np.abs(self.upper - start)), 0.0)
        rows = []
        for shape in self.shapes:
            world = shape.points @ data.geom_xmat[shape.geom].reshape(3, 3).T + data.geom_xpos[shape.geom]
            beyond = np.full(len(world), shape.radius)
            rows.append(reaches(world, beyond, self.chain(shape.part), (anchors, axes), self.slides, added))
        return np.reshape(rows, (len(self.shapes), len(self.joints)))

    def chain(self, part: int) -> list[int]:
        """Places of the joints that move a part, the innermost first."""
        return self._chains[part]

    @cached_property
    def _chains(self) -> list[list[int]]:
        # in a model, joints of outer bodies come after those of inner ones
        order = np.argsort(self.joints)
        return [[int(j) for j in order if moved[j]] for moved in self.moves]

    def between(self, one: int, other: int) -> Mask:
        """Mask (k,) of joints that move one of two parts and not the other; their distance depends on these
        alone.
        """
        return np.asarray(self.moves[one] ^ self.moves[other])

    def random_poses(self, rng: np.random.Generator, count: int) -> Array:
        """Uniform poses (count, k) inside the limits, rad (m)."""
        return rng.uniform(self.lower, self.upper, (count, len(self.joints)))


def skeleton_of(
    model: mujoco.MjModel,
    names: tuple[str, ...],
    lower: Array,
    upper: Array,
    enlargements: Mapping[str, float] = NOTHING,
) -> Skeleton:
    """The skeleton of a model with exactly these joints.

    Args:
        model: compiled. names: of the joints. lower, upper: (k,) their limits, rad (m).
        enlargements: m by which shapes are thicker than their geoms, by the geoms' names.

    Raises:
        UsageError: the model has another number of degrees of freedom, or lacks a joint.
    """
    import mujoco

    numbers = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
    if -1 in numbers or model.nq != len(names) or model.nv != len(names):
        raise UsageError(
            f"the model has {model.nv} degrees of freedom, the file {len(names)} joints: {', '.join(names)}",
            next_step="Distances need the same joints in both; others must be fixed.",
        )
    welds = sorted({int(body) for body in model.body_weldid})
    place = {weld: i for i, weld in enumerate(welds)}
    parent = [-1 if weld == 0 else place[int(model.body_weldid[model.body_parentid[weld]])] for weld in welds]
    moves = np.zeros((len(welds), len(names)), dtype=np.bool_)
    for part, weld in enumerate(welds):
        if weld:
            moves[part] = moves[parent[part]]  # parents come first
            moves[part] |= np.array([int(model.jnt_bodyid[number]) == weld for number in numbers])
    moving = [model.body(weld).name or f"body {weld}" for weld in welds if weld]
    parts = (free_name(BASE, moving), *moving)
    shapes = tuple(_shapes(model, place, enlargements))
    joints, parents = np.array(numbers, dtype=np.int64), np.array(parent, dtype=np.int64)
    return Skeleton(model, joints, np.asarray(lower), np.asarray(upper), parts, parents, moves, shapes)


def _shapes(
    model: mujoco.MjModel, place: Mapping[int, int], enlargements: Mapping[str, float]
) -> list[Shape]:
    import mujoco

    shapes = []
    for geom in range(model.ngeom):
        name, body = model.geom(geom).name, int(model.geom_bodyid[geom])
        solid = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        if solid or name.startswith(BOX):
            points, radius = points_of(model, geom)
            if len(points):
                part = place[int(model.body_weldid[body])]
                smooth = int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
                more = enlargements.get(name, 0.0)
                shapes.append(Shape(name, geom, part, points, radius + more, smooth, more, not solid))
    return shapes


def points_of(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Points (V, 3) and radius of a shape around a geom, m; no points for a geom without a convex hull."""
    import mujoco

    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angles = 2.0 * math.pi * np.arange(SIDES) / SIDES
        ring = size[0] / math.cos(math.pi / SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ends = [np.column_stack([ring, np.full(SIDES, z)]) for z in (-size[1], size[1])]
        return np.concatenate(ends), 0.0
    if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
        return signs * size, 0.0
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        return _corners(model, mesh), 0.0
    return np.zeros((0, 3)), 0.0


def _corners(model: mujoco.MjModel, mesh: int) -> Array:
    """Points of a mesh that its hull needs, as MuJoCo found them; all points if it has no hull."""
    first, graph = int(model.mesh_vertadr[mesh]), int(model.mesh_graphadr[mesh])
    points: Array = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float)
    if graph < 0:
        return points
    count = int(model.mesh_graph[graph])  # then the number of faces, places of edges, numbers of points
    return np.asarray(points[np.sort(model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count])])
