"""Limits of commands along a motion: by a model with its deviation, and their rates.

A command along a motion is no polynomial and its model is learned. So nothing is proved for all times: it is
sampled every few milliseconds, and its row is marked "sampled". Between two samples a command with second
derivative c stays within c h^2/8 of the line through them, and its rate within c h/2 of that line's slope. c
is taken from the second differences of the samples themselves, times two.

After little training data the model may predict too large deviations, above all at reversals. With these,
even the training motion would exceed the limits, although the robot ran it within them. In that case the
deviation is wrong. If it counted in full, hardly any motion would be allowed, and no informative one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from etude._runtime.rounding import whole_down, whole_up
from etude.abilities import SupportsFastMoments, SupportsRefusal
from etude.codes import Notice, Phrase, Warn
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits.certificate import COMMANDS, memoized
from etude.protocols import Family, Limit, Model, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Cone, Log, Motion, Proof

SPACING, COARSE = 0.005, 0.04
"""s between samples of the mean, and of its deviation."""
LOOK, CLOSE = 0.1, 0.99
"""s between samples in searches, and the fraction of each limit that is allowed there."""
FEW, AMPLE = 75, 0.75
"""Number of samples in the first check of a search, and the fraction of each limit below which it passes. The
larger deviation of two neighbours counts. Rates need more samples."""
SELDOM = 0.2
"""s between samples of the deviation there: with 0.4, proofs failed later where friction makes it peak."""
SURE = 0.95
"""Probability that all commands stay within their rows at once, if the model's deviations are correct."""
DECORRELATED = 0.5
"""s after which two deviations count as independent."""
CAUTION = 2.0
"""Safety factor on second differences, since the curvature between samples is not known."""
REMEMBERED = 24
"""Instants of failures that are kept: more take as long as a check of the whole motion."""
MORE = 2.0
"""Factor on the deviations before any data. Searches take the product as the model's largest deviation;
proofs compute the deviation."""
STEP = 1e-4
"""Step of the penalty's finite differences, in SI units."""

Answer = Callable[[Motion], Array]
Both = Callable[[Motion], tuple[Array, Array]]
Deviations = tuple[Array, Array]
"""Instants (n,) and the deviations (n, J) there."""

Instants = dict[float, Array]
"""Instants (m, r) of r failures, as fractions of the duration of motions that failed there; by that duration,
since other durations have other samples."""


