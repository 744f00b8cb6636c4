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
TESTED = (
    "The last test run, after round {number}: a motion that was never trained on, under PD with the learned "
    "feedforward."
)


def tracking(record: Record) -> Html:
    """Three panels per joint: of the last test run of the learned controller, else of the newest log."""
    title = "Desired against actual, feedforward against command"
    tested = record.test_log(None)
    if tested is not None:
        text, log, before = TESTED.format(number=tested[0].number), tested[1], record.test_log("pd")
    else:
        told = [n for n, r in sorted(record.state.rounds.items()) if r.told is not None]
        readable = ((n, found) for n in reversed(told) if (found := record.log(n)) is not None)
        newest, told_log = next(readable, (0, None))
        if told_log is None:
            return section("tracking", title, missing("No log that can be read has come back yet."))
        text, log, before = f"The newest log, number {newest}.", told_log, None
    alone = before[1] if before is not None else None
    columns = 3 if log.q_des is not None else 2
    panels = [p for joint in range(log.dof) for p in joint_panels(log, joint, alone)]
    return section(
        "tracking", title, paragraph(f"{text} {_reading(log)}"), *_absent(log), grid(panels, columns)
    )


def _reading(log: RobotLog) -> str:
    if log.q_des is None:
        return ""
    position = "noise-free position" if log.q_true is not None else "measured position"
    sentence = f"Error is the desired position minus the {position}."
    if log.tau_ff is None or not log.tau_ff.any():
        return sentence
    return (
        f"{sentence} Where the feedforward lies on the applied command, the model already knows what "
        "the motion needs; what is left between them is the feedback's work."
    )


def _absent(log: RobotLog) -> list[Html]:
    sentences = []
    if log.q_des is None:
        sentences.append("This log has no desired position, so there is no tracking error to show.")
    if log.tau_ff is None:
        sentences.append("This log has no separate feedforward; only the applied command is drawn.")
    elif not log.tau_ff.any():
        sentences.append(
            "This log was run without a feedforward, as training motions are; the next part shows "
            "what the model would have given."
        )
    return [missing(sentence) for sentence in sentences]


def joint_panels(log: RobotLog, joint: int, alone: RobotLog | None = None) -> list[Html]:
    """Position, error and command of one joint; the error only if the desired position is known.

    `alone` is the same motion under PD alone, drawn behind the error.
    """
    name = log.names[joint]
    panels = [_positions(log, joint, name)]
    if log.q_des is not None:
        panels.append(_error(log, joint, name, alone))
    panels.append(_commands(log, joint, name))
    return panels


def _positions(log: RobotLog, joint: int, name: str) -> Html:
    marks: list[Mark] = [_curve(log.t, log.q[:, joint], "measured", "c1")]
    if log.q_des is not None:
        marks.append(_curve(log.t, log.q_des[:, joint], "desired", "c2 dash"))
    return panel(f"{name}: position", _time(log), Axis("position (rad)"), marks, size=SIZE)


def _error(log: RobotLog, joint: int, name: str, alone: RobotLog | None) -> Html:
    error = _deviation(log, joint)
    marks: list[Mark] = [Level(0.0, style="axis-line")]
    if alone is not None and alone.q_des is not None:
        marks.append(_curve(alone.t, _deviation(alone, joint), "PD alone", "c2 thin"))
    marks.append(_curve(log.t, error, "with feedforward" if len(marks) > 1 else "", "c1"))
    moving = log.t >= 0.0
    mean = float(np.mean(np.abs(error[moving]))) if moving.any() else float("nan")
    title = f"{name}: tracking error, mean {mean:.3g}°"
    return panel(title, _time(log), Axis("error (degrees)"), marks, size=SIZE)


def _deviation(log: RobotLog, joint: int) -> Array:
    """Tracking error in degrees, of the true position where it is known."""
    assert log.q_des is not None
    actual = log.q if log.q_true is None else log.q_true
    return np.asarray(np.degrees(log.q_des[:, joint] - actual[:, joint]))


def _commands(log: RobotLog, joint: int, name: str) -> Html:
    marks: list[Mark] = [_curve(log.t, log.tau[:, joint], "applied", "c6 thin")]
    if log.tau_ff is not None and log.tau_ff.any():
        marks.append(_curve(log.t, log.tau_ff[:, joint], "feedforward", "c2"))
    return panel(f"{name}: command", _time(log), Axis(f"command ({log.command_unit})"), marks, size=SIZE)


def _curve(t: Array, values: Array, label: str, style: str) -> Line:
    x, y = thinned(t, values, points=500)
    return Line(x, y, label, style)


def _time(log: RobotLog) -> Axis:
    return Axis("time (s)", limits=(float(log.t[0]), float(log.t[-1])))
