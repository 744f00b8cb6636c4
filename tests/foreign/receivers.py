"""What each format's receiver commands, from ten seconds before the first row to ten after the last.

A format of another package is played once it stands in `RECEIVERS`; those of vehicles are flown, see FLOWN.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trajectory_controller import Parameters, Played, message_of, play

Array = NDArray[np.float64]
BEFORE, AFTER, RATE = 10.0, 10.0, 200.0
Files = Mapping[str, bytes]


def by_controller(name: str) -> Callable[[Files, tuple[str, ...]], Played]:
    """joint_trajectory_controller with an effort interface, its robot standing at the first point."""

    def played(files: Files, joints: tuple[str, ...]) -> Played:
        message = message_of(name, files)
        return play(message, Parameters(joints, effort_interface=True), None, BEFORE, AFTER, RATE)

    return played


def by_replay(files: Files, joints: tuple[str, ...]) -> Played:
    """`lerobot-replay`: an action a frame, in degrees by its own names; drives see lines between frames."""
    import polars as pl

    info = json.loads(files["meta/info.json"])
    frame = pl.read_parquet(io.BytesIO(files["data/chunk-000/file-000.parquet"]))
    names = info["features"]["action"]["names"]
    actions = np.array(frame["action"].to_list(), dtype=float)[:, [names.index(f"{n}.pos") for n in joints]]
    return _lines(np.arange(len(actions)) / info["fps"], np.radians(actions))


def by_rows(files: Files, joints: tuple[str, ...]) -> Played:
    """A user's player of trajectory.csv: each row is sent at its time, the last one goes on being sent."""
    header, *rows = csv.reader(io.StringIO(files["trajectory.csv"].decode()))
    table = np.array([[float(cell) for cell in row] for row in rows])
    parts = [[header.index(f"{word}_{name}") for name in joints] for word in ("q", "qd", "qdd")]
    t = _clock(table[-1, 0])
    k = np.clip(np.searchsorted(table[:, 0], t + 1e-9, side="right") - 1, 0, len(table) - 1)
    q, qd, qdd = (table[k][:, part] for part in parts)
    return Played(t, q, qd, qdd, np.zeros_like(q))


def _lines(knots: Array, rows: Array) -> Played:
    t = _clock(float(knots[-1]))
    q = np.stack([np.interp(t, knots, column) for column in rows.T], axis=1)
    step = np.diff(rows, axis=0) / np.diff(knots)[:, None]
    k = np.searchsorted(knots, t, side="right") - 1
    inside = ((k >= 0) & (k < len(step)))[:, None]
    qd = np.where(inside, step[np.clip(k, 0, len(step) - 1)], 0.0)
    return Played(t, q, qd, np.zeros_like(q), np.zeros_like(q))


def _clock(duration: float) -> Array:
    before = round(BEFORE * RATE)
    return (np.arange(before + math.ceil((duration + AFTER) * RATE) + 1) - before) / RATE


RECEIVERS: dict[str, Callable[[Files, tuple[str, ...]], Any]] = {
    **{name: by_controller(name) for name in ("ros2", "ros2_sqlite", "ros2_yaml", "ros2_csv")},
    "lerobot": by_replay,
}
SIX_JOINTS = ("urscript", "urscript_cb")
"""Formats of arms of six joints: what runs their text is in tests/deploy/inside/test_urscript.py."""
FLOWN = ("px4", "crazyflie")
"""Formats of vehicles: what flies them is a plant and no table, `px4_cascade.py`."""
