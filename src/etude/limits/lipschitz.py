"""A limit on any function of the pose, proved for all times from samples and the function's slopes.

Between two instants h apart a function with |df/dq_j| <= slope_j changes by no more than h times
sum_j slope_j max |dq_j/dt|. So the mean of its two values minus half of that is a lower bound, and plus half
of that an upper bound. Intervals with bounds beyond the sampled extremes are halved (the method of Piyavskii
and Shubert), until the proved extremes are close to the sampled ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType

import numpy as np

from etude.errors import EtudeError, UsageError
from etude.limits.certificate import memoized
from etude.limits.motion_limits import STRAYS, STRAYS_HOW, bound_of, tracked
from etude.protocols import Family, Trajectory
from etude.types import Array, Cone, Margins, Motion, Proof, Thing

FIRST_STEP, SEARCH_STEP = 0.02, 0.04
"""s between samples: of a proof at first, and of a search."""
TOLERANCE = 0.003
"""Fraction of the limit's width by which a proved extreme may exceed the sampled one."""
HALVINGS = 24
"""Largest number of halvings of an interval; after that its bound is accepted."""
POSES, STEPS = 64, (1e-3, 1.0)
"""Poses at which slopes are checked, and the largest changes of a coordinate there, relative to its range."""
ROUNDING = 1e-9
"""Fraction of the function's size by which a change may exceed its bound, for rounding."""


