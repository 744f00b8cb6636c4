"""A table of points and the program that has joint_trajectory_controller play it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib.resources import files as resources
from typing import Any

import numpy as np

from etude.deploy.commanded import Commanded
from etude.deploy.exporters.joint_trajectory import ORDERS
from etude.deploy.exporters.knots import NANO, knots_of, require_joints
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined

TABLE, PLAYER = "points.csv", "play.py"
TIME = "nanoseconds"
WORDS = ("position", "velocity", "acceleration")
EFFORT = "effort"


class CsvPlayer:
    """A `protocols.Exporter`: points.csv (`position/shoulder`, ...) and play.py, a node for rclpy."""

    def __call__(self, what: Trajectory | Commanded, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """Both files. UsageError: no robot of joints, or too quick a motion."""
        require_joints(kind, spec, "a JointTrajectory")
        knots = knots_of(what, kind, spec, ORDERS)
        columns = [f"{word}/{name}" for word in WORDS for name in knots.names]
        table = np.concatenate(list(knots.points), axis=1)
        if knots.command is not None:
            columns += [f"{EFFORT}/{name}" for name in knots.names]
            table = np.concatenate([table, knots.command], axis=1)
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow([TIME, *columns])
        lines.writerows(
            [t, *map(repr, row)] for t, row in zip(knots.nanoseconds.tolist(), table.tolist(), strict=True)
        )
        return {TABLE: text.getvalue().encode(), PLAYER: player("play_points.py")}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """What the controller plays of the table that the player sends."""
        header, *rows = csv.reader(io.StringIO(files[TABLE].decode()))
        times = np.array([int(row[0]) for row in rows]) / NANO
        columns = [
            [i for i, name in enumerate(header) if name.startswith(word + "/")] for word in WORDS[:ORDERS]
        ]
        return Splined(times, np.array([[[float(row[i]) for i in part] for row in rows] for part in columns]))


def player(name: str) -> bytes:
    """The text of a program that runs on the robot's computer."""
    return (resources("etude.deploy.exporters") / "players" / name).read_bytes()


PLAYED = CsvPlayer()
