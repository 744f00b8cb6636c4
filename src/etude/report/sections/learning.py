"""The learning curve: error against robot time, beside the baselines."""

from __future__ import annotations

import numpy as np

from etude.report.markup import (
    Html,
    baseline,
    element,
    error_axis,
    grid,
    missing_data,
    paragraph,
    section,
    table,
    test_title,
    unit_sign,
)
from etude.report.record import (
    Evaluation,
    Record,
    Test,
    chosen_structure,
    held_out,
    score,
    scored_structures,
    structure_name,
    tests,
)
from etude.report.scales import Axis
from etude.report.svg import Level, Line, Mark, panel

JOINT_STYLES = ("c1", "c2", "c3", "c4", "c5", "c6", "c7", "c8")


TEXT = (
    "Mean tracking error on motions that are never used for training, after each trajectory, compared "
    "with baselines without learning. “PD alone” and “PID alone” have no feedforward. “Identified "
    "physics” feeds forward an identified model; a “perfect model” has the exact inverse dynamics: its "
    "remaining error comes from noise, delay and stiction. “Analytic” plans with an analytic vehicle "
    "model, without drag or with the exact linear drag, which is known only in simulations. “Learning on "
    "line” is the learned model that continues to learn during the test."
)


def joint_style(index: int) -> str:
    """Colour of a joint, and a dash from the ninth on."""
    return JOINT_STYLES[index % len(JOINT_STYLES)] + (" dash" if index >= len(JOINT_STYLES) else "")


def learning(record: Record) -> Html:
    """Tracking error when the robot is simulated; held-out nMSE per joint when it is real."""
    title = "Learning curve"
    evaluated = [test for test in tests(record) if test.learned or test.baselines]
    if evaluated:
        return section("learning", title, *_simulated(evaluated, record.names))
    structures = scored_structures(record)
    parts = _blocks(record)
    if any(
        score(r.trained, structure, "nmse") is not None
        for r in record.state.trained
        for structure in structures
    ):
        parts = _prequential(record, record.outputs) + parts
    nothing = missing_data("No evaluation yet: there is neither a simulated test nor a held-out score.")
    return section("learning", title, *(parts or [nothing]))


def _simulated(evaluated: list[Test], names: tuple[str, ...]) -> list[Html]:
    learned = [test for test in evaluated if test.learned]
    panels = [*map(learning_panel, evaluated), *(_joints_of(test, names) for test in learned)]
    text = paragraph(TEXT)
    return [text, grid(panels), *(_table_of(test, names) for test in learned)]


def curve_marks(test: Test) -> list[Mark]:
    """The learned controller's curve and one line or level per baseline."""
    marks: list[Mark] = []
    for name, series in test.baselines.items():
        label, style = baseline(name).name, baseline(name).style
        if len(series) > 1:
            marks.append(_line(series, label, style + " dash"))
        else:
            marks.append(Level(series[0].mean, label, style + " dash"))
    if test.learned:
        marks.append(_line(test.learned, "learned by Étude", "c1 thick"))
    return marks


def _line(series: tuple[Evaluation, ...], label: str, style: str) -> Line:
    x, y = (np.array([getattr(e, a) for e in series], dtype=float) for a in ("seconds", "mean"))
    return Line(x, y, label, style, markers=True)


def learning_panel(test: Test) -> Html:
    """The mean error over robot time on one test motion, names at the ends of the lines."""
    title = f"Mean tracking error on {test_title(test.name)}"
    axes = Axis("robot time (s)", floor=0.0), Axis(error_axis(test.unit), log=True)
    return panel(title, *axes, curve_marks(test), end_labels=True)


