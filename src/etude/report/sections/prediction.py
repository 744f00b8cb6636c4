"""The newest log's commands beside what the model had predicted before it learned from that log."""

from __future__ import annotations

import numpy as np

from etude.campaign.config_file import load_config
from etude.errors import EtudeError
from etude.models.dataset import Dataset
from etude.models.preprocess import build_dataset
from etude.report.markup import Html, grid, missing, paragraph, section
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.svg import Area, Array, Line, Mark, panel, thinned

Z95 = 1.96
"""Half width of a normal distribution's 95 % interval, in deviations."""


def prediction(record: Record) -> Html:
    """One panel per joint: measured command, predicted mean and 95 % interval."""
    title = "Predicted against measured command"
    trained = record.state.trained
    if len(trained) < 2 or record.spec is None:
        return section("prediction", title, missing("This needs two logs: one to learn, one to predict."))
    model, log = record.model(trained[-2].number), record.log(trained[-1].number)
    if model is None or log is None:
        return section("prediction", title, missing("The newest log or the model before it cannot be read."))
    try:
        config, _ = load_config(record.folder)
        data = build_dataset(log, record.spec, config.data, group=trained[-1].number)
        mean, variance = model.predict(data.q, data.qd, data.qdd)
    except EtudeError as error:
        return section("prediction", title, missing(f"The prediction could not be made: {error}"))
    text = paragraph(
        f"Log {trained[-1].number}, predicted by the model learned from the logs before it. The band "
        "should hold 95 % of the measured commands; where the joint stands still, friction makes its "
        "command arbitrary."
    )
    names, unit = record.names, record.spec.command_unit
    panels = [command_panel(data, mean, variance, j, (name, unit)) for j, name in enumerate(names)]
    return section("prediction", title, text, grid(panels))


def command_panel(data: Dataset, mean: Array, variance: Array, joint: int, names: tuple[str, str]) -> Html:
    """Measured and predicted command of one joint over time, smoothed alike; `names` are joint and unit."""
    t, expected = data.t, mean[:, joint]
    half = Z95 * np.sqrt(np.maximum(variance[:, joint], 0.0))
    (tl, low), (th, high) = thinned(t, expected - half, 400), thinned(t, expected + half, 400)
    marks: list[Mark] = [
        Area(tl, low, th, high, "95 % interval"),
        Line(*thinned(t, data.tau[:, joint], 600), "measured", "c8"),
        Line(*thinned(t, expected, 600), "predicted", "c2 dash"),
    ]
    axes = Axis("time (s)", limits=(float(t[0]), float(t[-1]))), Axis(f"command ({names[1]})")
    return panel(names[0], *axes, marks, size=(560, 260))
