"""The supervisor of a motion: each check is a quantity, a bound, and a time beyond it.

A glitch of the bus is one sample, a collision lasts. So nothing stops at once, except what the robot itself
reports. Times are of our own clock (`Sample.seen`), which no fault of the robot's clock touches.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from etude.drivers.contract import About, Bounds, PlannedMotion, Reaction, Sample
from etude.errors import UsageError
from etude.types import Array

MEAN_OVER = 0.1
"""s, of the means of residuals."""
DRIFT_FORGOTTEN = 1.0
"""s in which a drift of the robot's clock becomes the one that a jump is told against."""
FROZEN_STEPS, FROZEN_PART = 3.0, 0.25
"""No position of any joint changes in any bit, while a motion asks a joint to move by so many steps of its
encoder and by this part of its bound of errors. Stiction holds a joint too, but not all of them that far.
"""


@dataclass(eq=False)
class _Check:
    """A quantity that must not be beyond its bound for longer than for_s.

    quantity: from a sample to (J,) or a number; None: the sample lacks it. bound: of its size.
    sentence: for the reason, with {name}, {value} and {bound}.
    """

    quantity: Callable[[Sample], Array | float | None]
    bound: Array | float
    sentence: str
    for_s: float
    since: float | None = None

    def beyond(self, sample: Sample) -> tuple[int, float, float] | None:
        """(joint, value, bound) if the bound has been left for long enough."""
        value = self.quantity(sample)
        inside = value is None or np.less_equal(value, self.bound).all()  # NaN is beyond
        if value is None or inside:
            self.since = None
            return None
        if self.since is None:
            self.since = sample.seen
        if sample.seen - self.since < self.for_s:
            return None
        values, bounds = np.broadcast_arrays(np.atleast_1d(value), self.bound)
        joint = int(np.argmax(np.where(np.isfinite(values), values / np.maximum(bounds, 1e-300), np.inf)))
        return joint, float(values[joint]), float(bounds[joint])


class Supervisor:
    """Watches one motion. `watch` is called with every sample, in the order in which they come.

    Args:
        bounds: of the motion.
        about: the moving robot.
        motion: the planned motion.
        predicted: (n, J) commands at the rows of the motion, with gravity as in the robot's own commands;
            None: residuals are not watched.

    Attributes:
        reason: a sentence on why it stopped the motion; "" before.
        worst_error: (J,) largest |q - asked| so far, glitches of one sample left out.

    Raises:
        UsageError: the motion is of other joints, or bounds of another number of them.
    """

    def __init__(
        self, bounds: Bounds, about: About, motion: PlannedMotion, predicted: Array | None = None
    ) -> None:
        _require_fitting(bounds, about, motion, predicted)
        self.bounds, self.about, self.motion = bounds, about, motion
        self.reason = ""
        self.worst_error = np.zeros(len(about.joints))
        self._predicted = predicted
        self._error_before = np.zeros(len(about.joints))
        self._still = _Still(bounds, about)
        self._clock = _ClockOffset()
        self._velocity = _Velocity(bounds.for_s)
        self._residual = _Mean(MEAN_OVER)
        self._checks = self._make_checks(bounds)

    def watch(self, sample: Sample) -> Reaction:
        """The robot's next action; after the first STOP always STOP."""
        if not sample.seen:
            sample = _stamped(sample)
        if not self.reason:
            self._note_error(sample)
            self.reason = self._violation(sample)
        return Reaction.STOP if self.reason else Reaction.GO

    def _violation(self, sample: Sample) -> str:
        """Sentence on the first bound that the sample leaves; "" if it leaves none."""
        if sample.fault:
            return f"{self.about.name} reports: {sample.fault}"
        for check in self._checks:
            beyond = check.beyond(sample)
            if beyond is not None:
                joint, value, bound = beyond
                where = "" if sample.at is None else f" at {sample.at:.2f} s of the motion"
                name = self.about.joints[joint]
                return check.sentence.format(name=name, value=value, bound=bound) + where
        return ""

    def _make_checks(self, bounds: Bounds) -> list[_Check]:
        hold, low, high = bounds.for_s, bounds.lower, bounds.upper
        checks = [
            _Check(lambda s: float(np.sum(~np.isfinite(s.q))), 0.0, "a position is not a number", hold),
            _Check(self._clock.drift, bounds.clock, "the robot's clock is {value:.2f} s off ours", hold),
            _Check(self._clock.jump, bounds.silence, "the robot's clock jumped by {value:.2f} s", hold),
            _Check(self._still, 1.0, "no position changes although {name} has to move: encoders", hold),
            _Check(_asked_lacks, 0.0, "the driver does not report its set-points", hold),
            _Check(
                lambda s: None if s.asked is None else np.abs(s.q - s.asked),
                bounds.error,
                "{name} is {value:.3g} from its set-point, more than {bound:.3g}",
                hold,
            ),
            _Check(lambda s: low - s.q, 0.0, "{name} is {value:.3g} below its lower limit", hold),
            _Check(lambda s: s.q - high, 0.0, "{name} is {value:.3g} above its upper limit", hold),
            _Check(
                self._velocity.of, bounds.velocity, "{name} moves at {value:.3g}, more than {bound:.3g}", hold
            ),
        ]
        if bounds.effort is not None:
            sentence = "the command of {name} is {value:.3g}, more than {bound:.3g}"
            checks.append(_Check(_effort, bounds.effort, sentence, hold))
        if bounds.residual is not None and self._predicted is not None:
            sentence = "the command of {name} is {value:.3g} from the model, more than {bound:.3g}"
            checks.append(_Check(self._mean_residual, bounds.residual, sentence, hold))
        return checks

    def _note_error(self, sample: Sample) -> None:
        """Note the smaller error of two samples in a row, so that a glitch of one sample does not count."""
        if sample.asked is None or not np.isfinite(sample.q).all():
            return
        error = np.abs(sample.q - sample.asked)
        np.maximum(self.worst_error, np.minimum(error, self._error_before), out=self.worst_error)
        self._error_before = error

    def _mean_residual(self, sample: Sample) -> Array | None:
        if sample.command is None or sample.at is None or self._predicted is None:
            return None
        row = min(int(np.searchsorted(self.motion.t, sample.at)), len(self._predicted) - 1)
        mean = self._residual.with_one_more(sample.seen, sample.command - self._predicted[row])
        return None if mean is None else np.abs(mean)


