"""Limits in space: speeds of the tool and the links, and the tool's region, proved for all times.

A point's velocity v between two samples h apart stays within h^2/8 max |v''| of the line between them, and
lengths are convex: |v| <= max(|v_k|, |v_k+1|) + h^2/8 max |p'''|. The bound of p''' is `skeleton.bent`, from
the proved rates of the joints. For a link the corners of a box around it suffice, since velocities of a rigid
body are affine in the point. Positions are bounded likewise, by p''.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from etude._runtime.operators import cross
from etude.errors import UsageError
from etude.limits.certificate import SPEED, memoized
from etude.protocols import Family, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Cone, Motion, Proof
from etude_arm.clearance.path_poses import largest
from etude_arm.clearance.skeleton import bent, reaches
from etude_arm.loading.load import load_arm, of_file
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.kinematics import BodyMotion, KinematicTree, body_motion
from etude_arm.physics.transmission import Geometry
from etude_arm.rehearsal.body import tips
from etude_arm.space.table import Cartesian
from etude_arm.spec import ArmSpec

LOOSE = 0.003
"""Part of a limit that may be lost between samples; it determines their spacing."""
LEAST, MOST = 1e-3, 0.02
"""s between samples."""
LOOK = 0.04
"""s between samples in searches."""
CLOSE = 0.99
"""Part of a limit that searches use, as a reserve for the proof."""
PLACES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Points:
    """Points of one body: a tool's, or corners around a link.

    Attributes:
        name: as in the certificate.
        body: number in the tree. at: (V, 3) m in its frame.
        chain: joints that move it, the innermost first. reach: (k,) as `reach.reaches`.
    """

    name: str
    body: int
    at: Array
    chain: tuple[int, ...]
    reach: Array

    def places(self, motion: BodyMotion) -> Array:
        """(T, V, 3) m in the room."""
        return np.asarray(motion.position[self.body][:, None] + self._turned(motion))

    def speeds(self, motion: BodyMotion) -> Array:
        """(T,) m/s, of the fastest."""
        swing = cross(motion.omega[self.body][:, None], self._turned(motion))
        velocity = motion.velocity[self.body][:, None] + swing
        return np.asarray(np.linalg.norm(velocity, axis=2).max(axis=1))

    def _turned(self, motion: BodyMotion) -> Array:
        return np.asarray(np.einsum("nij,vj->nvi", motion.rotation[self.body], self.at))


@dataclass(frozen=True, eq=False)
class SpaceLimit:
    """A `protocols.Limit`, not convex: motions are scaled towards home until it is proved.

    Attributes:
        tree: the robot's bodies. tool: its point. links: corners around each moving link.
        table: the limits.
    """

    tree: KinematicTree
    tool: Points
    links: tuple[Points, ...]
    table: Cartesian
    name: str = "cartesian"
    looks_at: tuple[str, ...] = (SPEED,)
    _proofs: dict[str, tuple[Proof, ...]] = field(default_factory=dict, repr=False)

    @property
    def not_verified(self) -> tuple[str, ...]:
        """Of the two speeds, the one without a limit."""
        speeds = {"tool": self.table.speed, "links": self.table.link_speed}
        return tuple(f"The speed of the {what} in space." for what, most in speeds.items() if most is None)

    @property
    def rows(self) -> list[tuple[str, str, float, float]]:
        """Axis, quantity, lower and upper limit, in the order of `of_motion`."""
        table, name = self.table, self.tool.name
        rows: list[tuple[str, str, float, float]] = []
        if table.speed is not None:
            rows.append((name, "tool speed", -table.speed, table.speed))
        if table.lower is not None and table.upper is not None:
            sides = zip(PLACES, table.lower, table.upper, strict=True)
            rows += [(f"{name} {axis}", "tool position", low, high) for axis, low, high in sides]
        if table.radius is not None:
            rows.append((name, "tool radius", -table.radius, table.radius))
        if table.link_speed is not None:
            most = table.link_speed
            rows += [(link.name, "link speed", -most, most) for link in self.links]
        return rows

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """No penalty: motions that are too fast are scaled towards home."""
        return 0.0, np.zeros_like(motion.orders)

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples satisfy all limits with a reserve: for searches, whose result is proved
        afterwards.
        """
        count = max(2, math.ceil(piece.duration / LOOK)) + 1
        values = self.of_motion(piece.motion(np.linspace(0.0, piece.duration, count), 2))
        ends = np.array([[low, high] for _, _, low, high in self.rows])
        middle, half = ends.mean(axis=1), 0.5 * np.ptp(ends, axis=1)
        return bool(np.all(np.abs(values - middle) <= CLOSE * half))

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """A row for each quantity. UsageError for curves without a bound of their acceleration."""
        return memoized(self._proofs, piece.to_json(), lambda: self._rows(piece))

    def of_motion(self, motion: Motion) -> Array:
        """(T, r) speeds, places and distances from the cylinder's axis."""
        still = np.zeros_like(motion.orders[0])
        bodies = body_motion(self.tree, motion.orders[0], motion.orders[1], still)
        table, columns = self.table, []
        place = self.tool.places(bodies)[:, 0]
        if table.speed is not None:
            columns.append(self.tool.speeds(bodies)[:, None])
        if table.lower is not None:
            columns.append(place)
        if table.radius is not None:
            columns.append(np.hypot(*(place[:, :2] - np.array(table.centre)).T)[:, None])
        if table.link_speed is not None:
            columns += [link.speeds(bodies)[:, None] for link in self.links]
        return np.concatenate(columns, axis=1)

    def _rows(self, piece: Trajectory) -> tuple[Proof, ...]:
        rows, (places, speeds, gentle) = self.rows, self._bends(piece)
        loose = [LOOSE * (high - low) for _, _, low, high in rows]
        fits = [
            # from h²/8 of the second derivative, as in the proof below
            math.sqrt(8.0 * room / bend) if bend > 0.0 else math.inf
            for room, bend in zip(loose, speeds if gentle else places, strict=True)
        ]
        step = float(np.clip(min(fits, default=MOST), LEAST, MOST))
        count = max(2, math.ceil(piece.duration / step)) + 1
        t = np.linspace(0.0, piece.duration, count)
        step = float(t[1] - t[0])
        samples = self.of_motion(piece.motion(t, 2))
        out = []
        for (axis, quantity, low, high), values, bend, rough in zip(
            rows, samples.T, speeds, places, strict=True
        ):
            slow = "speed" not in quantity
            # between samples h apart a value moves by h²/8 of its second derivative, or h/2 of its first
            more = step**2 / 8.0 * bend if slow or gentle else 0.5 * step * rough
            size = quantity != "tool position"
            most = float(values.max()) + more
            least = -most if size else float(values.min()) - more
            method = f"samples every {1000.0 * step:.2g} ms, and {more:.2g} between, from the joints' rates"
            out.append(Proof(axis, quantity, low, high, least, most, method))
        return tuple(out)

    def _bends(self, piece: Trajectory) -> tuple[list[float], list[float], bool]:
        """For each row the bounds of p'' and of the next derivative: p''' of speeds, p'' of positions; and
        whether p''' exists.
        """
        if isinstance(piece, Splined) and piece.held:
            raise UsageError("the speed between held set-points depends on the receiver")
        rates = [largest(piece, order) for order in (1, 2)]
        try:
            rates.append(largest(piece, 3))
        except UsageError:  # a curve whose acceleration jumps
            gentle = False
        else:
            gentle = bool(np.isfinite(rates[2]).all())
        tool, links = bent(self.tool.reach, self.tool.chain, rates), list(self.links)
        second, third = [], []
        for _, quantity, _, _ in self.rows:
            bounds = tool
            if quantity == "link speed":
                link = links.pop(0)
                bounds = bent(link.reach, link.chain, rates)
            second.append(float(bounds[0]))
            third.append(float(bounds[1]) if "speed" in quantity else float(bounds[0]))
        return second, third, gentle


