"""Tracking margins, before and after a log: the part of each limit kept for the robot's tracking error.

Before the first log of a form of motion the margin is assumed. Where the feedback's gains are known, it is
the error that they allow: at an extremum of the error e its rate is zero, so a proportional gain K produces
the whole command K e. Elsewhere it is a configured fraction of each range. Afterwards it is the largest error
in the last logs of that form, times a factor that depends on their number. Margins of velocity also include
what smoothing hides. The factors were measured: on simulated arms they cover all joints of the next run at
once in about 95 of 100 runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Margins

HELD = 2
"""Number of derivative orders with a margin: position and velocity. Accelerations have none: stick-slip
friction disturbs them during any motion.
"""
LOGS_CONSIDERED = 8
"""Number of most recent logs that a margin is learned from."""
CONFIDENCE = 0.95
"""Probability that the next run of the form stays within its margins in all coordinates at once."""
ASSUMED = 0.0
"""The confidence of a margin that was not measured."""
HIDDEN = 0.005
"""Fraction of each velocity limit that is added to the error in the logs. Where a joint sticks or slips, the
rate of the error jumps for about 0.05 s, and smoothing flattens the jump. The addition matters where a
feedforward leaves an error of about that size.
"""
LARGEST_MARGIN = 0.5
"""Part of the way from home, or from rest, to the nearer limit that a margin may take at most."""


@dataclass(frozen=True)
class TrackingConfig:
    """Margins for tracking errors: the table [tracking] of a campaign.

    Attributes:
        margin: "learned" from the logs; "assumed", which ignores the logs; or "none".
        position: assumed fraction of each coordinate's range where the gains are not known. For a joint with
            a range above half a turn it is a fraction of half a turn.
        velocity: assumed fraction of each velocity limit.
        most: part of the way from home to the nearer position limit that a margin may take at most. An error
            is mostly a lag, which leaves the path's own range by far less: feedback that lagged by 7 degrees
            left it by 1.
        control: the control of training motions in `simulate` and `run` after the first fit, where the robot
            accepts it: "learned" or "feedback".

    Raises:
        UsageError: an unknown word, or position, velocity, most outside of 0..most/2 and 0..LARGEST_MARGIN.
    """

    margin: Literal["learned", "assumed", "none"] = "learned"
    position: float = 0.02
    velocity: float = 0.05
    most: float = LARGEST_MARGIN
    control: Literal["learned", "feedback"] = "learned"

    def __post_init__(self) -> None:
        if self.margin not in ("learned", "assumed", "none"):
            raise UsageError(
                f"margin must be 'learned', 'assumed' or 'none', not {self.margin!r}", where="tracking.margin"
            )
        if self.control not in ("learned", "feedback"):
            raise UsageError(
                f"control must be 'learned' or 'feedback', not {self.control!r}", where="tracking.control"
            )
        for name, most in (
            ("most", LARGEST_MARGIN),
            ("position", 0.5 * self.most),
            ("velocity", LARGEST_MARGIN),
        ):
            if not 0.0 <= getattr(self, name) <= most:
                raise UsageError(
                    f"{name} must be a fraction from 0 to {most:g}, not {getattr(self, name)}",
                    where=f"tracking.{name}",
                )


@dataclass(frozen=True, eq=False)
class Ranges:
    """The limited range of each coordinate's position and velocity; NaN where there is no limit.

    Attributes:
        size: (HELD, k) the range that assumed margins are a fraction of: the whole range of positions, the
            limit of velocities.
        room: (HELD, k) distance from home, or from rest, to the nearer end.
    """

    size: Array
    room: Array

    @classmethod
    def of(
        cls,
        path: tuple[Array, Array],
        rate: tuple[Array, Array] | None,
        home: Array,
        units: Sequence[str] = (),
    ) -> Ranges:
        """Ranges from the lower and upper ends, (k,) each, of the positions, and of the rates if limited.

        Args:
            path, rate: the ends. home: (k,) the pose about which robots move.
            units: (k,) of the positions.
        """
        none = np.full(len(home), np.nan)
        low, high = (none, none) if rate is None else rate
        turns = np.array([unit == "rad" for unit in units or ("",) * len(home)])
        whole = path[1] - path[0]
        size = np.stack([np.where(turns, np.minimum(whole, math.pi), whole), np.minimum(high, -low)])
        room = np.stack([np.minimum(home - path[0], path[1] - home), np.minimum(high, -low)])
        return cls(np.where(np.isfinite(size), size, np.nan), np.where(np.isfinite(room), room, np.nan))


def factor(logs: int) -> float:
    """Factor on the largest error of `logs` logs, for `CONFIDENCE` in all coordinates at once."""
    # measured over simulated arms: see the head of this file
    return 3.0 if logs <= 1 else 2.0 if logs <= 3 else 1.5


def start_table(config: TrackingConfig, ranges: Ranges, error_bounds: Array | None) -> tuple[Array, Array]:
    """Margins (O, k) before any log, and their confidence (O, k).

    Args:
        config: the assumed parts.
        ranges: of the robot.
        error_bounds: (k,) largest position error that the robot's gains allow, NaN where unknown; None:
            all unknown.
    """
    parts = np.array([[config.position], [config.velocity]])
    table = parts * ranges.size
    confidence = np.full_like(table, ASSUMED)
    if error_bounds is not None:
        table[0] = np.where(np.isfinite(error_bounds), error_bounds, table[0])
        confidence[0] = np.where(np.isfinite(error_bounds), 1.0, ASSUMED)
    return table, confidence


def learned_table(errors: Sequence[Array], ranges: Ranges) -> tuple[Array, Array]:
    """Margins (O, k) after logs with these largest errors (orders >= O, k), oldest first."""
    last = np.stack([log_errors[:HELD] for log_errors in errors[-LOGS_CONSIDERED:]])
    table = factor(len(last)) * last.max(axis=0)
    table[1] += HIDDEN * np.nan_to_num(ranges.size[1])
    return table, np.full_like(table, CONFIDENCE)


def within_room(
    table: Array, confidence: Array, ranges: Ranges, most_of: float = LARGEST_MARGIN
) -> tuple[Array, Array]:
    """Margins, each cut to the fraction `most_of` of the room; a cut margin has the confidence `ASSUMED`.

    For rates the fraction is `LARGEST_MARGIN`.
    """
    most = np.array([[most_of], [LARGEST_MARGIN]]) * ranges.room
    cut = table > most
    return np.where(cut, most, table), np.where(cut, ASSUMED, confidence)


def margins_of(
    config: TrackingConfig,
    ranges: Ranges,
    errors: Mapping[str, Sequence[Array]],
    forms: Sequence[str],
    error_bounds: Array | None = None,
) -> Margins:
    """Margins by form of motion, not yet cut to the room (see `within_room`); {} for the margin "none".

    Args:
        config: the campaign's table. ranges: of the robot.
        errors: by form, the largest errors (orders, k) of each log, oldest first.
        forms: the forms that need a margin, with or without logs.
        error_bounds: as for `start_table`.
    """
    if config.margin == "none":
        return {}
    margins = {}
    for form in forms:
        log_errors = errors.get(form, ()) if config.margin == "learned" else ()
        margins[form] = (
            learned_table(log_errors, ranges) if log_errors else start_table(config, ranges, error_bounds)
        )
    return margins
