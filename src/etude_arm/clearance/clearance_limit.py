"""Clearance limit: least distance of a robot from itself and from its surroundings, at all times.

The distance of a pair at home is no suitable margin, since it depends on the choice of home. Two parts with
at most two joints between them often pass each other with a few millimetres in every pose, by construction.
For these, the margin depends on the distances over all clear poses. Parts farther along the arm, and
surroundings, keep the whole margin.

A proof needs a solver that is right in every pose, but MuJoCo 4.0.0 sometimes returns a few millimetres for a
capsule deep inside another shape (about one pose in some thousand). So before a motion counts as proved, each
distance that the proof uses is compared with the slab across the solver's own direction. Shapes whose
bounding spheres are far apart need no slab. An ellipsoid has no corners: its distances are used unchecked.

Let P_j be the reach of joint j for a pair, and TV_j the joint's total variation between two samples. Between
them the distance d is at least max((d_1 + d_2 - P.TV) / 2, min(d_1, d_2) - P.TV), since it falls by at most
P.TV from either end. Intervals where this bound is below the required distance are halved.
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
from etude.limits.motion_limits import AxisLimit, tracked
from etude.limits.tracking_margins import ASSUMED
from etude.protocols import Family, Trajectory
from etude.trajectories.fourier import FourierTrajectory
from etude.types import Array, Cone, Index, Margins, Mask, Motion, Nearby, Proof
from etude_arm.clearance.clear_pose import BOX_ROOM
from etude_arm.clearance.distances import CUTOFF, TOLERANCE, Gaps
from etude_arm.clearance.path_poses import PosePath, path_of
from etude_arm.clearance.skeleton import BOX
from etude_arm.clearance.tracking_distance import Scene, all_keep, lost

METHOD = "distances of convex hulls at poses, and between them a bound on the motion of their points"
LOOK = 2
"""Searches check every n-th of a path's first samples."""
TAKEN = 0.75
"""Fraction of a gap's room at home, beyond what searches keep, that tracking may use. The rest is for motion:
neighbours that pass each other with 15 mm in every pose need a millimetre or two of it."""
SMALL = 0.1
"""Fraction of a joint's range: if no joint sweeps more, a motion gives hardly any information."""


NEIGHBOUR_JOINTS = 2
"""Largest number of joints between two parts that count as neighbours."""
FLOOR = 0.002
"""m, smallest margin of neighbours."""
SELDOM = 0.05
"""Fraction of the clear poses in which neighbours are closer than twice their margin."""
SEED = 21
"""Seed of the random poses: the margins of a robot are reproducible."""
POSES = 1024  # random poses that say which pairs can come near
AT_HOME = 0.5
"""Largest margin as a fraction of a pair's distance at home, so that home stays allowed."""


def margins_of_rows(gaps: Gaps, row_of: Index, home: Array, margin: float) -> Array:
    """Margin (r,) m of each row of a certificate.

    Args:
        gaps: of the robot. row_of: (n,) row of each gap.
        home: (k,) a clear pose, rad (m). margin: m.
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
    """Mask (r,) of the certificate's rows whose gaps are all between neighbours."""
    near = np.ones(rows, dtype=np.bool_)
    np.logical_and.at(near, row_of, neighbours(gaps))
    return near


def neighbours(gaps: Gaps) -> Mask:
    """Mask (n,) of gaps between two parts of the arm with at most `NEAR` joints between them."""
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
    """Least value of each row (T, r), from (T, n)."""
    least = np.full((rows, len(distances)), np.inf)
    np.minimum.at(least, row_of, distances.T)
    return np.asarray(least.T)


def excess(gaps: Gaps, poses: Array) -> Array:
    """Distances at poses (T, k) less those that a slab confirms, (T, n) m; 0 if confirmed."""
    distances = gaps.of_poses(poses)
    corrections = np.zeros_like(distances)
    count = len(gaps.sensed)
    if not count:
        return corrections
    scene = Scene.of(gaps, poses, np.zeros((len(poses), count), dtype=np.bool_))
    doubted = (distances[:, :count] > 0.0) & ~_far(gaps, scene)
    scene = Scene.of(gaps, poses, doubted)
    still = np.zeros(len(gaps.skeleton.joints))
    for i in np.flatnonzero(doubted.any(axis=0)):
        at = np.flatnonzero(doubted[:, i])
        short = distances[at, i] - scene.least(int(i), at, still)
        corrections[at, i] = np.where(short > TOLERANCE, short, 0.0)
    return corrections


