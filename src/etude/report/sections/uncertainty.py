"""Where the model is uncertain: its predicted deviation over position and velocity of each joint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.errors import EtudeError
from etude.report.colour_bar import colour_bar
from etude.report.markup import Html, grid, missing, paragraph, section
from etude.report.png import colours, png_address
from etude.report.record import Record
from etude.report.scales import Axis
from etude.report.svg import Image, Mark, Points, panel
from etude.robots.spec import RobotSpec

if TYPE_CHECKING:
    from etude.models.inverse_dynamics import InverseDynamicsModel

Array = NDArray[np.float64]

GRID = 44
POINTS = 250


def uncertainty(record: Record) -> Html:
    """One map per joint, with the learned data on it."""
    title = "Where the model is uncertain"
    trained = [r.number for r in record.state.trained]
    found = [(n, model) for n in trained[-1:] if (model := record.model(n)) is not None]
    if not found or record.spec is None:
        return section("uncertainty", title, missing("There is no trained model that can be loaded yet."))
    data = _learned_motion(record)
    if data is None:
        return section(
            "uncertainty", title, missing("No log can be read, so there is no data to show it around.")
        )
    try:
        maps = deviation_maps(found[0][1], record.spec, data)
    except EtudeError as error:
        return section("uncertainty", title, missing(f"The model could not be evaluated: {error}"))
    return section("uncertainty", title, *_content(maps, record.spec, data), *_remark(found[0][1]))


def _remark(model: InverseDynamicsModel) -> list[Html]:
    if model.kind != "identified":
        return []
    sentence = (
        "The model in use is the identified rigid body, which states one deviation for all motions; "
        "drawn is what a Gaussian process on its error does not know yet, which is what the next "
        "trajectory is designed for."
    )
    return [missing(sentence)]


def deviation_maps(model: InverseDynamicsModel, spec: RobotSpec, data: tuple[Array, Array]) -> list[Array]:
    """Predicted standard deviation of each joint's command, one (GRID, GRID) per joint: rows qd, columns q.

    All other joints rest at the median of the data's positions; accelerations are zero.
    """
    middle = np.median(data[0], axis=0)
    maps = []
    for joint in range(spec.dof):
        q = np.tile(middle, (GRID * GRID, 1))
        qd = np.zeros_like(q)
        across, up = np.meshgrid(*_ranges(spec, joint))
        q[:, joint], qd[:, joint] = across.ravel(), up.ravel()
        variance = _variance(model, joint, q, qd)
        maps.append(np.sqrt(np.maximum(variance, 0.0)).reshape(GRID, GRID))
    return maps


def _variance(model: InverseDynamicsModel, joint: int, q: Array, qd: Array) -> Array:
    """Predicted variance of one command; of the process alone if the model in use has none that varies."""
    if model.kind == "identified":
        X = model.features.transform(q, qd, np.zeros_like(q))
        return model.posteriors[joint].predict(X)[1]
    return model.predict(q, qd, np.zeros_like(q))[1][:, joint]


def _ranges(spec: RobotSpec, joint: int) -> tuple[Array, Array]:
    """Cell centres of position and velocity over the whole range of the joint."""
    centres = (np.arange(GRID) + 0.5) / GRID
    position = spec.lower[joint] + centres * (spec.upper[joint] - spec.lower[joint])
    return position, spec.velocity[joint] * (2.0 * centres - 1.0)


def _learned_motion(record: Record) -> tuple[Array, Array] | None:
    """Positions and velocities (n, dof) of all learned logs, some hundred of them evenly over time."""
    logs = [log for r in record.state.trained if (log := record.log(r.number)) is not None]
    if not logs:
        return None
    each = max(20, POINTS // len(logs))
    q, qd = [], []
    for log in logs:
        inside = np.flatnonzero(log.t >= 0.0)
        index = inside[np.linspace(0, len(inside) - 1, min(each, len(inside))).astype(int)]
        position = log.q if log.q_des is None else log.q_des
        given = log.qd if log.qd is not None else log.qd_des
        speed = given if given is not None else np.gradient(position, log.t, axis=0)
        q.append(log.q[index])
        qd.append(speed[index])
    return np.concatenate(q), np.concatenate(qd)


def _content(maps: list[Array], spec: RobotSpec, data: tuple[Array, Array]) -> list[Html]:
    unit = spec.command_unit
    text = paragraph(
        f"Colour is the predicted standard deviation of a joint's command in {unit}: dark where the model is "
        "sure, bright where it would still learn most, on a scale of each joint's own. White dots "
        "are the data learned so far. The other joints stand still at the median of the data, so a "
        "dot may lie on a bright patch: its other joints were elsewhere."
    )
    panels = [map_panel(maps[j], spec, j, data) for j in range(spec.dof)]
    return [text, grid(panels, 4)]


def map_panel(values: Array, spec: RobotSpec, joint: int, data: tuple[Array, Array]) -> Html:
    """One joint's deviations (GRID, GRID) in colour, with the data on them and a colour bar."""
    low, high = float(values.min()), float(values.max())
    span = high - low or 1.0
    picture = png_address(colours((values[::-1] - low) / span))
    axis = spec.axes[joint]
    x_limits, y_limits = (axis.lower, axis.upper), (-axis.velocity, axis.velocity)
    marks: list[Mark] = [
        Image(picture, *x_limits, *y_limits),
        Points(data[0][:, joint], data[1][:, joint], style="data", radius=2.2),
    ]
    axes = Axis("position (rad)", limits=x_limits), Axis("velocity (rad/s)", limits=y_limits)
    drawing = panel(axis.name, *axes, marks, size=(285, 280), header=20)
    return Html(drawing.replace("</svg>", colour_bar(low, high, spec.command_unit) + "</svg>"))
