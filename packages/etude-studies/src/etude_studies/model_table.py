"""The members of the model family side by side: which figures there are, and their table for people."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from etude_studies.rows import Row, table


@dataclass(frozen=True)
class Figure:
    """One column of the table.

    Attributes:
        metric: name of the row, with {} for the model.
        heading: of the column. unit: of the row.
        interval: whether the table shows it; the rows always do.
    """

    metric: str
    heading: str
    unit: str
    interval: bool = False


FIGURES = {
    "nmse": Figure("nmse_{}_arm4", "nMSE", "1", interval=True),
    "msll": Figure("msll_{}_arm4", "MSLL", "nat", interval=True),
    "z2": Figure("z2_{}_arm4", "z²", "1", interval=True),
    "fit_s": Figure("fit_s_{}", "fit, s", "s"),
    "predict_1_us": Figure("predict_1_us_{}", "1 pt, µs", "us"),
    "predict_600_ms": Figure("predict_600_ms_{}", "600 pts, ms", "ms"),
    "memory_mb": Figure("memory_mb_{}", "MB", "MB"),
}


def show(rows: Sequence[Row], title: str) -> None:
    """Print one table of the models, a row for each, and one of all other rows."""
    values = {row.metric: row.value for row in rows}
    models = [name for row in rows if (name := _model_of(row.metric))]
    metrics = {
        name + end
        for model in models
        for name in (figure.metric.format(model) for figure in FIGURES.values())
        for end in ("", "_ci95")
    }
    if models:
        _print(values, models, title)
    others = [row for row in rows if row.metric not in metrics]
    if others:
        table(others, title)


def cells(values: dict[str, float], model: str) -> list[str]:
    """The model's figures in the order of `FIGURES`; a dash for what was not measured."""
    return [_cell(values, figure, model) for figure in FIGURES.values()]


def _model_of(metric: str) -> str | None:
    """The model that the first figure's row is about, None for any other row."""
    head, tail = FIGURES["nmse"].metric.split("{}")
    match = re.fullmatch(f"{head}(.+){tail}", metric)
    return match[1] if match else None


def _cell(values: dict[str, float], figure: Figure, model: str) -> str:
    metric = figure.metric.format(model)
    value, half = values.get(metric, float("nan")), values.get(f"{metric}_ci95")
    if value != value:
        return "–"
    shown = f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"
    return f"{shown} ±{half:.2g}" if figure.interval and half is not None else shown


def _print(values: dict[str, float], models: Sequence[str], title: str) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    # no figure may be cut off on 80 columns: intervals below their means, headings on two lines
    shown = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    shown.add_column("model", no_wrap=True)
    for figure in FIGURES.values():
        shown.add_column(figure.heading.replace(", ", ",\n"), justify="right", no_wrap=True)
    for model in models:
        shown.add_row(model, *(cell.replace(" ±", "\n±") for cell in cells(values, model)))
    Console().print(shown)
