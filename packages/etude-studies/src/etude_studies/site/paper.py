"""For print: tables as dots with intervals and curves with bands, as PDF and SVG; tables in LaTeX."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude_studies.collected import Results
from etude_studies.site.claim_words import COUNTED
from etude_studies.site.curve_plot import letter
from etude_studies.site.numbers import Numbers, Summary, counts, printed
from etude_studies.site.words import LINES, axis_label, column_name, line_name
from etude_studies.thesis.ledger import Entry, Ledger, Row
from etude_studies.thesis.presenting import cell

INCHES = (3.4, 2.9)
"""One column of a journal."""
APART = 0.045
"""Of the axis, between letters of lines to compare with."""
KINDS = ("pdf", "svg")
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS, DASHES = "os^P", ("-", "--", ":", "-.")
SETTINGS = {
    "font.size": 8,
    "svg.hashsalt": "etude",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
INCOMPARABLE = ("PWM2",)


def paper_figures(
    ledger: Ledger, results: Results, folder: Path, *, only: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Writes `<id>.pdf` and `<id>.svg` of every table and curve that has results, and returns the files.

    The same inputs give the same bytes: no date is written.

    Args:
        ledger: the entries. results: what was measured.
        folder: made if need be.
        only: ids of entries; all if empty.

    Raises:
        UsageError: matplotlib is not installed, or an id of `only` is none.
    """
    plt = pyplot()
    entries = [ledger.entry(id) for id in only] or list(ledger.entries)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for entry in entries:
        if entry.kind != "trace" and has_results(entry, results):
            with plt.rc_context(SETTINGS):
                written += _saved(plt, Numbers(results), entry, folder)
    return tuple(written)


def paper_tables(ledger: Ledger, results: Results, folder: Path) -> tuple[Path, ...]:
    """Writes `<id>.tex` of every table that has results, for the package booktabs; the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for entry in ledger.entries:
        if entry.kind == "table" and has_results(entry, results):
            path = folder / f"{entry.id}.tex"
            path.write_text("\n".join(_tex(entry, results)) + "\n", encoding="utf-8")
            written.append(path)
    return tuple(written)


def has_results(entry: Entry, results: Results) -> bool:
    """Whether any of its rows was run."""
    return any(row.run.partition(":")[0] in results.tables for row in entry.rows)


def cells(entry: Entry, results: Results) -> list[list[str]]:
    """Each row and line that has results: label, a text for each column, seeds."""
    rows = [*entry.rows, *(Row(line_name(line, {}), line) for line in entry.lines)]
    out = []
    for row in rows:
        row_cells = [
            cell(results, entry, row.run, column, counts(entry, row)[-1]) for column in entry.columns
        ]
        if any(item.asked for item in row_cells):
            out.append(
                [row.label, *(item.text for item in row_cells), str(max(item.asked for item in row_cells))]
            )
    return out


def caption(entry: Entry, results: Results) -> str:
    """What a table or a figure shows, of how many seeds, by which interval."""
    k = (
        f" after {entry.at[-1]}"
        if entry.kind == "table" and entry.at[-1] and "after" not in entry.title
        else ""
    )
    unit = f" ({entry.unit})" if entry.unit not in entry.title and entry.unit != "1" else ""
    mean = "geometric mean" if entry.in_logs else "mean"
    width = "half width of " if entry.kind == "table" and not entry.in_logs else ""
    n = sorted({len(results.seeds(row.run.partition(":")[0])) for row in entry.rows} - {0})
    seeds = f"{n[0]} to {n[-1]}" if len(n) > 1 else "".join(map(str, n))
    return (
        f"{entry.title}{unit}{k}: {mean} over {seeds} paired seeds and {width}its 95 % t interval. "
        "The thesis has one run of each row."
    )


def _tex(entry: Entry, results: Results) -> list[str]:
    rows = [
        " & ".join(tex(text).replace("±", r"$\pm$") for text in row) + r" \\" for row in cells(entry, results)
    ]
    caption_text = caption(entry, results)
    head = " & ".join(["", *(tex(column_name(column)) for column in entry.columns), "n"]) + r" \\"
    columns = "l" + "r" * (len(entry.columns) + 1)
    top = [r"\begin{table}", r"\centering", rf"\caption{{{tex(caption_text)}}}", rf"\label{{{entry.id}}}"]
    inside = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", head, r"\midrule", *rows, r"\bottomrule"]
    return [*top, *inside, r"\end{tabular}", r"\end{table}"]


def tex(source: str) -> str:
    """Words with LaTeX's own signs escaped."""
    return re.sub(r"([#$%&_{}])", r"\\\1", source)