class _ClockOffset:
    """The robot's clock against ours."""

    def __init__(self) -> None:
        self.first: tuple[float, float] | None = None
        self.usual = 0.0
        self.before = 0.0

    def _offset(self, sample: Sample) -> float:
        if self.first is None:
            self.first = sample.t, sample.seen
        return (sample.t - self.first[0]) - (sample.seen - self.first[1])

    def drift(self, sample: Sample) -> float:
        """s since the first sample."""
        return abs(self._offset(sample))

    def jump(self, sample: Sample) -> float:
        """s off the drift of the last second, to either side."""
        offset = self._offset(sample)
        part = min((sample.seen - self.before) / DRIFT_FORGOTTEN, 1.0) if self.before else 0.0
        self.usual += part * (offset - self.usual)
        self.before = sample.seen
        return abs(offset - self.usual)


class _Still:
    """Commanded travel of each joint since any position last changed, as a part of the bound."""

    def __init__(self, bounds: Bounds, about: About) -> None:
        steps = 0.0 if about.encoder_step is None else FROZEN_STEPS * about.encoder_step
        self.travel = np.maximum(steps, FROZEN_PART * bounds.error)
        self.q: Array | None = None
        self.asked: Array | None = None

    def __call__(self, sample: Sample) -> Array | None:
        if sample.asked is None:
            return None
        if self.q is None or self.asked is None or not np.array_equal(sample.q, self.q):
            self.q, self.asked = sample.q, sample.asked.copy()
        return np.abs(sample.asked - self.asked) / self.travel


class _Velocity:
    """Measured velocities, or differences over at least for_s, where a glitch of one sample shows twice."""

    def __init__(self, over: float) -> None:
        self.over = over
        self.past: deque[tuple[float, Array]] = deque()

    def of(self, sample: Sample) -> Array | None:
        if sample.qd is not None:
            return np.abs(sample.qd)
        self.past.append((sample.t, sample.q))
        while len(self.past) > 2 and sample.t - self.past[1][0] >= self.over:
            self.past.popleft()
        t, q = self.past[0]
        if sample.t < t:  # the clock went back: another check's
            self.past.clear()
            return None
        return np.abs(sample.q - q) / (sample.t - t) if sample.t - t >= self.over else None


class _Mean:
    """Running mean over the last seconds of the smaller of two values in a row: a glitch is no push."""

    def __init__(self, over: float) -> None:
        self.over = over
        self.past: deque[tuple[float, Array]] = deque()
        self.before: Array | float = 0.0
        self.total: Array | None = None

    def with_one_more(self, t: float, value: Array) -> Array | None:
        """(J,) the mean over the whole span; None before. NaN values are left out."""
        if not np.isfinite(value).all():
            return None
        value, self.before = np.where(np.abs(value) < np.abs(self.before), value, self.before), value
        self.past.append((t, value))
        self.total = value.copy() if self.total is None else self.total + value
        full = False
        while t - self.past[0][0] > self.over:
            self.total = self.total - self.past.popleft()[1]
            full = True
        return self.total / len(self.past) if full else None


def _asked_lacks(sample: Sample) -> float:
    return float(sample.at is not None and sample.asked is None)


def _effort(sample: Sample) -> Array | None:
    return None if sample.command is None else np.abs(sample.command)


def _stamped(sample: Sample) -> Sample:
    return replace(sample, seen=time.monotonic())


def _require_fitting(bounds: Bounds, about: About, motion: PlannedMotion, predicted: Array | None) -> None:
    if motion.joints != about.joints:
        raise UsageError(
            f"the motion has the joints {', '.join(motion.joints)}, but {about.name} has "
            f"{', '.join(about.joints)}",
            next_step="Plan it with the joints in the driver's order.",
        )
    for name in ("error", "lower", "upper", "velocity", "effort", "residual"):
        value = getattr(bounds, name)
        if value is not None and np.shape(value) != (len(about.joints),):
            raise UsageError(f"bounds.{name} has shape {np.shape(value)}, not ({len(about.joints)},)")
    if predicted is not None and predicted.shape != motion.q.shape:
        raise UsageError(f"predicted commands have shape {predicted.shape}, not {motion.q.shape}")
