"""Scores of the models: errors on unseen logs, calibration, and deviation over position and velocity of
each coordinate.
"""

from __future__ import annotations

import itertools

import numpy as np

from etude.campaign.record.events import Trained
from etude.campaign.record.state import Round
from etude.errors import EtudeError
from etude.limits.motion_limits import AxisLimit
from etude.models.learned_model import LearnedModel
from etude.protocols import Model
from etude.report.markup import Html, element, grid, join, missing_data, paragraph, section, table
from etude.report.png import colour_bar, colours, png_address
from etude.report.record import Quantity, Record, chosen_structure, score, scored_structures, structure_name
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style
from etude.report.sections.paths import through_space
from etude.report.svg import Band, Image, Level, Line, Mark, Points, panel
from etude.types import Array, Motion

Series = dict[str, dict[int, Array | None]]
"""By structure of model and number of the log."""


def selection(record: Record) -> Html:
    """Scores of every structure on the newest held-out data, the chosen one in bold."""
    title = "Model selection"
    scored = [r for r in record.state.trained if r.trained and r.trained.models]
    if not scored:
        return section("selection", title, missing_data("No model has been scored yet."))
    return section("selection", title, *_newest(record, scored[-1]), *_by_round(record))


def _newest(record: Record, last: Round) -> list[Html]:
    chosen = chosen_structure(last.trained)
    structures = [
        structure
        for structure in scored_structures(record)
        if score(last.trained, structure, "nmse") is not None
    ]
    rows = [[structure_name(structure), *_structure(last.trained, structure)] for structure in structures]
    names = (f"nMSE {name}" for name in record.outputs)
    header = ["model", "nMSE, mean", *names, "nMSE with joints at rest, mean", "z², mean", "coverage, mean"]
    text = paragraph(
        f"Scored on log {last.number} before training on it. nMSE is the mean squared error divided by "
        "the variance of the command, while its joint moves, and in another column while any joint "
        "moves; lower is better; GP is the Gaussian process. In use now: ",
        element("b", structure_name(chosen)),
        ".",
    )
    return [text, table(header, rows, structures.index(chosen) if chosen in structures else None)]


Z2 = (0.5, 2.5)
"""Band of z² that is good enough."""
COVERAGE = 0.85
"""Least coverage that is good enough."""
UNCALIBRATED = (
    "too few logs were held out to estimate the error on a new one. The model in use is therefore used "
    "only near its training inputs; its deviations are not used."
)


def calibration(record: Record) -> Html:
    """z² and coverage of the model in use after each round, per output, with the band that is good enough."""
    title = "Held-out calibration"
    if not any(score_in_use(r.trained, "z2") is not None for r in record.state.trained):
        nothing = missing_data("No held-out score yet: it comes with the second log.")
        newest = _uncalibrated(record) if record.state.trained else []
        return section("calibration", title, *newest, nothing)
    text = paragraph(
        "The model in use predicts each new log before training on it. z² is the mean squared error "
        "divided by the predicted variance: 1 is calibrated, above is overconfident, below is too "
        "cautious. Coverage is the fraction of the commands inside the predicted 95 % interval. The "
        "bands show acceptable values."
    )
    sentences = [text, *_uncalibrated(record), paragraph(_verdict(record)), *_early(record)]
    return section("calibration", title, *sentences, grid(_panels(record)))


def _uncalibrated(record: Record) -> list[Html]:
    """A model that says itself that too few logs were held out."""
    if record.state.newest is None or record.state.newest.calibrated:
        return []
    return [paragraph(element("b", "Uncalibrated:"), f" {UNCALIBRATED}", class_="missing")]


QUANTITIES: tuple[Quantity, ...] = ("z2", "coverage")


