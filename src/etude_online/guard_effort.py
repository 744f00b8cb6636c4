"""Effort of the feedback, by an identified law or as the controller reports it, or the reason for its
absence.

The sent command plus the feedback's is what the motion needed, whatever the sensor of the command reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.protocols import Kind
from etude.types import Array, Channel, Log

COMMAND, FED_FORWARD, FED_BACK, PLANNED = "command", "command_ff", "command_fb", "_des"
DECISION_S, FEWEST = 0.1, 5
"""Length of a decision, which averages rounding and noise; in ticks, at least."""
EXPLAINED = 0.9
"""Least part of the command's variation that a law must explain."""
FLOOR = 1e-3
"""Least deviation of a law, a part of the command's limit."""
TAIL, TAIL_PART = 5.0, 99.5
"""Deviation from the tail: that percentile of what is left, over so many."""


def decision_ticks(rate: float) -> int:
    """Control ticks of one decision."""
    return max(FEWEST, round(DECISION_S * rate))


class Feedback(Protocol):
    """Where the feedback's command comes from. sigma (J,): deviation of command - sent - feedback's."""

    @property
    def sigma(self) -> Array: ...
    @property
    def channels(self) -> tuple[str, ...]: ...
    def effort(self, rows: Mapping[str, Array], period: float) -> Array: ...  # (n, J) of n ticks, in a row


@dataclass(frozen=True, eq=False)
class FeedbackLaw:
    """kp e + kd de/dt, each command by its own coordinate of the path.

    Attributes:
        kp, kd: (J,) command unit per rad (m), and s of it. sigma: (J,) command unit.
        path: the channel of the path; its plan is that name with _des.
    """

    kp: Array
    kd: Array
    sigma: Array
    path: str

    @property
    def channels(self) -> tuple[str, ...]:
        return (self.path, self.path + PLANNED)

    def effort(self, rows: Mapping[str, Array], period: float) -> Array:
        """The slope of the error is that over all the ticks."""
        error = rows[self.path + PLANNED] - rows[self.path]
        slope = (error[-1] - error[0]) / (period * max(len(error) - 1, 1))
        return np.asarray(self.kp * error + self.kd * slope)


@dataclass(frozen=True, eq=False)
class StatedFeedback:
    """A controller that reports what it adds: the channel `command_fb` of every measured row."""

    sigma: Array

    @property
    def channels(self) -> tuple[str, ...]:
        return (FED_BACK,)

    def effort(self, rows: Mapping[str, Array], period: float) -> Array:  # noqa: ARG002
        return rows[FED_BACK]


def command_limits(kind: Kind, spec: Any) -> tuple[Array, Array]:
    """Lower and upper (J,) of a robot's commands, in their unit."""
    reach = np.asarray(kind.limit(spec), dtype=float)
    return kind.expected(spec).limits.get(COMMAND, (-reach, reach))


def feedback_of(
    logs: Sequence[Log], channels: Sequence[Channel], path: str, limits: tuple[Array, Array], rate: float
) -> Feedback:
    """The feedback of a robot, from logs of its own runs.

    A command that acts on a coordinate of the path has a law, by least squares over decisions; what was fed
    forward is taken off. Of other robots the controller has to say it, in rows with `command_fb`.

    Args:
        logs: of runs under the feedback that there will be, at the rate of control.
        limits: lower and upper (J,) of the commands.
        rate: Hz of the logs.

    Raises:
        DataError: the logs hold no plan, or the command does not follow from the error along the path: the
            sensor's sign is wrong, or the controller is another (an integral, gravity in the drive).
    """
    command = next(c for c in channels if c.role == "command")
    least = FLOOR * np.maximum(*np.abs(limits))
    if command.acts_on != path:
        return StatedFeedback(least)
    each = [_decisions(log, path, limits, rate) for log in logs]
    parts = [part for stretches in each for part in stretches]
    if not parts:
        raise DataError(
            f"no log holds {path}{PLANNED}, so the robot's feedback is unknown",
            next_step="Log the desired positions; without them the guard cannot check the learned part.",
        )
    decisions = np.stack([np.stack(part) for part in parts], axis=1)  # (4, n, J)
    group = np.repeat(np.arange(len(each)), [len(stretches) for stretches in each])
    laws = [_law(decisions[:, :, j], group, name) for j, name in enumerate(command.parts)]
    kp, kd, sigma = np.array(laws).T
    return FeedbackLaw(kp, kd, np.maximum(sigma, least), path)


