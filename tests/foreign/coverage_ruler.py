"""How much of where an arm can be its motions sweep, by a ruler that shares nothing with the search.

Distances are coal's, of the triangles of the description's own collision meshes, placed by pinocchio. The
clear range of a joint lies between the extremes of all clear poses that see home in a straight line: 10 mm
between parts, 2 mm between parts at most two joints apart, no margin for tracking, a hinge one turn about
home at most. Of 20 bins of that range those count as swept in which segments spend at least half a percent of
their time. Links between segments do not count.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.protocols import Trajectory
from etude.types import Array

MARGIN, NEAR_MARGIN, NEAR = 0.010, 0.002, 2
"""m between parts; m between parts with at most so many joints between them."""
BINS, LEAST = 20, 0.005
POSES, STEP = 20_000, 0.1
"""Random poses that are tried; rad (m) between poses of a line, of the joint that moves most."""
INSTANTS = 1000
"""Of each segment."""
LARGE = 4.0
"""m: half the edge of the slab that the floor is."""


@dataclass(frozen=True, eq=False)
class Ruler:
    """An arm in pinocchio and coal.

    Attributes:
        model, data, shapes, found: theirs. places: of the k joints in a configuration, two of an endless one.
        still: a configuration. lower, upper: (k,) ends of the ranges, a turn at most. home: (k,).
    """

    model: Any
    data: Any
    shapes: Any
    found: Any
    places: list[Any]
    still: Array
    lower: Array
    upper: Array
    home: Array

    def clear(self, pose: Array) -> bool:
        import pinocchio as pin

        q = self.still.copy()
        for place, value in zip(self.places, pose, strict=True):
            if isinstance(place, tuple):  # a joint without ends is a point on a circle
                q[place[0]], q[place[1]] = math.cos(value), math.sin(value)
            else:
                q[place] = value
        return not pin.computeCollisions(self.model, self.data, self.shapes, self.found, q, True)

    def sees_home(self, pose: Array) -> bool:
        count = max(3, math.ceil(float(np.abs(pose - self.home).max()) / STEP))
        steps = np.linspace(0.0, 1.0, count, endpoint=False)[1:]
        coarse = steps[:: max(1, len(steps) // 4)]
        return all(
            self.clear(self.home + s * (pose - self.home)) for s in (*coarse, *np.setdiff1d(steps, coarse))
        )

    def clear_range(self, rng: np.random.Generator, poses: int = POSES) -> tuple[Array, Array]:
        """(k,) ends of the clear range."""
        lower, upper = self.home.copy(), self.home.copy()
        for pose in rng.uniform(self.lower, self.upper, (poses, len(self.home))):
            inside = np.all((pose >= lower) & (pose <= upper))  # it would change nothing
            if not inside and self.clear(pose) and self.sees_home(pose):
                lower, upper = np.minimum(lower, pose), np.maximum(upper, pose)
        return lower, upper


def ruler_of(
    urdf: Path,
    packages: Sequence[Path],
    joints: Sequence[str],
    ends: tuple[Array, Array],
    home: Array,
    ignored: Sequence[Sequence[str]] = (),
    floor: float | None = None,
) -> Ruler:
    """The ruler of an arm.

    Args:
        urdf: its description. packages: folders in which its meshes are looked for.
        joints: k of them; all others are held at zero.
        ends: lower and upper (k,) limits. home: (k,).
        ignored: pairs of links that are not verified, as the robot file says. floor: its height, m.
    """
    import coal
    import pinocchio as pin

    folders = [str(folder) for folder in packages]
    model = pin.buildModelFromUrdf(str(urdf))
    shapes = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
    links = {shape.name: model.frames[shape.parentFrame].name for shape in shapes.geometryObjects}
    floors = []
    if floor is not None:
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, floor - 0.5]))
        slab = pin.GeometryObject("floor", 0, place, coal.Box(2.0 * LARGE, 2.0 * LARGE, 1.0))
        floors.append(shapes.addGeometryObject(slab))
        links["floor"] = "floor"
    out = {frozenset(pair) for pair in ignored}
    margins = []
    objects = list(shapes.geometryObjects)
    chains = [_chain(model, one.parentJoint, joints) for one in objects]
    for i, one in enumerate(objects):
        for k in range(i + 1, len(objects)):
            other = objects[k]
            apart, thing = len(chains[i] ^ chains[k]), k in floors
            if frozenset((links[one.name], links[other.name])) in out:
                continue
            if (thing and not chains[i]) or (not thing and apart < 2):
                continue
            shapes.addCollisionPair(pin.CollisionPair(i, k))
            margins.append(NEAR_MARGIN if not thing and apart <= NEAR else MARGIN)
    found = shapes.createData()
    for request, margin in zip(found.collisionRequests, margins, strict=True):
        request.security_margin = margin
    low, high = np.asarray(ends[0], dtype=float), np.asarray(ends[1], dtype=float)
    places: list[Any] = []
    for j, name in enumerate(joints):
        joint = model.joints[model.getJointId(name)]
        places.append((joint.idx_q, joint.idx_q + 1) if joint.nq == 2 else joint.idx_q)
        slides = joint.shortname().startswith("JointModelP")
        if not slides and high[j] - low[j] > 2.0 * math.pi:
            start = min(max(home[j] - math.pi, low[j]), high[j] - 2.0 * math.pi)
            low[j], high[j] = start, start + 2.0 * math.pi
    data = model.createData()
    return Ruler(model, data, shapes, found, places, pin.neutral(model), low, high, np.asarray(home))


def ruler_of_campaign(lab: Path, urdf: Path, packages: Sequence[Path]) -> Ruler:
    """Of the arm of a campaign folder: limits, home, floor and what is not verified are its robot file's."""
    robot = tomllib.loads((lab / "robot.toml").read_text())
    ends = np.array([[axis["lower"], axis["upper"]] for axis in robot["axis"]]).T
    ignored = robot.get("collision", {}).get("ignore", ())
    names, home = [axis["name"] for axis in robot["axis"]], np.array(robot["search"]["home"])
    height = robot.get("floor", {}).get("height")
    return ruler_of(urdf, packages, names, (ends[0], ends[1]), home, ignored, height)


def _chain(model: Any, joint: int, moving: Sequence[str]) -> frozenset[int]:
    """The joints that move a body."""
    found = set()
    while joint:
        found |= {joint} if model.names[joint] in moving else set()
        joint = model.parents[joint]
    return frozenset(found)


@dataclass(frozen=True, eq=False)
class Swept:
    """What proposals sweep: share (k,) of the bins of each joint; part of the time that links take; mean
    speed of each segment, rad/s over all joints.
    """

    share: Array
    links: float
    speeds: Array


def swept(proposals: Sequence[Trajectory], lower: Array, upper: Array) -> Swept:
    """Of one or more proposals together, in the clear range (k,), (k,)."""
    pieces = [piece for one in proposals for _, label, piece in one.pieces() if label == "segment"]
    seconds = np.zeros((len(lower), BINS))
    speeds = []
    for piece in pieces:
        orders = piece.motion(piece.duration * (np.arange(INSTANTS) + 0.5) / INSTANTS, 2).orders
        speeds.append(float(np.abs(orders[1]).mean()))
        for j, column in enumerate(orders[0].T):
            edges = np.linspace(lower[j], upper[j], BINS + 1)
            seconds[j] += np.histogram(column, edges)[0] * piece.duration / INSTANTS
    total = sum(piece.duration for piece in pieces)
    whole = sum(one.duration for one in proposals)
    return Swept((seconds >= LEAST * total).mean(axis=1), 1.0 - total / whole, np.array(speeds))
