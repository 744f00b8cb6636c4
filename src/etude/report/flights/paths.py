"""Where the vehicle flew, and where the model was unsure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from etude.errors import EtudeError
from etude.report.colour_bar import colour_bar
from etude.report.curves import tests
from etude.report.flights.files import (
    Forecast,
    flight_model,
    flight_spec,
    forecast,
    tested_flight,
    told_flight,
)
from etude.report.flights.scene import Path, scene
from etude.report.markup import Html, grid, missing, paragraph, section, text, with_unit
from etude.report.png import VIRIDIS
from etude.report.record import Record
from etude.report.words import test_title
from etude.robots.flight_spec import FlightSpec

Array = NDArray[np.float64]

NEWEST = 8
"""More training flights than these are not drawn: a page is read, not searched."""
TITLE = "Where it flew, and where the model was unsure"


@dataclass(frozen=True)
class Flown:
    """One flight to draw: its path, and what a model that had not learned it said; None before any model."""

    title: str
    path: Path
    said: Forecast | None


def paths(record: Record) -> Html:
    """A drawing per training flight, and one of the newest test flight, in colours of predicted deviation."""
    spec = flight_spec(record)
    if spec is None:
        return section("paths", TITLE, missing("The vehicle's file cannot be read; its room is unknown."))
    try:
        flights = [*_trained(record), *_tested(record)]
    except EtudeError as error:
        return section("paths", TITLE, missing(f"The deviations could not be predicted: {error}"))
    if not flights:
        return section("paths", TITLE, missing("No flight with positions has come back yet."))
    left_out = len(record.state.trained) - NEWEST
    omitted = [missing(f"The first {left_out} flights are not drawn.")] if left_out > 0 else []
    return section("paths", TITLE, paragraph(_text(spec)), *omitted, grid(_scenes(flights, spec), 3))


def _text(spec: FlightSpec) -> str:
    unit = "" if spec.command_unit == "1" else f", {spec.command_unit}"
    return (
        "Each path in the vehicle's room, with its shadow on the floor and a stem every 5 s; the ring is its "
        f"start. Colour is the deviation (mean over the four commands{unit}) that the model "
        "predicted for this flight before it had learned from it: dark where it was sure, bright where it "
        "had most to learn. All drawings share one logarithmic scale."
    )


def _trained(record: Record) -> list[Flown]:
    """Training flights; each in the colours of the model learned before it."""
    rounds = record.state.trained
    found = []
    for before, now in list(pairwise([None, *rounds]))[-NEWEST:]:
        assert now is not None  # only the first `before` is
        log = told_flight(record, now.number)
        if log is None or log.position is None:
            continue
        model = flight_model(record, before.number) if before else None
        said = forecast(record, model, log) if model else None
        found.append(Flown(f"Flight {now.number}, PID alone", Path(log.t, log.position), said))
    return found


def _tested(record: Record) -> list[Flown]:
    """The newest flight of the first test with what was learned, in the colours of the model in use then."""
    for test in tests(record)[:1]:
        run = tested_flight(record, test.name, None)
        if run is None or run[1].position is None:
            continue
        event, log = run
        model = flight_model(record, event.number or 0)
        said = forecast(record, model, log) if model else None
        title = f"{test_title(test.name).capitalize()}, after flight {event.number}"
        return [Flown(title, Path(log.t, run[1].position), said)]
    return []


def _scenes(flights: list[Flown], spec: FlightSpec) -> list[Html]:
    spreads = [flown.said.spread for flown in flights if flown.said is not None]
    values = np.concatenate(spreads) if spreads else np.ones(1)
    ends = float(values.min()), float(values.max())
    return [_scene(flown, spec, ends) for flown in flights]


def _scene(flown: Flown, spec: FlightSpec, ends: tuple[float, float]) -> Html:
    said, unit = flown.said, spec.command_unit
    if said is None or said.position is None:
        return scene(flown.title, spec, [flown.path], note="no model yet when it was flown")
    drawing = scene(flown.title, spec, [Path(said.t, said.position, shades(said.spread, ends))])
    mean = f"mean {with_unit(float(said.spread.mean()), unit, 2)}"
    words = f'<text class="tick" x="388" y="36" text-anchor="end">{text(mean)}</text>'
    return Html(drawing.replace("</svg>", words + colour_bar(*ends, unit, VIRIDIS) + "</svg>"))


def shades(spread: Array, ends: tuple[float, float]) -> Array:
    """Place of each deviation between the ends, in [0, 1], logarithmic: a few flights span a decade."""
    low, high = np.log(np.maximum(ends, np.finfo(float).tiny))
    place = (np.log(np.maximum(spread, np.finfo(float).tiny)) - low) / ((high - low) or 1.0)
    return np.asarray(np.clip(place, 0.0, 1.0))
