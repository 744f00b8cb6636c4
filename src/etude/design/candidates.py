"""Candidates: random trajectories inside the limits, and curves about poses all over the workspace.

A box of which nearly every pose is clear is small, since a motion is a curve and no box. So each candidate
starts at a random clear pose, half of them in parts that were not visited yet, is drawn there until its path
is clear, and is then widened, each coordinate and each side of it by itself, as long as the path stays clear.
What the information criterion then refines stays inside what was found, and goes back to it where it is not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from etude.abilities import SupportsBlocking, SupportsBoxes
from etude.design.nonconvex_limits import FEW_HALVINGS, NonconvexLimits
from etude.errors import UnsafeTrajectoryError
from etude.limits.feasible import FeasibleSet, still_at
from etude.limits.samplers import amplitude, boundary, scaled, uniform
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array, Mask, Reachable

Sampler = Literal["scaled", "uniform"]
Sample = Callable[[np.random.Generator, FeasibleSet, int], Array]

AMPLITUDE_SHARE = 4
"""One scaled candidate in so many has a random amplitude: slow motion is sometimes what is missing."""
STEPS = 60
"""Of the walk to each uniform candidate; they need to differ, not to be exactly uniform."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A point p (P,) of the feasible set of a family whose omega0 has been drawn."""

    family: Family
    feasible: FeasibleSet
    p: Array

    @property
    def trajectory(self) -> Trajectory:
        return self.family.trajectory(self.p)

    @property
    def standing(self) -> Array:
        """(P,) standing still where all limits are kept."""
        return self.feasible.centre

    def home(self, kept: NonconvexLimits) -> Drawn:
        """As it was sampled, drawn home until its limits hold by a quick word."""
        p = kept.shrink_to_home(self.family, self.standing, self.p, FEW_HALVINGS, quickly=True)
        return self if p is self.p else replace(self, p=p)

    def allowed(self, kept: NonconvexLimits, p: Array, worth: Callable[[Array], float]) -> Drawn:
        """What a search has made of it (P,), drawn home until its limits hold, and grown where that is worth
        something.
        """
        p = kept.shrink_to_home(self.family, self.standing, p, quickly=True)
        return replace(self, p=kept.grown(self.family, self.standing, p, worth))


@dataclass(frozen=True, eq=False)
class Source:
    """Where random trajectories come from: a family, its limits, a pose inside them, a way to sample."""

    family: Family
    limits: tuple[Limit, ...]
    home: Array
    sampler: Sampler

    def candidates(self, rng: np.random.Generator, count: int) -> list[Drawn]:
        """`count` of them to choose from: a quarter of random amplitude, or half on the edge.

        They keep the limits that are convex; what the others forbid is drawn home of those that may win.

        Raises:
            UnsafeTrajectoryError: the limits leave no room.
        """
        if self.sampler == "uniform":
            half = count // 2
            first = self._drawn(rng, count - half, lambda r, s, n: uniform(r, s, n, STEPS))
            return [*first, *self._drawn(rng, half, boundary)]
        slow = count // AMPLITUDE_SHARE
        return [*self._drawn(rng, count - slow, scaled), *self._drawn(rng, slow, amplitude)]

    def typical(self, rng: np.random.Generator, count: int, *, grown: bool = False) -> list[Drawn]:
        """`count` large ones, as motions that stand in for tasks; or grown, as first trajectories."""
        sampled = self._drawn(rng, count, uniform if self.sampler == "uniform" else scaled)
        found = [drawn.home(NonconvexLimits.of(self.limits, drawn.family, drawn.p)) for drawn in sampled]
        return [self._grown(drawn) for drawn in found] if grown else found

    def _grown(self, drawn: Drawn) -> Drawn:
        kept = NonconvexLimits.of(self.limits, drawn.family, drawn.p)
        home = drawn.feasible.centre
        p = kept.grown(drawn.family, home, drawn.p)
        return replace(drawn, p=kept.settled(drawn.family, home, p))

    @cached_property
    def _whole(self) -> FeasibleSet:
        return self._set(self.family)

    def _set(self, family: Family) -> FeasibleSet:
        return FeasibleSet.of(self.limits, family, self.home)

    def _drawn(self, rng: np.random.Generator, count: int, sample: Sample) -> list[Drawn]:
        """A family that leaves nothing to draw has one feasible set, and all are sampled at once."""
        families = [self.family.drawn(rng) for _ in range(count)]
        found: dict[int, Drawn] = {}
        for family in {id(one): one for one in families}.values():
            places = [i for i, one in enumerate(families) if one is family]
            feasible = self._whole if family is self.family else self._set(family)
            points = sample(rng, feasible, len(places))
            found |= {place: Drawn(family, feasible, p) for place, p in zip(places, points, strict=True)}
        return [found[place] for place in range(count)]


