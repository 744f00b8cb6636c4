"""Candidates: random trajectories inside the limits, and curves about poses all over the workspace.

Boxes in which nearly every pose is clear are small, but a motion needs only a clear curve. So each candidate
starts at a random clear pose, half of them in bins that were not visited yet. It is shrunk towards that pose
until its path is clear. Then each side of each coordinate is extended separately while the path stays clear.
Refinement by the information criterion stays inside the resulting box; a result that is not clear is shrunk
towards the candidate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from etude.abilities import SupportsBlocking, SupportsBoxes
from etude.design.nonconvex_limits import FEW_HALVINGS, NonconvexLimits, last_true
from etude.errors import UnsafeTrajectoryError
from etude.limits.feasible import FeasibleSet, still_at
from etude.limits.samplers import amplitude, boundary, scaled, uniform
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array, Mask, Reachable

Sampler = Literal["scaled", "uniform"]
Sample = Callable[[np.random.Generator, FeasibleSet, int], Array]

AMPLITUDE_SHARE = 4
"""One scaled candidate in this many has a random amplitude, since slow motion is sometimes missing."""
STEPS = 60
"""Steps of the random walk to each uniform candidate; they must differ, but need not be exactly uniform."""


@dataclass(frozen=True, eq=False)
class SampledPoint:
    """A point p (P,) of the feasible set of a family whose omega0 has been drawn."""

    family: Family
    feasible: FeasibleSet
    p: Array

    @property
    def trajectory(self) -> Trajectory:
        return self.family.trajectory(self.p)

    @property
    def standing(self) -> Array:
        """(P,) parameters of rest at a pose that keeps all limits."""
        return self.feasible.centre

    def home(self, nonconvex: NonconvexLimits) -> SampledPoint:
        """The sample, shrunk towards home until its limits pass fast checks."""
        p = nonconvex.shrink_to_home(self.family, self.standing, self.p, FEW_HALVINGS, fast_check=True)
        return self if p is self.p else replace(self, p=p)

    def may_exceed(self, nonconvex: NonconvexLimits, worth: Callable[[Array], float], least: float) -> bool:
        """Whether the value of `home` may exceed `least`; that of the sample itself does.

        The smaller a motion the less it is worth, and the smaller its commands. So where these fail at a
        scale of no more than that value, it will not exceed it.
        """
        if not nonconvex.growing:
            return True
        outside, steps = self.p - self.standing, int(2**FEW_HALVINGS)
        scale = last_true(lambda k: worth(self.standing + k / steps * outside) <= least, 0, steps)
        checked = replace(nonconvex, limits=nonconvex.growing)
        return checked.proved(self.family, self.standing + scale / steps * outside, fast_check=True)

    def allowed(self, nonconvex: NonconvexLimits, p: Array, worth: Callable[[Array], float]) -> SampledPoint:
        """The result p (P,) of a search, shrunk until its limits pass fast checks, and then enlarged where
        that does not lower its value.
        """
        p = nonconvex.shrink_to_home(self.family, self.standing, p, fast_check=True)
        return replace(self, p=nonconvex.expand(self.family, self.standing, p, worth))


@dataclass(frozen=True, eq=False)
class Source:
    """Source of random trajectories: a family, its limits, a pose inside them, a sampler."""

    family: Family
    limits: tuple[Limit, ...]
    home: Array
    sampler: Sampler

    def candidates(self, rng: np.random.Generator, count: int) -> list[SampledPoint]:
        """`count` candidates: a quarter with random amplitude, or half on the edge, see the sampler.

        They keep the convex limits; those that may win are later shrunk to the other limits.

        Raises:
            UnsafeTrajectoryError: the limits leave no room.
        """
        if self.sampler == "uniform":
            half = count // 2
            first = self._sampled(rng, count - half, lambda r, s, n: uniform(r, s, n, STEPS))
            return [*first, *self._sampled(rng, half, boundary)]
        slow = count // AMPLITUDE_SHARE
        return [*self._sampled(rng, count - slow, scaled), *self._sampled(rng, slow, amplitude)]

    def typical(self, rng: np.random.Generator, count: int, *, expanded: bool = False) -> list[SampledPoint]:
        """`count` large trajectories to replace tasks; expanded: enlarged, as first trajectories."""
        sampled = self._sampled(rng, count, uniform if self.sampler == "uniform" else scaled)
        points = [drawn.home(NonconvexLimits.of(self.limits, drawn.family, drawn.p)) for drawn in sampled]
        return [self._expanded(drawn) for drawn in points] if expanded else points

    def _expanded(self, drawn: SampledPoint) -> SampledPoint:
        nonconvex = NonconvexLimits.of(self.limits, drawn.family, drawn.p)
        home = drawn.feasible.centre
        p = nonconvex.expand(drawn.family, home, drawn.p)
        return replace(drawn, p=nonconvex.settled(drawn.family, home, p))

    @cached_property
    def _whole(self) -> FeasibleSet:
        return self._set(self.family)

    def _set(self, family: Family) -> FeasibleSet:
        return FeasibleSet.of(self.limits, family, self.home)

    def _sampled(self, rng: np.random.Generator, count: int, sample: Sample) -> list[SampledPoint]:
        """Samples of the family; without random draws it has one feasible set and is sampled at once."""
        families = [self.family.drawn(rng) for _ in range(count)]
        sampled: dict[int, SampledPoint] = {}
        for family in {id(one): one for one in families}.values():
            places = [i for i, one in enumerate(families) if one is family]
            feasible = self._whole if family is self.family else self._set(family)
            points = sample(rng, feasible, len(places))
            sampled |= {
                place: SampledPoint(family, feasible, p) for place, p in zip(places, points, strict=True)
            }
        return [sampled[place] for place in range(count)]


CENTRES = 6
"""Number of clear poses that are tried for a segment."""
TRIES = 3
"""Largest number of repetitions, while no pose gives a motion that is fast enough."""
REGIONS = 2
"""Number of candidates with the largest coverage, among which the criterion chooses."""
SLOW = 0.35
"""Fraction of the mean speed without clearance below which a candidate is sampled again."""
ROUGH = 32
"""Number of instants of a curve that are checked to choose between curves."""
ROUGHLY = (2.0, 1.3)
"""Factors by which each side of these curves is extended."""
AGAIN = (1.3, 1.1)
"""The same for the chosen candidates, and for refined ones."""
BLOCKED = 64
"""Number of poses at which the blocking limit is determined, for a message."""
WELL_INSIDE = 0.97
"""Fraction of the distance from home to the edge of the limits within which motions are centred."""
BALANCE = 0.1
"""Offset of a coordinate's coverage in its weight: below it, less coverage hardly increases the weight."""
SWIFT = 1.0
"""Weight of a motion's speed, relative to that without clearance, compared with its coverage."""
BEYOND = 1.02
"""Width of the box in which a motion is refined, relative to the motion's range."""


