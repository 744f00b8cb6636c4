"""Certificates: each limit with the extreme that is proved for all times, not only at samples."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np

from etude.abilities import SupportsCoverage, SupportsOrder, SupportsWarnings
from etude.codes import Notice, stated
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.protocols import Limit, Trajectory
from etude.trajectories.json_text import from_json
from etude.types import Proof

VERSION = 2
"""Of the certificate's JSON. Version 1 names none, and its rows have the slack under the key "margin"."""
ENDS = {"lower": -math.inf, "upper": math.inf, "slack": math.inf}
"""What null stands for in a row that was looked at."""
NAN = dict.fromkeys(("lower", "upper", "proved_lower", "proved_upper", "slack"), math.nan)
REST_TOLERANCE = 1e-9
"""Speed at either end, as a fraction of the speed limits, below which a trajectory is at rest."""


def slack(row: Proof) -> float:
    """Smaller distance from the proved interval to the limit; negative if it is not met, NaN if not seen."""
    return min(row.upper - row.proved_upper, row.proved_lower - row.lower)


def utilization(row: Proof) -> float:
    """Fraction of the limit that is used, 1 where it is touched; infinite if the limit has no width.

    Of a limit without an upper end: 1 / (1 + slack / scale). The scale of a distance is its limit, so that
    this is the limit over what is proved; where the limit is no distance it is the range that is proved.
    """
    if row.upper == math.inf:
        scale = row.lower if row.lower > 0.0 else row.proved_upper - row.proved_lower
        beyond = scale + slack(row)
        return scale / beyond if beyond > 0.0 else math.inf
    half = 0.5 * (row.upper - row.lower)
    return 1.0 - slack(row) / half if half > 0.0 else math.inf


TRACKING = "The tracking error, with overshoot."
COLLISIONS = "Collisions with itself, the floor and obstacles."
APPROACH = "The motion to the start pose, and the motion back from the end pose."
COMMANDS = "Whether the drives can give the forces that the motion needs."
SPEED = "The speed of the tool and of the links in space."
LOAD = "Loads that the robot file does not describe."
ALL = (TRACKING, COLLISIONS, APPROACH, COMMANDS, SPEED, LOAD)
"""What is not verified where no limit looks at it."""
HELD = ("position", "velocity", "radius", "speed", "tool position", "tool radius", "tool speed", "link speed")
"""Quantities of which tracking keeps a margin; clearance says itself what tracking takes."""


def not_verified(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    rows: Sequence[Proof],
    unenforced: Sequence[str] = (),
    *,
    approach: bool = False,
) -> tuple[str, ...]:
    """The sentences of one certificate.

    Args:
        trajectory: with an approach and a return among its pieces the way was looked at.
        limits: one says by `looks_at` which of `ALL` it looks at, and by `not_verified` what it leaves out
            of these.
        rows: their proofs: of some a margin is kept for tracking.
        unenforced: what else the robot is known not to hold.
        approach: whether the trajectory is the way itself, to a motion's start or back.
    """
    labels = {label for _, label, _ in trajectory.pieces()}
    said = {TRACKING: _of_tracking(rows)}
    for limit in limits:
        if isinstance(limit, SupportsCoverage):
            for topic in limit.looks_at:
                said[topic] = (*said.get(topic, ()), *limit.not_verified)
    if approach or {"approach", "return"} <= labels:
        said[APPROACH] = ()
    found = [one for topic in ALL for one in said.get(topic, (topic,))]
    return (*found, *unenforced)


def _of_tracking(rows: Sequence[Proof]) -> tuple[str, ...]:
    """Nothing where every margin was measured; else of which quantities none was kept, or it is assumed."""
    own = [row for row in rows if row.quantity in HELD and row.status != "not verified"]
    without = list(dict.fromkeys(row.quantity for row in own if row.tracking_margin == 0.0))
    assumed = list(
        dict.fromkeys(row.quantity for row in own if row.tracking_margin > 0.0 and row.confidence == 0.0)
    )
    if not own or len(without) == len({row.quantity for row in own}):
        return (TRACKING,)
    found = [f"The tracking error of {' and '.join(without)}."] if without else []
    if assumed:
        found.append(
            f"Tracking: the margins of {' and '.join(assumed)} are assumed; no log{_under(own)} has "
            "measured them."
        )
    return tuple(found)


