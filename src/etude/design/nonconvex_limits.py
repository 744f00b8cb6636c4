"""Nonconvex limits: a penalty during the search, and a proof of its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.abilities import SupportsFastCheck, SupportsOrders, SupportsViolation, SupportsWitness
from etude.design.objective import SearchFunction
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import slack, tracked_in_words
from etude.limits.feasible import Block, FeasibleSet
from etude.protocols import Family, Limit, Trajectory
from etude.trajectories.extremes import USABLE_PART
from etude.types import Array, Proof

INSTANTS = 400
"""Number of evenly spaced instants of a motion at which penalties are computed."""
ORDERS = 3
"""Derivative orders for penalties, unless a limit needs more: position, velocity, acceleration."""
HALVINGS = 12
"""Bisections of the line to home: they bring the proved point within a thousandth of it to one not proved."""
FEW_HALVINGS = 5
"""Bisections for a motion that is only compared with others, or enlarged again afterwards."""
LEAST_CUT = 0.02
"""Part of the bracket that a failure must exclude; after a smaller one the search bisects alone."""
GROWTH = (2.0, 1.4, 1.15, 1.05)
"""Factors by which each block of a motion is enlarged, tried in turn."""
TRIES = 2
"""Largest number of successive uses of each factor, while they succeed."""
SHRUNK, SHRINKINGS = 0.97, 4
"""Factor and number of attempts to shrink a motion that passed fast checks but is not quite proved."""
LEAST_GROWTH = 1.01
"""Enlargements below this factor are not worth a proof."""
HEAVY = 10.0
"""Weight of the penalty of a typical candidate, in values of the criterion."""
Stand = Callable[[Array], Array]
"""Function of a family: pose (k,) -> parameters (P,) of rest at that pose."""


@dataclass(frozen=True, eq=False)
class NonconvexLimits:
    """The limits that `cones` do not describe completely; without any, every method is trivial.

    Attributes:
        limits: the limits with a penalty.
        times: (T,) s at which penalties are computed.
        others: the limits that their cones describe completely.
        boxed: whether cones of `limits` restrict the search to a part of what is allowed.
    """

    limits: tuple[Limit, ...]
    times: Array
    others: tuple[Limit, ...] = ()
    boxed: bool = False

    @classmethod
    def of(cls, limits: Sequence[Limit], family: Family, p: Array) -> NonconvexLimits:
        """Those of `limits` that return a penalty for the member p (P,), or have no cones either.

        Without both, a limit only judges: motions are shrunk until it is proved.
        """
        duration = family.trajectory(p).duration
        times = duration * (np.arange(INSTANTS) + 0.5) / INSTANTS
        motion = family.motion(p, times[:1], _orders(limits))  # shows whether there is a penalty
        parts: dict[bool, list[Limit]] = {True: [], False: []}
        for limit in limits:
            parts[limit.penalty(motion) is None and bool(limit.cones(family))].append(limit)
        boxed = [bool(limit.cones(family)) for limit in parts[False]]
        # limits that restrict the search fail most often: check them first
        ordered = [parts[False][i] for i in sorted(range(len(boxed)), key=lambda i: not boxed[i])]
        return cls(tuple(ordered), times, tuple(parts[True]), any(boxed))

    @property
    def growing(self) -> tuple[Limit, ...]:
        """Those that a larger motion about the same pose violates too, as a rule: they tell by a witness. An
        obstacle is none of them: a larger motion may pass it by.
        """
        return tuple(limit for limit in self.limits if isinstance(limit, SupportsWitness))

    def penalty(self, family: Family, p: Array) -> tuple[float, Array]:
        """Sum of the penalties at p (P,) and its gradient (P,); 0 where all are kept."""
        motion = family.motion(p, self.times, _orders(self.limits))
        total, gradient = 0.0, np.zeros_like(motion.orders)
        for limit in self.limits:
            term = limit.penalty(motion)
            if term is not None:
                total, gradient = total + term[0], gradient + term[1]
        return total, family.vjp(p, self.times, gradient)

    def weight(self, candidates: Iterable[tuple[Family, Array]]) -> float:
        """Weight of the penalty, in values of the criterion: a typical candidate's whole value is offset.

        0 where no candidate has a penalty; then only the search's result is shrunk towards home. Limits with
        `keeps` are left out: candidates were shrunk until they kept these.
        """
        slow = tuple(limit for limit in self.limits if not isinstance(limit, SupportsFastCheck))
        checked = replace(self, limits=slow)
        penalties = [checked.penalty(family, p)[0] for family, p in candidates] if slow else []
        typical = float(np.mean(penalties)) if penalties else 0.0
        return HEAVY / typical if typical > 0.0 else 0.0

    def proved(self, family: Family, p: Array, *, fast_check: bool = False) -> bool:
        """Whether all limits are proved on the trajectory of p (P,).

        fast_check: use `keeps(piece)` of limits that have it. It may be wrong: for searches only.
        """
        return _hold(self.limits, family, p, fast_check)

    def shrink_to_home(
        self, family: Family, home: Array, p: Array, halvings: int = HALVINGS, *, fast_check: bool = False
    ) -> Array:
        """The parameters p (P,), moved towards `home` (P,) only until the limits are proved.

        Limits are treated one after the other, each together with those before it. The first one is usually
        violated most, so that the more expensive ones are mostly checked only once.

        Args:
            family: of the parameters.
            home: (P,) parameters of rest at home.
            p: parameters to start from.
            halvings: number of bisections.
            fast_check: see `proved`.

        Raises:
            UnsafeTrajectoryError: the limits are proved nowhere on the line, home included.
        """
        for i, limit in enumerate(self.limits):
            if _hold((limit,), family, p, fast_check):
                continue
            checked = self.limits[: i + 1]
            scale = _largest_scale(checked, family, home, p, halvings, fast_check)
            if scale == 0.0 and not _hold(checked, family, home, fast_check):
                raise _home_outside(checked, family, home, fast_check)
            p = np.asarray(home + scale * (p - home))
        return p

    def expand(
        self, family: Family, home: Array, p: Array, worth: Callable[[Array], float] = lambda _: 0.0
    ) -> Array:
        """The parameters (P,) with each block enlarged about `home`, as far as fast checks allow.

        `shrink_to_home` shrinks a whole motion because of one block that violates a limit, and the search may
        have been restricted to a part of what is allowed. So each block of parameters that the other limits
        couple, such as a joint, is enlarged separately.

        Args:
            family: of the parameters.
            home: (P,) parameters of rest at home.
            p: parameters to start from.
            worth: value of parameters; a change that lowers it is not made.
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
                        break  # the cheapest limit, which fails most often
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
        """The parameters (P,) with each block extended to one side and then to the other, while it is clear.

        One end of the block's range stays fixed and the other one moves, so that an obstacle on one side does
        not limit the other side. Convex limits are checked first.

        Args:
            feasible: set of the convex limits; its blocks are extended separately, in this order.
            family: of the parameters.
            p: parameters to start from, inside all limits.
            stand: pose (k,) -> parameters (P,) of rest at that pose.
            factors: factors of extension, tried in turn.
            holds: whether parameters are allowed; None: fast checks of all limits.
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
        """The parameters (P,), shrunk towards `home` (P,) until all limits are proved; often they are.

        Raises:
            UnsafeTrajectoryError: as `shrink_to_home`.
        """
        for _ in range(SHRINKINGS if self.limits else 0):
            if self.proved(family, p):
                return p
            p = home + SHRUNK * (p - home)
        return self.shrink_to_home(family, home, p)


def _largest_scale(
    limits: Sequence[Limit], family: Family, home: Array, p: Array, halvings: int, fast_check: bool
) -> float:
    """A scale of p - home, in steps of 2^-halvings, that keeps the limits, where the next step or the last
    check shows a failure; the last limit fails at 1.

    It bisects. If the last limit has a cheap test of the instants that failed, the largest scale that passes
    this test is tried first. A failure there adds an instant to the test, as a cutting plane does.
    """
    last, steps = limits[-1], int(2**halvings)
    fails = _cheap_test(last, fast_check)

    def at(scale: int) -> Array:
        return np.asarray(home + scale / steps * (p - home))

    def passes(scale: int) -> bool:
        return not any(fails(piece) for _, _, piece in family.trajectory(at(scale)).pieces())

    inside, outside, slow = 0, steps, fails is _never
    while outside - inside > 1:
        leading = inside if slow else last_true(passes, inside, outside)
        scale = leading if leading > inside else (inside + outside) // 2
        if _hold(limits, family, at(scale), fast_check):
            inside, outside = scale, scale + 1 if leading == scale else outside
        else:
            # an instant that excludes little: the next ones may too, and the middle tells more
            slow = slow or (leading == scale and outside - scale <= LEAST_CUT * (outside - inside))
            outside = scale
    return inside / steps


def _cheap_test(limit: Limit, fast_check: bool) -> Callable[[Trajectory], bool]:
    """What shows at little cost that a motion violates the limit."""
    if fast_check:
        return limit.fails_again if isinstance(limit, SupportsWitness) else _never
    return limit.violated if isinstance(limit, SupportsViolation) else _never


def _never(piece: Trajectory) -> bool:  # noqa: ARG001
    """A test that finds no violation."""
    return False


def last_true(passes: Callable[[int], bool], inside: int, outside: int) -> int:
    """By bisection: the largest number that passes, of those below `outside`; `inside` if none does."""
    while outside - inside > 1:
        middle = (inside + outside) // 2
        inside, outside = (middle, outside) if passes(middle) else (inside, middle)
    return inside


def _stretched(
    block: Block, family: Family, p: Array, stand: Stand, times: Array, side: int, factor: float
) -> Array | None:
    """A block extended with its low (1) or high (0) end fixed; None where it has no room."""
    path = family.motion(p, times, 1).orders[0]
    fixed = stand(path.min(axis=0) if side else path.max(axis=0))[block.members]
    block_point = p[block.members]
    _, most = block.chord(block_point[None], (block_point - fixed)[None])
    step = min(factor - 1.0, USABLE_PART * float(most[0]))
    if not step > LEAST_GROWTH - 1.0:
        return None
    trial = p.copy()
    trial[block.members] = block_point + step * (block_point - fixed)
    return trial


def _orders(limits: Sequence[Limit]) -> int:
    """Number of derivative orders that the limits need."""
    return max([ORDERS, *(limit.orders for limit in limits if isinstance(limit, SupportsOrders))])


def _hold(limits: Sequence[Limit], family: Family, p: Array, fast_check: bool) -> bool:
    pieces = [piece for _, _, piece in family.trajectory(p).pieces()] if limits else []
    return all(_holds(limit, piece, fast_check) for limit in limits for piece in pieces)


def _home_outside(
    limits: Sequence[Limit], family: Family, home: Array, fast_check: bool
) -> UnsafeTrajectoryError:
    """The error that names the limit violated by rest at home (P,), and by how much."""
    broken = [limit for limit in limits if not _hold((limit,), family, home, fast_check)]
    pieces = [piece for _, _, piece in family.trajectory(home).pieces()]
    rows = [row for limit in broken for piece in pieces for row in limit.prove(piece) if slack(row) < 0.0]
    facts = dict.fromkeys(_violation_text(row) for row in rows)
    return UnsafeTrajectoryError(
        f"rest at home violates the limits: {'; '.join(facts)}",
        where=", ".join(limit.name for limit in broken),
        next_step="Choose another home: `home` of [search] in robot.toml for arms, the middle of the "
        "room for vehicles. Enlarge only limits that are narrower than the data sheet's, "
        "or correct your own [[limit]].",
    )


def _violation_text(row: Proof) -> str:
    """Text on a violated row: the proved value, and the limit."""
    above = row.upper - row.proved_upper <= row.proved_lower - row.lower
    value, end = (row.proved_upper, row.upper) if above else (row.proved_lower, row.lower)
    tracking = f" with a tracking margin of {tracked_in_words(row)}" if row.tracking_margin else ""
    return f"{row.quantity} of {row.axis} is {value:.4g}, limit {end:.4g}{tracking}"


def _holds(limit: Limit, piece: Trajectory, fast_check: bool) -> bool:
    if fast_check and isinstance(limit, SupportsFastCheck):
        return limit.keeps(piece)
    if isinstance(limit, SupportsViolation) and limit.violated(piece):
        return False
    return all(slack(row) >= 0.0 for row in limit.prove(piece) if row.status != "not verified")


@dataclass(frozen=True, eq=False)
class PenalisedObjective:
    """An objective minus the weighted penalty, only for the search."""

    objective: SearchFunction
    nonconvex: NonconvexLimits
    weight: float

    @property
    def family(self) -> Family:
        return self.objective.family

    def value(self, p: Array) -> float:
        """The criterion minus the penalty."""
        return self.objective.value(p) - self.weight * self.nonconvex.penalty(self.family, p)[0]

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """Value and gradient (P,)."""
        value, gradient = self.objective.value_and_gradient(p)
        penalty, slope = self.nonconvex.penalty(self.family, p)
        return value - self.weight * penalty, gradient - self.weight * slope
