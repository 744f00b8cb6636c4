"""URScript program that gives a Universal Robots controller a target of `servoj` at each of its steps.

The program computes the targets on quintics through points. One line for each target would be 30,000 lines a
minute, and controllers read a whole program before they move. The controller smooths targets over the
look-ahead time, so the arm lags by about that time; logs show this as tracking error.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude._runtime.rounding import whole_up
from etude.deploy.exporters.knots import SLOWEST, MovesJoints, names_of
from etude.deploy.feedforward import MotionWithCommands, motion_and_command
from etude.errors import UsageError
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Index

FILE = "motion.script"
JOINTS = 6  # of every arm of Universal Robots
ORDERS = 3  # position, velocity, acceleration
LOOK_AHEAD_S, GAIN = 0.1, 300
"""Defaults of the script manual: servoj(q, a, v, t=0.002, lookahead_time=0.1, gain=300)."""
AT_START = 0.02
"""rad that a joint may be off the first target: the program stops elsewhere, since `servoj` would jump."""
CLOSE = 1e-5
"""Largest distance of targets from the motion, as a part of the path's size: `servoj` smooths far more."""
DIGITS = 10
"""Behind the point: a step of 2 ms turns an error of 1e-10 rad into one of 1e-4 rad/s^2."""
LONG = 1000
"""Lines that controllers of the CB series were seen to take; see docs/hand_over.md."""
HEAD = re.compile(r"^ *# rate: ([0-9.]+) ", re.MULTILINE)
START = re.compile(r"^ *global etude_q = (\[.*\])$", re.MULTILINE)
PIECE = re.compile(r"^ *etude_to\(([0-9.]+), (\[.*\]), (\[.*\]), (\[.*\])\)$", re.MULTILINE)
PROGRAM = """\
def etude_motion():
  # joints, base to wrist 3: {names}
  # rate: {rate:g} targets a second for {duration:.1f} s, with the speed slider at 100 %.
  global etude_q = {start}
  global etude_v = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  global etude_a = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  # In so many steps to a place (rad), with that velocity (rad/s) and acceleration (rad/s^2).
  def etude_to(steps, q, v, a):
    local t = steps * {step:g}
    local d = q - etude_q
    local v0 = t * etude_v
    local v1 = t * v
    local a0 = t * t * etude_a
    local a1 = t * t * a
    local c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    local c4 = 8.0 * v0 + 7.0 * v1 - 15.0 * d + 1.5 * a0 - 1.0 * a1
    local c5 = 6.0 * d - 3.0 * v0 - 3.0 * v1 - 0.5 * a0 + 0.5 * a1
    local k = 1.0
    while k <= steps:
      local u = k / steps
      servoj(etude_q + u * (v0 + u * (0.5 * a0 + u * (c3 + u * (c4 + u * c5)))), {servoj})
      k = k + 1.0
    end
    etude_q = q
    etude_v = v
    etude_a = a
  end
  now = get_actual_joint_positions()
  i = 0
  while i < {joints}:
    if norm(now[i] - etude_q[i]) > {at_start:g}:
      popup("The arm is not at the start of this motion.", title="Etude", error=True, blocking=True)
      halt
    end
    i = i + 1
  end
  servoj(etude_q, {servoj})
{pieces}
  stopj(2.0)
end
"""