def _labels(test: Test, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of an error's parts: the joints', or a vehicle's axes."""
    count = len(test.learned[-1].parts)
    return names if len(names) == count else tuple(f"axis {j + 1}" for j in range(count))


def _joints_of(test: Test, names: tuple[str, ...]) -> Html:
    seconds = np.array([e.seconds for e in test.learned])
    errors = np.array([e.parts for e in test.learned]).T
    marks = [
        Line(seconds, error, label, joint_style(j), markers=True)
        for j, (error, label) in enumerate(zip(errors, _labels(test, names), strict=True))
    ]
    axes = Axis("robot time (s)", floor=0.0), Axis(error_axis(test.unit), log=True)
    return panel(f"The same for each coordinate, {test_title(test.name)}", *axes, marks)


def _table_of(test: Test, names: tuple[str, ...]) -> Html:
    rows = [
        [baseline(name).name, series[-1].mean, *map(float, series[-1].parts)]
        for name, series in test.baselines.items()
    ]
    rows += [[f"learned, after round {e.number}", e.mean, *map(float, e.parts)] for e in test.learned]
    whole = len(test.learned[-1].parts) < len(test.learned[-1].error)
    unit, first = unit_sign(test.unit), "distance" if whole else "mean"
    header = ["controller", *(f"{name} ({unit})" for name in (first, *_labels(test, names)))]
    title = f"All numbers on {test_title(test.name)}"
    return element("details", element("summary", title), table(header, rows, highlight=len(rows) - 1))


def _blocks(record: Record) -> list[Html]:
    """Scores on held-out blocks of the newest log that has them, beside linear regression."""
    scored = [r for r in record.state.trained if held_out(r.trained)]
    if not scored:
        return []
    scores = held_out(scored[-1].trained)
    blocks = scored[-1].trained.held_out if scored[-1].trained else None
    assert blocks is not None
    text = paragraph(
        f"Log {scored[-1].number} was cut into {blocks.of} blocks; models trained on the other blocks "
        "were scored on the held-out ones. nMSE is the mean squared error over the command's variance: 0 "
        "is perfect, 1 is no better than the mean. Errors on other motions may be many times as large."
    )
    rows = [
        [structure_name(structure), float(np.nanmean(v)), *map(float, v)] for structure, v in scores.items()
    ]
    chosen = list(scores).index(blocks.chosen) if blocks.chosen in scores else None
    return [text, table(["model", "mean", *record.outputs], rows, highlight=chosen)]


def _prequential(record: Record, names: tuple[str, ...]) -> list[Html]:
    text = paragraph(
        "This robot has no simulated test, so each model is scored on each new log before training on it "
        "(nMSE: mean squared error over the command's variance; 1 is no better than the mean). GP is the "
        "Gaussian process."
    )
    panels = [_joint_scores(record, j, name) for j, name in enumerate(names)]
    last = record.state.trained[-1].trained
    structures = [k for k in scored_structures(record) if score(last, k, "nmse") is not None]
    rows = [[structure_name(k), *map(float, score(last, k, "nmse"))] for k in structures]  # type: ignore[arg-type]
    chosen = chosen_structure(last)
    marked = structures.index(chosen) if chosen in structures else None
    return [
        text,
        grid(panels),
        paragraph("nMSE on the newest held-out data:"),
        table(["model", *names], rows, highlight=marked),
    ]


def _joint_scores(record: Record, joint: int, name: str) -> Html:
    marks: list[Mark] = []
    for index, structure in enumerate(scored_structures(record)):
        points = [
            (r.number, s[joint])
            for r in record.state.trained
            if (s := score(r.trained, structure, "nmse")) is not None
        ]
        if points:
            x, y = np.array(points, dtype=float).T
            style = "c5 dash" if structure == "linear" else joint_style((0, 2, 3, 5)[index % 4])
            marks.append(Line(x, y, structure_name(structure), style, markers=True))
    last = float(record.state.trained[-1].number)
    axes = Axis("round", limits=(0.5, last + 0.5), whole=True), Axis("held-out nMSE (1)", log=True)
    return panel(name, *axes, marks, size=(560, 300))