@dataclass(frozen=True, eq=False)
class LipschitzLimit:
    """lower <= function(pose) <= upper at all times.

    The limit is not convex: motions are shrunk towards home until it is proved.

    Attributes:
        quantity: name in the certificate: "height", "distance to the wall", ...
        axis: the body that it applies to, "tool" or "vehicle".
        function: poses (T, k) of the path -> (T,) its values.
        slopes: (k,) bounds of |d function / d pose|, valid between the ends of a motion's coordinates.
        lower, upper: ends, in the unit of the function; `upper` may be infinite.
        margins: of tracking, by form of motion, as `Kind.limits` gets them; each coordinate's error counts by
            its slope. An empty mapping allows for no tracking error.
        drawn: objects that represent the limit in a drawing.
        order, rest: 0 and False: the limit is on the pose, and requires no rest.
        coordinates: (k,) names of the pose's coordinates, for messages; `made_limits` gives them.
    """

    quantity: str
    axis: str
    function: Callable[[Array], Array]
    slopes: Array
    lower: float
    upper: float
    margins: Margins
    drawn: tuple[Thing, ...] = ()
    order: int = 0
    rest: bool = False
    coordinates: tuple[str, ...] = ()
    _proofs: dict[str, Proof] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and self.lower < self.upper):
            raise UsageError(
                f"the limit of {self.quantity} has the range {self.lower:g} to {self.upper:g}",
                where=self._source,
                next_step="State two numbers, the lower first; the upper may be infinite. For an upper "
                "end alone, limit minus the function.",
            )
        slopes = np.asarray(self.slopes, dtype=float)
        if slopes.ndim != 1 or not np.all(np.isfinite(slopes) & (slopes >= 0.0)):
            raise UsageError(
                f"the slopes of {self.quantity} are {slopes.tolist()}: one is negative or not a number",
                where=self._source,
                next_step="State the largest |df/dq| of each coordinate, 0 where f does not depend on it.",
            )
        if not isinstance(self.margins, Mapping):
            raise UsageError(
                f"the tracking margins of the limit of {self.quantity} are {type(self.margins).__name__}",
                where=self._source,
                next_step="Pass on the third argument of the function: def limit(spec, model, margins, "
                "*, ...).",
            )
        if self.order != 0 or self.rest:
            raise UsageError(
                f"the limit of {self.quantity} has order {self.order} and rest {self.rest}",
                next_step="LipschitzLimit proves functions of the pose alone: order 0, rest False. "
                "A limit on speeds or commands is a class with the methods of etude.protocols.Limit.",
            )
        if self.coordinates:
            self._check_size(len(self.coordinates))

    @property
    def name(self) -> str:
        return self.quantity

    @property
    def things(self) -> tuple[Thing, ...]:
        """Objects that represent the limit in a drawing."""
        return self.drawn

    def inner(self, form: str) -> tuple[float, float, float, float]:
        """Lower and upper less the margin, the margin, and its confidence."""
        slopes = np.asarray(self.slopes, dtype=float)
        error, confidence = tracked(0.0, self.margins, form, 0, list(range(len(slopes))))
        margin = float(slopes @ error)
        return self.lower + margin, self.upper - margin, margin, float(np.min(confidence))

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None: it is not convex."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """A penalty of zero: motions outside are shrunk towards home instead."""
        return 0.0, np.zeros_like(motion.orders)

    def keeps(self, piece: Trajectory) -> bool:
        """Whether samples of a piece keep the limit; for searches, whose result is proved afterwards."""
        count = max(2, math.ceil(piece.duration / SEARCH_STEP)) + 1
        poses = piece.motion(np.linspace(0.0, piece.duration, count), 1).orders[0]
        return self._inside(poses, piece.form)

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row; raises UsageError for a curve without a bound of its speed."""
        return (memoized(self._proofs, piece.to_json(), lambda: self._row(piece)),)

    def of_motion(self, motion: Motion) -> Array:
        """(T, 1) the function's values."""
        return self._values(motion.orders[0])[:, None]

    def strayed(self, places: Array, off: Array) -> Sequence[Proof]:
        """One row, from poses (T, k) and their possible errors (T, k), which margins allow for."""
        values, by = self._values(places), off @ np.asarray(self.slopes)
        ends = self.lower, self.upper, float((values - by).min()), float((values + by).max())
        return [Proof(self.axis, f"{self.quantity}, {STRAYS}", *ends, STRAYS_HOW, "sampled")]

    def blocked(self, form: str, pose: Array) -> str:
        """The name of the quantity if a pose (k,) is outside, else ""."""
        return "" if self._inside(pose[None], form) else f"the limit of {self.quantity} of {self.axis}"

    def about(self, lower: Array, upper: Array) -> LipschitzLimit:  # noqa: ARG002
        """The same limit: it has no box."""
        return self

    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]:  # noqa: ARG002
        """Whether poses (T, k) are inside."""
        return lambda poses: self._inside(poses, form)

    def _inside(self, poses: Array, form: str) -> bool:
        values = self._values(poses)
        low, high, _, _ = self.inner(form)
        return bool(np.all((values >= low) & (values <= high)))

    def _values(self, poses: Array) -> Array:
        self._check_size(poses.shape[1])
        try:
            values = np.asarray(self.function(poses), dtype=float)
        except EtudeError:
            raise
        except Exception as error:
            raise UsageError(
                f"the function of the limit of {self.quantity} failed: {type(error).__name__}: {error}",
                where=self._source,
                next_step="Repair the plug-in: its function takes poses (T, k) and returns T numbers.",
            ) from error
        if values.shape != (len(poses),) or not np.isfinite(values).all():
            raise UsageError(
                f"the limit of {self.quantity} gives {values.shape} for poses {poses.shape}, or not numbers",
                where=self._source,
                next_step="Its function takes poses (T, k) and returns T finite numbers.",
            )
        return values

    @property
    def _source(self) -> str:
        """The plug-in's function."""
        definition = self.function if isinstance(self.function, FunctionType) else type(self.function)
        return f"{definition.__module__}:{definition.__qualname__}"

    def _check_size(self, size: int) -> None:
        if len(self.slopes) != size:
            raise UsageError(
                f"the limit of {self.quantity} has {len(self.slopes)} slopes, but the pose has {size} "
                "coordinates",
                where=self._source,
                next_step="State the largest |df/dq| of each coordinate, 0 where f does not depend on it.",
            )

    def _check_slopes(self, poses: Array) -> None:
        """Raise UsageError if a slope is too small somewhere between the ends of poses (T, k)."""
        needed = needed_slopes(self._values, poses.min(axis=0), poses.max(axis=0))
        for j in np.flatnonzero(needed > self.slopes):
            axis = self.coordinates[j] if self.coordinates else f"coordinate {j + 1}"
            raise UsageError(
                f"the slope of {self.quantity} in {axis} is {self.slopes[j]:g}, but at least "
                f"{needed[j]:.3g} is needed",
                where=self._source,
                next_step="State the largest |df/dq| of each coordinate; smaller values prove nothing.",
            )

    def _row(self, piece: Trajectory) -> Proof:
        t = np.linspace(0.0, piece.duration, max(2, math.ceil(piece.duration / FIRST_STEP)) + 1)
        poses = piece.motion(t, 1).orders[0]
        values = self._values(poses)
        self._check_slopes(poses)
        low, high, margin, confidence = self.inner(piece.form)
        rate = self._rate(piece)
        width = self.upper - self.lower
        tolerance = TOLERANCE * (width if math.isfinite(width) else float(np.ptp(values)))

        def at(instants: Array) -> Array:
            return self._values(piece.motion(instants, 1).orders[0])

        least, most = extremes(at, t, values, rate, tolerance)
        how = f"samples, and slopes times speeds of at most {rate:.3g} per s between them"
        return Proof(
            self.axis,
            self.quantity,
            low,
            high,
            least,
            most,
            how,
            tracking_margin=margin,
            confidence=confidence,
        )

    def _rate(self, piece: Trajectory) -> float:
        """Bound of the function's rate of change, per s."""
        axes = list(range(len(self.slopes)))
        low, high = bound_of(piece, 1, 1, axes, np.zeros(len(axes))).range()
        rate = float(np.asarray(self.slopes) @ np.maximum(np.abs(low), np.abs(high)))
        if not math.isfinite(rate):
            raise UsageError(f"the speed of this curve has no bound, so its {self.quantity} has none")
        return rate


