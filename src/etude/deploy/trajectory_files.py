"""Trajectory files: exact coefficients, a table of set-points, and the certificate of both."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.abilities import SupportsCommandUnit, SupportsConfirmation, SupportsTableRate
from etude.codes import Notice
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits.certificate import Certificate, require_certified
from etude.logs.readers.cells import header_row, restored
from etude.protocols import Inputs, Kind, Limit, Trajectory
from etude.storage import GENERATION, write_atomic
from etude.trajectories.json_text import from_json
from etude.types import Array, Channel, Log, Motion

STEM = "trajectory"
COEFFICIENTS, TABLE, CERTIFICATE = f"{STEM}.json", f"{STEM}.csv", "certificate.json"
SPEEDS = (25, 50, 100)
"""Per cent, speeds for the first runs of a new motion."""
PLANNED = "_des"
"""Suffix of the names of planned channels; tables of set-points leave it out."""
SHORT = {
    "position": "{}",
    "velocity": "v{}",
    "acceleration": "a{}",
    "attitude": "{}",
    "rates": "w{}",
    "thrust": "thrust",
}
"""Columns of motions in space, as autopilots name them: x, vx, ax, roll, wx; others are CHANNEL_PART."""
Beside = Callable[[Log], Mapping[str, Array]]
LOOKED_AT = 4
"""Number of derivative orders that limits use: up to jerk."""
ROUNDING = 1e-9
"""Fraction of a limit by which the table may exceed it: its values are exact, but its times are rounded."""
SMALLEST_PLAIN, LARGEST_PLAIN = 1e-4, 1e16
"""Range in which Python writes a float without an exponent."""


@dataclass(frozen=True)
class TrajectoryFiles:
    """The bytes of one trajectory's files, certified as they are.

    Attributes:
        trajectory: as read from `coefficients`.
        certificate: proved from `coefficients`, not from the original object.
        coefficients, table, proof: contents of trajectory.json, trajectory.csv and certificate.json.
        names: of these files, or of those of a way.
    """

    trajectory: Trajectory
    certificate: Certificate
    coefficients: bytes
    table: bytes
    proof: bytes
    names: tuple[str, str, str] = (COEFFICIENTS, TABLE, CERTIFICATE)

    def contents(self, folder: Path) -> dict[Path, bytes]:
        """The bytes of the three files in that folder, the certificate last."""
        files = (self.coefficients, self.table, self.proof)
        return {folder / name: data for name, data in zip(self.names, files, strict=True)}

    def write(self, folder: Path) -> list[Path]:
        """Write the three files, the certificate last; return their paths."""
        for path, data in self.contents(folder).items():
            write_atomic(path, data)
        return [folder / name for name in self.names]


def render(
    trajectory: Trajectory,
    kind: Kind,
    spec: Any,
    config: Any,
    limits: Sequence[Limit],
    unenforced: Sequence[str] = (),
    stem: str = STEM,
    control: str = "",
    swept: Sequence[Mapping[str, Any]] = (),
    warned: Sequence[Notice] = (),
) -> TrajectoryFiles:
    """The files of a trajectory, verified from their own bytes.

    Args:
        trajectory: the motion to run.
        kind, spec, config: of the robot; the table contains the plans of its inputs.
        limits: limits of the robot.
        unenforced: sentences for the certificate on limits that this robot is known not to enforce.
        stem: of the files' names; another one than `STEM` means an approach or a return.
        control: the control that the tracking margins apply to, in words.
        swept: for each axis the range that the motion sweeps, see `campaign.propose.proposal`.
        warned: warnings that precede those of the limits.

    Raises:
        UnsafeTrajectoryError: a limit is not proved.
    """
    coefficients = trajectory.to_json().encode()
    written = from_json(coefficients)
    certificate = require_certified(written, limits, unenforced, approach=stem != STEM, control=control)
    certificate = replace(certificate, warnings=(*warned, *certificate.warnings))
    inputs = kind.inputs(spec, config)
    table = csv_bytes(written, inputs, table_rate(spec))
    _check_table(table, written, kind, inputs, limits, spec.name)
    names = (f"{stem}.json", f"{stem}.csv", CERTIFICATE if stem == STEM else f"{stem}.{CERTIFICATE}")
    proof = {
        "generation": GENERATION,
        "trajectory": names[0],
        "robot": spec.name,
        **json.loads(certificate.to_json()),
    }
    proof |= {"swept": list(swept)} if swept else {}
    assumed = to_confirm(spec)
    proof |= {"to_confirm": assumed} if assumed else {}
    text = json.dumps(proof, indent=1) + "\n"
    return TrajectoryFiles(written, certificate, coefficients, table, text.encode(), names)


def table_rate(spec: Any) -> float:
    """Hz of the robot's set-points: the rate of its logs, unless its description has another one."""
    return float(spec.table_rate if isinstance(spec, SupportsTableRate) else spec.rate)


def command_unit(spec: Any) -> str:
    """Unit of the robot's commands; "" if they have different ones."""
    return spec.command_unit if isinstance(spec, SupportsCommandUnit) else ""


def to_confirm(spec: Any) -> list[str]:
    """Sentences on unconfirmed assumptions about the robot."""
    return list(spec.confirm) if isinstance(spec, SupportsConfirmation) else []