def _decisions(
    log: Log, path: str, limits: tuple[Array, Array], rate: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Mean error, its slope, mean feedback and mean integral of the error since the log's start, for
    stretches as long as a decision.
    """
    planned, n = log.get(path + PLANNED), decision_ticks(rate)
    if planned is None:
        return []
    error, sent = planned - log[path], log.get(FED_FORWARD)
    u = log[COMMAND] - (0.0 if sent is None else sent)
    # a command within 1 % of its limit was cut, or may have been
    beyond = (log[COMMAND] <= 0.99 * limits[0]) | (log[COMMAND] >= 0.99 * limits[1])
    good = np.asarray(~beyond.any(axis=1) & np.isfinite(error).all(axis=1) & np.isfinite(u).all(axis=1))
    total = np.cumsum(np.nan_to_num(error, posinf=0.0, neginf=0.0), axis=0) / rate
    spans = [slice(k, k + n) for k in range(0, len(log) - n + 1, n) if good[k : k + n].all()]
    slopes = [(error[s][-1] - error[s][0]) * rate / (n - 1) for s in spans]
    means = [tuple(values[s].mean(axis=0) for values in (error, u, total)) for s in spans]
    return [(e, slope, sent, sums) for slope, (e, sent, sums) in zip(slopes, means, strict=True)]


ENOUGH = 0.9
"""Part of the command's variation, about its mean in each log, from which something explains it."""
CLEARLY = 0.5
"""An integral is reported only where its residual is at most that part of the residual without it."""

NOTHING = "nothing can be learned online."
SIGN = f"Invert the sign of the logged command, or exclude the log; otherwise {NOTHING}"
INTEGRAL = (
    "Very probably the controller integrates: with an integral of the error {part:.0f} % are explained "
    "(gain {gain:.3g} per s). Online learning assumes a feedback of position and velocity alone: remove "
    "the integral and record again, or use another target without online learning (etude export --to c)."
)
CONSTANT = (
    "The command holds a constant in addition to the feedback ({part:.0f} % are explained with one): "
    f"an offset of its sensor, or gravity that the controller adds; log it as command_ff. Else {NOTHING}"
)
EITHER = (
    "Look at the sign and scale of the logged command; or the controller integrates, or adds what it knows "
    f"(gravity, friction): log that as command_ff. Else {NOTHING}"
)


def why(error: Array, slope: Array, total: Array, u: Array, group: NDArray[np.int64]) -> str:
    """What to do about a command that does not follow from its tracking error, in words.

    Args:
        error, slope, total: (n,) tracking error, its slope and its integral since the log began, by
            decision: rad (m), rad/s, rad s.
        u: (n,) the command less what was fed forward.
        group: (n,) which log each is of: an integral begins anywhere.
    """
    whole, (kp, _) = _explained([error, slope], u)
    if whole >= ENOUGH and kp < 0.0:
        return SIGN
    error, slope, total, u = (_about_means(values, group) for values in (error, slope, total, u))
    plain, (kp, _) = _explained([error, slope], u)
    if plain >= ENOUGH and kp > 0.0:
        return CONSTANT.format(part=100.0 * plain)
    part, (kp, _, ki) = _explained([error, slope, total], u)
    if part >= ENOUGH and min(kp, ki) > 0.0 and 1.0 - part <= CLEARLY * (1.0 - plain):
        return INTEGRAL.format(part=100.0 * part, gain=ki)
    return EITHER


def _about_means(values: Array, group: NDArray[np.int64]) -> Array:
    mean = np.bincount(group, values) / np.maximum(np.bincount(group), 1)
    return np.asarray(values - mean[group])


def _explained(columns: list[Array], u: Array) -> tuple[float, Array]:
    """Part of the squares of u that least squares on the columns explains, and their gains."""
    A = np.column_stack(columns)
    gains, *_ = np.linalg.lstsq(A, u, rcond=None)
    left = u - A @ gains
    return 1.0 - float(left @ left) / max(float(u @ u), np.finfo(float).tiny), np.asarray(gains, dtype=float)


def _law(decisions: Array, group: NDArray[np.int64], name: str) -> tuple[float, float, float]:
    """kp, kd, sigma of one command, from its decisions (4, n); group: (n,) which log each is of."""
    error, slope, u, total = decisions
    A = np.column_stack([error, slope])
    (kp, kd), *_ = np.linalg.lstsq(A, u, rcond=None)
    left = u - A @ (kp, kd)
    part = 1.0 - float(left @ left) / max(float(u @ u), np.finfo(float).tiny)
    if not (part >= EXPLAINED and kp > 0.0):
        raise DataError(
            f"the command of {name} does not follow from its tracking error "
            f"({100 * max(part, 0.0):.0f} % of it explained, gain {kp:.3g})",
            where=name,
            next_step=why(error, slope, total, u, group),
        )
    # 1.4826: from the median deviation to the standard deviation of a normal distribution
    spread = 1.4826 * float(np.median(np.abs(left)))
    return float(kp), float(kd), max(spread, float(np.percentile(np.abs(left), TAIL_PART)) / TAIL)