def _panels(record: Record) -> list[Html]:
    z2, cover = (_lines(record, quantity) for quantity in QUANTITIES)
    highest = 1.5 * np.nanmax([10.0 / 1.5, *(value for line in z2 for value in line.y)])
    lowest = np.nanmin([0.5, *(value for line in cover for value in line.y)])
    rounds = Axis("round", limits=(0.5, len(record.state.trained) + 0.5), whole=True)
    target: Mark = Band(*Z2, "target")
    good: Mark = Band(COVERAGE, 1.0, "target")
    z2_axis = Axis("z² (1)", log=True, limits=(0.1, float(highest)))
    cover_axis = Axis("coverage (1)", limits=(float(lowest), 1.0))
    ideal, nominal = Level(1.0, "honest", style="limit"), Level(0.95, "nominal", style="limit")
    return [
        panel("z² on held-out data", rounds, z2_axis, [target, ideal, *z2]),
        panel("Coverage of the 95 % interval", rounds, cover_axis, [good, nominal, *cover]),
    ]


def _early(record: Record) -> list[Html]:
    """Which of the scores are those of models that did not claim to be calibrated."""
    pairs = itertools.pairwise(record.state.trained)
    early = [now.number for before, now in pairs if before.trained and not before.trained.calibrated]
    if not early:
        return []
    logs = f"log {early[0]}" if len(early) == 1 else f"logs {', '.join(map(str, early))}"
    return [paragraph(f"The models that predicted {logs} were not calibrated yet.", class_="soft")]


def score_in_use(trained: Trained | None, quantity: Quantity) -> Array | None:
    """The score of the model in use when the log came, or of the nearest structure that has one."""
    structures = [*trained.models, trained.chosen, trained.predicted_by] if trained else []
    scores = (score(trained, structure, quantity) for structure in reversed(structures) if structure)
    return next((value for value in scores if value is not None), None)


def _lines(record: Record, quantity: Quantity) -> list[Line]:
    scored = [
        (index, values)
        for index, r in enumerate(record.state.trained, start=1)
        if (values := score_in_use(r.trained, quantity)) is not None
    ]
    x = np.array([index for index, _ in scored], dtype=float)
    columns = np.array([values for _, values in scored]).T
    return [
        Line(x, column, name, joint_style(j), markers=True)
        for j, (column, name) in enumerate(zip(columns, _names(record, len(columns)), strict=True))
    ]


def _names(record: Record, count: int) -> tuple[str, ...]:
    named = record.outputs
    return named if len(named) == count else tuple(f"command {j + 1}" for j in range(count))


def _verdict(record: Record) -> str:
    last = record.state.trained[-1].trained
    z2, cover = score_in_use(last, "z2"), score_in_use(last, "coverage")
    if z2 is None or cover is None:
        return "The newest model has no held-out score."
    names, (least, most) = _names(record, len(z2)), Z2
    outside = [
        name
        for name, v, c in zip(names, z2, cover, strict=False)
        if not (least <= v <= most and c >= COVERAGE)
    ]
    if not outside:
        return "On the newest held-out data every command is inside both bands: the deviations are reliable."
    listed = ", ".join(outside)
    return (
        f"On the newest held-out data these commands are outside a band: {listed}. Their deviations "
        "are less reliable."
    )


def _by_round(record: Record) -> list[Html]:
    """Every structure of model over the rounds; rings are around the structures in use."""
    text = paragraph(
        "Left: every model on each new log before training on it; the ring marks the model in use at "
        "that time. Right: cross-validation error of every model over all ingested logs. From two logs "
        "on, the least error selects the model in use (ring); before, only physics are compared."
    )
    rounds, unit = record.state.trained, record.unit or "1"
    predicted = {
        structure: {r.number: score(r.trained, structure, "nmse") for r in rounds}
        for structure in scored_structures(record)
    }
    used = {r.number: score_in_use(r.trained, "nmse") for r in rounds}
    left = {
        structure: {r.number: cross_validation_errors(r.trained).get(structure) for r in rounds}
        for structure in predicted
    }
    chosen = {
        r.number: cross_validation_errors(r.trained).get(chosen_structure(r.trained) or "") for r in rounds
    }
    panels = [
        _structures(record, "On each new log", "nMSE, mean over commands (1)", predicted, used),
        _structures(record, "Cross-validation on ingested logs", f"mean error ({unit})", left, chosen),
    ]
    return [text, grid(panels)]


def cross_validation_errors(trained: Trained | None) -> dict[str, Array]:
    """(1,) mean absolute error of each structure on logs left out, command units."""
    errors = trained.held_out_mae if trained else {}
    return {
        structure: np.array([float(e)]) for structure, e in errors.items() if e is not None and np.isfinite(e)
    }