@dataclass(frozen=True)
class UrScript(MovesJoints):
    """A `protocols.Exporter`: one program.

    Attributes:
        rate: targets per second: 500 for the e-Series, 125 for the CB series.
    """

    written = "URScript"
    rate: float

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The program.

        Args:
            what: the motion; commands are left out. kind: of the robot. spec: its description.

        Raises:
            UsageError: the robot does not have six revolute joints.
        """
        self.require_robot(kind, spec)
        motion, _ = motion_and_command(what)
        at, points = self._points(motion)
        steps = np.diff(at)
        rows = np.moveaxis(points, 1, 0)
        calls = [
            f"  etude_to({float(n):.1f}, {', '.join(map(_list, row))})"
            for n, row in zip(steps, rows[1:], strict=True)
        ]
        text = PROGRAM.format(
            names=json.dumps(", ".join(names_of(kind, spec))),
            rate=self.rate,
            duration=at[-1] / self.rate,
            start=_list(points[0, 0]),
            step=1.0 / self.rate,
            servoj=f"0, 0, {1.0 / self.rate:g}, {LOOK_AHEAD_S:g}, {GAIN}",
            joints=JOINTS,
            at_start=AT_START,
            pieces="\n".join(calls),
        )
        return {FILE: text.encode("ascii")}

    def require_robot(self, kind: Kind, spec: Any) -> None:
        """UsageError: the robot does not have six revolute joints."""
        super().require_robot(kind, spec)
        path = next(c for c in kind.channels(spec) if c.name == kind.path)
        if len(path.parts) != JOINTS or set(path.units) != {"rad"}:
            raise UsageError(
                f"URScript moves {JOINTS} revolute joints, but {spec.name!r} has {', '.join(path.parts)}",
                next_step="Use another format: etude plugins lists them.",
            )

    def _points(self, motion: Trajectory) -> tuple[Index, Array]:
        """Steps (K,) at which pieces meet, as far apart as CLOSE allows, and the motion there (O, K, J)."""
        last, apart = whole_up(motion.duration * self.rate), int(self.rate / SLOWEST)
        t = np.minimum(np.arange(last + 1) / self.rate, motion.duration)
        path = motion.motion(t, 1).orders[0]
        while True:
            at = np.unique(np.append(np.arange(0, last, apart), last))
            points = np.array(motion.motion(t[at], ORDERS).orders)
            points[1:, [0, -1]] = 0.0  # it starts and ends at rest
            error = np.abs(_targets(at, points, self.rate) - path).max()
            if error <= CLOSE * np.ptp(path, axis=0).max() or apart == 1:
                return at, points
            apart //= 2

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """Lines between the targets, each held for its step."""
        at, points, rate = _read(files)
        return Splined(np.arange(at[-1] + 1) / rate, _targets(at, points, rate)[None])

    def notes(self, files: Mapping[str, bytes]) -> tuple[str, ...]:
        """Sentences on the controller's lag and on a long program."""
        count = len(_read(files)[0])
        follows = (
            f"servoj follows its targets about {LOOK_AHEAD_S:g} s late by its own control law. Tracking "
            "margins include this once a log shows it."
        )
        longer = (
            f"{FILE} has more than {LONG} lines ({count}), at which controllers of the CB series failed: "
            "docs/hand_over.md. A shorter [trajectory] duration in campaign.toml makes it shorter."
        )
        return (follows, longer) if count > LONG else (follows,)


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{value:.{DIGITS}f}" for value in values) + "]"


def _targets(at: Index, points: Array, rate: float) -> Array:
    """Target (T, J) rad of each step, on quintics through points (O, K, J) at steps `at` (K,)."""
    return np.asarray(Splined(at / rate, points).motion(np.arange(at[-1] + 1) / rate, 1).orders[0])


def _read(files: Mapping[str, bytes]) -> tuple[Index, Array, float]:
    """Steps (K,) at which pieces meet, the points there (O, K, J) with derivatives per s, and steps per
    second.
    """
    text = files[FILE].decode("ascii")
    rate = float(HEAD.findall(text)[0])
    calls = PIECE.findall(text)
    steps = np.array([float(call[0]) for call in calls])
    rows = np.array([[json.loads(values) for values in call[1:]] for call in calls])
    start = np.zeros((1, ORDERS, JOINTS))
    start[0, 0] = json.loads(START.findall(text)[0])
    at = np.concatenate([[0], np.cumsum(steps)]).astype(np.int64)
    return at, np.moveaxis(np.concatenate([start, rows]), 1, 0), rate


E_SERIES, CB_SERIES = UrScript(500.0), UrScript(125.0)
