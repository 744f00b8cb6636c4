"""The pictures of a figure or table: a dot for every row, curves, motions over time; each joint by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from etude.report import Html, element, grid, join, missing_data
from etude_studies.site.claim_words import COUNTED
from etude_studies.site.context import Study
from etude_studies.site.curve_plot import Curve, curve_plot, letter
from etude_studies.site.dot_plot import Dot, Rule, dot_plot
from etude_studies.site.marks import Style, figure, legend, style_of
from etude_studies.site.numbers import Summary, counts, printed, summary
from etude_studies.site.page import folded
from etude_studies.site.traces import (
    joined_plot,
    kernel_names,
    kernel_plot,
    names,
    path_plot,
    trace_plot,
    traces,
)
from etude_studies.site.words import axis_label, column_name, entry_name, line_name
from etude_studies.thesis.ledger import Entry

KERNEL = "figure-2.3"
DRAWN_POINTS = {"m10": "(a) 10 spectral points", "m50": "(b) 50 spectral points"}
INCOMPARABLE = ("PWM2",)
"""Units in which the thesis's numbers are of another scale: printed in tables, and not drawn."""


def pictures(study: Study, entry: Entry) -> Html:
    """What is seen first."""
    if entry.kind == "trace":
        return _traces(study, entry)
    drawn = [_kernel(study)] if entry.id == KERNEL else []
    columns = ["mean"] if "mean" in entry.columns else _few(entry)
    if entry.kind != "curve":
        drawn += [_dots(study, entry, column) for column in columns] or [_all_dots(study, entry)]
    drawn += [_curves(study, entry, column) for column in columns]
    plots = [plot for plot in drawn if plot]
    if not plots:
        return missing_data("There is nothing to draw yet.")
    return join([grid(plots), _legend(study, entry)])


def joints(study: Study, entry: Entry) -> Html:
    """The same for each joint or command, folded."""
    if entry.kind == "trace" or "mean" not in entry.columns or len(entry.columns) == 1:
        return Html("")
    draw = _dots if entry.kind != "curve" else _curves
    plots = [draw(study, entry, column) for column in entry.columns if column != "mean"]
    shown = [plot for plot in plots if plot]
    return folded("Each joint", grid(shown), _legend(study, entry)) if shown else Html("")


def _few(entry: Entry) -> Sequence[str]:
    """Columns drawn by themselves where there is no mean: inputs of a kernel are too many."""
    return entry.columns if len(entry.columns) <= 4 else ()


def _dots(study: Study, entry: Entry, column: str) -> Html:
    """Rows of one column."""
    dots = _rows(study, entry, column)
    if all(dot.result is None and dot.printed is None for dot in dots):
        return Html("")
    title = f"{entry_name(entry.id)}, {column_name(column)}"
    rules = _rules(study, entry, column)
    drawn = dot_plot(title, dots, rules, axis=axis_label(entry.measure, entry.unit), log=_log(entry))
    return figure(f"dots {column}", drawn, _caption(entry, column))


def _all_dots(study: Study, entry: Entry) -> Html:
    """Rows of every column, one below the other."""
    dots = [
        replace(dot, name=column_name(column) if place == 0 else "")
        for column in entry.columns
        for place, dot in enumerate(_rows(study, entry, column))
    ]
    if all(dot.result is None and dot.printed is None for dot in dots):
        return Html("")
    title, axis = f"{entry_name(entry.id)}, all columns", axis_label(entry.measure, entry.unit)
    return figure(
        "dots all", dot_plot(title, dots, axis=axis, log=_log(entry), dense=True), _caption(entry, "")
    )


def _log(entry: Entry) -> bool | None:
    """Lengths span decades; other numbers decide by themselves."""
    return True if entry.in_logs else None


def _rows(study: Study, entry: Entry, column: str) -> list[Dot]:
    values = [study.numbers.cell(entry, row.run, column, counts(entry, row)[-1]) for row in entry.rows]
    return [
        Dot(
            row.label,
            summary(by_seed, logs=entry.in_logs),
            printed(entry, row).get(column) if entry.unit not in INCOMPARABLE else None,
            style_of(place),
            asked=len(by_seed),
        )
        for place, (row, by_seed) in enumerate(zip(entry.rows, values, strict=True))
    ]


def _caption(entry: Entry, column: str) -> str:
    k = entry.at[-1]
    counted = COUNTED.get(entry.rows[0].run[0], "trajectories")
    where = {"mean": "mean of the joints", "": "all columns"}.get(column, column_name(column))
    after = f"After {k} {counted}, {where}" if k else f"Column {where}"
    mean = "geometric mean" if entry.in_logs else "mean"
    return f"{after}; bars are 95 % intervals of the {mean} over seeds."


def _rules(study: Study, entry: Entry, column: str) -> list[Rule]:
    results = [(line, study.numbers.summary(entry, line, column, entry.at[-1])) for line in entry.lines]
    return [Rule(line_name(line, study.what), value.mean) for line, value in results if value]