BINS = 20
"""Number of bins of the range between a coordinate's extreme clear poses."""
LEAST_VISIT = 0.005
"""Fraction of the time that a bin needs to count as visited: mere reversals in a bin give little information.
"""
INSTANTS = 512
"""Number of instants of a segment that are counted, for the report."""
CANDIDATE_INSTANTS = 96
"""The same for a candidate."""


@dataclass(frozen=True, eq=False)
class VisitedTimes:
    """The time that segments spend in each bin of each coordinate; links do not count.

    Attributes:
        lower, upper: (k,) ends between which clear poses lie.
        seconds: (k, BINS).
        total: s of all segments.
    """

    lower: Array
    upper: Array
    seconds: Array
    total: float = 0.0

    @classmethod
    def nothing(cls, reach: Reachable) -> VisitedTimes:
        """Zero time in all bins, before any motion."""
        lower, upper = reach.clear
        return cls(lower, upper, np.zeros((len(lower), BINS)))

    def adding(self, trajectories: Sequence[Trajectory]) -> VisitedTimes:
        """Sum with the time of the trajectories' segments."""
        pieces = [
            p for trajectory in trajectories for _, label, p in trajectory.pieces() if label == "segment"
        ]
        total = self
        for piece in pieces:
            t = piece.duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
            total = total.adding_poses(piece.motion(t, 1).orders[0], piece.duration)
        return total

    def adding_poses(self, poses: Array, duration: float) -> VisitedTimes:
        """Sum with the time of poses (T, k), spread evenly over `duration` s."""
        each = duration / max(len(poses), 1)
        return replace(self, seconds=self.seconds + each * self.counts(poses), total=self.total + duration)

    def counts(self, poses: Array) -> Array:
        """(k, BINS) poses (T, k) in each bin."""
        # 1e-12 rad (m): a coordinate without a range has all of its poses in one bin
        place = np.floor(BINS * (poses - self.lower) / np.maximum(self.upper - self.lower, 1e-12))
        place = np.where(poses == self.upper, BINS - 1, place)
        inside = (place >= 0) & (place < BINS)
        table = np.zeros((poses.shape[1], BINS))
        coordinate = np.broadcast_to(np.arange(poses.shape[1]), poses.shape)
        np.add.at(table, (coordinate[inside], place[inside].astype(np.int64)), 1.0)
        return table

    def bins(self, total: float | None = None) -> Mask:
        """(k, BINS) whether a bin was visited, relative to a total time in s (None: the time so far)."""
        whole = self.total if total is None else total
        return np.asarray((self.seconds > 0.0) & (self.seconds >= LEAST_VISIT * whole))

    def share(self, total: float | None = None) -> Array:
        """(k,) fraction of each coordinate's bins that was visited."""
        return np.asarray(self.bins(total).mean(axis=1))