def pyplot() -> Any:
    """matplotlib without a screen. UsageError: it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        step = "pip install 'matplotlib>=3.8'."
        raise UsageError("figures for print need matplotlib", next_step=step) from error
    matplotlib.use("Agg")
    from matplotlib import pyplot as own

    return own


def drawing_of(entry: Entry) -> Callable[[Any, Numbers, Entry], None]:
    """What draws it on axes of matplotlib."""
    return _curves if entry.kind == "curve" else _dots


def _saved(plt: Any, numbers: Numbers, entry: Entry, folder: Path) -> list[Path]:
    figure, axes = plt.subplots(figsize=INCHES, layout="constrained")
    drawing_of(entry)(axes, numbers, entry)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(
            loc="outside lower left", ncols=2, frameon=False, fontsize=6, handlelength=1.8, columnspacing=0.8
        )
    files = []
    for kind in KINDS:
        path = folder / f"{entry.id}.{kind}"
        dated = {"Date": None} if kind == "svg" else {"CreationDate": None}
        figure.savefig(path, metadata=dated)
        files.append(path)
    plt.close(figure)
    return files


def _column(entry: Entry) -> str:
    """The one that is drawn."""
    return "mean" if "mean" in entry.columns else entry.columns[0]


def _dots(axes: Any, numbers: Numbers, entry: Entry) -> None:
    """A row each, from the top; lines to compare with across all rows."""
    column = _column(entry)
    for place, row in enumerate(entry.rows):
        result = numbers.summary(entry, row.run, column, counts(entry, row)[-1])
        if result:
            axes.errorbar(
                result.mean, -place, xerr=_bars(result), fmt=MARKERS[place % 4], color=_colour(place)
            )
        printed_number = printed(entry, row).get(column)
        if printed_number is not None and entry.unit not in INCOMPARABLE:
            name = "the thesis, one run" if place == 0 else None
            axes.plot(printed_number, -place, "D", mfc="none", mec="black", ms=5, ls="", label=name)
    results = [(source, numbers.summary(entry, source, column, entry.at[-1])) for source in entry.lines]
    values = [(source, result.mean) for source, result in results if result]
    for place, (source, value) in enumerate(values):
        axes.axvline(value, color="0.6", lw=0.8, ls="--", label=_line(place, source))
    axes.set_yticks([-place for place in range(len(entry.rows))], [row.label for row in entry.rows])
    axes.set_ylim(-len(entry.rows) + 0.4, 0.6)
    axes.set_xlabel(_label(entry, column))
    low, high = axes.get_xlim()
    for sign, x in _spread([value for _, value in values], APART * (high - low)):
        axes.annotate(sign, (x, 1.02), xycoords=("data", "axes fraction"), ha="center", fontsize=6)


def _curves(axes: Any, numbers: Numbers, entry: Entry) -> None:
    """Means with bands; lines to compare with in grey."""
    column = _column(entry)
    for place, row in enumerate(entry.rows):
        results = numbers.curve(entry, row.run, column, counts(entry, row))
        if results:
            look = {"color": _colour(place), "marker": MARKERS[place % 4], "ls": DASHES[place % 4], "ms": 4}
            axes.plot(
                [*results], [result.mean for result in results.values()], label=row.label, lw=1.2, **look
            )
            low, high = (
                [result.low for result in results.values()],
                [result.high for result in results.values()],
            )
            axes.fill_between([*results], low, high, color=_colour(place), alpha=0.18, lw=0)
    lines = [(source, numbers.curve(entry, source, column, entry.at)) for source in entry.lines]
    lines = [(source, curve) for source, curve in lines if curve]
    for place, (source, curve) in enumerate(lines):
        means = [one.mean for one in curve.values()]
        axes.plot([*curve], means, color="0.6", lw=0.8, ls="--", label=_line(place, source))
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel(f"{COUNTED.get(entry.rows[0].run[0], 'trajectories')} learned")
    axes.set_ylabel(_label(entry, column))
    ends = [curve[max(curve)].mean for _, curve in lines]
    for sign, y in _spread(ends, APART * axes.get_ylim()[1]):
        axes.annotate(sign, (1.02, y), xycoords=("axes fraction", "data"), va="center", fontsize=6)


def _line(place: int, source: str) -> str:
    return f"{letter(place)}  {line_name(source, LINES)}"


def _spread(values: Sequence[float], apart: float) -> list[tuple[str, float]]:
    """A letter for each value, moved up where it would lie on the one before."""
    out, last = [], -math.inf
    for value, place in sorted((value, place) for place, value in enumerate(values)):
        last = max(value, last + apart)
        out.append((letter(place), last))
    return out


def _bars(result: Summary) -> list[list[float]]:
    return [[result.mean - result.low], [result.high - result.mean]]


def _colour(place: int) -> str:
    return PALETTE[place % len(PALETTE)]


def _label(entry: Entry, column: str) -> str:
    name = axis_label(entry.measure, entry.unit)
    return name if column == "mean" else f"{column_name(column)}: {name}"