def _curves(study: Study, entry: Entry, column: str) -> Html:
    """Rows over k; those of a table over all counts that are there."""
    curves = [
        Curve(row.label, results, style_of(place), printed_by_k)
        for place, row in enumerate(entry.rows)
        if (results := _summaries(study, entry, row.run, column, counts(entry, row)))
        for printed_by_k in [_printed_by_k(study, entry, row.run, column)]
    ]
    if not curves:
        return Html("")
    last = max(k for curve in curves for k in curve.results)
    others = _others(study, entry, column, last)
    counted = COUNTED.get(entry.rows[0].run[0], "trajectories")
    title = "" if column == "mean" else column_name(column)
    wide = last > 30
    drawn = curve_plot(
        title or f"{entry_name(entry.id)}, mean",
        curves,
        others,
        x=f"{counted} learned" if not wide else counted,
        y=axis_label(entry.measure, entry.unit),
        log_x=wide,
    )
    return figure(f"curves {column}", drawn, "Bands are 95 % intervals of the mean over seeds.")


def _others(study: Study, entry: Entry, column: str, last: int) -> list[tuple[str, Mapping[int, Summary]]]:
    """Lines to compare with, up to the last count of the rows."""
    curves = ((line_name(s, study.what), _summaries(study, entry, s, column, entry.at)) for s in entry.lines)
    return [(name, {k: result for k, result in by.items() if k <= last}) for name, by in curves if by]


def _summaries(
    study: Study, entry: Entry, source: str, column: str, at: tuple[int, ...]
) -> Mapping[int, Summary]:
    if entry.kind == "table":
        at = tuple(range(1, max(at) + 1))
    return study.numbers.curve(entry, source, column, at)


def _printed_by_k(study: Study, entry: Entry, run: str, column: str) -> dict[int, float]:
    """Printed numbers of the same run in tables of the same section and measure, by k."""
    alike = [e for e in study.ledger.entries if (e.section, e.measure) == (entry.section, entry.measure)]
    if entry.unit in INCOMPARABLE or (entry.kind == "curve" and entry.in_logs):
        return {}
    return {
        counts(other, row)[-1]: numbers[column]
        for other in alike
        for row in other.rows
        if row.run == run and column in (numbers := printed(other, row))
    }


def _legend(study: Study, entry: Entry) -> Html:
    series = [(row.label, style_of(place)) for place, row in enumerate(entry.rows)]
    has_printed = entry.unit not in INCOMPARABLE and any(
        _printed_by_k(study, entry, row.run, column) for row in entry.rows for column in entry.columns
    )
    column = "mean" if "mean" in entry.columns else entry.columns[0]
    lines = [
        (letter(place), name) for place, (name, _) in enumerate(_others(study, entry, column, entry.at[-1]))
    ]
    return legend(series, printed=has_printed, lines=lines)


def _traces(study: Study, entry: Entry) -> Html:
    """Every row of every joint or command, as far as motions were kept; angles of all rows together."""
    if entry.measure == "angle" and len(entry.rows) > 1 and (joined := _joined(study, entry)):
        return joined
    drawn = [_path(study, entry)] if entry.measure == "position" else []
    shown: dict[str, Style] = {}
    for row in entry.rows:
        for column in entry.columns:
            recorded = traces(study.numbers, entry, row, column)
            if recorded:
                shown |= dict(names(recorded))
                title = f"{row.label}: {column_name(column)}"
                plot = trace_plot(title, recorded, axis_label(entry.measure, entry.unit))
                drawn.append(figure(f"trace {row.run} {column}", plot))
    if not shown:
        runs = ", ".join(f"{row.run}t" for row in entry.rows)
        return missing_data(f"No motions over time are kept yet; they come from {runs}.")
    return join([grid(filter(None, drawn)), legend(list(shown.items()))])


def _joined(study: Study, entry: Entry) -> Html | None:
    """A drawing for each joint with the rows side by side in it; None unless all rows were kept."""
    styles = [style_of(place) for place, _ in enumerate(entry.rows)]
    drawn = []
    for column in entry.columns:
        rows = [traces(study.numbers, entry, row, column) for row in entry.rows]
        if not all(rows):
            return None
        plot = joined_plot(column_name(column), rows, styles, axis_label(entry.measure, entry.unit))
        drawn.append(figure(f"trace {column}", plot))
    labels = [(row.label, style) for row, style in zip(entry.rows, styles, strict=True)]
    return join([grid(drawn), legend([*names({"q_des": rows[0]["q_des"]}), *labels])])


def _path(study: Study, entry: Entry) -> Html:
    """The flight of the first row from above."""
    x, y = (traces(study.numbers, entry, entry.rows[0], column) for column in ("x", "y"))
    return figure("path", path_plot("the path, seen from above", x, y, entry.unit)) if x and y else Html("")


def _kernel(study: Study) -> Html:
    plots = [(title, kernel_plot(title, study.numbers, model)) for model, title in DRAWN_POINTS.items()]
    drawn = [figure(f"kernel {title}", plot) for title, plot in plots if plot is not None]
    if not drawn:
        return Html("")
    return element("div", join(drawn), legend(list(kernel_names())))
