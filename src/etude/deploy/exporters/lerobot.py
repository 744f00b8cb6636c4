"""LeRobot dataset (v3) with the motion as one episode of actions, for its `replay`.

Angles are in degrees, as for arms with `use_degrees`, and joints are named `shoulder.pos`. Numbers have
single precision. Each step of the robot's rate has a frame. LeRobot sends one action a frame, which drives
join by lines or steps.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from etude._runtime.rounding import whole_up
from etude.deploy.exporters.knots import MovesJoints
from etude.deploy.feedforward import MotionWithCommands, motion_and_command
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Channel

INFO, DATA = "meta/info.json", "data/chunk-000/file-000.parquet"
SUFFIX = ".pos"


class LerobotActions(MovesJoints):
    """A `protocols.Exporter`: meta/info.json and one data file."""

    written = "LeRobot"

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """Both files.

        Args:
            what: the motion; commands are left out. kind: of the robot. spec: its description.

        Raises:
            UsageError: the robot has no joints.
        """
        self.require_robot(kind, spec)
        motion, _ = motion_and_command(what)
        path = next(c for c in kind.channels(spec) if c.name == kind.path)
        rate = float(spec.rate)
        count = whole_up(motion.duration * rate) + 1
        t = np.arange(count) / rate  # at rest after the end
        actions = (motion.motion(t, 1).orders[0] * _factor(path)).astype(np.float32)
        text = json.dumps(_info([p + SUFFIX for p in path.parts], path, spec, count, rate), indent=1) + "\n"
        return {INFO: text.encode(), DATA: _parquet(t, actions)}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """Lines between the actions, in rad or m."""
        frame = pl.read_parquet(io.BytesIO(files[DATA]))
        info = json.loads(files[INFO])
        factor = np.array([math.pi / 180.0 if unit == "deg" else 1.0 for unit in info["etude"]["units"]])
        actions = np.array(frame["action"].to_list(), dtype=float)
        return Splined(frame["frame_index"].to_numpy() / info["fps"], (actions * factor)[None])


def _factor(path: Channel) -> Array:
    return np.array([180.0 / math.pi if unit == "rad" else 1.0 for unit in path.units])


def _info(names: list[str], path: Channel, spec: Any, count: int, rate: float) -> dict[str, Any]:
    """The info of LeRobot's v3, with our additional units."""
    single = {"shape": [1], "names": None}
    counters = ("frame_index", "episode_index", "index", "task_index")
    return {
        "codebase_version": "v3.0",
        "robot_type": spec.name,
        "total_episodes": 1,
        "total_frames": count,
        "total_tasks": 1,
        "fps": int(rate) if rate.is_integer() else rate,
        "splits": {"train": "0:1"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": {
            "action": {"dtype": "float32", "shape": [len(names)], "names": names},
            "timestamp": {"dtype": "float32", **single},
            **{name: {"dtype": "int64", **single} for name in counters},
        },
        "etude": {"units": ["deg" if unit == "rad" else unit for unit in path.units]},
    }


def _parquet(t: Array, actions: Any) -> bytes:
    still, count = np.zeros(len(t), dtype=np.int64), np.arange(len(t), dtype=np.int64)
    frame = pl.DataFrame(
        {
            "action": pl.Series(actions.tolist(), dtype=pl.List(pl.Float32)),
            "timestamp": pl.Series(t, dtype=pl.Float32),
            "frame_index": count,
            "episode_index": still,
            "index": count,
            "task_index": still,
        }
    )
    out = io.BytesIO()
    frame.write_parquet(out)
    return out.getvalue()


LEROBOT = LerobotActions()