TOOL = "tool"
_cached_limits: dict[str, SpaceLimit] = {}


def space_of(spec: ArmSpec) -> SpaceLimit | None:
    """The limit; None where the robot file has no [cartesian] with a limit in it.

    Raises:
        UsageError: the robot has no model file; or link_speed is set and the robot has no shapes.
    """
    table = spec.cartesian
    if table is None or table == Cartesian(point=table.point):
        return None
    if spec.model_file is None:
        raise UsageError(
            f"robot '{spec.name}' has no model_file, but [cartesian] needs the positions of its links",
            next_step="Add a URDF or MJCF to the robot file, or remove [cartesian].",
        )
    return of_file(_cached_limits, spec, lambda: _space_limit(spec, table))


def _space_limit(spec: ArmSpec, table: Cartesian) -> SpaceLimit:
    geometry = read_geometry(spec)
    assert geometry is not None
    last = geometry.tree.joint_body[spec.dof - 1]
    end = tips(load_arm(spec, shapes=False), [spec.names[-1]])[0] if table.point is None else table.point
    pose = np.clip(np.zeros(spec.dof), spec.lower, spec.upper)
    still = np.zeros((1, spec.dof))
    motion = body_motion(geometry.tree, pose[None], still, still)
    tool = _points(TOOL, int(last), np.array([end], dtype=float), spec, geometry.tree, motion, pose)
    links = _links(spec, geometry, motion, pose) if table.link_speed is not None else ()
    return SpaceLimit(geometry.tree, tool, links, table)


