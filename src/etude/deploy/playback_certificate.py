"""Playback certificate: limits of the curve that a receiver makes of a file's bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from etude.abilities import SupportsCommandedFiles, SupportsFileNotes, SupportsOffsets, SupportsOrder
from etude.deploy.feedforward import (
    ACCELERATION,
    HALVINGS,
    ROUNDING,
    MotionWithCommands,
    with_acceleration_share,
    within_tilt,
)
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import Certificate, certify, rows_of, slack
from etude.limits.motion_limits import TiltLimit
from etude.protocols import Exporter, Kind, Limit, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Proof

LEAST_PART = 0.5
"""Smallest fraction of the model's additions that is commanded if all of them could violate the limits."""
MEET = 1e-5
"""s by which points may be beside the ends of a piece: times are rounded."""
EXCESS = 1e-6
"""Fraction of a limit's width by which a curve through points may exceed the proved values of the motion."""
HELD_STILL = 1e-3
"""m (rad) per s and s^2 that count as rest where a receiver holds a row, since some use single precision. A
robot that holds such a speed set-point stays within about a millimetre.
"""
ORDERS_HELD = 3
"""Position, velocity, acceleration."""
HELD = ("before the first row", "after the last row")


def certified_playback(
    exporter: Exporter,
    what: Trajectory | MotionWithCommands,
    kind: Kind,
    spec: Any,
    limits: Sequence[Limit],
    control: str = "",
) -> tuple[Mapping[str, bytes], Certificate]:
    """The files of a motion, and the certificate of the motion that their receiver plays.

    The model's additions to accelerations are reduced as far as limits of tilt and of positions require, see
    `_part`.

    Raises:
        UsageError: as the exporter. UnsafeTrajectoryError: as `certify_played`.
    """
    what = within_tilt(what, limits) if isinstance(what, MotionWithCommands) else what
    motion = what.trajectory if isinstance(what, MotionWithCommands) else what
    files = exporter(what, kind, spec)
    part = _part(_possible_offsets(exporter, files), limits)
    if part == 1.0 or not isinstance(what, MotionWithCommands):
        return files, certify_played(exporter, files, limits, motion, control)
    files = exporter(with_acceleration_share(what, part), kind, spec)
    certificate = certify_played(exporter, files, limits, motion, control)
    note = (
        f"Only {100.0 * part:.0f} % of the learned accelerations is commanded: an error in all of them "
        "could move the robot out of its limits."
    )
    return files, replace(certificate, notes=(*certificate.notes, note))


def certify_played(
    exporter: Exporter,
    files: Mapping[str, bytes],
    limits: Sequence[Limit],
    motion: Trajectory,
    control: str = "",
) -> Certificate:
    """Certificate of the motion that the receiver of these files plays.

    Args:
        exporter: its attribute `back` reads the files as their receiver does. Optional attributes: `notes`
            gives further contents of the files, `answered` the accelerations that result, and `strays` the
            deviation from the plan under its feedback if the learned additions are wrong.
        files: the exported files.
        limits: of the robot.
        motion: the exported motion; the tracking margins of its form apply. If the curve has points where the
            motion's pieces meet, each piece is proved separately, since a take-off has other limits.
        control: the control that the margins apply to, in words.

    Raises:
        UnsafeTrajectoryError: the curve leaves a limit by more than EXCESS of its width.
    """
    curve = exporter.back(files)
    if isinstance(curve, Splined):
        curve = _cut(replace(curve, like=motion.form), motion)
    notes = exporter.notes(files) if isinstance(exporter, SupportsFileNotes) else ()
    certificate = certify(curve, limits, control=control, partial=True)
    answered = exporter.answered(files) if isinstance(exporter, SupportsCommandedFiles) else None
    strays = _offset_rows(_possible_offsets(exporter, files), limits)
    rows = (
        *certificate.rows,
        *_held_setpoint_rows(curve, limits, control),
        *_tilts(answered, limits),
        *strays,
    )
    certificate = replace(certificate, rows=rows, notes=notes)
    for row in certificate.failed:
        if row.quantity == REST:
            raise UnsafeTrajectoryError(
                f"the motion is not at rest where its receiver holds a row ({row.where}): "
                f"{row.proved_upper:.3g} per s or s^2",
                where=row.axis,
                next_step="Let a motion begin and end at rest. Export a proposal with its approach and "
                "return: etude ask FOLDER --from home --format NAME.",
            )
        if not slack(row) >= -EXCESS * (row.upper - row.lower):
            raise UnsafeTrajectoryError(
                f"as its receiver plays it, {row.quantity} of '{row.axis}' may reach "
                f"{row.proved_lower:.6g}..{row.proved_upper:.6g}, outside {row.lower:.6g}..{row.upper:.6g}",
                where=f"{row.axis}, {row.quantity}",
                next_step="Use another format, or a lower speed: etude ask --speed 50.",
            )
    return certificate