def needed_slopes(values: Callable[[Array], Array], lower: Array, upper: Array) -> Array:
    """(k,) the steepest change seen in each coordinate, at random pairs of poses that differ in it alone.

    Rounding errors are subtracted.

    Args:
        values: poses (T, k) -> (T,). lower, upper: (k,) ends of the poses.
    """
    rng, k = np.random.default_rng(0), len(lower)
    width = upper - lower
    first = np.tile(rng.uniform(lower, upper, (POSES, k)), (len(STEPS), 1))
    at_first = values(first)
    slack = ROUNDING * (1.0 + np.abs(at_first).max())
    slopes = np.zeros(k)
    for j in np.flatnonzero(width > 0.0):
        second = first.copy()
        reach = np.repeat(STEPS, POSES) * width[j]
        second[:, j] = np.clip(second[:, j] + rng.uniform(-reach, reach), lower[j], upper[j])
        step = np.abs(second[:, j] - first[:, j])
        change = np.abs(values(second) - at_first) - slack
        slopes[j] = np.max(change / np.where(step > 0.0, step, np.inf), initial=0.0)
    return slopes


def extremes(
    at: Callable[[Array], Array], t: Array, values: Array, rate: float, tolerance: float
) -> tuple[float, float]:
    """An interval that holds a function on all of [t_0, t_n].

    Args:
        at: instants (M,) -> values (M,). t: (n + 1,) increasing. values: (n + 1,) at these.
        rate: bound of |d value / dt|.
        tolerance: amount by which the interval may exceed the sampled values.
    """
    start, step, left, right = t[:-1], np.diff(t), values[:-1], values[1:]
    sampled = float(values.min()), float(values.max())
    least, most = sampled
    for halving in range(HALVINGS + 1):
        middle, spread = 0.5 * (left + right), 0.5 * rate * step
        far = (middle - spread < sampled[0] - tolerance) | (middle + spread > sampled[1] + tolerance)
        done = ~far if halving < HALVINGS else np.ones_like(far)
        least = min(least, float((middle - spread)[done].min(initial=np.inf)))
        most = max(most, float((middle + spread)[done].max(initial=-np.inf)))
        if done.all():
            break
        start, step, left, right = start[far], 0.5 * step[far], left[far], right[far]
        middle_values = at(start + step)
        sampled = min(sampled[0], float(middle_values.min())), max(sampled[1], float(middle_values.max()))
        start, step = np.concatenate([start, start + step]), np.tile(step, 2)
        left, right = np.concatenate([left, middle_values]), np.concatenate([middle_values, right])
    return least, most
