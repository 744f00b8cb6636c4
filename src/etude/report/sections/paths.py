"""Where the robot went through space, and where the model was unsure; nothing for robots of joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from etude.errors import EtudeError
from etude.report.colour_bar import colour_bar
from etude.report.curves import tests
from etude.report.forecasts import Forecast, forecast
from etude.report.markup import Html, grid, join, missing, paragraph, section, text, with_unit
from etude.report.png import VIRIDIS
from etude.report.record import Record
from etude.report.scene import Path, Room, room_of, scene
from etude.report.sections.views import through_space
from etude.report.words import test_title
from etude.types import Array

NEWEST = 8
"""More training motions than these are not drawn: a page is read, not searched."""
TITLE = "Where it went, and where the model was unsure"


@dataclass(frozen=True)
class Gone:
    """One motion to draw: its path, and what a model that had not learned it said; None before any model."""

    title: str
    path: Path
    said: Forecast | None


def paths(record: Record) -> Html:
    """A drawing per training motion, and one of the newest test, in colours of predicted deviation."""
    if not through_space(record) or len(record.names) != 3:
        return join([])
    try:
        motions = [*_trained(record), *_tested(record)]
    except EtudeError as error:
        return section("paths", TITLE, missing(f"The deviations could not be predicted: {error}"))
    if not motions:
        return section("paths", TITLE, missing("No log with positions has come back yet."))
    left_out = len(record.state.trained) - NEWEST
    omitted = [missing(f"The first {left_out} motions are not drawn.")] if left_out > 0 else []
    room = room_of(record.limits, [motion.path for motion in motions])
    return section(
        "paths", TITLE, paragraph(_text(record)), *omitted, grid(_scenes(record, motions, room), 3)
    )


def _text(record: Record) -> str:
    unit = f", {record.unit}" if record.unit not in ("", "1") else ""
    return (
        "Each path in the robot's room, with its shadow on the floor and a stem every 5 s; the ring is its "
        f"start. Colour is the deviation (mean over the commands{unit}) that the model "
        "predicted for this motion before it had learned from it: dark where it was sure, bright where it "
        "had most to learn. All drawings share one logarithmic scale."
    )


def _trained(record: Record) -> list[Gone]:
    """Training motions; each in the colours of the model learned before it."""
    assert record.path is not None
    found = []
    for before, now in list(pairwise([None, *record.state.trained]))[-NEWEST:]:
        assert now is not None  # only the first `before` is
        log = record.log(now.number)
        places = log.get(record.path.name) if log else None
        if log is None or places is None:
            continue
        model = record.model(before.number) if before else None
        said = forecast(record, model, log) if model else None
        found.append(Gone(f"Motion {now.number}", Path(log.t, places), said))
    return found


def _tested(record: Record) -> list[Gone]:
    """The newest run of the first test with what was learned, in the colours of the model in use then."""
    assert record.path is not None
    for test in tests(record)[:1]:
        run = record.test_run(None, test.name)
        places = run[1].get(record.path.name) if run else None
        if run is None or places is None:
            continue
        event, log = run
        model = record.model(event.number or 0)
        said = forecast(record, model, log) if model else None
        title = f"{test_title(test.name).capitalize()}, after round {event.number}"
        return [Gone(title, Path(log.t, places), said)]
    return []


def _scenes(record: Record, motions: list[Gone], room: Room) -> list[Html]:
    spreads = [gone.said.spread for gone in motions if gone.said is not None]
    values = np.concatenate(spreads) if spreads else np.ones(1)
    ends = float(values.min()), float(values.max())
    return [_scene(gone, room, ends, record.unit or "1") for gone in motions]


def _scene(gone: Gone, room: Room, ends: tuple[float, float], unit: str) -> Html:
    said = gone.said
    if said is None or said.path is None:
        return scene(gone.title, room, [gone.path], note="no model yet when it was run")
    drawing = scene(gone.title, room, [Path(said.t, said.path, shades(said.spread, ends))])
    mean = f"mean {with_unit(float(said.spread.mean()), unit, 2)}"
    words = f'<text class="tick" x="388" y="36" text-anchor="end">{text(mean)}</text>'
    return Html(drawing.replace("</svg>", words + colour_bar(*ends, unit, VIRIDIS) + "</svg>"))


def shades(spread: Array, ends: tuple[float, float]) -> Array:
    """Place of each deviation between the ends, in [0, 1], logarithmic: a few motions span a decade."""
    low, high = np.log(np.maximum(ends, np.finfo(float).tiny))
    place = (np.log(np.maximum(spread, np.finfo(float).tiny)) - low) / ((high - low) or 1.0)
    return np.asarray(np.clip(place, 0.0, 1.0))
