"""Certificates: each limit with the extreme that is proved for all times, not only at samples."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np

from etude.abilities import SupportsCoverage, SupportsOrder, SupportsWarnings
from etude.codes import Notice, stated
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.plugin_values import is_guarded
from etude.protocols import Limit, Trajectory
from etude.trajectories.json_text import from_json
from etude.types import Proof

VERSION = 2
"""Version of the certificate's JSON. Files of version 1 have no version number, and their rows have the slack
under the key "margin"."""
ENDS = {"lower": -math.inf, "upper": math.inf, "slack": math.inf}
"""The number that null stands for in a row that was verified."""
NAN = dict.fromkeys(("lower", "upper", "proved_lower", "proved_upper", "slack"), math.nan)
REST_TOLERANCE = 1e-9
"""Speed at either end, as a fraction of the speed limits, below which a trajectory is at rest."""


def slack(row: Proof) -> float:
    """Smaller distance from the proved interval to the limit; negative if violated, NaN if not verified."""
    return min(row.upper - row.proved_upper, row.proved_lower - row.lower)


def utilization(row: Proof) -> float:
    """Fraction of the limit that is used, 1 where it is touched; infinite if the limit has no width.

    A limit without an upper end has the utilization 1 / (1 + slack / scale). The scale is the lower limit if
    that is positive, as for a distance: then the result is the limit divided by the proved value. Otherwise
    the scale is the width of the proved interval. A limit without a lower end is its mirror image; a positive
    upper limit, as of an energy, is the scale of 1 - slack / scale.
    """
    if row.lower == -math.inf and 0.0 < row.upper < math.inf:
        return max(0.0, 1.0 - slack(row) / row.upper)
    if row.lower == -math.inf and row.upper < math.inf:
        return utilization(_mirrored(row))
    if row.upper == math.inf:
        scale = row.lower if row.lower > 0.0 else row.proved_upper - row.proved_lower
        beyond = scale + slack(row)
        return scale / beyond if beyond > 0.0 else math.inf
    half = 0.5 * (row.upper - row.lower)
    return 1.0 - slack(row) / half if half > 0.0 else math.inf


def _mirrored(row: Proof) -> Proof:
    """The row of the quantity with the other sign."""
    ends = replace(row, lower=-row.upper, upper=-row.lower)
    return replace(ends, proved_lower=-row.proved_upper, proved_upper=-row.proved_lower)


TRACKING = "The tracking error, with overshoot."
COLLISIONS = "Collisions with itself, the floor and obstacles."
APPROACH = "The approach to the start pose, and the return from the end pose."
COMMANDS = "Whether the drives can deliver the forces of the motion."
SPEED = "The speed of the tool and of the links in space."
LOAD = "Loads that the robot file does not describe."
ALL = (TRACKING, COLLISIONS, APPROACH, COMMANDS, SPEED, LOAD)
"""Topics that count as not verified unless a limit covers them."""
HELD = ("position", "velocity", "radius", "speed", "tool position", "tool radius", "tool speed", "link speed")
"""Quantities with a margin for tracking, beside those of plug-ins. Clearance states its own allowance."""


def not_verified(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    rows: Sequence[Proof],
    unenforced: Sequence[str] = (),
    *,
    approach: bool = False,
    held: Collection[str] = HELD,
) -> tuple[str, ...]:
    """Sentences on what one certificate does not verify.

    Args:
        trajectory: the approach counts as verified if the pieces include an approach and a return.
        limits: a limit lists the topics of `ALL` that it covers in `looks_at`, and the gaps within these in
            `not_verified`.
        rows: proofs of the limits; some include a margin for tracking.
        unenforced: sentences on further limits that the robot is known not to enforce.
        approach: whether the trajectory is itself an approach or a return.
        held: quantities with a margin for tracking.
    """
    labels = {label for _, label, _ in trajectory.pieces()}
    gaps = {TRACKING: _of_tracking(rows, held)}
    for limit in limits:
        if isinstance(limit, SupportsCoverage):
            for topic in limit.looks_at:
                gaps[topic] = (*gaps.get(topic, ()), *limit.not_verified)
    if approach or {"approach", "return"} <= labels:
        gaps[APPROACH] = ()
    sentences = [one for topic in ALL for one in gaps.get(topic, (topic,))]
    return (*sentences, *_of_rows(rows), *unenforced)


def _of_rows(rows: Sequence[Proof]) -> tuple[str, ...]:
    """A sentence for each quantity that its limit could not verify, with the axes and the reason."""
    axes: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.status == "not verified":
            axes.setdefault((row.quantity, row.method), []).append(row.axis)
    return tuple(
        f"The {quantity} of {', '.join(names)}: {reason.rstrip('.')}."
        for (quantity, reason), names in axes.items()
    )


def _of_tracking(rows: Sequence[Proof], held: Collection[str]) -> tuple[str, ...]:
    """Sentences on the quantities whose tracking margin is missing or assumed; () if all were measured."""
    tracked_rows = [row for row in rows if row.quantity in held and row.status != "not verified"]
    without = list(dict.fromkeys(row.quantity for row in tracked_rows if row.tracking_margin == 0.0))
    assumed = list(
        dict.fromkeys(
            row.quantity for row in tracked_rows if row.tracking_margin > 0.0 and row.confidence == 0.0
        )
    )
    if not tracked_rows or len(without) == len({row.quantity for row in tracked_rows}):
        return (TRACKING,)
    sentences = [f"The tracking error of {' and '.join(without)}."] if without else []
    if assumed:
        sentences.append(
            f"Tracking: no log of such a motion{_under(tracked_rows)} confirms the margins of "
            f"{' and '.join(assumed)}."
        )
    return tuple(sentences)


def _under(rows: Sequence[Proof]) -> str:
    """Text that names the control that the margins apply to; all rows of a certificate share one control."""
    return next((f" under {row.control}" for row in rows if row.control), "")


def in_words(row: Proof) -> str:
    """A row as text: the planned value, the tracking margin, and the limit of their sum.

    Without an upper end, one of the two numbers already includes tracking: it is subtracted from a distance,
    or added to the limit.
    """
    if row.status == "not verified":
        return f"not verified: {row.method}"
    if row.upper == math.inf:
        taken = tracked_in_words(row)
        under = f" under {row.control}" if row.control else ""
        with_it = f" with tracking{under} of {taken}" if taken else ""
        return f"at least {row.proved_lower:.4g}{with_it}, limit {row.lower:.4g}"
    above = row.upper - row.proved_upper <= row.proved_lower - row.lower
    planned, limit = (row.proved_upper, row.upper) if above else (row.proved_lower, row.lower)
    beyond = row.tracking_margin if above else -row.tracking_margin
    return f"planned {planned:.4g}, {_tracked(row)}limit {limit + beyond:.4g}"


def tracked_in_words(row: Proof) -> str:
    """The tracking margin of a row and its confidence; "" where there is no margin."""
    if row.tracking_margin == 0.0:
        return ""
    if row.confidence == 0.0:
        return f"{row.tracking_margin:.3g}, assumed"
    sure = "" if row.confidence == 1.0 else f" with {100.0 * row.confidence:.0f} % confidence"
    return f"{row.tracking_margin:.3g}{sure}"


def place_of(row: Proof) -> str:
    """Place and time of the extreme, and the row's note; "" if the row has neither."""
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
        not_verified: sentences on what was not proved.
        warnings: printed first: by how much the motion exceeds a limit that is not enforced.
        notes: sentences on what the file contains beside the proved motion.
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
        """The rows that were verified, whether met or not."""
        return tuple(row for row in self.rows if row.status != "not verified")

    @property
    def failed(self) -> tuple[Proof, ...]:
        """The rows whose limit is not met."""
        return tuple(row for row in self.seen if not slack(row) >= 0.0)

    @property
    def ok(self) -> bool:
        """Whether every verified limit is met, and the motion rests at both ends where this is required."""
        return (self.at_rest or not self.rest_needed) and not self.failed

    @property
    def worst(self) -> Proof:
        """The limit used most."""
        return max(self.seen, key=utilization)

    def active(self, tolerance: float = 0.01) -> tuple[tuple[str, str], ...]:
        """(axis, quantity) of every limit that is used to within `tolerance` of its half width."""
        return tuple((row.axis, row.quantity) for row in self.seen if utilization(row) >= 1.0 - tolerance)

    def to_json(self) -> str:
        """The certificate as JSON text, see certificate.schema.json; null is an infinite end or no number."""
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
    """Prove the limits for all times, piece by piece; pieces with different margins have separate rows.

    If a limit has `rest` set, each piece must start and end at rest; otherwise only the whole trajectory.

    Args:
        trajectory: the trajectory to prove. limits: of the robot.
        unenforced: sentences on limits that this robot is known not to enforce.
        approach: whether the trajectory is an approach to a motion's start, or a return.
        control: the control that the tracking margins apply to, in words; "": unknown.
        partial: a limit that can prove nothing for this curve gets a row "not verified", not a UsageError.
    """
    proofs: dict[tuple[str, str, str, tuple[float, float] | None], Proof] = {}
    pieces, held = trajectory.pieces(), set(HELD)
    for start, label, piece in pieces:
        where = f"{label} at {start:g} s" if len(pieces) > 1 else ""
        for limit in limits:
            proved = rows_of(limit, piece, partial=partial)
            held |= {row.quantity for row in proved} if is_guarded(limit) else set()
            for i, row in enumerate(proved):
                key = (row.axis, row.quantity, f"{limit.name} {i}", _limit_key(row))
                of = control if row.tracking_margin > 0.0 else ""
                row = replace(row, where=" of the ".join(filter(None, (row.where, where))), control=of)
                proofs[key] = _joined(proofs[key], row) if key in proofs else row
    axes = list(dict.fromkeys(key[0] for key in proofs))
    rows = tuple(row for axis in axes for key, row in proofs.items() if key[0] == axis)
    needs_rest = any(isinstance(limit, SupportsOrder) and limit.rest for limit in limits)
    ends = [_end_speeds(piece, limits, partial) for _, _, piece in pieces]
    end_speed = max(map(max, ends)) if needs_rest else max(ends[0][0], ends[-1][1])
    unverified = not_verified(trajectory, limits, rows, unenforced, approach=approach, held=held)
    return Certificate(rows, end_speed, needs_rest, unverified, _warnings(trajectory, limits))


