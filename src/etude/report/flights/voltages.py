"""The four commands of a flight beside what the model says of them, with the 95 % band."""

from __future__ import annotations

import numpy as np

from etude.errors import EtudeError
from etude.models.calibration import NORMAL_95
from etude.report.curves import tests
from etude.report.flights.files import (
    Forecast,
    flight_model,
    flight_spec,
    forecast,
    tested_flight,
    told_flight,
)
from etude.report.markup import Html, grid, missing, number, paragraph, section, with_unit
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.sections.prediction import band_panel
from etude.report.svg import Area, Level, Line, Mark, panel, thinned
from etude.report.words import test_name

TITLE = "Predicted against measured commands"


def voltages(record: Record) -> Html:
    """Two panels per command: measured and predicted, and their difference inside its band."""
    spec = flight_spec(record)
    try:
        found = _tested(record) or _newest(record)
    except EtudeError as error:
        return section("voltages", TITLE, missing(f"The prediction could not be made: {error}"))
    if found is None or spec is None:
        return section("voltages", TITLE, missing("This needs two flights: one to learn, one to predict."))
    which, said = found
    inside = np.abs(said.command - said.mean) <= NORMAL_95 * said.deviation
    size = with_unit(float(np.abs(said.command - said.mean).mean()), spec.command_unit, 2)
    text = paragraph(
        f"{which} The band should hold 95 % of the measured commands; here it holds "
        f"{number(100.0 * float(inside.mean()))} %. On the right the same, less the prediction: the error is "
        f"{size} on average."
    )
    return section("voltages", TITLE, text, grid(_panels(said, spec.command_names, spec.command_unit)))


def _tested(record: Record) -> tuple[str, Forecast] | None:
    """The newest flight of the first test, by the model that it was flown with."""
    for test in tests(record)[:1]:
        run = tested_flight(record, test.name, None)
        model = flight_model(record, run[0].number or 0) if run else None
        if run is not None and model is not None:
            sentence = (
                f"The newest run of {test_name(test.name)}, after flight {run[0].number}, by the model "
                "in use then, which never learned from it."
            )
            return sentence, forecast(record, model, run[1])
    return None


def _newest(record: Record) -> tuple[str, Forecast] | None:
    """The newest log, by the model learned from those before it."""
    trained = record.state.trained
    if len(trained) < 2:
        return None
    model, log = flight_model(record, trained[-2].number), told_flight(record, trained[-1].number)
    if model is None or log is None:
        return None
    sentence = f"Log {trained[-1].number}, predicted by the model learned from the logs before it."
    return sentence, forecast(record, model, log)


def _panels(said: Forecast, names: tuple[str, ...], unit: str) -> list[Html]:
    panels = []
    for j, name in enumerate(names):
        measured, expected, half = said.command[:, j], said.mean[:, j], NORMAL_95 * said.deviation[:, j]
        panels.append(band_panel(said.t, measured, expected, half, name.replace("_", " "), unit))
        panels.append(_error(said.t, measured - expected, half, name.replace("_", " "), unit))
    return panels


def _error(t: np.ndarray, error: np.ndarray, half: np.ndarray, name: str, unit: str) -> Html:
    low, high = (thinned(t, sign * half, 300) for sign in (-1.0, 1.0))
    marks: list[Mark] = [
        Area(*low, *high, "95 % interval"),
        Level(0.0, style="axis-line"),
        Line(*thinned(t, error, 400), "measured − predicted", "c8"),
    ]
    axes = Axis("time (s)", limits=(float(t[0]), float(t[-1]))), Axis(f"error ({unit})")
    return panel(f"{name}: error of the prediction", *axes, marks, size=(560, 260))
