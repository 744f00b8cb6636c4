"""Set-points for PX4's offboard mode, in its frame (north, east, down), and the program that sends them.

PX4 holds each set-point until the next: its position, velocity and acceleration go to its controllers as they
are, so that is what is certified. What is held after the last one is that one: half a second at rest ends the
table.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from etude.contracts import Kind, Trajectory
from etude.deploy.commanded import Commanded, parted
from etude.deploy.exporters.csv_player import player
from etude.deploy.exporters.knots import require_space
from etude.trajectories.lead_in import STILL
from etude.trajectories.splined import Splined

TABLE, PLAYER = "setpoints.csv", "play.py"
RATE = 50.0
"""Hz; offboard mode ends below 2."""
ORDERS = 3
HELD_S = 0.5
"""s of rows at rest after the motion: whoever stops reading early still reads one."""
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""(north, east, down) <- (east, north, up), and back."""
YAW = 0.5 * math.pi
"""Heading zero looks east."""
HEADER = ["time", *(prefix + axis for prefix in ("", "v", "a") for axis in ("north", "east", "down")), "yaw"]


class Offboard:
    """A `contracts.Exporter`: setpoints.csv and play.py, a node for rclpy and px4_msgs."""

    def __call__(self, what: Trajectory | Commanded, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """Both files. UsageError: no path in space."""
        require_space(kind, spec, "an autopilot")
        motion, _ = parted(what)
        count = math.ceil(motion.duration * RATE - 1e-9) + 1
        t = np.arange(count + round(HELD_S * RATE)) / RATE
        orders = motion.motion(t, ORDERS).orders @ NED.T  # at rest after the end
        for end in (0, count - 1):  # rest is exact in what is sent
            if np.abs(orders[1:, end]).max() <= STILL:
                orders[1:, end] = 0.0
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(HEADER)
        rows = np.concatenate(list(orders.astype(np.float32)), axis=1).astype(float).tolist()
        lines.writerows(
            [*map(repr, [seconds, *row, YAW])] for seconds, row in zip(t.tolist(), rows, strict=True)
        )
        return {TABLE: text.getvalue().encode(), PLAYER: player("play_setpoints.py")}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The set-points, each held until the next, in single precision; east, north, up."""
        _, *rows = csv.reader(io.StringIO(files[TABLE].decode()))
        table = np.array([[float(cell) for cell in row] for row in rows])
        points = np.moveaxis(table[:, 1:-1].astype(np.float32).reshape(len(table), ORDERS, 3), 1, 0)
        return Splined(table[:, 0], points.astype(float) @ NED.T, held=True)


OFFBOARD = Offboard()