def _links(spec: ArmSpec, geometry: Geometry, motion: BodyMotion, pose: Array) -> tuple[Points, ...]:
    """The corners of a box around the shapes of each moving part, in the frame of the body that moves it."""
    import mujoco

    from etude_arm.clearance.skeleton import skeleton_of

    skeleton = skeleton_of(load_arm(spec).model(), spec.names, spec.lower, spec.upper)
    data = mujoco.MjData(skeleton.model)
    data.qpos[skeleton.addresses] = pose
    mujoco.mj_kinematics(skeleton.model, data)
    links = []
    for part, name in enumerate(skeleton.parts):
        chain, shapes = skeleton.chain(part), [shape for shape in skeleton.shapes if shape.part == part]
        if not chain or not shapes:
            continue
        body = int(geometry.tree.joint_body[chain[-1]])
        corners = []
        for shape in shapes:
            turn, place = data.geom_xmat[shape.geom].reshape(3, 3), data.geom_xpos[shape.geom]
            world = shape.points @ turn.T + place
            local = (world - motion.position[body, 0]) @ motion.rotation[body, 0]
            corners += [local - shape.radius, local + shape.radius]
        low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
        grid = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
        links.append(_points(name, body, grid, spec, geometry.tree, motion, pose))
    if not links:
        raise UsageError(
            f"link_speed needs shapes, and robot '{spec.name}' has none",
            where="cartesian",
            next_step="Limit the speed of the tool point instead.",
        )
    return tuple(links)


def _points(
    name: str, body: int, at: Array, spec: ArmSpec, tree: KinematicTree, motion: BodyMotion, pose: Array
) -> Points:
    world = motion.position[body, 0] + at @ motion.rotation[body, 0].T
    chain = _chain(tree, body)
    travel = np.maximum(np.abs(spec.lower - pose), np.abs(spec.upper - pose))
    added = np.where(tree.joint_slides, travel, 0.0)
    joints = motion.anchor[:, 0], motion.axis[:, 0]
    reach = reaches(world, np.zeros(len(world)), chain, joints, tree.joint_slides, added)
    return Points(name, body, at, tuple(chain), reach)


def _chain(tree: KinematicTree, body: int) -> list[int]:
    """The joints that move a body, the innermost first; of several on one body, in their order."""
    chain: list[int] = []
    while body > 0:
        chain = [j for j in range(tree.joints) if tree.joint_body[j] == body] + chain
        body = int(tree.parent[body])
    return chain