def rows_of(limit: Limit, piece: Trajectory, *, partial: bool) -> Sequence[Proof]:
    """Proofs of a limit for a piece; partial: a limit that cannot prove gives one row "not verified"."""
    try:
        return limit.prove(piece)
    except UsageError as problem:
        if not partial:
            raise
        nan = math.nan
        return [Proof("all", limit.name, nan, nan, nan, nan, problem.fact, "not verified")]


def _warnings(trajectory: Trajectory, limits: Sequence[Limit]) -> tuple[Notice, ...]:
    """Warnings of the limits about this motion; () for a curve without accelerations."""
    notices: list[Notice] = []
    for limit in limits:
        if isinstance(limit, SupportsWarnings):
            with contextlib.suppress(UsageError):
                notices += stated(limit.warned(trajectory))
    return tuple(notices)


def _limit_key(row: Proof) -> tuple[float, float] | None:
    """Key that separates rows of pieces: the ends of the limit; None for a distance, which has one row."""
    return None if row.upper == math.inf else (row.lower, row.upper)


def certify_bytes(data: bytes | str, limits: Sequence[Limit]) -> Certificate:
    """Certificate of the trajectory in a file's exact bytes, before or after they are written."""
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
    """One row for two pieces: the union of both intervals, with place and status of the smaller slack."""
    tighter = other if not slack(other) >= slack(one) else one
    low, high = (
        min(one.proved_lower, other.proved_lower),
        max(one.proved_upper, other.proved_upper),
    )
    return replace(tighter, proved_lower=low, proved_upper=high)


