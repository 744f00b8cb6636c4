"""How fast a robot's tool and links move through space, and where the tool stays: proved for all times.

A point's velocity v between two samples h apart stays within h^2/8 max |v''| of the line between them, and
lengths are convex: |v| <= max(|v_k|, |v_k+1|) + h^2/8 max |p'''|. The bound of p''' is `reach.bent`, from the
proved rates of the joints. Of a link it is enough to look at the corners of a box around it, since velocities
of a rigid body are affine in the point. Places are bounded alike, by p''.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from etude.errors import UsageError
from etude.limits.certificate import SPEED, memoized
from etude.operators import cross
from etude.protocols import Family, Trajectory
from etude.types import Array, Cone, Motion, Proof
from etude_arm.clearance.way import largest
from etude_arm.physics.kinematics import BodyMotion, KinematicTree, body_motion
from etude_arm.space.reach import bent
from etude_arm.space.table import Cartesian

LOOSE = 0.003
"""Part of a limit that may be lost between samples: they are as near as that needs."""
LEAST, MOST = 1e-3, 0.02
"""s between samples."""
LOOK = 0.04
"""s between samples in searches."""
CLOSE = 0.99
"""Part of a limit that is used in searches: the proof then has room."""
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
    """A limit of `contracts`; not convex: motions are drawn home until it is proved.

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
    def not_looked_at(self) -> tuple[str, ...]:
        """Of the two speeds, the one without a limit."""
        speeds = {"tool": self.table.speed, "links": self.table.link_speed}
        return tuple(
            f"How fast the {what} may move through space." for what, most in speeds.items() if most is None
        )

    @property
    def rows(self) -> list[tuple[str, str, float, float]]:
        """Axis, quantity, lower and upper limit, in the order of `of_motion`."""
        table, name = self.table, self.tool.name
        found: list[tuple[str, str, float, float]] = []
        if table.speed is not None:
            found.append((name, "tool speed", -table.speed, table.speed))
        if table.lower is not None and table.upper is not None:
            sides = zip(PLACES, table.lower, table.upper, strict=True)
            found += [(f"{name} {axis}", "tool position", low, high) for axis, low, high in sides]
        if table.radius is not None:
            found.append((name, "tool radius", -table.radius, table.radius))
        if table.link_speed is not None:
            most = table.link_speed
            found += [(link.name, "link speed", -most, most) for link in self.links]
        return found

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """None that pushes: what is too fast is drawn home."""
        return 0.0, np.zeros_like(motion.orders)

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples keep all that with a little to spare: for searches, whose result is then proved."""
        count = max(2, math.ceil(piece.duration / LOOK)) + 1
        found = self.of_motion(piece.motion(np.linspace(0.0, piece.duration, count), 2))
        ends = np.array([[low, high] for _, _, low, high in self.rows])
        middle, half = ends.mean(axis=1), 0.5 * np.ptp(ends, axis=1)
        return bool(np.all(np.abs(found - middle) <= CLOSE * half))

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """A row for each quantity; UsageError of curves whose acceleration nothing bounds."""
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
            math.sqrt(8.0 * room / bend) if bend > 0.0 else math.inf
            for room, bend in zip(loose, speeds if gentle else places, strict=True)
        ]
        step = float(np.clip(min(fits, default=MOST), LEAST, MOST))
        count = max(2, math.ceil(piece.duration / step)) + 1
        t = np.linspace(0.0, piece.duration, count)
        step = float(t[1] - t[0])
        found = self.of_motion(piece.motion(t, 2))
        out = []
        for (axis, quantity, low, high), values, bend, rough in zip(
            rows, found.T, speeds, places, strict=True
        ):
            slow = "speed" not in quantity
            more = step**2 / 8.0 * bend if slow or gentle else 0.5 * step * rough
            size = quantity != "tool position"
            most = float(values.max()) + more
            least = -most if size else float(values.min()) - more
            method = f"samples every {1000.0 * step:.2g} ms, and {more:.2g} between, from the joints' rates"
            out.append(Proof(axis, quantity, low, high, least, most, method))
        return tuple(out)

    def _bends(self, piece: Trajectory) -> tuple[list[float], list[float], bool]:
        """By row the bounds of p'' and of what is limited: p''' of speeds, p'' of places; whether there is a
        third.
        """
        if getattr(piece, "held", False):
            raise UsageError("how fast a robot goes between set-points that are held is its receiver's word")
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
            own = tool
            if quantity == "link speed":
                link = links.pop(0)
                own = bent(link.reach, link.chain, rates)
            second.append(float(own[0]))
            third.append(float(own[1]) if "speed" in quantity else float(own[0]))
        return second, third, gentle
