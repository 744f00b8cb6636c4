"""Path of the robot in its workspace, coloured by predicted deviation, and from two sides."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from etude.errors import EtudeError
from etude.report.markup import (
    Html,
    grid,
    join,
    missing_data,
    paragraph,
    section,
    test_title,
    text,
    with_unit,
)
from etude.report.png import VIRIDIS, colour_bar
from etude.report.record import Record, tests
from etude.report.scales import Axis
from etude.report.scene import Path, SceneBox, room_of, scene
from etude.report.sections.prediction import ExpectedError, expected_error
from etude.report.svg import Line, Mark, panel
from etude.types import Array, Log

NEWEST = 8
"""More training motions than these are not drawn: a page is read, not searched."""
TITLE = "Measured paths, and the model's uncertainty along them"


@dataclass(frozen=True)
class DrawnMotion:
    """One motion to draw: its path, and what a model that had not learned it said; None before any model."""

    title: str
    path: Path
    errors: ExpectedError | None


SIZE = (400, 320)  # px
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
    planes = [view for view in VIEWS if view[1] in record.names]
    drawn = [_view(record.path.name, runs, view, equal=view[1] == "y") for view in planes]
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


def paths(record: Record) -> Html:
    """A drawing per training motion, and one of the newest test, in colours of predicted deviation."""
    if not through_space(record) or len(record.names) != 3:
        return join([])
    try:
        motions = [*_trained(record), *_tested(record)]
    except EtudeError as error:
        return section("paths", TITLE, missing_data(f"The deviations could not be predicted: {error}"))
    if not motions:
        return section("paths", TITLE, missing_data("No log with positions was ingested yet."))
    left_out = len(record.state.trained) - NEWEST
    omitted = [missing_data(f"The first {left_out} motions are not drawn.")] if left_out > 0 else []
    room = room_of(record.limits, [motion.path for motion in motions])
    return section(
        "paths", TITLE, paragraph(_text(record)), *omitted, grid(_scenes(record, motions, room), 3)
    )


def _text(record: Record) -> str:
    unit = f", {record.unit}" if record.unit not in ("", "1") else ""
    return (
        "Each path in the robot's room, with its shadow on the floor and a stem every 5 s; the ring is "
        f"its start. Colour is the deviation (mean over the commands{unit}) that the model predicted for "
        "this motion before training on it: dark where it is small, bright where new data helped most. "
        "All drawings share one logarithmic scale."
    )


def _trained(record: Record) -> list[DrawnMotion]:
    """Training motions; each in the colours of the model learned before it."""
    assert record.path is not None
    motions = []
    for before, now in list(pairwise([None, *record.state.trained]))[-NEWEST:]:
        assert now is not None  # only the first `before` is
        log = record.log(now.number)
        places = log.get(record.path.name) if log else None
        if log is None or places is None:
            continue
        model = record.model(before.number) if before else None
        errors = expected_error(record, model, log) if model else None
        motions.append(DrawnMotion(f"Motion {now.number}", Path(log.t, places), errors))
    return motions


def _tested(record: Record) -> list[DrawnMotion]:
    """The newest run of the first test with what was learned, in the colours of the model in use then."""
    assert record.path is not None
    for test in tests(record)[:1]:
        run = record.test_run("", test.name)
        places = run[1].get(record.path.name) if run else None
        if run is None or places is None:
            continue
        event, log = run
        model = record.model(event.number or 0)
        errors = expected_error(record, model, log) if model else None
        title = f"{test_title(test.name).capitalize()}, after round {event.number}"
        return [DrawnMotion(title, Path(log.t, places), errors)]
    return []


def _scenes(record: Record, motions: list[DrawnMotion], room: SceneBox) -> list[Html]:
    spreads = [gone.errors.spread for gone in motions if gone.errors is not None]
    values = np.concatenate(spreads) if spreads else np.ones(1)
    ends = float(values.min()), float(values.max())
    return [_scene(gone, room, ends, record.unit or "1") for gone in motions]


def _scene(gone: DrawnMotion, room: SceneBox, ends: tuple[float, float], unit: str) -> Html:
    errors = gone.errors
    if errors is None or errors.path is None:
        return scene(gone.title, room, [gone.path], note="no model at the time of the run")
    drawing = scene(gone.title, room, [Path(errors.t, errors.path, shades(errors.spread, ends))])
    mean = f"mean {with_unit(float(errors.spread.mean()), unit, 2)}"
    caption = f'<text class="tick" x="388" y="36" text-anchor="end">{text(mean)}</text>'
    return Html(drawing.replace("</svg>", caption + colour_bar(*ends, unit, VIRIDIS) + "</svg>"))


def shades(spread: Array, ends: tuple[float, float]) -> Array:
    """Place of each deviation between the ends, in [0, 1], logarithmic: a few motions span a decade."""
    low, high = np.log(np.maximum(ends, np.finfo(float).tiny))
    place = (np.log(np.maximum(spread, np.finfo(float).tiny)) - low) / ((high - low) or 1.0)
    return np.asarray(np.clip(place, 0.0, 1.0))