CENTRES = 6
"""Clear poses that are tried for a segment."""
TRIES = 3
"""Times as many, where none of them gives a motion that is fast enough."""
JUDGED = 2
"""Of them, those that cover most, between which the criterion decides."""
SLOW = 0.35
"""Of the mean speed of motions without clearance: a candidate that is slower is drawn anew."""
ROUGH = 32
"""Instants of a curve that are looked at to choose between curves."""
ROUGHLY = (2.0, 1.3)
"""Factors by which each side of these is widened."""
AGAIN = (1.3, 1.1)
"""The same of those that are chosen, and of what was refined."""
BLOCKED = 64
"""Poses at which limits are asked what they block, for a message."""
WELL_INSIDE = 0.97
"""Of the way from home to the edge of the limits, beyond which no motion is centred."""
BALANCE = 0.1
"""Share of a coordinate's bins below which more of it counts hardly more than of the others."""
SWIFT = 1.0
"""Weight of a motion's speed, in parts of that without clearance, beside what it covers."""
BEYOND = 1.02
"""How much wider than the way of a motion the box is in which it is refined."""


BINS = 20
"""Of the range between a coordinate's extreme clear poses."""
LEAST_VISIT = 0.005
"""Part of the time that a bin needs to count as visited: a motion that only turns round there shows little.
"""
INSTANTS = 512
"""At which a segment is looked at, for the report."""
CANDIDATE_INSTANTS = 96
"""The same of a candidate."""


@dataclass(frozen=True, eq=False)
class Visited:
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
    def nothing(cls, reach: Reachable) -> Visited:
        """Before any motion."""
        lower, upper = reach.clear
        return cls(lower, upper, np.zeros((len(lower), BINS)))

    def adding(self, trajectories: Sequence[Trajectory]) -> Visited:
        """With the segments of these."""
        pieces = [p for own in trajectories for _, label, p in own.pieces() if label == "segment"]
        found = self
        for piece in pieces:
            t = piece.duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
            found = found.adding_poses(piece.motion(t, 1).orders[0], piece.duration)
        return found

    def adding_poses(self, poses: Array, duration: float) -> Visited:
        """With poses (T, k), spread evenly over a time in s."""
        each = duration / max(len(poses), 1)
        return replace(self, seconds=self.seconds + each * self.counts(poses), total=self.total + duration)

    def counts(self, poses: Array) -> Array:
        """(k, BINS) poses (T, k) in each bin."""
        # 1e-12 rad (m): a coordinate without a range has all of its poses in one bin
        place = np.floor(BINS * (poses - self.lower) / np.maximum(self.upper - self.lower, 1e-12))
        place = np.where(poses == self.upper, BINS - 1, place)
        inside = (place >= 0) & (place < BINS)
        found = np.zeros((poses.shape[1], BINS))
        coordinate = np.broadcast_to(np.arange(poses.shape[1]), poses.shape)
        np.add.at(found, (coordinate[inside], place[inside].astype(np.int64)), 1.0)
        return found

    def bins(self, total: float | None = None) -> Mask:
        """(k, BINS) which were visited, of a total time in s (None: of what there was)."""
        whole = self.total if total is None else total
        return np.asarray((self.seconds > 0.0) & (self.seconds >= LEAST_VISIT * whole))

    def share(self, total: float | None = None) -> Array:
        """(k,) part of each coordinate's bins that was visited."""
        return np.asarray(self.bins(total).mean(axis=1))


