"""Clearance limit: least distance of a robot from itself and from its surroundings, at all times.

What a pair has at home says little: a home a hand's breadth away would keep something else. Two parts with at
most two joints between them often pass each other with a few millimetres whatever the pose, by construction:
of these the distances over all clear poses count. Parts farther along the arm, and what stands around, keep
the whole margin.

A solver that is right in all but one of some thousand poses is not enough for a proof: MuJoCo 4.0.0 sometimes
gives a few millimetres for a capsule deep inside another shape. So before a motion counts as proved, each
distance that it rests on is held against the slab across the direction that the solver itself names. Shapes
whose spheres are far apart need no slab. An ellipsoid has no corners: its distances are taken as they are.

With P_j the reach of joint j for a pair and TV_j the way that the joint makes between two samples, its
distance d is in between at least max((d_1 + d_2 - P.TV) / 2, min(d_1, d_2) - P.TV): it falls by at most P.TV
from either end. Intervals where that is less than is wanted are halved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from etude.codes import Notice, Warn
from etude.limits.certificate import COLLISIONS, memoized
from etude.limits.convex_limits import AxisLimit, tracked
from etude.limits.tracking_margins import ASSUMED
from etude.protocols import Family, Trajectory
from etude.trajectories.fourier import FourierTrajectory
from etude.types import Array, Cone, Index, Margins, Mask, Motion, Nearby, Proof
from etude_arm.clearance.clear_pose import BOX_ROOM
from etude_arm.clearance.distances import CUTOFF, TOLERANCE, Gaps
from etude_arm.clearance.path_poses import PosePath, path_of
from etude_arm.clearance.skeleton import BOX
from etude_arm.clearance.tracking_distance import Scene, all_keep, lost

METHOD = "distances of convex hulls at poses, and between them how far joints can carry a point"
LOOK = 2
"""One of so many of a way's first samples is looked at in searches."""
TAKEN = 0.75
"""Of the room that a gap has at home beyond what searches keep, the part that tracking may take. The rest is
for motion: neighbours that pass each other with 15 mm in every pose need a millimetre or two of it."""
SMALL = 0.1
"""Of a joint's range: where no joint goes through more, a motion teaches hardly anything."""


NEIGHBOUR_JOINTS = 2
"""Joints between two parts that are neighbours."""
FLOOR = 0.002
"""m, that neighbours keep at least."""
SELDOM = 0.05
"""Part of the clear poses in which neighbours are nearer than twice what they keep."""
SEED = 21
"""Of the poses that are looked at: the same robot always keeps the same."""
POSES = 1024  # random poses that say which pairs can come near
AT_HOME = 0.5
"""Of what a pair has at home, the part that is kept at most: home itself must stay allowed."""


def kept(gaps: Gaps, row_of: Index, home: Array, margin: float) -> Array:
    """(r,) m that each row of a certificate keeps.

    Args:
        gaps: of the robot. row_of: (n,) each gap's row.
        home: (k,) a clear pose. margin: m.
    """
    rows = int(row_of.max(initial=-1)) + 1
    at_home = _by_row(gaps.of_poses(home[None]), row_of, rows)[0]
    near = neighbour_rows(gaps, row_of, rows)
    poses = gaps.skeleton.random_poses(np.random.default_rng(SEED), POSES)
    apart = gaps.of_poses(poses)
    clear = apart[np.all(apart > TOLERANCE, axis=1)]
    most = np.full(rows, margin)
    if len(clear):
        usual = np.quantile(_by_row(clear, row_of, rows), SELDOM, axis=0)
        most = np.where(near, np.clip(0.5 * usual, min(FLOOR, margin), margin), margin)
    return np.asarray(np.minimum(most, AT_HOME * at_home))


def neighbour_rows(gaps: Gaps, row_of: Index, rows: int) -> Mask:
    """(r,) whether a row of a certificate has gaps of neighbours alone."""
    near = np.ones(rows, dtype=np.bool_)
    np.logical_and.at(near, row_of, neighbours(gaps))
    return near


