"""Playback certificate: limits of the curve that a receiver makes of a file's bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from etude.abilities import SupportsCommandedFiles, SupportsFileNotes, SupportsOffsets, SupportsOrder
from etude.deploy.feedforward import ACCELERATION, HALVINGS, ROUNDING, Commanded, shared, within_tilt
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import Certificate, certify, rows_of, slack
from etude.limits.convex_limits import TiltLimit
from etude.protocols import Exporter, Kind, Limit, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Proof

LEAST_PART = 0.5
"""Of what was learned, that is commanded where all of it could lead out of the limits."""
MEET = 1e-5
"""s by which points may be beside the ends of a piece: times are rounded."""
EXCESS = 1e-6
"""Part of a limit's width by which a curve through points may exceed what was proved of the motion."""
HELD_STILL = 1e-3
"""m (rad) per s and s^2 that count as rest where a receiver holds a row: some play single precision. Who is
told such a speed for ever stays within about a millimetre.
"""
ORDERS_HELD = 3
"""Position, velocity, acceleration."""
HELD = ("before the first row", "after the last row")


def played(
    exporter: Exporter,
    what: Trajectory | Commanded,
    kind: Kind,
    spec: Any,
    limits: Sequence[Limit],
    control: str = "",
) -> tuple[Mapping[str, bytes], Certificate]:
    """The files of a motion, and the certificate of what their receiver plays of them.

    Of what a model adds to accelerations as much stands in them as limits of the tilt and of the room allow,
    see `_part`.

    Raises:
        UsageError: as of the exporter. UnsafeTrajectoryError: as of `certify_played`.
    """
    what = within_tilt(what, limits) if isinstance(what, Commanded) else what
    motion = what.trajectory if isinstance(what, Commanded) else what
    files = exporter(what, kind, spec)
    part = _part(_off(exporter, files), limits)
    if part == 1.0 or not isinstance(what, Commanded):
        return files, certify_played(exporter, files, limits, motion, control)
    files = exporter(shared(what, part), kind, spec)
    found = certify_played(exporter, files, limits, motion, control)
    said = (
        f"Of the learned part of the accelerations {100.0 * part:.0f} % is commanded: where it is wrong, all "
        "of it would take the robot out of its limits."
    )
    return files, replace(found, notes=(*found.notes, said))


def certify_played(
    exporter: Exporter,
    files: Mapping[str, bytes],
    limits: Sequence[Limit],
    motion: Trajectory,
    control: str = "",
) -> Certificate:
    """What the receiver of these files plays, held against the limits.

    Args:
        exporter: its attribute `back` reads the files as their receiver does; `notes`, if it has one, says
            what they hold beside the motion, `accelerations` what they command in its place, `strays` how far
            off the plan its feedback leaves a robot where what was learned of these is wrong.
        files: what it wrote.
        limits: of the robot.
        motion: that was exported; the tracking margins of its form hold. A curve with points where its pieces
            meet is proved piece by piece, since a take-off may be where a flight may not.
        control: that the margins are of, in words.

    Raises:
        UnsafeTrajectoryError: the curve leaves a limit by more than EXCESS of its width.
    """
    curve = exporter.back(files)
    if isinstance(curve, Splined):
        curve = _cut(replace(curve, like=motion.form), motion)
    said = exporter.notes(files) if isinstance(exporter, SupportsFileNotes) else ()
    found = certify(curve, limits, control=control, partial=True)
    sent = exporter.accelerations(files) if isinstance(exporter, SupportsCommandedFiles) else None
    strays = _strays(_off(exporter, files), limits)
    rows = (*found.rows, *_holds(curve, limits, control), *_tilts(sent, limits), *strays)
    found = replace(found, rows=rows, notes=said)
    for row in found.failed:
        if row.quantity == REST:
            raise UnsafeTrajectoryError(
                f"the motion is not at rest where its receiver holds it ({row.where}): "
                f"{row.proved_upper:.3g} per s or s^2",
                where=row.axis,
                next_step="Export it with its way from rest and back: "
                "etude ask FOLDER --from home --format NAME.",
            )
        if not slack(row) >= -EXCESS * (row.upper - row.lower):
            raise UnsafeTrajectoryError(
                f"as its receiver plays it, {row.quantity} of '{row.axis}' may reach "
                f"{row.proved_lower:.6g}..{row.proved_upper:.6g}, outside {row.lower:.6g}..{row.upper:.6g}",
                where=f"{row.axis}, {row.quantity}",
                next_step="Ask for another format, or at a lower speed: etude ask --speed 50.",
            )
    return found