def _structures(
    record: Record, title: str, axis: str, values: Series, ringed: dict[int, Array | None]
) -> Html:
    marks: list[Mark] = []
    for index, (structure, scores) in enumerate(values.items()):
        x, y = _means(scores)
        style = "c7 dash" if structure == "linear" else joint_style(index)
        marks += [Line(x, y, structure_name(structure), style, markers=True)] if len(x) else []
    marks.append(Points(*_means(ringed), label="in use", style="ring", radius=8.0))
    logs = Axis("log", limits=(0.5, max(r.number for r in record.state.trained) + 0.5), whole=True)
    return panel(title, logs, Axis(axis, log=True), marks)


def _means(scores: dict[int, Array | None]) -> tuple[Array, Array]:
    """Numbers of the logs with a score, and its mean over the outputs."""
    means = {number: float(np.nanmean(values)) for number, values in scores.items() if values is not None}
    return np.array(list(means), dtype=float), np.array(list(means.values()))


def _structure(trained: Trained | None, structure: str) -> list[object]:
    def mean(quantity: Quantity) -> float:
        values = score(trained, structure, quantity)
        return float("nan") if values is None else float(np.nanmean(values))

    nmse = score(trained, structure, "nmse")
    return [
        mean("nmse"),
        *(map(float, nmse) if nmse is not None else ()),
        mean("nmse_all"),
        mean("z2"),
        mean("coverage"),
    ]


TITLE = "Where the model is uncertain"
GRID = 44  # cells each way: 1,936 predictions a joint
POINTS = 250  # of the logs on a map, spread over them


def uncertainty(record: Record) -> Html:
    """One map per joint, with the learned data on it. A path through space is drawn in its room instead."""
    if through_space(record) and len(record.names) == 3:
        return join([])
    trained = [r.number for r in record.state.trained]
    models = [model for n in trained[-1:] if (model := record.model(n)) is not None]
    if not models:
        return section(
            "uncertainty", TITLE, missing_data("There is no trained model that can be loaded yet.")
        )
    data = _learned_motion(record)
    if data is None:
        nothing = missing_data("No log can be read, so there are no data to show.")
        return section("uncertainty", TITLE, nothing)
    try:
        ranges = _ranges(record, data)
        maps = deviation_maps(models[0], data, ranges)
    except EtudeError as error:
        return section("uncertainty", TITLE, missing_data(f"The model could not be evaluated: {error}"))
    count = min(len(maps), len(record.outputs))
    panels = [map_panel(record, j, maps[j], data, ranges) for j in range(count)]
    return section("uncertainty", TITLE, paragraph(_text(record)), grid(panels, 4))


def _text(record: Record) -> str:
    unit = f" in {record.unit}" if record.unit not in ("", "1") else ""
    return (
        f"Colour is the predicted standard deviation of a joint's command{unit}: dark where it is small, "
        "bright where new data would help most, with a separate scale for each joint. White dots are the "
        "training data. The other joints are at rest at the median of the data, so a dot may lie on a "
        "bright patch if its other joints were elsewhere."
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
        one = model.of_command(j) if isinstance(model, LearnedModel) else model
        _, variance = one.posterior(one.inputs.states(Motion(np.arange(GRID * GRID, dtype=float), orders)))
        maps.append(np.sqrt(np.maximum(variance[:, j], 0.0)).reshape(GRID, GRID))
    return maps


def _centres(ends: Array) -> Array:
    return np.asarray(ends[0] + (np.arange(GRID) + 0.5) / GRID * (ends[1] - ends[0]))


def _ranges(record: Record, data: tuple[Array, Array]) -> tuple[Array, Array]:
    """(2, k) ends of positions and of velocities: of the limits, or of the data where there are none."""
    ranges = [np.stack([part.min(axis=0), part.max(axis=0)]) for part in data]
    for limit in record.limits:
        if not isinstance(limit, AxisLimit) or limit.order > 1:
            continue
        low, high = np.asarray(limit.lower), np.asarray(limit.upper)
        if low.shape == high.shape == (len(record.names),):
            ranges[limit.order] = np.stack([low, high]).astype(float)
    return ranges[0], ranges[1]


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