def _under(rows: Sequence[Proof]) -> str:
    """The control that the rows' margins are of; all of a certificate are of one."""
    return next((f" of a motion under {row.control}" for row in rows if row.control), "")


def in_words(row: Proof) -> str:
    """A row as a sentence: what is asked, how far tracking may leave it, and the limit of both together.

    Without an upper end tracking is in one of the two numbers already: off a distance, or on the limit.
    """
    if row.upper == math.inf:
        taken = tracked_in_words(row)
        under = f" under {row.control}" if row.control else ""
        with_it = f" with tracking{under} of {taken}" if taken else ""
        return f"{row.proved_lower:.4g} is kept{with_it}, limit {row.lower:.4g}"
    above = row.upper - row.proved_upper <= row.proved_lower - row.lower
    asked, limit = (row.proved_upper, row.upper) if above else (row.proved_lower, row.lower)
    beyond = row.tracking_margin if above else -row.tracking_margin
    return f"planned {asked:.4g}, {_tracked(row)}limit {limit + beyond:.4g}"


def tracked_in_words(row: Proof) -> str:
    """The margin of a row and how sure it is; nothing where none is kept."""
    if row.tracking_margin == 0.0:
        return ""
    if row.confidence == 0.0:
        return f"{row.tracking_margin:.3g}, assumed"
    sure = "" if row.confidence == 1.0 else f" with {100.0 * row.confidence:.0f} % confidence"
    return f"{row.tracking_margin:.3g}{sure}"


def place_of(row: Proof) -> str:
    """Where and when, and what else is to be known of it; "" if nothing is."""
    return "; ".join(filter(None, (row.where, row.note)))


def _tracked(row: Proof) -> str:
    text = tracked_in_words(row)
    under = f" under {row.control}" if row.control else ""
    return f"tracking margin{under} {text}, " if text else ""