@dataclass(frozen=True, eq=False)
class Roam:
    """Where a robot can be, and what its motions have visited of that.

    Attributes:
        reach: clear poses, and the ends of the ranges.
        visited: so far; total: s of segments when this recording is done.
    """

    reach: Reachable
    visited: Visited
    total: float


@dataclass(frozen=True, eq=False)
class Region(Drawn):
    """A candidate that was widened about a clear pose.

    Attributes:
        clear: (P,) its path keeps the limits by quick words: what does not is drawn to this.
        start: (P,) standing still at its clear pose.
        source: that it comes of.
    """

    clear: Array
    start: Array
    source: Roamed

    @property
    def standing(self) -> Array:
        return self.start

    def home(self, kept: NonconvexLimits) -> Drawn:  # noqa: ARG002
        """Itself: it keeps its limits already."""
        return self

    def allowed(self, kept: NonconvexLimits, p: Array, worth: Callable[[Array], float]) -> Drawn:  # noqa: ARG002
        """Drawn back to what is clear, and widened again: room that it has is worth having."""
        p = kept.shrink_to_home(self.family, self.clear, p, FEW_HALVINGS, quickly=True)
        feasible = self.source.ordered(self.family)
        return replace(self, p=kept.widened(feasible, self.family, p, self.source.stand(self.family), AGAIN))


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve about a clear pose, about clear: parameters p (P,), standing still where it starts (P,), what
    it is worth, and its speed in parts of what it had before anything stood in its way.
    """

    family: Family
    p: Array
    start: Array
    worth: float
    speed: float


@dataclass(frozen=True, eq=False)
class Roamed:
    """A source of such candidates, as `candidates.Source` is one about home.

    Attributes:
        family: of motions. limits: of which some are `SupportsBoxes`, their boxes the whole range.
        roam: where to look.
        sampler: of the curves.
    """

    family: Family
    limits: tuple[Limit, ...]
    roam: Roam
    sampler: Sampler

    @classmethod
    def of(cls, family: Family, limits: Sequence[Limit], roam: Roam, sampler: Sampler) -> Roamed:
        """With the limits' boxes as wide as the range."""
        ends = roam.reach.lower, roam.reach.upper
        return cls(family, tuple(_about(limit, *ends) for limit in limits), roam, sampler)

    def candidates(self, rng: np.random.Generator, count: int) -> list[Drawn]:  # noqa: ARG002
        """The `JUDGED` that cover most of what was not visited, of `CENTRES` or more.

        Raises:
            UnsafeTrajectoryError: the limits leave no room, or nothing is clear.
        """
        found: list[Curve] = []
        for _ in range(TRIES):
            found += self._started(rng, CENTRES, widened=True)
            if sum(one.speed >= SLOW for one in found) >= JUDGED:
                break
        found.sort(key=lambda one: (one.speed < SLOW, -one.worth))
        regions: list[Drawn] = []
        for one in found:
            region = self._region(one)
            regions += [] if region is None else [region]
            if len(regions) == JUDGED:
                break
        if not regions:
            raise self._none()
        return regions

    def typical(self, rng: np.random.Generator, count: int) -> list[Drawn]:
        """`count` that stand in for tasks: clear, or nearly so, each about its pose.

        Raises:
            UnsafeTrajectoryError: there is none.
        """
        found = self._started(rng, count)
        if not found:
            raise self._none()
        return [Drawn(one.family, self._set(one.family), one.p) for one in found]

    def _none(self) -> UnsafeTrajectoryError:
        """No motion keeps all limits; with what holds at fewest of the poses, if a limit says so."""
        form = self.family.trajectory(self._set(self.family).centre).form
        poses = self.roam.reach.poses[:BLOCKED]
        asked = [limit for limit in self.limits if isinstance(limit, SupportsBlocking)]
        met = Counter(found for limit in asked for pose in poses if (found := limit.blocked(form, pose)))
        often = [what for what, count in met.most_common() if 2 * count > len(poses)]
        return UnsafeTrajectoryError(
            "no motion about any of the poses that were tried keeps all limits"
            + (f": most of them break {' and '.join(often)}" if often else ""),
            next_step="Widen the limits, or correct what stands around the robot; confirm, in the robot "
            "file, names pairs of links whose shapes leave little room.",
        )

    def stand(self, family: Family) -> Callable[[Array], Array]:
        """Pose (k,) -> parameters (P,) of standing still there."""
        offset, rows = self._standing(family)
        return lambda pose: offset + rows @ pose

    def ordered(self, family: Family) -> FeasibleSet:
        """The convex limits, their blocks in the order in which coordinates lack coverage most."""
        whole = self._set(family)
        share, touched = self.roam.visited.share(self.roam.total), np.any(family.rows(0, 1)[0] != 0.0, axis=1)
        lack = [share[touched[:, block.members].any(axis=1)].min() for block in whole.blocks]
        return replace(whole, blocks=tuple(whole.blocks[i] for i in np.argsort(lack, kind="stable")))

    @cached_property
    def _sets(self) -> dict[int, tuple[Family, FeasibleSet]]:
        return {}

    def _set(self, family: Family) -> FeasibleSet:
        if id(family) not in self._sets:
            found = FeasibleSet.of(self.limits, family, self.roam.reach.poses[0])
            self._sets[id(family)] = family, found
        return self._sets[id(family)][1]

    @cached_property
    def _stands(self) -> dict[int, tuple[Family, tuple[Array, Array]]]:
        return {}

    def _standing(self, family: Family) -> tuple[Array, Array]:
        if id(family) not in self._stands:
            k = len(self.roam.reach.lower)
            offset = still_at(family, np.zeros(k))
            rows = np.stack([still_at(family, row) - offset for row in np.eye(k)], axis=1)
            self._stands[id(family)] = family, (offset, rows)
        return self._stands[id(family)][1]

    def _kept(self, family: Family, p: Array) -> NonconvexLimits:
        """What is not convex."""
        return NonconvexLimits.of(self.limits, family, p)

    def _started(self, rng: np.random.Generator, count: int, *, widened: bool = False) -> list[Curve]:
        """Curves from clear poses, drawn there until their paths are about clear, and then widened."""
        family = self.family.drawn(rng)
        whole, stand = self._set(family), self.stand(family)
        draw = uniform if self.sampler == "uniform" else scaled
        shapes, ordered = draw(rng, whole, count), self.ordered(family)
        kept, form = self._kept(family, whole.centre), family.trajectory(whole.centre).form
        t = family.trajectory(whole.centre).duration * (np.arange(ROUGH) + 0.5) / ROUGH
        path = [limit for limit in self.limits if isinstance(limit, SupportsBoxes)]
        found = []
        for pose, shape in zip(self._poses(rng, whole, stand, count), shapes, strict=True):
            start, first = stand(pose), family.motion(shape, np.zeros(1), 1).orders[0, 0]
            words = [limit.roughly(form, pose) for limit in path]

            def holds(p: Array, words: Sequence[Callable[[Array], bool]] = words) -> bool:
                poses = family.motion(p, t, 1).orders[0]
                return all(word(poses) for word in words)

            if not holds(start):
                continue  # with this tracking the pose is not clear
            p = whole.about(start).shrink(start + shape - stand(first))
            p = _drawn(start, p, holds)
            if widened:
                p = kept.widened(ordered, family, p, stand, ROUGHLY, holds)
            worth, speed = self._judged(family, p, self._speed(family, shape))
            found.append(Curve(family, p, start, worth, speed))
        return found

    def _poses(
        self, rng: np.random.Generator, whole: FeasibleSet, stand: Callable[[Array], Array], count: int
    ) -> list[Array]:
        """Clear poses, every other one of the few that lie most in bins that were not visited."""
        poses, visited = self.roam.reach.poses, self.roam.visited
        unvisited = ~visited.bins(self.roam.total)
        order = rng.permutation(len(poses))
        found: list[Array] = []
        some = order[: 8 * count]
        gain = np.array([(visited.counts(poses[i : i + 1]) * unvisited).sum() for i in some])
        most = iter(some[np.argsort(-gain, kind="stable")].tolist())
        any_ = iter(order[::-1].tolist())
        while len(found) < count:
            i = next(most if len(found) % 2 == 0 else any_, None)
            if i is None:
                found.append(poses[0])
            elif float(whole.gauge(stand(poses[i])).max(initial=0.0)) <= WELL_INSIDE:
                found.append(poses[i])
        return found

    def _judged(self, family: Family, p: Array, free: float) -> tuple[float, float]:
        """What a motion would cover, more where less is covered yet, with its speed; and that speed, in parts
        of what it had before anything stood in its way.
        """
        visited, duration = self.roam.visited, family.trajectory(p).duration
        t = duration * (np.arange(CANDIDATE_INSTANTS) + 0.5) / CANDIDATE_INSTANTS
        share = visited.adding_poses(family.motion(p, t, 1).orders[0], duration).share(self.roam.total)
        # a motion that stands still has no speed to compare with
        speed = self._speed(family, p) / max(free, 1e-12)
        cover = float(np.log((share + BALANCE) / (visited.share(self.roam.total) + BALANCE)).sum())
        return cover + SWIFT * min(speed, 1.0), speed

    def _speed(self, family: Family, p: Array) -> float:
        """Mean size of the rates, each in parts of its range."""
        t = family.trajectory(p).duration * (np.arange(CANDIDATE_INSTANTS) + 0.5) / CANDIDATE_INSTANTS
        return float(np.mean(np.abs(family.motion(p, t, 2).orders[1])))

    def _region(self, curve: Curve) -> Region | None:
        """The curve drawn to its start until all limits hold, widened, with the box of its way, in which it
        is refined; None where nothing is left of it.
        """
        family, start = curve.family, curve.start
        kept = self._kept(family, curve.p)
        try:
            p = kept.shrink_to_home(family, start, curve.p, FEW_HALVINGS, quickly=True)
            p = kept.widened(self.ordered(family), family, p, self.stand(family), AGAIN)
            t = (
                family.trajectory(p).duration
                * (np.arange(4 * CANDIDATE_INSTANTS) + 0.5)
                / (4 * CANDIDATE_INSTANTS)
            )
            way = family.motion(p, t, 1).orders[0]
            middle, half = 0.5 * (way.max(axis=0) + way.min(axis=0)), 0.5 * BEYOND * np.ptp(way, axis=0)
            box = tuple(_about(limit, middle - half, middle + half) for limit in self.limits)
            return Region(family, FeasibleSet.of(box, family, middle), p, p, start, self)
        except UnsafeTrajectoryError:
            return None


def _drawn(start: Array, p: Array, holds: Callable[[Array], bool]) -> Array:
    """The parameters (P,), or the first on the way to `start` that hold."""
    if holds(p):
        return p
    inside, outside = 0.0, 1.0
    for _ in range(FEW_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if holds(start + middle * (p - start)) else (inside, middle)
    return np.asarray(start + inside * (p - start))


def _about(limit: Limit, lower: Array, upper: Array) -> Limit:
    return limit.about(lower, upper) if isinstance(limit, SupportsBoxes) else limit