def _tilts(sent: Array | None, limits: Sequence[Limit]) -> list[Proof]:
    """Of accelerations (T, 3) that are commands, not the motion's: each is held, so each is all there is."""
    if sent is None:
        return []
    rows = []
    for limit in (own for own in limits if isinstance(own, TiltLimit)):
        most = float(limit.of_acceleration(sent).max())
        angle, name = limit.angle, f"{limit.quantity}, commanded"
        rows.append(Proof(limit.axis, name, -angle, angle, -most, most, "what the rows say"))
    return rows


def learned_part(exporter: Exporter, files: Mapping[str, bytes]) -> tuple[Array, Array] | None:
    """Times (K,) s, and what was learned of the accelerations that files command then, (K, k), in addition to
    the motion's own. None: nothing.
    """
    sent = exporter.accelerations(files) if isinstance(exporter, SupportsCommandedFiles) else None
    curve = exporter.back(files)
    if sent is None or not isinstance(curve, Splined):
        return None
    return curve.times, sent - curve.points[ACCELERATION]


def _off(exporter: Exporter, files: Mapping[str, bytes]) -> tuple[Array, Array] | None:
    """Places (K, k) of a plan, and how far a robot may be off them where what was learned is wrong."""
    return exporter.strays(files) if isinstance(exporter, SupportsCommandedFiles) else None


def _strays(off: tuple[Array, Array] | None, limits: Sequence[Limit]) -> list[Proof]:
    """What limits of places say of these; margins are there for them too."""
    own = [limit for limit in _of_places(limits) if isinstance(limit, SupportsOffsets)]
    return [] if off is None else [row for limit in own for row in limit.strayed(*off)]


def _of_places(limits: Sequence[Limit]) -> list[Limit]:
    return [limit for limit in limits if isinstance(limit, SupportsOrder) and limit.order == 0]


def _part(off: tuple[Array, Array] | None, limits: Sequence[Limit]) -> float:
    """How much of what was learned stays within the limits where it is wrong, 1 if all of it does.

    What is left out is an error too, where it was right: with less than half of it, that is the larger one.
    Then it is 1, and the certificate refuses the whole.
    """
    if off is None:
        return 1.0

    def inside(part: float) -> bool:
        return all(slack(row) >= 0.0 for row in _strays((off[0], part * off[1]), limits))

    low, high = LEAST_PART, 1.0
    if inside(high) or not inside(low):
        return 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside(middle) else (low, middle)
    return low * (1.0 - ROUNDING)


REST = "largest speed or acceleration"
"""Quantity of the rows that say how a receiver holds the first and the last row."""


def _holds(played: Any, limits: Sequence[Limit], control: str) -> list[Proof]:
    """What a receiver holds before it plays and after it has: rest, at a place inside the limits and margins.

    It knows nothing after the last row but that row, and starts from where the first one is.
    """
    pieces = played.pieces()
    rows = []
    ends = (pieces[0][2], 0.0), (pieces[-1][2], pieces[-1][2].duration)
    for where, (piece, t) in zip(HELD, ends, strict=True):
        orders = piece.motion(np.array([t]), ORDERS_HELD).orders[:, 0]
        moves = float(np.abs(orders[1:]).max())
        rest = 0.0, HELD_STILL, moves, moves
        rows.append(Proof(f"held {where}", REST, *rest, "what the row says", where=where))
        still = np.zeros((ORDERS_HELD, 2, len(orders[0])))
        still[0] = orders[0]
        hold = Splined(np.array([0.0, 1.0]), still, like=piece.form)
        for limit in _of_places(limits):
            for row in rows_of(limit, hold, partial=True):
                of = control if row.tracking_margin > 0.0 else ""
                rows.append(replace(row, quantity=f"{row.quantity}, held {where}", control=of))
    return rows


@dataclass(frozen=True, eq=False)
class Played:
    """A curve in the pieces of the motion that it plays: what a certificate asks of a trajectory."""

    parts: tuple[tuple[float, str, Splined], ...]
    form: str
    duration: float

    def pieces(self) -> Sequence[tuple[float, str, Splined]]:
        """Each with the time at which it starts."""
        return self.parts


def _cut(played: Splined, motion: Trajectory) -> Any:
    """The curve in pieces; whole where it has no points at their ends."""
    pieces = motion.pieces()
    edges = [start for start, _, _ in pieces] + [motion.duration]
    at = [int(np.argmin(np.abs(played.times - edge))) for edge in edges]
    at[-1] = len(played.times) - 1  # set-points go on until the next one would come
    near = all(abs(played.times[i] - edge) <= MEET for i, edge in zip(at[:-1], edges, strict=False))
    if len(pieces) == 1 or not near or not all(a < b for a, b in pairwise(at)):
        return played
    parts = []
    for (_, label, _), a, b in zip(pieces, at, at[1:], strict=False):
        times = played.times[a : b + 1]
        own = replace(played, times=times - times[0], points=played.points[:, a : b + 1])
        parts.append((float(times[0]), label, own))
    return Played(tuple(parts), played.form, played.duration)
