"""The last run, joint by joint: desired against actual, and the feedforward against the command applied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.logs.log import RobotLog
from etude.report.markup import Html, grid, missing, paragraph, section
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.svg import Level, Line, Mark, panel, thinned

Array = NDArray[np.float64]

SIZE = (380, 260)


def tracking(record: Record) -> Html:
    """Three panels per joint of the newest log."""
    title = "Desired against actual, feedforward against command"
    told = [n for n, r in sorted(record.state.rounds.items()) if r.told is not None]
    readable = ((n, log) for n in reversed(told) if (log := record.log(n)) is not None)
    newest, log = next(readable, (0, None))
    if log is None:
        return section("tracking", title, missing("No log that can be read has come back yet."))
    panels = [p for joint in range(log.dof) for p in joint_panels(log, joint)]
    return section("tracking", title, paragraph(_introduction(log, newest)), *_absent(log), grid(panels, 3))


def _introduction(log: RobotLog, number: int) -> str:
    position = "noise-free position" if log.q_true is not None else "measured position"
    return (
        f"The newest log, of trajectory {number}: {len(log.t):,} samples. Error is the desired "
        f"position minus the {position}. Where the feedforward lies on the applied command, the model "
        "already knows what the motion needs; what is left between them is the feedback's work."
    )


def _absent(log: RobotLog) -> list[Html]:
    sentences = []
    if log.q_des is None:
        sentences.append("This log has no desired position, so there is no tracking error to show.")
    if log.tau_ff is None:
        sentences.append("This log has no separate feedforward; only the applied command is drawn.")
    return [missing(sentence) for sentence in sentences]


def joint_panels(log: RobotLog, joint: int) -> list[Html]:
    """Position, error and command of one joint; the error only if the desired position is known."""
    name = log.names[joint]
    panels = [_positions(log, joint, name)]
    if log.q_des is not None:
        panels.append(_error(log, joint, name))
    panels.append(_commands(log, joint, name))
    return panels


def _positions(log: RobotLog, joint: int, name: str) -> Html:
    marks: list[Mark] = [_curve(log.t, log.q[:, joint], "measured", "c1")]
    if log.q_des is not None:
        marks.append(_curve(log.t, log.q_des[:, joint], "desired", "c2 dash"))
    return panel(f"{name}: position", _time(log), Axis("position (rad)"), marks, size=SIZE)


def _error(log: RobotLog, joint: int, name: str) -> Html:
    assert log.q_des is not None
    actual = log.q if log.q_true is None else log.q_true
    error = np.degrees(log.q_des[:, joint] - actual[:, joint])
    marks: list[Mark] = [Level(0.0, style="axis-line"), _curve(log.t, error, "", "c8 thin")]
    mean = float(np.mean(np.abs(error[log.t >= 0.0]))) if np.any(log.t >= 0.0) else float("nan")
    title = f"{name}: tracking error, mean {mean:.3g}°"
    return panel(title, _time(log), Axis("error (degrees)"), marks, size=SIZE)


def _commands(log: RobotLog, joint: int, name: str) -> Html:
    marks: list[Mark] = [_curve(log.t, log.tau[:, joint], "applied", "c6 thin")]
    if log.tau_ff is not None:
        marks.append(_curve(log.t, log.tau_ff[:, joint], "feedforward", "c2"))
    return panel(f"{name}: command", _time(log), Axis(f"command ({log.command_unit})"), marks, size=SIZE)


def _curve(t: Array, values: Array, label: str, style: str) -> Line:
    x, y = thinned(t, values, points=500)
    return Line(x, y, label, style)


def _time(log: RobotLog) -> Axis:
    return Axis("time (s)", limits=(float(log.t[0]), float(log.t[-1])))
