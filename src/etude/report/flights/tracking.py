"""Tracking before and after: the same test flights under PID alone and with what was learned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.logs.flight.log import FlightLog
from etude.report.curves import tests
from etude.report.flights.files import tested_flight, told_flight
from etude.report.markup import Html, element, grid, join, missing, paragraph, section
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.svg import Line, Mark, panel, thinned
from etude.report.words import ERROR_AXES, test_name

Array = NDArray[np.float64]

TITLE = "Tracking before and after"
SIZE = (400, 320)
DRAWING = (324.0, 226.0)
"""Width and height of the axes of a panel of `SIZE` with one row of legend, px."""
VIEWS = (("x", "y", "From above"), ("x", "z", "From the side"))
EXACT = "exact drag"
SHOWN = (("pid", "PID alone", "c2"), (None, "learned", "c1 thick"), ("exact_drag", EXACT, "c3 dash"))
"""Controller, its short name and its style; short, so that a legend fits one row."""


@dataclass(frozen=True)
class Run:
    """One flown test: its log, and how it is drawn."""

    log: FlightLog
    label: str
    style: str


def tracking(record: Record) -> Html:
    """Distance over time, and paths from two sides, for every test; of the newest log without a test."""
    names = [test.name for test in tests(record)]
    found = [(name, runs) for name in names if (runs := _runs(record, name))]
    if not found:
        return section("tracking", TITLE, *_newest(record))
    text = paragraph(
        "Each test flight under PID alone, with the analytic model that knows the exact drag, and with what "
        "was learned. The dashed line is the desired path; the side view has its own scale of height."
    )
    parts = [_test(name, runs) for name, runs in found]
    return section("tracking", TITLE, text, *parts)


def _runs(record: Record, test: str) -> list[Run]:
    """The runs of one test that have a desired and a measured position, in the order of drawing."""
    runs = []
    for baseline, label, style in SHOWN:
        found = tested_flight(record, test, baseline)
        if found is not None and _has_places(found[1]):
            runs.append(Run(found[1], label, style))
    return runs


def _has_places(log: FlightLog) -> bool:
    return log.position is not None and log.position_des is not None


def _test(name: str, runs: list[Run]) -> Html:
    heading = test_name(name)
    return join([element("h3", heading[:1].upper() + heading[1:]), grid(_panels(runs), 3)])


def _panels(runs: list[Run]) -> list[Html]:
    return [_distance(runs), _view(runs, VIEWS[0], equal=True), _view(runs, VIEWS[1], equal=False)]


def distance(log: FlightLog) -> Array:
    """(T,) m between desired and measured position."""
    assert log.position is not None
    assert log.position_des is not None
    return np.asarray(np.linalg.norm(log.position_des - log.position, axis=1))


def _distance(runs: list[Run]) -> Html:
    marks: list[Mark] = [
        Line(*thinned(run.log.t, distance(run.log), 400), run.label, run.style) for run in runs
    ]
    axes = Axis("time (s)", limits=(0.0, float(runs[0].log.t[-1]))), Axis(ERROR_AXES["m"], floor=0.0)
    return panel("Distance from the desired position", *axes, marks, size=SIZE)


def _view(runs: list[Run], view: tuple[str, str, str], *, equal: bool) -> Html:
    """The paths seen along one axis; desired last, on top."""
    i, j = ("xyz".index(name) for name in view[:2])
    marks: list[Mark] = []
    for run in runs:
        assert run.log.position is not None
        if run.label == EXACT:
            continue  # one curve more would hide the two that matter
        marks.append(Line(run.log.position[:, i], run.log.position[:, j], run.label, run.style))
    desired = runs[0].log.position_des
    assert desired is not None
    marks.append(Line(desired[:, i], desired[:, j], "desired", "c8 dash"))
    across, up = (np.concatenate([mark.extent()[k] for mark in marks]) for k in (0, 1))
    limits = equal_limits(across, up) if equal else (None, None)
    x_axis, y_axis = Axis(f"{view[0]} (m)", limits=limits[0]), Axis(f"{view[1]} (m)", limits=limits[1])
    return panel(f"{view[2]}: {view[0]} and {view[1]}", x_axis, y_axis, marks, size=SIZE)


def equal_limits(x: Array, y: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits around the points with as many px per m along both axes of a panel of `SIZE`."""
    middles = [0.5 * (float(np.nanmin(v)) + float(np.nanmax(v))) for v in (x, y)]
    per_px = max(float(np.ptp(v)) / px for v, px in zip((x, y), DRAWING, strict=True)) * 1.06 or 1e-3
    (left, right), (low, high) = (
        (middle - 0.5 * per_px * px, middle + 0.5 * per_px * px)
        for middle, px in zip(middles, DRAWING, strict=True)
    )
    return (left, right), (low, high)


def _newest(record: Record) -> list[Html]:
    """What a real vehicle has: its newest flight, without anything to hold it against."""
    nothing = missing("There is no test flight, which only a simulated vehicle has.")
    for entry in reversed(record.state.told):
        log = told_flight(record, entry.number)
        if log is None:
            continue
        if not _has_places(log):
            return [
                nothing,
                missing(f"Log {entry.number} has no desired position to hold the flight against."),
            ]
        return [
            nothing,
            paragraph(f"The newest log, number {entry.number}."),
            grid(_panels([Run(log, "flown", "c1")]), 3),
        ]
    return [missing("No flight that can be read has come back yet.")]