def facts_of(data: bytes | str) -> dict[str, Any]:
    """Contents of a certificate's file, with the keys of this version; missing ends are infinite.

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
    """The row with the keys of this version; the earliest certificates have no tracking margins."""
    fields = {name: value for name, value in row.items() if name != "margin"}
    if fields.get("status") == "not looked at":
        fields["status"] = "not verified"
    return {
        "status": "proved",
        "tracking_margin": 0.0,
        "confidence": 1.0,
        "where": "",
        **fields,
        "slack": row["margin"],
    }


def _read(row: dict[str, Any]) -> dict[str, Any]:
    """The row with numbers in place of null: infinite ends, or NaN in rows that were not verified."""
    none = NAN if row["status"] == "not verified" else ENDS
    return {**row, **{name: value for name, value in none.items() if row[name] is None}}


def _end_speeds(piece: Trajectory, limits: Sequence[Limit], partial: bool) -> tuple[float, float]:
    """Speed at the start and end of a piece, as a fraction of the limits of order 1.

    Without any, as a fraction of the piece's largest speed.
    """
    ends = piece.motion(np.array([0.0, piece.duration]), 2)
    fractions = []
    for limit in limits:
        if not isinstance(limit, SupportsOrder) or limit.order != 1:
            continue
        size = np.array(
            [max(abs(row.lower), abs(row.upper)) for row in rows_of(limit, piece, partial=partial)]
        )
        values = np.abs(limit.of_motion(ends))
        fractions.append(np.divide(values, size, out=np.full(values.shape, math.inf), where=size > 0.0))
    if not fractions:
        # only a scale for the speeds at the ends, no part of a proof: samples are enough
        speeds = np.linalg.norm(piece.motion(np.linspace(0.0, piece.duration, 2001), 2).orders[1], axis=1)
        largest = max(float(speeds.max()), float(np.finfo(float).tiny))
        fractions = [np.linalg.norm(ends.orders[1], axis=1)[:, None] / largest]
    start, end = np.concatenate(fractions, axis=1).max(axis=1)
    return float(start), float(end)


T = TypeVar("T")
PROOFS_KEPT = 256
"""Number of motions whose proofs are kept: a certificate needs the same proof of a limit several times."""


def memoized(store: dict[str, T], key: str, make: Callable[[], T], most: int = PROOFS_KEPT) -> T:
    """The value of `key` in `store`, made if it is not there; a full store is emptied first."""
    if key not in store:
        if len(store) >= most:
            store.clear()
        store[key] = make()
    return store[key]