@dataclass(frozen=True, eq=False)
class ReachablePoses:
    """The reachable poses of a robot, and those that its motions have visited.

    Attributes:
        reach: clear poses, and the ends of the ranges.
        visited: time per bin so far. total: s of all segments at the end of this recording.
    """

    reach: Reachable
    visited: VisitedTimes
    total: float
    rests: dict[int, bool] = field(default_factory=dict, repr=False)
    """By number of a pose, whether the limits of the design allow rest there; all its segments share it."""


@dataclass(frozen=True, eq=False)
class Region(SampledPoint):
    """A candidate that was extended about a clear pose.

    Attributes:
        clear: (P,) parameters whose path passes fast checks; violating ones are shrunk towards these.
        start: (P,) parameters of rest at its clear pose.
        source: the source of the candidate.
    """

    clear: Array
    start: Array
    source: ClearPoseSource

    @property
    def standing(self) -> Array:
        return self.start

    def home(self, nonconvex: NonconvexLimits) -> SampledPoint:  # noqa: ARG002
        """The candidate itself, which already keeps its limits."""
        return self

    def may_exceed(self, nonconvex: NonconvexLimits, worth: Callable[[Array], float], least: float) -> bool:  # noqa: ARG002
        """True: `home` changes nothing."""
        return True

    def allowed(self, nonconvex: NonconvexLimits, p: Array, worth: Callable[[Array], float]) -> SampledPoint:  # noqa: ARG002
        """The result p (P,) of a search, shrunk until it is clear, and extended again into free space."""
        p = nonconvex.shrink_to_home(self.family, self.clear, p, FEW_HALVINGS, fast_check=True)
        feasible = self.source.ordered(self.family)
        return replace(
            self, p=nonconvex.widened(feasible, self.family, p, self.source.stand(self.family), AGAIN)
        )


@dataclass(frozen=True, eq=False)
class Curve:
    """A roughly clear curve about a clear pose: parameters p (P,), those of rest at its start (P,), its
    worth, and its speed relative to that without obstacles.
    """

    family: Family
    p: Array
    start: Array
    worth: float
    speed: float


