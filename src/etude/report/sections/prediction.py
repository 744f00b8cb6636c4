"""The newest log's commands beside what the model had predicted before it learned from that log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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
        "should hold 95 % of the measured commands. Where a joint stands still friction makes its command "
        "arbitrary, so nothing is learned or predicted there."
    )
    names, unit = record.names, record.spec.command_unit
    panels = [command_panel(data, mean, variance, j, (name, unit)) for j, name in enumerate(names)]
    return section("prediction", title, text, grid(panels))


def command_panel(data: Dataset, mean: Array, variance: Array, joint: int, names: tuple[str, str]) -> Html:
    """Measured and predicted command of one joint over time, smoothed alike; `names` are joint and unit."""
    half = Z95 * np.sqrt(np.maximum(variance[:, joint], 0.0))
    moving = _moving(data.stuck[:, joint])
    return band_panel(
        data.t,
        data.tau[:, joint],
        mean[:, joint],
        half,
        *names,
        moving=moving,
        label="predicted while moving",
    )


def band_panel(
    t: Array,
    measured: Array,
    expected: Array,
    half: Array,
    name: str,
    unit: str,
    *,
    moving: Sequence[slice] = (slice(None),),
    label: str = "predicted",
) -> Html:
    """Measured and predicted command (T,) with a band of half width `half`, in the stretches `moving`."""
    areas: list[Mark] = []
    lines: list[Mark] = [Line(*thinned(t, measured, 600), "measured", "c8")]
    for piece in moving:
        low, high = (thinned(t[piece], (expected + sign * half)[piece], 300) for sign in (-1.0, 1.0))
        areas.append(Area(*low, *high, "" if areas else "95 % interval"))
        line = thinned(t[piece], expected[piece], 400)
        lines.append(Line(*line, label if len(lines) == 1 else "", "c2 dash"))
    axes = Axis("time (s)", limits=(float(t[0]), float(t[-1]))), Axis(f"command ({unit})")
    return panel(name, *axes, [*areas, *lines], size=(560, 260))


def _moving(stuck: NDArray[np.bool_]) -> list[slice]:
    """Stretches of at least three samples in which the joint moves."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], stuck, [True]]).astype(int)))
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [slice(int(start), int(stop)) for start, stop in pairs if stop - start >= 3]