def neighbours(gaps: Gaps) -> Mask:
    """(n,) whether a gap is between two parts of the arm with at most `NEAR` joints between them."""
    skeleton, shapes = gaps.skeleton, gaps.skeleton.shapes
    return np.array(
        [
            gap.other >= 0
            and not shapes[gap.other].name.startswith(BOX)
            and int(skeleton.between(shapes[gap.one].part, shapes[gap.other].part).sum()) <= NEIGHBOUR_JOINTS
            for gap in gaps.list
        ],
        dtype=np.bool_,
    )


def _by_row(distances: Array, row_of: Index, rows: int) -> Array:
    """(T, r) the least of each row, from (T, n)."""
    found = np.full((rows, len(distances)), np.inf)
    np.minimum.at(found, row_of, distances.T)
    return np.asarray(found.T)


def excess(gaps: Gaps, poses: Array) -> Array:
    """(T, n) m by which distances at poses (T, k) are larger than what a slab confirms; 0 if confirmed."""
    distances = gaps.of_poses(poses)
    found = np.zeros_like(distances)
    count = len(gaps.sensed)
    if not count:
        return found
    scene = Scene.of(gaps, poses, np.zeros((len(poses), count), dtype=np.bool_))
    doubted = (distances[:, :count] > 0.0) & ~_far(gaps, scene)
    scene = Scene.of(gaps, poses, doubted)
    still = np.zeros(len(gaps.skeleton.joints))
    for i in np.flatnonzero(doubted.any(axis=0)):
        at = np.flatnonzero(doubted[:, i])
        short = distances[at, i] - scene.least(int(i), at, still)
        found[at, i] = np.where(short > TOLERANCE, short, 0.0)
    return found


def _far(gaps: Gaps, scene: Scene) -> Mask:
    """(T, number of gaps between geoms) where spheres around both are farther apart than anybody looks."""
    shapes = gaps.skeleton.shapes
    centres, sizes = [], []
    for shape in shapes:
        middle = 0.5 * (shape.points.min(axis=0) + shape.points.max(axis=0))
        sizes.append(np.linalg.norm(shape.points - middle, axis=1).max() + shape.radius)
        centres.append(scene.turns[:, shape.geom] @ middle + scene.places[:, shape.geom])
    pairs = [(gap.one, gap.other) for gap in gaps.sensed]
    apart = [np.linalg.norm(centres[a] - centres[b], axis=1) - sizes[a] - sizes[b] for a, b in pairs]
    smooth = [shapes[a].smooth or shapes[b].smooth for a, b in pairs]
    return np.asarray((np.stack(apart, axis=1) >= CUTOFF) | np.array(smooth))


QUICK = 4
"""One of so many of the first samples is looked at before the others: most that collide do so there."""
MOST_EVALUATIONS = 20_000
"""Evaluations after which a motion counts as not proved."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The least distance of each of n gaps along a way.

    Attributes:
        proved: (n,) m, no distance is less at any time; where one is touched, the least of the samples.
        seen: (n,) m, the least of the samples. x: (n,) where that was.
        touched: whether a sample has less than was wanted.
        evaluations: poses.
    """

    proved: Array
    seen: Array
    x: Array
    touched: bool
    evaluations: int


@dataclass
class Samples:
    """Poses of a way and their distances, as they come in."""

    path: PosePath
    distances: Callable[[Array], Array]
    x: Array
    poses: Array
    rates: Array
    found: Array

    @classmethod
    def of(cls, path: PosePath, distances: Callable[[Array], Array], x: Array) -> Samples:
        poses, rates = path.at(x)
        return cls(path, distances, x, poses, rates, distances(poses))

    def add(self, x: Array) -> Index:
        """Places of the new samples."""
        more = Samples.of(self.path, self.distances, x)
        first = len(self.x)
        for name in ("x", "poses", "rates", "found"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))
        return np.arange(first, len(self.x))

    def bounds(self, left: Index, right: Index, reach: Array) -> Array:
        """(I, n) below which no distance falls between those samples."""
        fall = self.path.variation(self.x, self.poses, self.rates, left, right) @ reach.T
        one, other = self.found[left], self.found[right]
        return np.asarray(np.maximum(0.5 * (one + other - fall), np.minimum(one, other) - fall))

    def nearest(self, proved: Array, *, touched: bool) -> Nearest:
        least = self.found.argmin(axis=0)
        seen = self.found[least, np.arange(self.found.shape[1])]
        return Nearest(
            seen if touched else np.minimum(proved, seen), seen, self.x[least], touched, len(self.x)
        )