@dataclass(frozen=True, eq=False)
class ClearPoseSource:
    """A source of candidates about clear poses; `Source` has candidates about home.

    Attributes:
        family: of motions. limits: boxes of those that are `SupportsBoxes` span the whole range.
        roam: reachable and visited poses.
        sampler: of the curves.
    """

    family: Family
    limits: tuple[Limit, ...]
    roam: ReachablePoses
    sampler: Sampler

    @classmethod
    def of(
        cls, family: Family, limits: Sequence[Limit], roam: ReachablePoses, sampler: Sampler
    ) -> ClearPoseSource:
        """The source, with the limits' boxes widened to the whole range."""
        ends = roam.reach.lower, roam.reach.upper
        return cls(family, tuple(_in_box(limit, *ends) for limit in limits), roam, sampler)

    def candidates(self, rng: np.random.Generator, count: int) -> list[SampledPoint]:  # noqa: ARG002
        """The `REGIONS` candidates, out of `CENTRES` or more, with the largest coverage of unvisited bins.

        Raises:
            UnsafeTrajectoryError: the limits leave no room, or nothing is clear.
        """
        curves: list[Curve] = []
        for _ in range(TRIES):
            curves += self._rough_curves(rng, CENTRES, widened=True)
            if sum(one.speed >= SLOW for one in curves) >= REGIONS:
                break
        curves.sort(key=lambda one: (one.speed < SLOW, -one.worth))
        regions: list[SampledPoint] = []
        for one in curves:
            region = self._region(one)
            regions += [] if region is None else [region]
            if len(regions) == REGIONS:
                break
        if not regions:
            raise self._no_clear_motion()
        return regions

    def typical(self, rng: np.random.Generator, count: int) -> list[SampledPoint]:
        """`count` motions that replace tasks: roughly clear, each about its own pose.

        Raises:
            UnsafeTrajectoryError: no motion was found.
        """
        curves = self._rough_curves(rng, count)
        if not curves:
            raise self._no_clear_motion()
        return [SampledPoint(one.family, self._set(one.family), one.p) for one in curves]

    def _no_clear_motion(self) -> UnsafeTrajectoryError:
        """The error that no motion keeps all limits; it names the limit that blocks most poses, if known."""
        poses = self.roam.reach.poses[:BLOCKED]
        blocking = [limit for limit in self.limits if isinstance(limit, SupportsBlocking)]
        met = Counter(
            blocker for limit in blocking for pose in poses if (blocker := limit.blocked(self._form, pose))
        )
        often = [what for what, count in met.most_common() if 2 * count > len(poses)]
        return UnsafeTrajectoryError(
            "no motion about any of the poses tried keeps all limits"
            + (f": most of them violate {' and '.join(often)}" if often else ""),
            next_step="In the robot file, correct obstacles, and limits narrower than the data sheet's. Its "
            "list confirm names pairs of links with little clearance. Where the model file's masses are "
            "wrong, begin anew: etude init FOLDER --robot FILE. Deviations of commands may be smaller "
            "after `etude tell` with a first, slow log of the robot.",
        )

    def stand(self, family: Family) -> Callable[[Array], Array]:
        """Function pose (k,) -> parameters (P,) of rest at that pose."""
        offset, rows = self._rest_map(family)
        return lambda pose: offset + rows @ pose

    def ordered(self, family: Family) -> FeasibleSet:
        """The set of the convex limits; its blocks with the least covered coordinates come first."""
        whole = self._set(family)
        share, touched = self.roam.visited.share(self.roam.total), np.any(family.rows(0, 1)[0] != 0.0, axis=1)
        lack = [share[touched[:, block.members].any(axis=1)].min() for block in whole.blocks]
        return replace(whole, blocks=tuple(whole.blocks[i] for i in np.argsort(lack, kind="stable")))

    @cached_property
    def _sets(self) -> dict[int, tuple[Family, FeasibleSet]]:
        return {}

    def _set(self, family: Family) -> FeasibleSet:
        if id(family) not in self._sets:
            feasible = FeasibleSet.of(self.limits, family, self.roam.reach.poses[0])
            self._sets[id(family)] = family, feasible
        return self._sets[id(family)][1]

    @cached_property
    def _rest_maps(self) -> dict[int, tuple[Family, tuple[Array, Array]]]:
        return {}

    def _rest_map(self, family: Family) -> tuple[Array, Array]:
        if id(family) not in self._rest_maps:
            k = len(self.roam.reach.lower)
            offset = still_at(family, np.zeros(k))
            rows = np.stack([still_at(family, row) - offset for row in np.eye(k)], axis=1)
            self._rest_maps[id(family)] = family, (offset, rows)
        return self._rest_maps[id(family)][1]

    def _nonconvex(self, family: Family, p: Array) -> NonconvexLimits:
        """The nonconvex limits."""
        return NonconvexLimits.of(self.limits, family, p)

    def _rough_curves(self, rng: np.random.Generator, count: int, *, widened: bool = False) -> list[Curve]:
        """Curves about clear poses, shrunk until their paths are roughly clear; widened: extended again."""
        family = self.family.drawn(rng)
        whole, stand = self._set(family), self.stand(family)
        draw = uniform if self.sampler == "uniform" else scaled
        shapes, ordered = draw(rng, whole, count), self.ordered(family)
        nonconvex, form = self._nonconvex(family, whole.centre), family.trajectory(whole.centre).form
        t = family.trajectory(whole.centre).duration * (np.arange(ROUGH) + 0.5) / ROUGH
        path = [limit for limit in self.limits if isinstance(limit, SupportsBoxes)]
        curves = []
        for pose, shape in zip(self._poses(rng, whole, stand, count), shapes, strict=True):
            start, first = stand(pose), family.motion(shape, np.zeros(1), 1).orders[0, 0]
            checks = [limit.roughly(form, pose) for limit in path]

            def holds(p: Array, checks: Sequence[Callable[[Array], bool]] = checks) -> bool:
                poses = family.motion(p, t, 1).orders[0]
                return all(check(poses) for check in checks)

            if not holds(start):
                continue  # the pose is not clear with these tracking margins
            p = whole.about(start).shrink(start + shape - stand(first))
            p = _bisect(start, p, holds)
            if widened:
                p = nonconvex.widened(ordered, family, p, stand, ROUGHLY, holds)
            worth, speed = self._worth_and_speed(family, p, self._speed(family, shape))
            curves.append(Curve(family, p, start, worth, speed))
        return curves

    def _poses(
        self, rng: np.random.Generator, whole: FeasibleSet, stand: Callable[[Array], Array], count: int
    ) -> list[Array]:
        """Clear poses at which the robot may rest; every other one is among those with the most coordinates
        in unvisited bins.
        """
        poses, visited = self.roam.reach.poses, self.roam.visited
        unvisited = ~visited.bins(self.roam.total)
        order = rng.permutation(len(poses))
        chosen: list[Array] = []
        some = order[: 8 * count]
        gain = np.array([(visited.counts(poses[i : i + 1]) * unvisited).sum() for i in some])
        most = iter(some[np.argsort(-gain, kind="stable")].tolist())
        any_ = iter(order[::-1].tolist())
        while len(chosen) < count:
            i = next(most if len(chosen) % 2 == 0 else any_, None)
            if i is None:
                chosen.append(poses[0])
            elif float(whole.gauge(stand(poses[i])).max(initial=0.0)) <= WELL_INSIDE and self._allows_rest(i):
                chosen.append(poses[i])
        return chosen

    def _allows_rest(self, i: int) -> bool:
        """Whether limits that no box describes, such as those of drives, allow rest at the i-th clear pose.

        Where drives hold the robot in a small part of its range, nearly all random poses would be lost later.
        """
        rests = self.roam.rests
        if i not in rests:
            pose = self.roam.reach.poses[i]
            rests[i] = not any(limit.blocked(self._form, pose) for limit in self._holding)
        return rests[i]

    @cached_property
    def _holding(self) -> tuple[SupportsBlocking, ...]:
        return tuple(
            limit
            for limit in self.limits
            if isinstance(limit, SupportsBlocking)
            and not (isinstance(limit, SupportsBoxes) or limit.cones(self.family))
        )

    @cached_property
    def _form(self) -> str:
        return self.family.trajectory(self._set(self.family).centre).form

    def _worth_and_speed(self, family: Family, p: Array, free: float) -> tuple[float, float]:
        """Worth of a motion, and its speed relative to that without obstacles.

        The worth is the gain in coverage, on a logarithmic scale, plus the speed, which counts up to 1.
        """
        visited, duration = self.roam.visited, family.trajectory(p).duration
        t = duration * (np.arange(CANDIDATE_INSTANTS) + 0.5) / CANDIDATE_INSTANTS
        share = visited.adding_poses(family.motion(p, t, 1).orders[0], duration).share(self.roam.total)
        # a motion at rest has no speed to compare with
        speed = self._speed(family, p) / max(free, 1e-12)
        cover = float(np.log((share + BALANCE) / (visited.share(self.roam.total) + BALANCE)).sum())
        return cover + SWIFT * min(speed, 1.0), speed

    def _speed(self, family: Family, p: Array) -> float:
        """Mean absolute rate over instants and coordinates."""
        t = family.trajectory(p).duration * (np.arange(CANDIDATE_INSTANTS) + 0.5) / CANDIDATE_INSTANTS
        return float(np.mean(np.abs(family.motion(p, t, 2).orders[1])))

    def _region(self, curve: Curve) -> Region | None:
        """The curve, shrunk towards its start until all limits hold and then extended, with the box of its
        range, in which it is refined; None where that is not possible.
        """
        family, start = curve.family, curve.start
        nonconvex = self._nonconvex(family, curve.p)
        try:
            p = nonconvex.shrink_to_home(family, start, curve.p, FEW_HALVINGS, fast_check=True)
            p = nonconvex.widened(self.ordered(family), family, p, self.stand(family), AGAIN)
            t = (
                family.trajectory(p).duration
                * (np.arange(4 * CANDIDATE_INSTANTS) + 0.5)
                / (4 * CANDIDATE_INSTANTS)
            )
            path = family.motion(p, t, 1).orders[0]
            middle, half = 0.5 * (path.max(axis=0) + path.min(axis=0)), 0.5 * BEYOND * np.ptp(path, axis=0)
            box = tuple(_in_box(limit, middle - half, middle + half) for limit in self.limits)
            return Region(family, FeasibleSet.of(box, family, middle), p, p, start, self)
        except UnsafeTrajectoryError:
            return None


def _bisect(start: Array, p: Array, holds: Callable[[Array], bool]) -> Array:
    """The parameters p (P,), moved towards `start` (P,) only until they hold."""
    if holds(p):
        return p
    inside, outside = 0.0, 1.0
    for _ in range(FEW_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if holds(start + middle * (p - start)) else (inside, middle)
    return np.asarray(start + inside * (p - start))


def _in_box(limit: Limit, lower: Array, upper: Array) -> Limit:
    return limit.about(lower, upper) if isinstance(limit, SupportsBoxes) else limit