@dataclass(frozen=True, eq=False)
class CommandLimit:
    """A limit of `contracts`: lower <= mean - b deviation and mean + b deviation <= upper, |rate| <= rate.

    Attributes:
        quantity: "torque" or "command".
        units: of the J commands: a slide's force is in N where a hinge's torque is in N m. names: of them.
        lower, upper: (J,). rate: (J,) per s, infinite where there is no limit.
        mean: motion -> (T, J). deviation: motion -> (T, J); None: the mean is all that is known.
        source: where the prediction comes from, for the certificate.
        orders: number of derivative orders of the motion that `mean` and `deviation` need.
        gaps: sentences for the certificate on what is not verified.
        most: (J,) deviations that are rarely exceeded. A search computes the costly actual deviations only
            where these would exceed the limit. None: unknown.
        both: motion -> mean and deviation, at the cost of the deviation alone; None: two separate calls.
        at_most: motion -> mean and a cheap upper bound of the deviations; None: there is none.
        share: (J,) fraction of the deviations that counts, see `credible`; None: all.
        lasts: s after which two deviations count as independent; inf: one deviation holds for the whole
            motion, as an assumed one of masses and friction does.
    """

    quantity: str
    units: tuple[str, ...]
    names: tuple[str, ...]
    lower: Array
    upper: Array
    rate: Array
    mean: Answer
    deviation: Answer | None
    source: str
    orders: int = 3
    gaps: tuple[str, ...] = ()
    looks_at: tuple[str, ...] = (COMMANDS,)
    most: Array | None = None
    both: Both | None = None
    at_most: Both | None = None
    share: Array | None = None
    lasts: float = DECORRELATED
    _proofs: dict[str, tuple[Proof, ...]] = field(default_factory=dict, repr=False)
    _witness: Instants = field(default_factory=dict, repr=False)
    _broken: Instants = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        return self.quantity

    @property
    def not_verified(self) -> tuple[str, ...]:
        """Sentences on what is not verified."""
        return self.gaps

    @property
    def rated(self) -> list[int]:
        """Places of the commands whose rate is limited."""
        return [int(j) for j in np.flatnonzero(np.isfinite(self.rate))]

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None: a command bounds no parameter by itself."""
        return ()

    def beyond(self, duration: float) -> float:
        """Factor b on all deviations along a motion: a union bound over independent deviations.

        maths: Phi^-1(1 - (1 - SURE)/(2 n)) for n independent deviations.
        """
        count = max(1.0, duration / self.lasts) * len(self.names)
        return NormalDist().inv_cdf(1.0 - (1.0 - SURE) / (2.0 * count))

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        """Mean square excess of the commands, relative to half a limit; gradient by finite differences."""
        duration, gradient = float(np.ptp(motion.t)), np.zeros_like(motion.orders)
        if self._clear(self.mean(motion), duration):
            return 0.0, gradient
        spread = self.spread(motion, duration, SELDOM)
        over = self._relative_excess(motion, spread)
        at = np.flatnonzero(over.any(axis=1))
        if not len(at):
            return 0.0, gradient
        value, near = float((over**2).mean()), Motion(motion.t[at], motion.orders[:, at])
        for order in range(min(self.orders, len(motion.orders))):
            for axis in range(motion.orders.shape[2]):
                ends = []
                for sign in (-1.0, 1.0):
                    orders = near.orders.copy()
                    orders[order, :, axis] += sign * STEP
                    ends.append((self._relative_excess(Motion(near.t, orders), spread[at]) ** 2).sum(axis=1))
                gradient[order, at, axis] = (ends[1] - ends[0]) / (2.0 * STEP * over.size)
        return value, gradient

    def keeps(self, piece: Trajectory) -> bool:
        """Whether coarse samples keep the limit; for searches, whose result is proved afterwards."""
        known = None
        if piece.duration / FEW >= 2.0 * LOOK and not self.rated:
            decided, known = self._coarse_check(piece)
            if decided is not None:
                return decided
        motion = self.along(piece, LOOK)
        mean, middle = self.mean(motion), 0.5 * (self.upper + self.lower)
        rates = np.abs(np.diff(mean, axis=0)) / np.diff(motion.t)[:, None]
        room = CLOSE * 0.5 * (self.upper - self.lower) - np.abs(mean - middle)
        if np.any(rates > CLOSE * self.rate):
            return False
        if np.any(room < 0.0) or self._clear(mean, piece.duration):  # the cheap mean alone already decides
            return self._check_excess(motion, -room, piece.duration)
        spread = self.spread(motion, piece.duration, SELDOM, known)
        return self._check_excess(motion, spread - room, piece.duration)

    def fails_again(self, piece: Trajectory) -> bool:
        """Whether a motion fails at instants at which `keeps` found the largest excess of earlier ones."""
        if piece.duration not in self._witness:
            return False
        t, rows = np.unique(self._witness[piece.duration] * piece.duration, return_inverse=True)
        mean, deviation = self._moments(piece.motion(t, self.orders))
        _, at, left, right = rows.reshape(4, -1)
        off = np.abs(mean[at] - 0.5 * (self.upper + self.lower))
        spread = self._counted(piece.duration) * np.maximum(deviation[left], deviation[right])
        return bool(np.any(off + spread > CLOSE * 0.5 * (self.upper - self.lower)))

    def _check_excess(self, motion: Motion, excess: Array, duration: float, apart: float = SELDOM) -> bool:
        """Whether no excess (T, J) is positive; else each such command's worst instant is kept for
        `fails_again`.

        With it are kept the instant before, which shows friction the direction, and the two samples `apart`
        seconds from each other whose deviations `spread` takes there.
        """
        if np.all(excess <= 0.0):
            return True
        rows = np.unique(excess.argmax(axis=0)[~np.all(excess <= 0.0, axis=0)])
        every = _every(motion, apart)
        left = rows // every * every
        places = np.stack([rows - 1, rows, left, left + (every if apart else 0)]).clip(0, len(motion.t) - 1)
        _remember(self._witness, duration, motion.t[places] / duration)
        return False

    def violated(self, piece: Trajectory) -> bool:
        """Whether a sample exceeds the limit, so that no proof can hold; such a proof takes ten times as
        long.

        Among the samples are the worst ones of proofs that failed, as these count them.
        """
        grid = self.along(piece, LOOK).t
        worst = self._broken.get(piece.duration, np.empty((7, 0))) * piece.duration
        t, rows = np.unique(np.concatenate([grid, worst.ravel()]), return_inverse=True)
        mean, deviation = self._moments(piece.motion(t, self.orders))
        off, half = np.abs(mean - 0.5 * (self.upper + self.lower)), 0.5 * (self.upper - self.lower)
        counted, looked = self._counted(piece.duration), rows[: len(grid)]
        if np.any(off[looked] + counted * deviation[looked] > half):
            return True
        *around, left, right = rows[len(grid) :].reshape(worst.shape)
        spread = counted * np.maximum(deviation[left], deviation[right])
        return bool(np.any(off[around[2]] + spread + _curvature(mean[np.array(around)])[2] / 8.0 > half))

    def _coarse_check(self, piece: Trajectory) -> tuple[bool | None, Deviations | None]:
        """Decision from few samples, and the deviations there: True if they use so little of each limit that
        the gaps cannot matter, False if they exceed it, None if only finer samples can decide.
        """
        motion, counted = self.along(piece, piece.duration / FEW), self._counted(piece.duration)
        middle, half = 0.5 * (self.upper + self.lower), 0.5 * (self.upper - self.lower)
        for ask in (self._moments,) if self.at_most is None else (self.at_most, self._moments):
            mean, deviation = ask(motion)
            off = np.abs(mean - middle)
            if np.any(off > CLOSE * half):
                return self._check_excess(motion, off - CLOSE * half, piece.duration, 0.0), None
            most = np.maximum(off[:-1], off[1:]) + counted * np.maximum(deviation[:-1], deviation[1:])
            if np.all(most <= AMPLE * half):
                return True, None
            excess = off + counted * deviation - CLOSE * half
        undecided = self._check_excess(motion, excess, piece.duration, 0.0)
        return (None, (motion.t, deviation)) if undecided else (False, None)

    def _moments(self, motion: Motion) -> tuple[Array, Array]:
        """(T, J) means and deviations."""
        if self.both is not None:
            return self.both(motion)
        mean = self.mean(motion)
        return mean, np.zeros_like(mean) if self.deviation is None else self.deviation(motion)

    def blocked(self, form: str, pose: Array) -> str:  # noqa: ARG002
        """The first command that exceeds its limit at rest at a pose (k,); "" if none does."""
        still = rest_at(pose, self.orders)
        mean, spread = self.mean(still)[0], self.spread(still, 0.0)[0]
        for added, why in ((0.0, ""), (spread, " with its deviation")):
            beyond = np.flatnonzero((mean - added < self.lower) | (mean + added > self.upper))
            if len(beyond):
                return f"the {self.quantity} of {self.names[beyond[0]]}{why}"
        return ""

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """A row for each command, and one for each limited rate; all have the status "sampled".

        Raises UsageError for a curve without accelerations, and for set-points that are held.
        """
        return memoized(self._proofs, piece.to_json(), lambda: self._rows(piece))

    def of_motion(self, motion: Motion) -> Array:
        """(T, J + rates) the mean, and the slopes from sample to sample."""
        mean = self.mean(motion)
        slopes = np.gradient(mean, motion.t, axis=0) if len(motion.t) > 1 else np.zeros_like(mean)
        return np.concatenate([mean, slopes[:, self.rated]], axis=1)

    def _rows(self, piece: Trajectory) -> tuple[Proof, ...]:
        if isinstance(piece, Splined) and piece.held:
            raise UsageError(f"the {self.quantity} between set-points that are held is the receiver's own")
        piece.bound(self.orders - 1, 1)  # raises for curves without that derivative
        motion = self.along(piece, SPACING)
        step, mean = float(motion.t[1] - motion.t[0]), self.mean(motion)
        spread, bend = self.spread(motion, piece.duration), _curvature(mean)
        # a curve leaves the chord between two samples by at most an eighth of its second difference
        low, high = (mean - spread - bend / 8.0).min(axis=0), (mean + spread + bend / 8.0).max(axis=0)
        text = f"samples every {1000.0 * step:.2g} ms of {self._source_text(piece)}"
        rows = []
        for j, name in enumerate(self.names):
            method = f"{text}; between them at most {bend[:, j].max() / 8.0:.2g} {self.units[j]} more"
            rows.append(_row(name, self.quantity, (self.lower[j], self.upper[j]), (low[j], high[j]), method))
        self._keep_worst(motion, np.abs(mean - 0.5 * (self.upper + self.lower)) + spread + bend / 8.0)
        slope, more = np.abs(np.diff(mean, axis=0)) / step, bend / (2.0 * step)
        steepest = (slope + np.maximum(more[:-1], more[1:])).max(axis=0)
        for j in self.rated:
            method = f"{text}, its mean; between them at most {more[:, j].max():.2g} {self.units[j]}/s more"
            ends = (-self.rate[j], self.rate[j]), (-steepest[j], steepest[j])
            rows.append(_row(self.names[j], f"{self.quantity} rate", *ends, method))
        return tuple(rows)

    def _keep_worst(self, motion: Motion, most: Array) -> None:
        """Keep the worst instant of each command (T, J) beyond half its limit, for `violated`: with the two
        before and after it, and the two samples whose deviations count there.
        """
        beyond, every = (most > 0.5 * (self.upper - self.lower)).any(axis=0), _every(motion, COARSE)
        if beyond.any() and len(most) > 4:
            at = most[2:-2, beyond].argmax(axis=0) + 2
            left = at // every * every
            places = np.stack([at - 2, at - 1, at, at + 1, at + 2, left, left + every])
            t, duration = motion.t[places.clip(max=len(most) - 1)], float(motion.t[-1])
            _remember(self._broken, duration, t / duration)

    def _source_text(self, piece: Trajectory) -> str:
        if self.deviation is None:
            return self.source
        counts = self._counted(piece.duration)
        most, least = float(counts.max()), float(counts.min())
        count = f"{most:.2g}" if most == least else f"{least:.2g} to {most:.2g}"
        assumed = "assumed " if math.isinf(self.lasts) else ""
        return f"{self.source} and {count} of its {assumed}deviations"

    def along(self, piece: Trajectory, spacing: float) -> Motion:
        """The motion sampled every `spacing` s, end included."""
        count = max(3, whole_up(piece.duration / spacing)) + 1
        return piece.motion(np.linspace(0.0, piece.duration, count), self.orders)

    def _clear(self, mean: Array, duration: float) -> bool:
        """Whether means (T, J) plus the rarely exceeded deviations `most` keep the limits; for searches."""
        if self.most is None:
            return False
        middle, half = 0.5 * (self.upper + self.lower), 0.5 * (self.upper - self.lower)
        return bool(np.all(np.abs(mean - middle) + self._counted(duration) * self.most <= CLOSE * half))

    def spread(
        self, motion: Motion, duration: float, apart: float = COARSE, known: Deviations | None = None
    ) -> Array:
        """(T, J) deviations times b, from samples every `apart` s; the larger of two neighbours counts.

        known: instants and deviations there, taken if these are the samples.
        """
        if self.deviation is None:
            return np.zeros((len(motion.t), len(self.names)))
        every = _every(motion, apart)
        places = np.arange(0, len(motion.t) - 1 + every, every)
        places[-1] = len(motion.t) - 1
        if known is not None and np.array_equal(known[0], motion.t[places]):
            deviations = known[1]
        else:
            deviations = self.deviation(Motion(motion.t[places], motion.orders[:, places]))
        left = np.minimum(
            np.searchsorted(places, np.arange(len(motion.t)), side="right") - 1, len(places) - 1
        )
        right = np.minimum(left + 1, len(places) - 1)
        return np.asarray(self._counted(duration) * np.maximum(deviations[left], deviations[right]))

    def _counted(self, duration: float) -> Array:
        """(J,) factor on the deviations: b times the fraction that counts."""
        return np.asarray(self.beyond(duration) * (1.0 if self.share is None else self.share))

    def _relative_excess(self, motion: Motion, spread: Array) -> Array:
        """(T, J) excess of the commands relative to half a limit, 0 inside."""
        mean, half = self.mean(motion), 0.5 * (self.upper - self.lower)
        outside = np.maximum(mean + spread - self.upper, self.lower - mean + spread)
        return np.asarray(np.maximum(outside, 0.0) / half)


def _remember(instants: Instants, duration: float, places: Array) -> None:
    """Add instants (m, r) to the newest of this duration; those of others go."""
    before = instants.get(duration, np.empty((len(places), 0)))
    instants.clear()
    instants[duration] = np.concatenate([before, places], axis=1)[:, -REMEMBERED:]


def by_model(
    model: Model,
    quantity: str,
    units: Sequence[str],
    names: Sequence[str],
    ends: tuple[Array, Array],
    rate: Array,
) -> CommandLimit:
    """Limit of the commands that a learned model predicts: mean, and deviations with noise and calibration.

    Args:
        model: the newest model. quantity, units, names: of its commands.
        ends: least and largest (J,). rate: (J,) per s, infinite where there is no limit.
    """
    inputs, fast = model.inputs, model if isinstance(model, SupportsFastMoments) else None
    last: list[tuple[Motion, Log]] = []

    def states(motion: Motion) -> Log:
        """Of the last motion they are kept: a bound and the exact answer need the same."""
        if not last or last[0][0] is not motion:
            last[:] = [(motion, inputs.states(motion))]
        return last[0][1]

    def mean(motion: Motion) -> Array:
        log = states(motion)
        return np.asarray(model.posterior(log)[0] if fast is None else fast.mean(log))

    def both(motion: Motion) -> tuple[Array, Array]:
        mean, variance = model.posterior(states(motion))
        return np.asarray(mean), np.asarray(np.sqrt(variance))

    def deviation(motion: Motion) -> Array:
        return both(motion)[1]

    def at_most(motion: Motion) -> tuple[Array, Array]:
        assert fast is not None
        bound, variance = fast.at_most(states(motion))
        return np.asarray(bound), np.asarray(np.sqrt(variance))

    # the mean of a model that claims a minimal variance may be completely wrong
    most = None if fast is None or fast.least is not None else MORE * fast.prior_deviation
    return CommandLimit(
        quantity,
        tuple(units),
        tuple(names),
        *ends,
        rate,
        mean,
        deviation,
        "the learned model",
        inputs.orders,
        most=most,
        both=both,
        at_most=None if fast is None else at_most,
    )


def _every(motion: Motion, apart: float) -> int:
    """Number of samples of the motion in `apart` seconds, at least 1."""
    return max(1, whole_down(apart / float(motion.t[1] - motion.t[0]))) if len(motion.t) > 1 else 1


def _row(
    axis: str, quantity: str, limit: tuple[float, float], interval: tuple[float, float], method: str
) -> Proof:
    low, high = map(float, limit)
    least, most = map(float, interval)
    return Proof(axis, quantity, low, high, least, most, f"{method} by second differences", "sampled")


def _curvature(mean: Array) -> Array:
    """(T, J) |second difference| around each sample, with the safety factor."""
    bend = np.zeros_like(mean)
    bend[1:-1] = CAUTION * np.abs(np.diff(mean, 2, axis=0))
    bend[0], bend[-1] = bend[1], bend[-2]
    return np.maximum(bend, np.maximum(np.roll(bend, 1, axis=0), np.roll(bend, -1, axis=0)))


BELIEVED_ROOM = 2.0 / 3.0
"""Fraction of the room beside the mean that deviations may use along a motion that was run. The next motion
differs, and its deviations may be half as large again."""
NEAR_LIMIT = 0.9
"""Fraction of half a limit above which a mean is no evidence: the robot may have been at its limit there."""
LEAST_BELIEVED = 0.25
"""Smallest fraction of the deviations that counts: with the usual factor b = 4, about one deviation."""


def after_run(limits: Sequence[Limit], ran: Trajectory) -> list[Limit]:
    """The limits; those of commands reduce each deviation to the fraction that the motion `ran` supports."""
    return [_updated(limit, ran) if isinstance(limit, CommandLimit) else limit for limit in limits]


def _updated(limit: CommandLimit, ran: Trajectory) -> CommandLimit:
    if limit.deviation is None:
        return limit
    return _with_share(
        limit,
        credible(limit, ran),
        "All of them together would exclude the robot's last motion: the model is still too uncertain.",
    )


def held_at(limit: CommandLimit, home: Array) -> CommandLimit:
    """The limit with the share of each assumed deviation that leaves room beside rest at `home` (k,), where a
    robot is known to stand.
    """
    still = rest_at(home, limit.orders)
    middle, half = 0.5 * (limit.upper + limit.lower), 0.5 * (limit.upper - limit.lower)
    room = half - np.abs(limit.mean(still)[0] - middle)
    share = np.clip(BELIEVED_ROOM * room / limit.spread(still, 0.0)[0], 0.0, 1.0)
    # a home that the mean alone excludes is another matter, see `kept_at`
    share = np.where(room > 0.0, share, 1.0)
    return _with_share(limit, share, "All of them together would almost exclude rest at home.")


def weight_at(limit: CommandLimit, poses: Array) -> Array:
    """(n,) largest part of a limit at rest at poses (n, k), up to 1 where `held_at` counts all deviations."""
    still, half = rest_at(poses, limit.orders), 0.5 * (limit.upper - limit.lower)
    mean, deviation = limit._moments(still)
    off = np.abs(mean - 0.5 * (limit.upper + limit.lower))
    return np.asarray(np.max((off + limit._counted(0.0) * deviation / BELIEVED_ROOM) / half, axis=1))


def _with_share(limit: CommandLimit, share: Array, why: str) -> CommandLimit:
    """The limit with a share (J,) of the deviations that it counts, and a sentence if that is not all."""
    if np.all(share >= 1.0):
        return limit
    share = share if limit.share is None else limit.share * share
    short = [j for j in range(len(share)) if share[j] < 1.0]
    parts = ", ".join(f"{limit.names[j]} {100.0 * share[j]:.0f} %" for j in short)
    sentence = (
        f"The full {limit.quantity}: only a part of the deviations of {limit.source} is used, {parts}. {why}"
    )
    return replace(limit, share=share, gaps=(*limit.gaps, sentence), _proofs={})


def credible(limit: CommandLimit, ran: Trajectory) -> Array:
    """(J,) largest fraction of each deviation with which the motion keeps its limits, `LEAST_BELIEVED`..1."""
    motion = limit.along(ran, LOOK)
    mean, spread = limit.mean(motion), limit.spread(motion, ran.duration, SELDOM)
    half = 0.5 * (limit.upper - limit.lower)
    off = np.abs(mean - 0.5 * (limit.upper + limit.lower))
    near = (off <= NEAR_LIMIT * half) & (spread > 0.0)
    with np.errstate(divide="ignore"):
        parts = np.where(near, BELIEVED_ROOM * (half - off) / spread, np.inf)
    return np.asarray(np.clip(parts.min(axis=0), LEAST_BELIEVED, 1.0))


LONGEST = 120.0
"""s, duration of the motion for which rest at home is checked."""


def _takes(limit: CommandLimit, j: int, most: float) -> Notice:
    """Notice of the largest value `most` of command `j`, and of its limit."""
    fields = {"command": limit.names[j], "most": most, "unit": limit.units[j]}
    return Notice(Phrase.TAKES, {**fields, "limit": float(min(limit.upper[j], -limit.lower[j]))})


@dataclass(frozen=True, eq=False)
class OpenCommands:
    """Commands that cannot be verified: a limit without rows, listed on the certificate as not verified.

    Attributes:
        gaps: sentences for the list of what is not verified.
        limit: the limit that even rest violates.
        refused: why no motion is allowed, and what to do; "" where the user has stated, or a log has shown,
            that a limit is not real.
    """

    gaps: tuple[str, ...]
    limit: CommandLimit | None = None
    refused: tuple[str, str] = ("", "")
    looks_at: tuple[str, ...] = (COMMANDS,)
    name: str = "commands"

    @property
    def not_verified(self) -> tuple[str, ...]:
        """The reason."""
        return self.gaps

    def warned(self, trajectory: Trajectory) -> tuple[Notice, ...]:
        """Warnings of the certificate: by how much the mean command of this motion exceeds its limits."""
        if self.limit is None:
            return ()
        low, high = _extremes(self.limit, trajectory)
        beyond = np.flatnonzero((high > self.limit.upper) | (low < self.limit.lower))
        if not len(beyond):
            return ()
        excesses = tuple(_takes(self.limit, j, float(max(high[j], -low[j]))) for j in beyond.tolist())
        fields = {"quantity": self.limit.quantity, "source": self.limit.source, "beyond": excesses}
        return (Notice(Warn.BEYOND_LIMITS, fields),)

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array] | None:  # noqa: ARG002
        """None."""
        return None

    def prove(self, piece: Trajectory) -> Sequence[Proof]:  # noqa: ARG002
        """No row."""
        return ()

    def of_motion(self, motion: Motion) -> Array:
        """(T, 0)."""
        return np.zeros((len(motion.t), 0))


def kept_at(limit: CommandLimit, home: Array) -> CommandLimit | OpenCommands:
    """The limit; or, where rest at `home` (k,) already exceeds it, the reason why it cannot be verified.

    In that case no motion keeps the limit, and the cause is the model's values or its deviation.
    """
    still = rest_at(home, limit.orders)
    mean, spread = limit.mean(still)[0], limit.spread(still, LONGEST)[0]
    over = np.maximum(mean + spread - limit.upper, limit.lower - mean + spread)
    if not np.any(over > 0.0):
        return limit
    j = int(np.argmax(over / (limit.upper - limit.lower)))
    most = f"{mean[j]:.3g} {limit.units[j]}" + (
        f" with a deviation of {spread[j]:.2g}" if spread.any() else ""
    )
    return OpenCommands(
        (
            f"Whether the drives can deliver the forces: {limit.source} states {most} for "
            f"{limit.names[j]} at rest at home, beyond {limit.lower[j]:.3g}..{limit.upper[j]:.3g}; one of "
            "them is wrong.",
        ),
        limit,
    )


def require_possible(limits: Sequence[Limit]) -> None:
    """Raise UnsafeTrajectoryError if one of the limits allows no motion."""
    for limit in limits:
        fact, next_step = limit.refused if isinstance(limit, SupportsRefusal) else ("", "")
        if fact:
            raise UnsafeTrajectoryError(fact, next_step=next_step)


def rest_at(poses: Array, orders: int) -> Motion:
    """Samples at rest at a pose (k,), or at each of some (n, k)."""
    poses = np.atleast_2d(poses)
    still = Motion(np.zeros(len(poses)), np.zeros((orders, *poses.shape)))
    still.orders[0] = poses
    return still


def _extremes(limit: CommandLimit, trajectory: Trajectory) -> tuple[Array, Array]:
    """(J,) least and largest means at samples along all pieces."""
    means = [limit.mean(limit.along(piece, LOOK)) for _, _, piece in trajectory.pieces()]
    return np.min([m.min(axis=0) for m in means], axis=0), np.max([m.max(axis=0) for m in means], axis=0)