def csv_bytes(trajectory: Trajectory, inputs: Inputs, rate: float, beside: Beside | None = None) -> bytes:
    """`time` and all planned channels at `rate` Hz; every float reads back exactly.

    The last row is the first instant of the grid at or after the motion's end, and players hold it. It is at
    rest if the motion ends at rest.

    Args:
        beside: function that gives further columns (T,) by name, from the states of perfect tracking.
    """
    count = math.ceil(trajectory.duration * rate - ROUNDING) + 1
    t = np.arange(count) / rate
    log = inputs.states(motion_and_rest(trajectory, t, inputs.orders))
    columns: dict[str, Array] = {"time": t}
    for channel in (c for c in log.channels.values() if c.role == "plan"):
        columns |= dict(zip(column_names(channel), log[channel.name].T, strict=True))
    columns |= {} if beside is None else beside(log)
    text = io.StringIO()
    text.write(header_row(columns))
    text.write(lines(np.column_stack([*columns.values()])))
    return text.getvalue().encode()


def motion_and_rest(trajectory: Trajectory, t: Array, orders: int) -> Motion:
    """The motion at times t (T,) s; after its end it rests at its last pose."""
    motion = trajectory.motion(np.minimum(t, trajectory.duration), orders)
    table = motion.orders.copy()
    table[1:, t > trajectory.duration * (1.0 + ROUNDING)] = 0.0
    return Motion(t, table)


def lines(rows: Array) -> str:
    """Rows (T, n) as lines of a table, each float like its `repr`, the shortest text that reads back exactly.

    msgspec writes the same digits in a seventh of the time, but other exponents. So rows with an exponent or
    with values that are not finite are written number by number.
    """
    numbers, size = rows.tolist(), np.abs(rows)
    plain = ((size >= SMALLEST_PLAIN) & (size < LARGEST_PLAIN)) | (size == 0.0)
    texts = msgspec.json.encode(numbers).decode()[2:-2].split("],[") if len(rows) else []
    for i in np.flatnonzero(~plain.all(axis=1)).tolist():
        texts[i] = ",".join(map(repr, numbers[i]))
    return "".join(f"{line}\n" for line in texts)


def column_names(channel: Channel) -> list[str]:
    """The columns of a planned channel in a table of set-points."""
    name = channel.name.removesuffix(PLANNED)
    return [SHORT.get(name, name + "_{}").format(part) for part in channel.parts]


def read_table(data: bytes) -> tuple[list[str], Array]:
    """Header and numbers of a table that `csv_bytes` made."""
    names = list(map(restored, next(csv.reader(io.StringIO(data.decode())))))
    return names, np.loadtxt(io.BytesIO(data), delimiter=",", skiprows=1, ndmin=2, comments=None)


def at_speed(trajectory: Trajectory, per_cent: float) -> Trajectory:
    """The same path run at a fraction of the speed.

    Raises:
        UsageError: the speed is not above 0 and at most 100 %.
    """
    if not 0 < per_cent <= 100:
        raise UsageError(f"the speed must be above 0 and at most 100 per cent, not {per_cent}")
    return trajectory.slowed(100 / per_cent)


def _check_table(
    table: bytes, written: Trajectory, kind: Kind, inputs: Inputs, limits: Sequence[Limit], robot: str
) -> None:
    """Read the table back and compare every row with the motion of the coefficients, which are proved
    elsewhere, and with the limits.

    Derivative orders that are not in the table come from the trajectory. Limits that were proved by samples
    are not checked again: their samples are denser than the rows.
    """
    names, rows = read_table(table)
    place = {name: j for j, name in enumerate(names)}
    motion = motion_and_rest(written, rows[:, 0], max(inputs.orders, LOOKED_AT))
    orders = motion.orders.copy()
    for i, channel in enumerate(_path_orders(kind.path, inputs.states(motion_of_one(written, inputs)))):
        orders[i] = rows[:, [place[name] for name in column_names(channel)]]
    scale = np.maximum(np.abs(motion.orders).max(axis=1, keepdims=True), 1.0)
    bad = ~np.isfinite(rows).all(axis=1) | (np.abs(orders - motion.orders) > ROUNDING * scale).any(
        axis=(0, 2)
    )
    for limit in limits:
        bad |= _outside(limit, Motion(rows[:, 0], orders), written)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise UnsafeTrajectoryError(
            f"row {row + 2} of the table leaves the motion or the limits of '{robot}'", where=TABLE
        )


def motion_of_one(trajectory: Trajectory, inputs: Inputs) -> Motion:
    """The first instant of a trajectory."""
    return trajectory.motion(np.zeros(1), inputs.orders)


def _path_orders(path: str, log: Log) -> list[Channel]:
    """The planned path and those of its derivatives that the plan has."""
    orders = [log.channels[path + PLANNED]] if path + PLANNED in log.channels else []
    while orders:
        following = [c for c in log.channels.values() if c.derivative_of == orders[-1].name]
        if not following:
            break
        orders.append(following[0])
    return orders


def _outside(limit: Limit, motion: Motion, written: Trajectory) -> Any:
    """(T,) whether the limited quantity is outside of its interval in a row."""
    bad = np.zeros(len(motion.t), dtype=np.bool_)
    proofs = [limit.prove(piece) for _, _, piece in written.pieces()]
    if all(proof.status == "sampled" for rows in proofs for proof in rows):
        return bad
    values = limit.of_motion(motion)
    for (start, _, piece), rows in zip(written.pieces(), proofs, strict=True):
        inside = (motion.t >= start) & (motion.t <= start + piece.duration)
        for column, proof in zip(values.T, rows, strict=True):
            slack = ROUNDING * max(abs(b) for b in (proof.lower, proof.upper, 1.0) if math.isfinite(b))
            bad |= inside & ((column < proof.lower - slack) | (column > proof.upper + slack))
    return bad