def nearest(
    path: PosePath,
    distances: Callable[[Array], Array],
    reach: Array,
    wanted: Array,
    excess: Callable[[Array], Array] | None = None,
) -> Nearest:
    """The least distances along a way, until all are proved to be `wanted` or one is found not to be.

    After `MOST` evaluations what is proved may be less than wanted: then nobody knows.

    Args:
        path: the curve.
        distances: poses (T, k) -> (T, n) m, lower bounds included.
        reach: (n, k) P: a distance changes by at most P |dq|.
        wanted: (n,) m.
        excess: poses -> (T, n) m by which distances may be too large, asked of those that all rests on.
    """
    first = Samples.of(path, distances, path.knots[::QUICK])
    if np.any(first.found < wanted):
        return first.nearest(wanted, touched=True)
    samples = Samples.of(path, distances, path.knots)
    left, right = np.arange(len(path.knots) - 1), np.arange(1, len(path.knots))
    closed = []
    while len(left):
        bounds = samples.bounds(left, right, reach)
        open_ = np.any(bounds < wanted, axis=1)
        closed.append((left[~open_], right[~open_]))
        touched = bool(np.any(samples.found < wanted))
        if touched or len(samples.x) + int(open_.sum()) > MOST_EVALUATIONS:
            return samples.nearest(bounds.min(axis=0), touched=touched)
        left, right = left[open_], right[open_]
        if len(left):
            middle = samples.add(0.5 * (samples.x[left] + samples.x[right]))
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    if excess is not None:
        samples.found = samples.found - excess(samples.poses)
    left, right = (np.concatenate(ends) for ends in zip(*closed, strict=True))
    proved = samples.bounds(left, right, reach).min(axis=0)
    return samples.nearest(proved, touched=bool(np.any(samples.found < wanted)))