def _far(gaps: Gaps, scene: Scene) -> Mask:
    """Mask (T, number of gaps between geoms) of bounding spheres that are more than `CUTOFF` apart."""
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
"""Every n-th of the first samples is checked before the others, since these find most collisions."""
MOST_EVALUATIONS = 20_000
"""Evaluations after which a motion counts as not proved."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The smallest distance of each of n gaps along a path.

    Attributes:
        proved: (n,) m, lower bounds for all times; if `touched`, the smallest of the samples.
        sampled: (n,) m, the smallest of the samples. x: (n,) its place on the path.
        touched: whether a sample is below the required distance.
        evaluations: number of poses.
    """

    proved: Array
    sampled: Array
    x: Array
    touched: bool
    evaluations: int


@dataclass
class Samples:
    """Poses of a path and their distances, collected step by step."""

    path: PosePath
    distances: Callable[[Array], Array]
    x: Array
    poses: Array
    rates: Array
    values: Array

    @classmethod
    def of(cls, path: PosePath, distances: Callable[[Array], Array], x: Array) -> Samples:
        poses, rates = path.at(x)
        return cls(path, distances, x, poses, rates, distances(poses))

    def add(self, x: Array) -> Index:
        """Adds samples and returns their indices."""
        more = Samples.of(self.path, self.distances, x)
        first = len(self.x)
        for name in ("x", "poses", "rates", "values"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))
        return np.arange(first, len(self.x))

    def bounds(self, left: Index, right: Index, reach: Array) -> Array:
        """Lower bounds (I, n) of the distances between the samples `left` and `right`, m."""
        fall = self.path.variation(self.x, self.poses, self.rates, left, right) @ reach.T
        one, other = self.values[left], self.values[right]
        return np.asarray(np.maximum(0.5 * (one + other - fall), np.minimum(one, other) - fall))

    def nearest(self, proved: Array, *, touched: bool) -> Nearest:
        least = self.values.argmin(axis=0)
        sampled = self.values[least, np.arange(self.values.shape[1])]
        return Nearest(
            sampled if touched else np.minimum(proved, sampled), sampled, self.x[least], touched, len(self.x)
        )


def nearest(
    path: PosePath,
    distances: Callable[[Array], Array],
    reach: Array,
    required: Array,
    excess: Callable[[Array], Array] | None = None,
) -> Nearest:
    """The smallest distances along a path, until all are proved to be `required` or a sample violates it.

    After the largest number of evaluations, proved bounds may still be below `required`: no decision.

    Args:
        path: the curve.
        distances: poses (T, k) -> (T, n) m, lower bounds included.
        reach: (n, k) P: a distance changes by at most P |dq|.
        required: (n,) m.
        excess: poses -> (T, n) m by which distances may be too large; only for samples that the proof uses.
    """
    first = Samples.of(path, distances, path.knots[::QUICK])
    if np.any(first.values < required):
        return first.nearest(required, touched=True)
    samples = Samples.of(path, distances, path.knots)
    left, right = np.arange(len(path.knots) - 1), np.arange(1, len(path.knots))
    closed = []
    while len(left):
        bounds = samples.bounds(left, right, reach)
        open_ = np.any(bounds < required, axis=1)
        closed.append((left[~open_], right[~open_]))
        touched = bool(np.any(samples.values < required))
        if touched or len(samples.x) + int(open_.sum()) > MOST_EVALUATIONS:
            return samples.nearest(bounds.min(axis=0), touched=touched)
        left, right = left[open_], right[open_]
        if len(left):
            middle = samples.add(0.5 * (samples.x[left] + samples.x[right]))
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    if excess is not None:
        samples.values = samples.values - excess(samples.poses)
    left, right = (np.concatenate(ends) for ends in zip(*closed, strict=True))
    proved = samples.bounds(left, right, reach).min(axis=0)
    return samples.nearest(proved, touched=bool(np.any(samples.values < required)))


