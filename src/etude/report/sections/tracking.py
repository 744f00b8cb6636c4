"""Tracking in the last run: desired and actual coordinates, the feedforward and the command."""

from __future__ import annotations

import numpy as np

from etude.report.markup import FEEDBACK, Html, grid, missing_data, paragraph, section, unit_sign
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.sections.paths import views
from etude.report.svg import Level, Line, Mark, panel, thinned
from etude.types import Array, Channel, Log

SIZE, WIDE = (380, 260), (560, 260)  # px
TITLE = "Desired against actual, feedforward against command"
TESTED = (
    "The last test run, after round {number}: a motion that is never used for training, under the "
    "robot's own feedback with the learned feedforward."
)


def tracking(record: Record) -> Html:
    """Panels per coordinate and command: of the last test run of what was learned, else of the newest log."""
    tested = record.test_run("")
    if tested is not None:
        heading, log = TESTED.format(number=tested[0].number), tested[1]
        runs = (record.test_run(name) for name in FEEDBACK)
        alone = next((run[1] for run in runs if run is not None), None)
    else:
        numbers = [n for n, r in sorted(record.state.rounds.items()) if r.ingested is not None]
        readable = (
            (n, readable_log) for n in reversed(numbers) if (readable_log := record.log(n)) is not None
        )
        newest, ingested_log = next(readable, (0, None))
        if ingested_log is None:
            return section("tracking", TITLE, missing_data("No readable log was ingested yet."))
        heading, log, alone = f"The newest log, number {newest}.", ingested_log, None
    run = TrackedRun(record, log, alone)
    text = paragraph(f"{heading} {run.reading()}")
    return section("tracking", TITLE, text, *run.absent(), *run.grids(), *views(record, log, alone))


class TrackedRun:
    """One log to draw, and the same motion under feedback alone, if there is one, behind its error."""

    def __init__(self, record: Record, log: Log, alone: Log | None) -> None:
        command = log.channels["command"]
        self.log, self.alone, self.channel = log, alone, record.path or _path_of(log)
        self.names, self.units = self.channel.parts, self.channel.units
        self.outputs, self.command_units = command.parts, command.units
        self.wanted = log.get(f"{self.channel.name}_des")
        self.true = f"{self.channel.name}_true"
        self.ahead = log.get("command_ff")
        self.size = SIZE if self.outputs == self.names else WIDE

    def reading(self) -> str:
        if self.wanted is None:
            return ""
        position = "noise-free position" if self.true in self.log else "measured position"
        sentence = f"Error is the desired position minus the {position}."
        if self.ahead is None or not self.ahead.any():
            return sentence
        return (
            f"{sentence} Where the feedforward agrees with the applied command, the model is accurate; "
            "the difference is the command of the feedback."
        )

    def absent(self) -> list[Html]:
        sentences = []
        if self.wanted is None:
            sentences.append("This log has no desired position, so there is no tracking error to show.")
        if self.ahead is None:
            sentences.append("This log has no separate feedforward; only the applied command is drawn.")
        elif not self.ahead.any():
            sentences.append(
                "This log was run without a feedforward, as training motions are; the next section shows "
                "the model's commands."
            )
        return [missing_data(sentence) for sentence in sentences]

    def grids(self) -> list[Html]:
        """A row for each joint; where commands are not the coordinates' own, in a grid of their own."""
        commands = [self.command(j) for j in range(self.log["command"].shape[1])]
        columns = 1 if self.wanted is None else 2
        if self.outputs != self.names:
            coordinates = [p for j in range(len(self.names)) for p in self.panels(j)]
            return [grid(coordinates, 3 if columns == 1 else 2), grid(commands, 3)]
        rows = [p for j, command in enumerate(commands) for p in (*self.panels(j), command)]
        return [grid(rows, columns + 1)]

    def panels(self, j: int) -> list[Html]:
        """Position and error of one coordinate; the error only if the desired position is known."""
        positions = self._positions(j)
        return [positions] if self.wanted is None else [positions, self._error(j)]

    def _positions(self, j: int) -> Html:
        places = self.log.get(self.channel.name)
        marks: list[Mark] = []
        if places is not None:
            marks.append(_curve(self.log.t, places[:, j], "measured", "c1"))
        if self.wanted is not None:
            marks.append(_curve(self.log.t, self.wanted[:, j], "desired", "c2 dash"))
        title = f"{self.names[j]}: position"
        return panel(title, _time(self.log), Axis(f"position ({self.units[j]})"), marks, size=self.size)

    def _error(self, j: int) -> Html:
        unit, factor = ("degrees", 180.0 / np.pi) if self.units[j] == "rad" else (self.units[j], 1.0)
        error = factor * deviation(self.log, self.channel.name)[:, j]
        marks: list[Mark] = [Level(0.0, style="axis-line")]
        if self.alone is not None and f"{self.channel.name}_des" in self.alone:
            behind = factor * deviation(self.alone, self.channel.name)[:, j]
            marks.append(_curve(self.alone.t, behind, "feedback alone", "c2 thin"))
        marks.append(_curve(self.log.t, error, "with feedforward" if len(marks) > 1 else "", "c1"))
        moving = self.log.t >= 0.0
        mean = float(np.nanmean(np.abs(error[moving]))) if moving.any() else float("nan")
        sign = "°" if unit == "degrees" else f" {unit_sign(unit)}"
        title = f"{self.names[j]}: tracking error, mean {mean:.3g}{sign}"
        return panel(title, _time(self.log), Axis(f"error ({unit})"), marks, size=self.size)

    def command(self, j: int) -> Html:
        """Applied command and feedforward of one output."""
        marks: list[Mark] = [_curve(self.log.t, self.log["command"][:, j], "applied", "c6 thin")]
        if self.ahead is not None and self.ahead.any():
            marks.append(_curve(self.log.t, self.ahead[:, j], "feedforward", "c2"))
        title = f"{self.outputs[j]}: command"
        return panel(title, _time(self.log), Axis(f"command ({self.command_units[j]})"), marks, size=SIZE)


def _path_of(log: Log) -> Channel:
    """The channel that has a desired one, where robot.toml cannot tell; else the first."""
    channels = list(log.channels.values())
    return next((c for c in channels if f"{c.name}_des" in log), channels[0])


def deviation(log: Log, path: str) -> Array:
    """(T, k) desired less actual path, of the true one where it is known."""
    true = log.get(f"{path}_true")
    return np.asarray(log[f"{path}_des"] - (log[path] if true is None else true))


def _curve(t: Array, values: Array, label: str, style: str) -> Line:
    x, y = thinned(t, values, points=500)
    return Line(x, y, label, style)


def _time(log: Log) -> Axis:
    return Axis("time (s)", limits=(float(log.t[0]), float(log.t[-1])))