@dataclass(frozen=True, eq=False)
class Clearance:
    """A limit of `contracts`: every gap at least as wide as its row of the certificate says.

    Not convex: motions are drawn home until it is proved. Its cones are no proof; they keep a search inside
    the box where nearly all poses are clear, and what is found there may be grown beyond it.

    Attributes:
        gaps: what is looked at.
        names: (k,) of the joints.
        home: (k,) a clear pose.
        margin: m to keep; neighbours may keep less, see `kept`.
        lower, upper: (k,) the box.
        margins: of tracking, by form of motion.
        not_verified: sentences, what this limit leaves out.
    """

    gaps: Gaps
    names: tuple[str, ...]
    home: Array
    margin: float
    lower: Array
    upper: Array
    margins: Margins = field(default_factory=dict)
    not_verified: tuple[str, ...] = ()
    looks_at: tuple[str, ...] = (COLLISIONS,)
    name: str = "clearance"
    _proofs: dict[str, tuple[Proof, ...]] = field(default_factory=dict, repr=False)
    _words: dict[str, bool] = field(default_factory=dict, repr=False)
    _shares: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @cached_property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Of the certificate: rigid parts, or a part and what stands around."""
        return tuple(dict.fromkeys(gap.row for gap in self.gaps.list))

    @cached_property
    def row_of(self) -> Index:
        """(n,) each gap's row."""
        place = {row: i for i, row in enumerate(self.rows)}
        return np.array([place[gap.row] for gap in self.gaps.list], dtype=np.int64)

    @cached_property
    def kept(self) -> Array:
        """(r,) m that each row keeps."""
        key = self.home.tobytes() + np.float64(self.margin).tobytes()
        known = self.gaps.kept_at  # a command asks for its limits often
        if key not in known:
            known[key] = kept(self.gaps, self.row_of, self.home, self.margin)
        return known[key]

    def _by_row(self, distances: Array) -> Array:
        """(T, r) the least of each row, from (T, n)."""
        found = np.full((len(self.rows), len(distances)), np.inf)
        np.minimum.at(found, self.row_of, distances.T)
        return np.asarray(found.T)

    def cones(self, family: Family) -> Sequence[Cone]:
        """The box, for the search."""
        return AxisLimit("box", 0, self.names, self.lower, self.upper).cones(family)

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """None that pushes: a search that starts in collision stays there, and the way home gets it out."""
        return 0.0, np.zeros_like(motion.orders)

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each pair of rigid parts, and for each part and what stands around."""
        return memoized(
            self._proofs, piece.to_json(), lambda: self._rows(path_of(piece), *self._error(piece))
        )

    def warned(self, trajectory: Trajectory) -> tuple[Notice, ...]:
        """That next to no motion is left, where shapes that are close at home leave no more; else nothing."""
        at_home = self.gaps.of_poses(self.home[None])[0]
        nearest = int(at_home.argmin())
        ways = [path_of(piece) for _, _, piece in trajectory.pieces() if isinstance(piece, FourierTrajectory)]
        if at_home[nearest] >= 2.0 * self.margin or not ways:
            return ()
        poses = np.concatenate([path.at(path.knots)[0] for path in ways])
        part = np.ptp(poses, axis=0) / (self.gaps.skeleton.upper - self.gaps.skeleton.lower)
        if part.max() >= SMALL:
            return ()
        fields = {"part": float(part.max()), "pair": self.gaps.list[nearest].text}
        return (Notice(Warn.HARDLY_MOVES, {**fields, "apart_mm": 1000.0 * float(at_home[nearest])}),)

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples keep all that with a little to spare: for searches, whose result is then proved."""
        return memoized(self._words, piece.to_json(), lambda: self._sampled(piece))

    def _sampled(self, piece: Trajectory) -> bool:
        path, error = path_of(piece), self._error(piece)[0]
        x = path.knots[::LOOK]
        first, others = x[::QUICK], np.delete(x, np.s_[::QUICK])  # most that collide do so there
        return all(self._kept_at(path.at(some)[0], error) for some in (first, others))

    def blocked(self, form: str, pose: Array) -> str:
        """The gap that is narrowest for what it keeps, where that is too narrow."""
        error, _ = tracked(0.0, self.margins, form, 0, list(range(len(self.names))))
        spared = self._distances(pose[None], error)[0] - self._wanted
        nearest = int(spared.argmin())
        return self.gaps.list[nearest].text if spared[nearest] < 0.0 else ""

    def about(self, lower: Array, upper: Array) -> Clearance:
        """The same limit with another box for searches; both remember what either has proved."""
        return replace(self, lower=lower, upper=upper)

    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]:
        """Whether poses (T, k) keep all that, if tracking takes everywhere what it takes at `pose` (k,): to
        choose between motions about it.
        """
        error, _ = tracked(0.0, self.margins, form, 0, list(range(len(self.names))))
        sought = self.sought + TOLERANCE
        if error.any():
            at = self.gaps.of_poses(pose[None]) - TOLERANCE
            sought = sought + self._share(error) * lost(self.gaps, pose[None], at, error, self._wanted)[0]
        sought = np.minimum(sought, CUTOFF)
        return lambda poses: bool(np.all(self.gaps.of_poses(poses) >= sought))

    def _kept_at(self, poses: Array, error: Array) -> bool:
        """Whether `_distances` at poses (T, k) are all what searches keep."""
        found = self.gaps.of_poses(poses) - TOLERANCE
        if not error.any() or np.any(found < self._wanted):
            return bool(np.all(found >= self.sought))
        return all_keep(self.gaps, poses, found, error, self._share(error), self._wanted, self.sought)

    @cached_property
    def _wanted(self) -> Array:
        """(n,) m that each gap keeps."""
        return np.asarray(self.kept[self.row_of])

    @cached_property
    def sought(self) -> Array:
        """(n,) m that samples of each gap keep in searches."""
        return np.asarray(self._wanted + np.minimum(BOX_ROOM, 0.5 * self._wanted))

    def _error(self, piece: Trajectory) -> tuple[Array, float]:
        """(k,) what the real joints may be off, and how sure that is."""
        error, confidence = tracked(0.0, self.margins, piece.form, 0, list(range(len(self.names))))
        return error, float(confidence.min())

    def _nearest(
        self, path: PosePath, error: Array, excess: Callable[[Array], Array] | None = None
    ) -> Nearest:
        return nearest(
            path, lambda poses: self._distances(poses, error), self.gaps.reach, self._wanted, excess
        )

    def _distances(self, poses: Array, error: Array) -> Array:
        """(T, n) m that no gap is less at poses (T, k), nor anywhere within the error (k,) of them."""
        found = self.gaps.of_poses(poses) - TOLERANCE
        if not error.any() or np.any(found < self._wanted):  # too near as it is
            return found
        return found - self._share(error) * lost(self.gaps, poses, found, error, self._wanted)

    def _share(self, error: Array) -> Array:
        """(n,) of what tracking can take, the part that is counted: at home it takes `TAKEN` at most of the
        room beyond what searches keep.

        Neighbours of some robots pass each other with a few millimetres in every pose, so a margin that was
        learned from poor tracking would forbid all motion, also the home that margins before it allowed.
        """
        key = error.tobytes()
        if key not in self._shares:
            at_home = self.gaps.of_poses(self.home[None]) - TOLERANCE
            taken = lost(self.gaps, self.home[None], at_home, error, self._wanted)[0]
            room = TAKEN * np.maximum(at_home[0] - self.sought, 0.0)
            self._shares[key] = np.minimum(1.0, room / np.maximum(taken, np.finfo(float).tiny))
        return self._shares[key]

    def _rows(self, path: PosePath, error: Array, confidence: float) -> tuple[Proof, ...]:
        """The certificate's rows; of a motion that is refused, what samples show."""
        found = self._nearest(path, error, lambda poses: excess(self.gaps, poses))
        status: Literal["proved", "sampled"] = "sampled" if found.touched else "proved"
        own = [np.flatnonzero(self.row_of == i) for i in range(len(self.rows))]
        worst = np.array([gaps[np.argmin(found.seen[gaps])] for gaps in own])
        x = found.x[worst]
        planned = self.gaps.of_poses(path.at(x)[0])[np.arange(len(worst)), worst] - TOLERANCE
        taken = np.maximum(planned - found.seen[worst], 0.0) if error.any() else np.zeros(len(worst))
        share = self._share(error) if error.any() else np.ones(len(self.gaps.list))
        rows = []
        for i, (row, time) in enumerate(zip(self.rows, path.time(x), strict=True)):
            far = (
                planned[i] >= CUTOFF - 2.0 * TOLERANCE
            )  # beyond what is measured: nobody knows what is nearest
            counted = float(share[own[i]].min())
            where = "" if far else f"{self.gaps.list[worst[i]].text} at {time:.3g} s"
            notes = [f"{CUTOFF:g} m or more as planned"] if far and taken[i] > 0.0 else []
            if counted < 1.0:
                notes += [f"tracking errors counted at {math.floor(100.0 * counted)}%: no room for more"]
            limit = float(self.kept[i]), np.inf, float(found.proved[own[i]].min()), CUTOFF
            tracking = float(taken[i]), confidence if counted == 1.0 else ASSUMED
            own_row = Proof(" and ".join(row), self.name, *limit, METHOD, status, *tracking, where)
            rows.append(replace(own_row, note="; ".join(notes)))
        return tuple(rows)

    def of_motion(self, motion: Motion) -> Array:
        """(T, r) m, the least distance of each row, at most `CUTOFF`."""
        return self._by_row(self.gaps.of_poses(motion.orders[0]))

    def nearby(self, poses: Array, lines: int) -> Nearby:
        """What rows measure at poses (T, k): as planned, without what tracking can take."""
        found = self.gaps.of_poses(poses) - TOLERANCE
        distance = self._by_row(found)
        near = neighbour_rows(self.gaps, self.row_of, len(self.rows))
        narrowest = np.argsort(distance - self.kept + 2.0 * CUTOFF * near, axis=1, kind="stable")[:, :lines]
        own = [np.flatnonzero(self.row_of == i) for i in range(len(self.rows))]
        gap_of = np.stack([gaps[found[:, gaps].argmin(axis=1)] for gaps in own], axis=1)
        ends = self.gaps.ends(poses, np.take_along_axis(gap_of, narrowest, axis=1))
        return Nearby(self.rows, self.kept, near, distance, narrowest, ends, CUTOFF - TOLERANCE)