@dataclass(frozen=True, eq=False)
class Clearance:
    """Limit: every gap keeps the margin of its row of the certificate.

    The limit is not convex: motions shrink towards home until it is proved. Its cones are no proof. They keep
    a search inside the box of nearly clear poses; later steps may enlarge results beyond it.

    Attributes:
        gaps: the checked distances.
        names: (k,) of the joints.
        home: (k,) a clear pose, rad (m).
        margin: m to keep; neighbours may keep less, see `margins_of_rows`.
        lower, upper: (k,) the box, rad (m).
        margins: of tracking, by form of motion.
        not_verified: sentences on what this limit does not cover.
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
    _verdicts: dict[str, bool] = field(default_factory=dict, repr=False)
    _shares: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @cached_property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Rows of the certificate: two rigid parts, or a part and an object of the surroundings."""
        return tuple(dict.fromkeys(gap.row for gap in self.gaps.list))

    @cached_property
    def row_of(self) -> Index:
        """Row (n,) of each gap."""
        place = {row: i for i, row in enumerate(self.rows)}
        return np.array([place[gap.row] for gap in self.gaps.list], dtype=np.int64)

    @cached_property
    def row_margins(self) -> Array:
        """Margin (r,) m of each row."""
        key = self.home.tobytes() + np.float64(self.margin).tobytes()
        cache = self.gaps.cached_margins  # cached, since a command makes its limits repeatedly
        if key not in cache:
            cache[key] = margins_of_rows(self.gaps, self.row_of, self.home, self.margin)
        return cache[key]

    def _by_row(self, distances: Array) -> Array:
        """Least value of each row (T, r), from (T, n)."""
        least = np.full((len(self.rows), len(distances)), np.inf)
        np.minimum.at(least, self.row_of, distances.T)
        return np.asarray(least.T)

    def cones(self, family: Family) -> Sequence[Cone]:
        """Cones of the box, for the search."""
        return AxisLimit("box", 0, self.names, self.lower, self.upper).cones(family)

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """Zero: a search that starts in collision stays there until the motion shrinks towards home."""
        return 0.0, np.zeros_like(motion.orders)

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each pair of rigid parts, and for each part and object of the surroundings."""
        return memoized(
            self._proofs, piece.to_json(), lambda: self._rows(path_of(piece), *self._error(piece))
        )

    def warned(self, trajectory: Trajectory) -> tuple[Notice, ...]:
        """Warning that hardly any motion is possible, if shapes close to each other at home are the cause."""
        at_home = self.gaps.of_poses(self.home[None])[0]
        nearest = int(at_home.argmin())
        paths = [
            path_of(piece) for _, _, piece in trajectory.pieces() if isinstance(piece, FourierTrajectory)
        ]
        if at_home[nearest] >= 2.0 * self.margin or not paths:
            return ()
        poses = np.concatenate([path.at(path.knots)[0] for path in paths])
        part = np.ptp(poses, axis=0) / (self.gaps.skeleton.upper - self.gaps.skeleton.lower)
        if part.max() >= SMALL:
            return ()
        fields = {"part": float(part.max()), "pair": self.gaps.list[nearest].text}
        return (Notice(Warn.HARDLY_MOVES, {**fields, "apart_mm": 1000.0 * float(at_home[nearest])}),)

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples keep all margins with a reserve; for searches, whose result is proved later."""
        return memoized(self._verdicts, piece.to_json(), lambda: self._sampled(piece))

    def _sampled(self, piece: Trajectory) -> bool:
        path, error = path_of(piece), self._error(piece)[0]
        x = path.knots[::LOOK]
        first, others = x[::QUICK], np.delete(x, np.s_[::QUICK])  # most that collide do so there
        return all(self._margins_hold(path.at(some)[0], error) for some in (first, others))

    def blocked(self, form: str, pose: Array) -> str:
        """The gap that falls most below its margin at the pose (k,); "" if none does."""
        error, _ = tracked(0.0, self.margins, form, 0, list(range(len(self.names))))
        spared = self._distances(pose[None], error)[0] - self._gap_margins
        nearest = int(spared.argmin())
        return self.gaps.list[nearest].text if spared[nearest] < 0.0 else ""

    def about(self, lower: Array, upper: Array) -> Clearance:
        """The same limit with another box for searches; both share cached proofs."""
        return replace(self, lower=lower, upper=upper)

    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]:
        """A function that checks margins at poses (T, k), with the effect of tracking as at `pose` (k,).

        It serves to choose between motions about that pose.
        """
        error, _ = tracked(0.0, self.margins, form, 0, list(range(len(self.names))))
        sought = self.sought + TOLERANCE
        if error.any():
            at = self.gaps.of_poses(pose[None]) - TOLERANCE
            sought = (
                sought + self._share(error) * lost(self.gaps, pose[None], at, error, self._gap_margins)[0]
            )
        sought = np.minimum(sought, CUTOFF)
        return lambda poses: bool(np.all(self.gaps.of_poses(poses) >= sought))

    def _margins_hold(self, poses: Array, error: Array) -> bool:
        """Whether `_distances` at poses (T, k) all keep the margins of searches."""
        distances = self.gaps.of_poses(poses) - TOLERANCE
        if not error.any() or np.any(distances < self._gap_margins):
            return bool(np.all(distances >= self.sought))
        return all_keep(
            self.gaps, poses, distances, error, self._share(error), self._gap_margins, self.sought
        )

    @cached_property
    def _gap_margins(self) -> Array:
        """Margin (n,) m of each gap."""
        return np.asarray(self.row_margins[self.row_of])

    @cached_property
    def sought(self) -> Array:
        """Margin (n,) m of each gap at samples in searches."""
        return np.asarray(self._gap_margins + np.minimum(BOX_ROOM, 0.5 * self._gap_margins))

    def _error(self, piece: Trajectory) -> tuple[Array, float]:
        """Tracking margins (k,) of the joints, rad (m), and their confidence."""
        error, confidence = tracked(0.0, self.margins, piece.form, 0, list(range(len(self.names))))
        return error, float(confidence.min())

    def _nearest(
        self, path: PosePath, error: Array, excess: Callable[[Array], Array] | None = None
    ) -> Nearest:
        return nearest(
            path, lambda poses: self._distances(poses, error), self.gaps.reach, self._gap_margins, excess
        )

    def _distances(self, poses: Array, error: Array) -> Array:
        """Lower bounds (T, n) m of the gaps at poses (T, k) and anywhere within the error (k,) of them."""
        distances = self.gaps.of_poses(poses) - TOLERANCE
        if not error.any() or np.any(distances < self._gap_margins):  # too close even without the error
            return distances
        return distances - self._share(error) * lost(self.gaps, poses, distances, error, self._gap_margins)

    def _share(self, error: Array) -> Array:
        """Fraction (n,) of the effect of tracking that counts.

        At home it takes at most `TAKEN` of what is left beyond the margins of searches. Neighbours of some
        robots pass each other with a few millimetres in every pose. A margin learned from poor tracking would
        forbid every motion, and even home.
        """
        key = error.tobytes()
        if key not in self._shares:
            at_home = self.gaps.of_poses(self.home[None]) - TOLERANCE
            taken = lost(self.gaps, self.home[None], at_home, error, self._gap_margins)[0]
            room = TAKEN * np.maximum(at_home[0] - self.sought, 0.0)
            self._shares[key] = np.minimum(1.0, room / np.maximum(taken, np.finfo(float).tiny))
        return self._shares[key]

    def _rows(self, path: PosePath, error: Array, confidence: float) -> tuple[Proof, ...]:
        """The certificate's rows; for a refused motion they hold the values at samples."""
        result = self._nearest(path, error, lambda poses: excess(self.gaps, poses))
        status: Literal["proved", "sampled"] = "sampled" if result.touched else "proved"
        groups = [np.flatnonzero(self.row_of == i) for i in range(len(self.rows))]
        worst = np.array([gaps[np.argmin(result.sampled[gaps])] for gaps in groups])
        x = result.x[worst]
        planned = self.gaps.of_poses(path.at(x)[0])[np.arange(len(worst)), worst] - TOLERANCE
        taken = np.maximum(planned - result.sampled[worst], 0.0) if error.any() else np.zeros(len(worst))
        share = self._share(error) if error.any() else np.ones(len(self.gaps.list))
        rows = []
        for i, (row, time) in enumerate(zip(self.rows, path.time(x), strict=True)):
            # beyond the measured distances: the nearest gap is unknown
            far = planned[i] >= CUTOFF - 2.0 * TOLERANCE
            counted = float(share[groups[i]].min())
            where = "" if far else f"{self.gaps.list[worst[i]].text} at {time:.3g} s"
            notes = [f"planned distance {CUTOFF:g} m or more"] if far and taken[i] > 0.0 else []
            if counted < 1.0:
                notes += [f"tracking errors counted at {math.floor(100.0 * counted)}%: no room for more"]
            limit = float(self.row_margins[i]), np.inf, float(result.proved[groups[i]].min()), CUTOFF
            tracking = float(taken[i]), confidence if counted == 1.0 else ASSUMED
            own_row = Proof(" and ".join(row), self.name, *limit, METHOD, status, *tracking, where)
            rows.append(replace(own_row, note="; ".join(notes)))
        return tuple(rows)

    def of_motion(self, motion: Motion) -> Array:
        """Least distance (T, r) m of each row, at most `CUTOFF`."""
        return self._by_row(self.gaps.of_poses(motion.orders[0]))

    def nearby(self, poses: Array, lines: int) -> Nearby:
        """Distances of the rows at planned poses (T, k), without the effect of tracking."""
        distances = self.gaps.of_poses(poses) - TOLERANCE
        distance = self._by_row(distances)
        near = neighbour_rows(self.gaps, self.row_of, len(self.rows))
        narrowest = np.argsort(distance - self.row_margins + 2.0 * CUTOFF * near, axis=1, kind="stable")[
            :, :lines
        ]
        groups = [np.flatnonzero(self.row_of == i) for i in range(len(self.rows))]
        gap_of = np.stack([gaps[distances[:, gaps].argmin(axis=1)] for gaps in groups], axis=1)
        ends = self.gaps.ends(poses, np.take_along_axis(gap_of, narrowest, axis=1))
        return Nearby(self.rows, self.row_margins, near, distance, narrowest, ends, CUTOFF - TOLERANCE)
