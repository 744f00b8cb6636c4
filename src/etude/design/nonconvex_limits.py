"""Nonconvex limits: a penalty during the search, and a proof of its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.abilities import SupportsFastCheck, SupportsOrders
from etude.design.objective import Sought
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import slack, tracked_in_words
from etude.limits.feasible import Block, FeasibleSet
from etude.protocols import Family, Limit, Trajectory
from etude.trajectories.extremes import USABLE_PART
from etude.types import Array, Proof

INSTANTS = 400
"""Evenly over a motion, at which penalties are asked for."""
ORDERS = 3
"""Derivative orders that penalties see, if they ask for no more: position, velocity, acceleration."""
HALVINGS = 12
"""Of the way home: the last proved point is within a thousandth of the way of one that is not."""
FEW_HALVINGS = 5
"""Of the way home of a motion that is only compared with others, or grown again afterwards."""
GROWTH = (2.0, 1.4, 1.15, 1.05)
"""Factors by which each part of a motion is tried to be enlarged."""
TRIES = 2
"""Of each factor in a row, while it succeeds."""
SHRUNK, SHRINKINGS = 0.97, 4
"""What was grown by a quick word and is not proved is nearly so."""
LEAST_GROWTH = 1.01
"""Less is not worth a proof."""
HEAVY = 10.0
"""Weight of the penalty of a typical candidate, in values of the criterion."""
Stand = Callable[[Array], Array]
"""Of a family: pose (k,) -> parameters (P,) of standing still there."""


@dataclass(frozen=True, eq=False)
class NonconvexLimits:
    """The limits whose `cones` do not say it all; without any, nothing is done.

    Attributes:
        limits: those that answer with a penalty.
        times: (T,) s at which they are asked.
        others: those whose cones say it all.
        boxed: whether cones of `limits` keep the search within less than is allowed.
    """

    limits: tuple[Limit, ...]
    times: Array
    others: tuple[Limit, ...] = ()
    boxed: bool = False

    @classmethod
    def of(cls, limits: Sequence[Limit], family: Family, p: Array) -> NonconvexLimits:
        """Those of `limits` that answer with a penalty for the member p (P,)."""
        duration = family.trajectory(p).duration
        times = duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
        motion = family.motion(p, times[:1], _orders(limits))  # whether one answers, not what
        parts: dict[bool, list[Limit]] = {True: [], False: []}
        for limit in limits:
            parts[limit.penalty(motion) is None].append(limit)
        boxed = [bool(limit.cones(family)) for limit in parts[False]]
        # what narrows the search is what most often fails: it is asked first
        own = [parts[False][i] for i in sorted(range(len(boxed)), key=lambda i: not boxed[i])]
        return cls(tuple(own), times, tuple(parts[True]), any(boxed))

    def penalty(self, family: Family, p: Array) -> tuple[float, Array]:
        """Sum of the penalties at p (P,) and its gradient (P,); 0 where all are kept."""
        motion = family.motion(p, self.times, _orders(self.limits))
        total, gradient = 0.0, np.zeros_like(motion.orders)
        for limit in self.limits:
            found = limit.penalty(motion)
            if found is not None:
                total, gradient = total + found[0], gradient + found[1]
        return total, family.vjp(p, self.times, gradient)

    def weight(self, candidates: Iterable[tuple[Family, Array]]) -> float:
        """What a penalty counts for, in values of the criterion: typical candidates lose all of theirs.

        0 where no candidate has any: then what comes of the search is only drawn home. Limits that have
        `keeps` are not asked: by that word the candidates were drawn home, and keep them.
        """
        slow = tuple(limit for limit in self.limits if not isinstance(limit, SupportsFastCheck))
        asked = replace(self, limits=slow)
        found = [asked.penalty(family, p)[0] for family, p in candidates] if asked.limits else []
        typical = float(np.mean(found)) if found else 0.0
        return HEAVY / typical if typical > 0.0 else 0.0

    def proved(self, family: Family, p: Array, *, quickly: bool = False) -> bool:
        """Whether all of them hold, proved, on the trajectory of p (P,).

        quickly: a limit that has `keeps(piece)` is asked that, which is wrong in rare cases: for searches.
        """
        return _hold(self.limits, family, p, quickly)

    def shrink_to_home(
        self, family: Family, home: Array, p: Array, halvings: int = HALVINGS, *, quickly: bool = False
    ) -> Array:
        """The parameters (P,), or the first on the way to `home` (P,) at which the limits are proved.

        One limit after the other, each with those before it: the first is mostly the one in the way, and
        those that cost more are then asked at its end alone.

        Args:
            family: of the parameters.
            home: (P,) standing still.
            p: where to begin.
            halvings: of the way.
            quickly: see `proved`.

        Raises:
            UnsafeTrajectoryError: nowhere on the way, and not even at home.
        """
        for i, limit in enumerate(self.limits):
            if _hold((limit,), family, p, quickly):
                continue
            asked, inside, outside = self.limits[: i + 1], 0.0, 1.0
            for _ in range(halvings):
                middle = 0.5 * (inside + outside)
                if _hold(asked, family, home + middle * (p - home), quickly):
                    inside = middle
                else:
                    outside = middle
            if inside == 0.0 and not _hold(asked, family, home, quickly):
                raise _home_outside(asked, family, home, quickly)
            p = np.asarray(home + inside * (p - home))
        return p

    def grown(
        self, family: Family, home: Array, p: Array, worth: Callable[[Array], float] = lambda _: 0.0
    ) -> Array:
        """The parameters (P,) with each part enlarged about `home`, as far as a quick word allows.

        Being drawn home shrinks all of a motion for the one part of it that is in the way, and the search may
        have been kept in a part of what is allowed. So every block of what the other limits couple, a joint
        say, is tried by itself.

        Args:
            family: of the parameters.
            home: (P,) standing still.
            p: where to begin.
            worth: of parameters; what lowers it is not done.
        """
        if not self.boxed:
            return p
        pose = family.motion(home, np.zeros(1), 1).orders[0, 0]
        whole, value = FeasibleSet.of(self.others, family, pose), worth(p)
        for factor in GROWTH:
            for block in whole.blocks:
                for _ in range(TRIES):
                    trial = p.copy()
                    use = block.gauge(p[block.members])
                    step = min(factor, USABLE_PART / use) if use > 0.0 else 1.0
                    trial[block.members] = block.centre + step * (p[block.members] - block.centre)
                    if step <= LEAST_GROWTH or not _hold(self.limits[:1], family, trial, True):
                        break  # by what is mostly in the way, and costs least
                    if (trial_value := worth(trial)) < value:
                        break
                    if not _hold(self.limits[1:], family, trial, True):
                        break
                    p, value = trial, trial_value
        return p

    def widened(
        self,
        feasible: FeasibleSet,
        family: Family,
        p: Array,
        stand: Stand,
        factors: Sequence[float],
        holds: Callable[[Array], bool] | None = None,
    ) -> Array:
        """The parameters (P,) with each part enlarged to one side and then to the other, as far as is clear.

        One end of its way stays where it is and the other goes on, so that the whole motion need not shrink
        for the side on which something stands. What the path alone decides is asked first.

        Args:
            feasible: of the limits that are convex, in blocks that are widened by themselves, in this order.
            family: of the parameters.
            p: where to begin, inside of all.
            stand: pose (k,) -> parameters (P,) of standing still there.
            factors: by which each part is tried to be enlarged.
            holds: whether parameters are allowed; None: by a quick word of all limits.
        """
        allowed = holds or (lambda trial: _hold(self.limits, family, trial, True))
        for factor in factors:
            for block in feasible.blocks:
                for side in (1, 0):
                    for _ in range(TRIES):
                        trial = _stretched(block, family, p, stand, self.times, side, factor)
                        if trial is None or not allowed(trial):
                            break
                        p = trial
        return p

    def settled(self, family: Family, home: Array, p: Array) -> Array:
        """The parameters (P,), drawn to `home` (P,) until all limits are proved: quick words mostly hold.

        Raises:
            UnsafeTrajectoryError: as `shrink_to_home`.
        """
        for _ in range(SHRINKINGS if self.limits else 0):
            if self.proved(family, p):
                return p
            p = home + SHRUNK * (p - home)
        return self.shrink_to_home(family, home, p)


def _stretched(
    block: Block, family: Family, p: Array, stand: Stand, times: Array, side: int, factor: float
) -> Array | None:
    """A block stretched from the low (1) or the high (0) end of its way; None where it has no room."""
    way = family.motion(p, times, 1).orders[0]
    fixed = stand(way.min(axis=0) if side else way.max(axis=0))[block.members]
    own = p[block.members]
    _, most = block.chord(own[None], (own - fixed)[None])
    step = min(factor - 1.0, USABLE_PART * float(most[0]))
    if not step > LEAST_GROWTH - 1.0:
        return None
    trial = p.copy()
    trial[block.members] = own + step * (own - fixed)
    return trial


def _orders(limits: Sequence[Limit]) -> int:
    """Of motion that the limits look at."""
    return max([ORDERS, *(limit.orders for limit in limits if isinstance(limit, SupportsOrders))])


def _hold(limits: Sequence[Limit], family: Family, p: Array, quickly: bool) -> bool:
    pieces = [piece for _, _, piece in family.trajectory(p).pieces()] if limits else []
    return all(_holds(limit, piece, quickly) for limit in limits for piece in pieces)


def _home_outside(
    limits: Sequence[Limit], family: Family, home: Array, quickly: bool
) -> UnsafeTrajectoryError:
    """Says which of the limits standing still at home (P,) breaks, and by how much."""
    broken = [limit for limit in limits if not _hold((limit,), family, home, quickly)]
    pieces = [piece for _, _, piece in family.trajectory(home).pieces()]
    rows = [row for limit in broken for piece in pieces for row in limit.prove(piece) if slack(row) < 0.0]
    facts = dict.fromkeys(_beyond(row) for row in rows)
    return UnsafeTrajectoryError(
        f"standing still at home does not keep the limits: {'; '.join(facts)}",
        where=", ".join(limit.name for limit in broken),
        next_step="Widen the limits, or choose another home: of an arm it is `home` of [search] in "
        "robot.toml, of a vehicle the middle of its room.",
    )


def _beyond(row: Proof) -> str:
    """A row that is not kept: the value that breaks it, and what is allowed."""
    above = row.upper - row.proved_upper <= row.proved_lower - row.lower
    value, end = (row.proved_upper, row.upper) if above else (row.proved_lower, row.lower)
    kept = f" with a tracking margin of {tracked_in_words(row)}" if row.tracking_margin else ""
    return f"{row.quantity} of {row.axis} is {value:.4g}, limit {end:.4g}{kept}"


def _holds(limit: Limit, piece: Trajectory, quickly: bool) -> bool:
    if quickly and isinstance(limit, SupportsFastCheck):
        return limit.keeps(piece)
    return all(slack(row) >= 0.0 for row in limit.prove(piece) if row.status != "not verified")


@dataclass(frozen=True, eq=False)
class Penalised:
    """An objective less the weighted penalty, for the search alone."""

    objective: Sought
    kept: NonconvexLimits
    weight: float

    @property
    def family(self) -> Family:
        return self.objective.family

    def value(self, p: Array) -> float:
        """The criterion less the penalty."""
        return self.objective.value(p) - self.weight * self.kept.penalty(self.family, p)[0]

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """Value and gradient (P,)."""
        value, gradient = self.objective.value_and_gradient(p)
        penalty, slope = self.kept.penalty(self.family, p)
        return value - self.weight * penalty, gradient - self.weight * slope