@dataclass(frozen=True)
class Certificate:
    """All limits of a trajectory, and rest at its ends.

    Attributes:
        rows: one proof per axis and quantity.
        end_speed: largest speed at an end of a piece as a fraction of its limit.
        rest_needed: whether rest at the ends is one of the limits; a flight may start in motion.
        not_verified: sentences, what nobody proved.
        warnings: what comes first: what the motion asks beyond a limit that is not held.
        notes: sentences on what the file holds beside the motion that is proved.
    """

    rows: tuple[Proof, ...]
    end_speed: float
    rest_needed: bool = True
    not_verified: tuple[str, ...] = ALL
    warnings: tuple[Notice, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def at_rest(self) -> bool:
        """Whether the trajectory starts and ends at rest."""
        return self.end_speed <= REST_TOLERANCE

    @property
    def seen(self) -> tuple[Proof, ...]:
        """The rows that were looked at."""
        return tuple(row for row in self.rows if row.status != "not verified")

    @property
    def failed(self) -> tuple[Proof, ...]:
        """The rows that were looked at and are not met."""
        return tuple(row for row in self.seen if not slack(row) >= 0.0)

    @property
    def ok(self) -> bool:
        """Whether every limit that was looked at is met, and rest at both ends where it is needed."""
        return (self.at_rest or not self.rest_needed) and not self.failed

    @property
    def worst(self) -> Proof:
        """The limit used most."""
        return max(self.seen, key=utilization)

    def active(self, tolerance: float = 0.01) -> tuple[tuple[str, str], ...]:
        """(axis, quantity) of every limit that is used to within `tolerance` of its half width."""
        return tuple((row.axis, row.quantity) for row in self.seen if utilization(row) >= 1.0 - tolerance)

    def to_json(self) -> str:
        """The certificate as JSON text, as certificate.schema.json says; null is no end, or no number."""
        content = {
            "version": VERSION,
            "ok": self.ok,
            "at_rest": self.at_rest,
            "end_speed": self.end_speed,
            "rest_needed": self.rest_needed,
            "rows": [_row(row) for row in self.rows],
            "not_verified": list(self.not_verified),
        }
        content |= {"warnings": [one.facts() for one in self.warnings]} if self.warnings else {}
        content |= {"notes": list(self.notes)} if self.notes else {}
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def certify(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    unenforced: Sequence[str] = (),
    *,
    approach: bool = False,
    control: str = "",
    partial: bool = False,
) -> Certificate:
    """Prove the limits for all times, piece by piece; pieces whose margins differ have rows of their own.

    Rest at the ends of each piece is needed if one of the limits says so (`rest`); else at those of
    the whole.

    Args:
        trajectory: what to prove. limits: of the robot.
        unenforced: sentences, what this robot is known not to hold.
        approach: whether it is the way to a motion's start, or back.
        control: that the margins of tracking are of, in words; "": nobody said.
        partial: a limit that can prove nothing of this curve has a row that says so, instead of a UsageError.
    """
    found: dict[tuple[str, str, str, tuple[float, float] | None], Proof] = {}
    pieces = trajectory.pieces()
    for start, label, piece in pieces:
        where = f"{label} at {start:g} s" if len(pieces) > 1 else ""
        for limit in limits:
            for i, row in enumerate(rows_of(limit, piece, partial=partial)):
                key = (row.axis, row.quantity, f"{limit.name} {i}", _kept(row))
                of = control if row.tracking_margin > 0.0 else ""
                row = replace(row, where=" of the ".join(filter(None, (row.where, where))), control=of)
                found[key] = _joined(found[key], row) if key in found else row
    axes = list(dict.fromkeys(key[0] for key in found))
    rows = tuple(row for axis in axes for key, row in found.items() if key[0] == axis)
    rest = any(isinstance(limit, SupportsOrder) and limit.rest for limit in limits)
    ends = [_end_speeds(piece, limits, partial) for _, _, piece in pieces]
    end_speed = max(map(max, ends)) if rest else max(ends[0][0], ends[-1][1])
    unverified = not_verified(trajectory, limits, rows, unenforced, approach=approach)
    return Certificate(rows, end_speed, rest, unverified, _warnings(trajectory, limits))


def rows_of(limit: Limit, piece: Trajectory, *, partial: bool) -> Sequence[Proof]:
    """What a limit proves of a piece; partial: one row, "not verified", with the reason, if it can not."""
    try:
        return limit.prove(piece)
    except UsageError as problem:
        if not partial:
            raise
        nan = math.nan
        return [Proof("all", limit.name, nan, nan, nan, nan, problem.fact, "not verified")]


def _warnings(trajectory: Trajectory, limits: Sequence[Limit]) -> tuple[Notice, ...]:
    """What limits say of this motion first of all; of a curve without accelerations nothing."""
    found: list[Notice] = []
    for limit in limits:
        if isinstance(limit, SupportsWarnings):
            with contextlib.suppress(UsageError):
                found += stated(limit.warned(trajectory))
    return tuple(found)


def _kept(row: Proof) -> tuple[float, float] | None:
    """By what rows of pieces differ: the ends of their limits; a distance has one row, whatever it loses."""
    return None if row.upper == math.inf else (row.lower, row.upper)


def certify_bytes(data: bytes | str, limits: Sequence[Limit]) -> Certificate:
    """Certificate of the trajectory in a file's bytes, exactly as they were or will be written."""
    return certify(from_json(data), limits)


def require_certified(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    unenforced: Sequence[str] = (),
    *,
    approach: bool = False,
    control: str = "",
) -> Certificate:
    """The certificate, if every limit is met. Arguments as of `certify`.

    Raises:
        UnsafeTrajectoryError: names the axis, the quantity, the limit and the proved value.
    """
    certificate = certify(trajectory, limits, unenforced, approach=approach, control=control)
    if certificate.ok:
        return certificate
    if not certificate.failed:
        raise UnsafeTrajectoryError(
            f"the trajectory starts or ends at {certificate.end_speed:.3g} of a velocity limit, not at rest",
            next_step="Use coefficients that start at rest and a whole number of periods, or a phase ramp.",
        )
    row = max(certificate.failed, key=utilization)
    above = row.proved_upper - row.upper >= row.lower - row.proved_lower
    place = f" ({place_of(row)})" if place_of(row) else ""
    raise UnsafeTrajectoryError(
        f"{row.quantity} of '{row.axis}' may reach {row.proved_upper if above else row.proved_lower:.6g}"
        f"{place}, outside its limit {row.lower:.6g}..{row.upper:.6g}",
        where=f"{row.axis}, {row.quantity}",
        next_step="Scale the trajectory down, or choose another one.",
        limit=(row.axis, row.quantity),
    )


def _row(row: Proof) -> dict[str, object]:
    content = asdict(row) | {"slack": slack(row), "in_words": in_words(row)}
    for name in ("control", "note"):
        if not content[name]:
            del content[name]
    return {key: _json(value) for key, value in content.items()}


def _json(value: object) -> object:
    """null where JSON has no number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _joined(one: Proof, other: Proof) -> Proof:
    """One row for two pieces: both intervals, the place and status of the one with less slack."""
    tighter = other if not slack(other) >= slack(one) else one
    low, high = (
        min(one.proved_lower, other.proved_lower),
        max(one.proved_upper, other.proved_upper),
    )
    return replace(tighter, proved_lower=low, proved_upper=high)


def facts_of(data: bytes | str) -> dict[str, Any]:
    """What a certificate's file says, with the keys of this version; ends that it has not are infinite.

    Raises:
        ValueError: it is no certificate, or a newer one.
    """
    value: dict[str, Any] = json.loads(data)
    rows = value.get("rows") if isinstance(value, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError("not a certificate")
    version = value.setdefault("version", 1)
    if version not in (1, VERSION):
        raise ValueError(f"a certificate of version {version}")
    if version == 1:
        value["not_verified"] = value.pop("not_looked_at", [])
    value["rows"] = [_read(row if version == VERSION else _of_version_1(row)) for row in rows]
    return value


def _of_version_1(row: dict[str, Any]) -> dict[str, Any]:
    """The row with the keys of this version; the earliest certificates know no tracking."""
    own = {name: value for name, value in row.items() if name != "margin"}
    if own.get("status") == "not looked at":
        own["status"] = "not verified"
    return {
        "status": "proved",
        "tracking_margin": 0.0,
        "confidence": 1.0,
        "where": "",
        **own,
        "slack": row["margin"],
    }


def _read(row: dict[str, Any]) -> dict[str, Any]:
    """The row with numbers where JSON has none; of what was not verified NaN."""
    none = NAN if row["status"] == "not verified" else ENDS
    return {**row, **{name: value for name, value in none.items() if row[name] is None}}


def _end_speeds(piece: Trajectory, limits: Sequence[Limit], partial: bool) -> tuple[float, float]:
    """Speed at the start and end of a piece, as a fraction of the limits of order 1.

    Without any, as a fraction of the piece's largest speed.
    """
    ends = piece.motion(np.array([0.0, piece.duration]), 2)
    found = []
    for limit in limits:
        if not isinstance(limit, SupportsOrder) or limit.order != 1:
            continue
        size = np.array(
            [max(abs(row.lower), abs(row.upper)) for row in rows_of(limit, piece, partial=partial)]
        )
        values = np.abs(limit.of_motion(ends))
        found.append(np.divide(values, size, out=np.full(values.shape, math.inf), where=size > 0.0))
    if not found:
        # only the scale of the speeds at the ends: samples are enough, nothing is proved by it
        speeds = np.linalg.norm(piece.motion(np.linspace(0.0, piece.duration, 2001), 2).orders[1], axis=1)
        largest = max(float(speeds.max()), float(np.finfo(float).tiny))
        found = [np.linalg.norm(ends.orders[1], axis=1)[:, None] / largest]
    start, end = np.concatenate(found, axis=1).max(axis=1)
    return float(start), float(end)


T = TypeVar("T")
PROOFS_KEPT = 256
"""Motions: a certificate asks each limit for the same proof several times."""


def memoized(store: dict[str, T], key: str, make: Callable[[], T], most: int = PROOFS_KEPT) -> T:
    """The value of `key` in `store`, made if it is not there; a full store is emptied first."""
    if key not in store:
        if len(store) >= most:
            store.clear()
        store[key] = make()
    return store[key]