def _tilts(answered: Array | None, limits: Sequence[Limit]) -> list[Proof]:
    """Tilt rows of commanded accelerations (T, 3): each is held, so that samples are exact."""
    if answered is None:
        return []
    rows = []
    for limit in (candidate for candidate in limits if isinstance(candidate, TiltLimit)):
        most = float(limit.of_acceleration(answered).max())
        angle, name = limit.angle, f"{limit.quantity}, commanded"
        rows.append(Proof(limit.axis, name, -angle, angle, -most, most, "what the rows say"))
    return rows


def learned_part(exporter: Exporter, files: Mapping[str, bytes]) -> tuple[Array, Array] | None:
    """Times (K,) s, and the accelerations that files command then in addition to the motion's own, (K, k),
    because of what was learned. None: nothing.
    """
    sent = exporter.accelerations(files) if isinstance(exporter, SupportsCommandedFiles) else None
    curve = exporter.back(files)
    if sent is None or not isinstance(curve, Splined):
        return None
    return curve.times, sent - curve.points[ACCELERATION]


def _possible_offsets(exporter: Exporter, files: Mapping[str, bytes]) -> tuple[Array, Array] | None:
    """Planned poses (K, k), and the possible deviations from them if the learned additions are wrong."""
    return exporter.strays(files) if isinstance(exporter, SupportsCommandedFiles) else None


def _offset_rows(off: tuple[Array, Array] | None, limits: Sequence[Limit]) -> list[Proof]:
    """Rows of the position limits for these poses; margins cover such deviations, too."""
    offset_limits = [limit for limit in _position_limits(limits) if isinstance(limit, SupportsOffsets)]
    return [] if off is None else [row for limit in offset_limits for row in limit.strayed(*off)]


def _position_limits(limits: Sequence[Limit]) -> list[Limit]:
    return [limit for limit in limits if isinstance(limit, SupportsOrder) and limit.order == 0]


def _part(off: tuple[Array, Array] | None, limits: Sequence[Limit]) -> float:
    """Largest fraction of the learned additions that keeps the limits even if they are wrong; 1 if all do.

    If the additions are right, the omitted fraction is an error instead; below one half it is the larger one.
    In that case the result is 1, and the certificate refuses the motion.
    """
    if off is None:
        return 1.0

    def inside(part: float) -> bool:
        return all(slack(row) >= 0.0 for row in _offset_rows((off[0], part * off[1]), limits))

    low, high = LEAST_PART, 1.0
    if inside(high) or not inside(low):
        return 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside(middle) else (low, middle)
    return low * (1.0 - ROUNDING)


REST = "largest speed or acceleration"
"""Quantity of the rows on how a receiver holds the first and the last row."""


def _held_setpoint_rows(played: Any, limits: Sequence[Limit], control: str) -> list[Proof]:
    """Rows for the set-points that a receiver holds before and after playing: rest inside limits and margins.

    Before it plays it holds the first row, and afterwards the last one.
    """
    pieces = played.pieces()
    rows = []
    ends = (pieces[0][2], 0.0), (pieces[-1][2], pieces[-1][2].duration)
    for where, (piece, t) in zip(HELD, ends, strict=True):
        orders = piece.motion(np.array([t]), ORDERS_HELD).orders[:, 0]
        moves = float(np.abs(orders[1:]).max())
        bounds = 0.0, HELD_STILL, moves, moves
        rows.append(Proof(f"held {where}", REST, *bounds, "what the row says", where=where))
        still = np.zeros((ORDERS_HELD, 2, len(orders[0])))
        still[0] = orders[0]
        hold = Splined(np.array([0.0, 1.0]), still, like=piece.form)
        for limit in _position_limits(limits):
            for row in rows_of(limit, hold, partial=True):
                of = control if row.tracking_margin > 0.0 else ""
                rows.append(replace(row, quantity=f"{row.quantity}, held {where}", control=of))
    return rows


@dataclass(frozen=True, eq=False)
class PlayedTrajectory:
    """A curve, divided into the pieces of the motion that it plays, as a trajectory for certificates."""

    parts: tuple[tuple[float, str, Splined], ...]
    form: str
    duration: float

    def pieces(self) -> Sequence[tuple[float, str, Splined]]:
        """Each with the time at which it starts."""
        return self.parts


def _cut(played: Splined, motion: Trajectory) -> Any:
    """The curve in pieces; undivided if it has no points at their ends."""
    pieces = motion.pieces()
    edges = [start for start, _, _ in pieces] + [motion.duration]
    at = [int(np.argmin(np.abs(played.times - edge))) for edge in edges]
    at[-1] = len(played.times) - 1  # the last set-point is held for one more step
    near = all(abs(played.times[i] - edge) <= MEET for i, edge in zip(at[:-1], edges, strict=False))
    if len(pieces) == 1 or not near or not all(a < b for a, b in pairwise(at)):
        return played
    parts = []
    for (_, label, _), a, b in zip(pieces, at, at[1:], strict=False):
        times = played.times[a : b + 1]
        part = replace(played, times=times - times[0], points=played.points[:, a : b + 1])
        parts.append((float(times[0]), label, part))
    return PlayedTrajectory(tuple(parts), played.form, played.duration)
