"""A path through space seen from two sides, desired and actual; nothing for robots of joints."""

from __future__ import annotations

import numpy as np

from etude.report.markup import Html, grid
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.svg import Line, Mark, panel
from etude.types import Array, Log

SIZE = (400, 320)
DRAWING = (324.0, 226.0)
"""Width and height of the axes of a panel of `SIZE` with one row of legend, px."""
VIEWS = (("x", "y", "From above"), ("x", "z", "From the side"))


def through_space(record: Record) -> bool:
    """Whether the path is one of a point: its coordinates are metres along x, y and perhaps z."""
    return record.names[:2] == ("x", "y") and set(record.path.units if record.path else ()) == {"m"}


def views(record: Record, log: Log, alone: Log | None) -> list[Html]:
    """The path of a run with a desired one, and of the same motion under feedback alone."""
    if not through_space(record) or record.path is None or f"{record.path.name}_des" not in log:
        return []
    runs = [(log, "with feedforward" if alone else "measured", "c1 thick")]
    if alone is not None:
        runs.insert(0, (alone, "feedback alone", "c2"))
    known = [view for view in VIEWS if view[1] in record.names]
    drawn = [_view(record.path.name, runs, view, equal=view[1] == "y") for view in known]
    return [grid(drawn, 2)]


def _view(path: str, runs: list[tuple[Log, str, str]], view: tuple[str, str, str], *, equal: bool) -> Html:
    """The paths seen along one axis; desired last, on top."""
    i, j = ("xyz".index(name) for name in view[:2])
    marks: list[Mark] = [
        Line(log[path][:, i], log[path][:, j], label, style) for log, label, style in runs if path in log
    ]
    desired = runs[0][0][f"{path}_des"]
    marks.append(Line(desired[:, i], desired[:, j], "desired", "c8 dash"))
    across, up = (np.concatenate([mark.extent()[k] for mark in marks]) for k in (0, 1))
    limits = equal_limits(across, up) if equal else (None, None)
    x_axis, y_axis = Axis(f"{view[0]} (m)", limits=limits[0]), Axis(f"{view[1]} (m)", limits=limits[1])
    return panel(f"{view[2]}: {view[0]} and {view[1]}", x_axis, y_axis, marks, size=SIZE)


def equal_limits(x: Array, y: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits around the points with as many px per m along both axes of a panel of `SIZE`."""
    middles = [0.5 * (float(np.nanmin(v)) + float(np.nanmax(v))) for v in (x, y)]
    spans = [float(np.nanmax(v) - np.nanmin(v)) for v in (x, y)]
    per_px = max(span / px for span, px in zip(spans, DRAWING, strict=True)) * 1.06 or 1e-3
    (left, right), (low, high) = (
        (middle - 0.5 * per_px * px, middle + 0.5 * per_px * px)
        for middle, px in zip(middles, DRAWING, strict=True)
    )
    return (left, right), (low, high)
