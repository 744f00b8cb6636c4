"""Where the model is uncertain: its predicted deviation over position and velocity of each coordinate."""

from __future__ import annotations

import numpy as np

from etude.errors import EtudeError
from etude.limits.convex_limits import AxisLimit
from etude.protocols import Model
from etude.report.markup import Html, grid, join, missing, paragraph, section
from etude.report.png import colour_bar, colours, png_address
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.sections.paths import through_space
from etude.report.svg import Image, Mark, Points, panel
from etude.types import Array, Motion

TITLE = "Where the model is uncertain"
GRID = 44  # cells each way: 1,936 predictions a joint
POINTS = 250  # of the logs on a map, spread over them


def uncertainty(record: Record) -> Html:
    """One map per joint, with the learned data on it. A path through space is drawn in its room instead."""
    if through_space(record) and len(record.names) == 3:
        return join([])
    trained = [r.number for r in record.state.trained]
    found = [model for n in trained[-1:] if (model := record.model(n)) is not None]
    if not found:
        return section("uncertainty", TITLE, missing("There is no trained model that can be loaded yet."))
    data = _learned_motion(record)
    if data is None:
        nothing = missing("No log can be read, so there is no data to show it around.")
        return section("uncertainty", TITLE, nothing)
    try:
        ranges = _ranges(record, data)
        maps = deviation_maps(found[0], data, ranges)
    except EtudeError as error:
        return section("uncertainty", TITLE, missing(f"The model could not be evaluated: {error}"))
    count = min(len(maps), len(record.outputs))
    panels = [map_panel(record, j, maps[j], data, ranges) for j in range(count)]
    return section("uncertainty", TITLE, paragraph(_text(record)), grid(panels, 4))


def _text(record: Record) -> str:
    unit = f" in {record.unit}" if record.unit not in ("", "1") else ""
    return (
        f"Colour is the predicted standard deviation of a joint's command{unit}: dark where the model is "
        "sure, bright where it would still learn most, on a scale of each joint's own. White dots "
        "are the data learned so far. The other joints stand still at the median of the data, so a "
        "dot may lie on a bright patch: its other joints were elsewhere."
    )


def deviation_maps(model: Model, data: tuple[Array, Array], ranges: tuple[Array, Array]) -> list[Array]:
    """Predicted deviation of each coordinate's command, (GRID, GRID) each: rows velocity, columns position.

    All other coordinates rest at the median of the data's positions; accelerations are zero.
    """
    middle, maps = np.median(data[0], axis=0), []
    for j in range(len(middle)):
        orders = np.zeros((max(model.inputs.orders, 2), GRID * GRID, len(middle)))
        orders[0] = middle
        across, up = np.meshgrid(_centres(ranges[0][:, j]), _centres(ranges[1][:, j]))
        orders[0, :, j], orders[1, :, j] = across.ravel(), up.ravel()
        _, variance = model.posterior(
            model.inputs.states(Motion(np.arange(GRID * GRID, dtype=float), orders))
        )
        maps.append(np.sqrt(np.maximum(variance[:, j], 0.0)).reshape(GRID, GRID))
    return maps


def _centres(ends: Array) -> Array:
    return np.asarray(ends[0] + (np.arange(GRID) + 0.5) / GRID * (ends[1] - ends[0]))


def _ranges(record: Record, data: tuple[Array, Array]) -> tuple[Array, Array]:
    """(2, k) ends of positions and of velocities: of the limits, or of the data where there are none."""
    found = [np.stack([part.min(axis=0), part.max(axis=0)]) for part in data]
    for limit in record.limits:
        if not isinstance(limit, AxisLimit) or limit.order > 1:
            continue
        low, high = np.asarray(limit.lower), np.asarray(limit.upper)
        if low.shape == high.shape == (len(record.names),):
            found[limit.order] = np.stack([low, high]).astype(float)
    return found[0], found[1]


def _learned_motion(record: Record) -> tuple[Array, Array] | None:
    """Positions and velocities (n, k) of all learned logs, some hundred of them evenly over time."""
    assert record.path is not None
    name = record.path.name
    logs = [log for r in record.state.trained if (log := record.log(r.number)) is not None and name in log]
    if not logs:
        return None
    each = max(20, POINTS // len(logs))
    places, speeds = [], []
    for log in logs:
        inside = np.flatnonzero(log.t >= 0.0)
        index = inside[np.linspace(0, len(inside) - 1, min(each, len(inside))).astype(int)]
        smooth = log.get(f"{name}_des")
        speed = np.gradient(log[name] if smooth is None else smooth, log.t, axis=0)
        places.append(log[name][index])
        speeds.append(speed[index])
    return np.concatenate(places), np.concatenate(speeds)


def map_panel(
    record: Record, j: int, values: Array, data: tuple[Array, Array], ranges: tuple[Array, Array]
) -> Html:
    """One coordinate's deviations (GRID, GRID) in colour, with the data on them and a colour bar."""
    low, high = float(values.min()), float(values.max())
    picture = png_address(colours((values[::-1] - low) / (high - low or 1.0)))
    x_limits, y_limits = ((float(r[0, j]), float(r[1, j])) for r in ranges)
    marks: list[Mark] = [
        Image(picture, *x_limits, *y_limits),
        Points(data[0][:, j], data[1][:, j], style="data", radius=2.2),
    ]
    unit = record.path.units[j] if record.path else "1"
    axes = Axis(f"position ({unit})", limits=x_limits), Axis(f"velocity ({unit}/s)", limits=y_limits)
    drawing = panel(record.names[j], *axes, marks, size=(285, 280), header=20)
    return Html(drawing.replace("</svg>", colour_bar(low, high, record.units[j]) + "</svg>"))
