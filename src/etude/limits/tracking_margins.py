"""Tracking margins: the part of each limit that is kept for the robot's tracking error.

Before any log of a form of motion the margin is assumed: what the feedback's gains allow where they are known
(at an extremum of the error its rate is zero, so a proportional gain K has made all of the command of K e),
else a stated part of each range. Afterwards it is the largest error of the last logs of that form, times a
factor that makes up for their number, and of velocities what smoothing hides. The factors were measured: over
simulated arms they cover all joints of the next run at once in about 95 of 100.
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
"""Orders that a margin is kept of: position and velocity. Accelerations are not held: friction grips and lets
go, whatever is asked.
"""
LOGS_CONSIDERED = 8
"""Logs that are looked back on."""
CONFIDENCE = 0.95
"""That the next run of the form stays within its margins in all coordinates at once."""
ASSUMED = 0.0
"""The confidence of a margin that nobody measured."""
HIDDEN = 0.005
"""Part of each velocity limit by which a margin of velocity exceeds what logs say: where friction grips or
lets go, the rate of the error leaps for a twentieth of a second, and smoothing flattens it. It counts where a
feedforward leaves hardly more.
"""
LARGEST_MARGIN = 0.5
"""Part of the way from home, or from rest, to the nearer limit that a margin may take at most."""


@dataclass(frozen=True)
class TrackingConfig:
    """What is kept for tracking errors: the table [tracking] of a campaign.

    Attributes:
        margin: "learned" from the logs; "assumed", whatever they say; or "none".
        position: assumed, part of each coordinate's range, where the gains are not known; of a joint that
            turns further than half a turn, of half a turn.
        velocity: assumed, part of each velocity limit.
        most: part of the way from home to the nearer position limit that a margin may take at most. An error
            is mostly a lag, which leaves the path's own range by far less: feedback that lagged by 7 degrees
            left it by 1.
        control: that motions which teach are run under by `simulate` and `run` once something was learned,
            where the robot takes it: "learned" or "feedback".

    Raises:
        UsageError: another word, or parts outside of 0..most/2, 0..MOST and 0..MOST.
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
                    f"{name} must be a part from 0 to {most:g}, not {getattr(self, name)}",
                    where=f"tracking.{name}",
                )


@dataclass(frozen=True, eq=False)
class Ranges:
    """What each coordinate may do, positions and velocities; NaN where nothing limits it.

    Attributes:
        size: (HELD, k) a range, of which a margin is assumed as a part: of positions the whole, of velocities
            the limit.
        room: (HELD, k) from home, or rest, to the nearer end.
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
        """From the ends (k,), (k,) of the positions, and of their rates if these are limited.

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
    """On the largest error of so many logs, for `CONFIDENCE` in all coordinates at once."""
    # measured over simulated arms: see the head of this file
    return 3.0 if logs <= 1 else 2.0 if logs <= 3 else 1.5


def start_table(config: TrackingConfig, ranges: Ranges, known: Array | None) -> tuple[Array, Array]:
    """Margins (O, k) before any log, and their confidence (O, k).

    Args:
        config: the assumed parts.
        ranges: of the robot.
        known: (k,) largest position error that its gains allow, NaN where unknown; None: none is known.
    """
    parts = np.array([[config.position], [config.velocity]])
    table = parts * ranges.size
    confidence = np.full_like(table, ASSUMED)
    if known is not None:
        table[0] = np.where(np.isfinite(known), known, table[0])
        confidence[0] = np.where(np.isfinite(known), 1.0, ASSUMED)
    return table, confidence


def learned_table(errors: Sequence[Array], ranges: Ranges) -> tuple[Array, Array]:
    """Margins (O, k) after logs with these largest errors (orders >= O, k), oldest first."""
    last = np.stack([own[:HELD] for own in errors[-LOGS_CONSIDERED:]])
    table = factor(len(last)) * last.max(axis=0)
    table[1] += HIDDEN * np.nan_to_num(ranges.size[1])
    return table, np.full_like(table, CONFIDENCE)


def within_room(
    table: Array, confidence: Array, ranges: Ranges, most_of: float = LARGEST_MARGIN
) -> tuple[Array, Array]:
    """The margins, none above that part of the room, `MOST` of rates: what was cut is only assumed."""
    most = np.array([[most_of], [LARGEST_MARGIN]]) * ranges.room
    cut = table > most
    return np.where(cut, most, table), np.where(cut, ASSUMED, confidence)


def margins_of(
    config: TrackingConfig,
    ranges: Ranges,
    errors: Mapping[str, Sequence[Array]],
    forms: Sequence[str],
    known: Array | None = None,
) -> Margins:
    """By form of motion, not yet cut to the room that there is; {} if none are to be kept.

    Args:
        config: the campaign's table. ranges: of the robot.
        errors: by form, of each log the largest errors (orders, k), oldest first.
        forms: for which there is to be a margin, logs or not.
        known: as for `start_table`.
    """
    if config.margin == "none":
        return {}
    found = {}
    for form in forms:
        own = errors.get(form, ()) if config.margin == "learned" else ()
        found[form] = learned_table(own, ranges) if own else start_table(config, ranges, known)
    return found
