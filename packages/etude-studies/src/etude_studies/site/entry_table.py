"""An entry in the thesis's own layout: printed numbers small and grey over ours with intervals."""

from __future__ import annotations

from collections.abc import Sequence

from etude.report import Html, element, join, number, paragraph, table
from etude_studies.method_comparison import compared_rows
from etude_studies.site.claim_words import estimate
from etude_studies.site.context import Study
from etude_studies.site.numbers import Summary, counts, printed
from etude_studies.site.page import file_of, link, word_chip
from etude_studies.site.words import column_name, line_name, once, plural
from etude_studies.thesis.ledger import Entry, Row
from etude_studies.thesis.part_verdicts import NOT_RUN

DECIMALS = 4
"""Of the thesis's printed numbers."""
WIDE = 8
"""Columns from which a table is set narrower."""


def table_of(study: Study, entry: Entry) -> Html:
    """Rows of the thesis, then lines to compare with and the default protocol, at the entry's last count."""
    columns = entry.columns
    head = element(
        "tr", _heading("", ""), *(_heading(column_name(c), c) for c in columns), _heading("seeds", "")
    )
    rows = [_row(study, entry, row) for row in entry.rows]
    beside = [_line(study, entry, source) for source in once((*entry.lines, *entry.beside))]
    parts = [element("thead", head), element("tbody", *rows)]
    if any(beside):
        title = element("th", "For comparison, on the same tests", colspan=len(columns) + 2, scope="rowgroup")
        parts.append(element("tbody", element("tr", title, class_="part"), *filter(None, beside)))
    kind = "values wide" if len(columns) > WIDE else "values"
    return element("div", element("table", *parts, class_=kind), class_="scroll")


def table_over_k(study: Study, entry: Entry, column: str) -> Html:
    """One column of a figure at every count."""
    at = sorted({k for row in entry.rows for k in counts(entry, row)})
    head = element("tr", _heading("", ""), *(_heading(str(k), str(k)) for k in at), _heading("seeds", ""))
    sources = [(row.label, row.run, counts(entry, row)) for row in entry.rows]
    sources += [(line_name(s, study.what), s, tuple(at)) for s in once((*entry.lines, *entry.beside))]
    rows = []
    for name, source, row_counts in sources:
        results = study.numbers.curve(entry, source, column, row_counts)
        if not results and (name, source, row_counts) not in sources[: len(entry.rows)]:
            continue
        cells = [_cell(results.get(k), None, f"after {k}") for k in at]
        rows.append(element("tr", _name(name, source), *cells, _seeds([*results.values()])))
    parts = element("thead", head), element("tbody", *rows)
    return element("div", element("table", *parts, class_="values"), class_="scroll")


def comparison(study: Study, entry: Entry) -> Html:
    """Every row over the one that the entry names: ratio over paired seeds, and the word on "less"."""
    parts = compared_rows(entry, study.numbers)
    if not parts:
        return Html("")
    names = {row.run: row.label for row in entry.rows}
    head = ["", "less?", "ratio", "less in", "adjusted p"]  # the word first: a phone shows two columns
    rows = [
        [
            names[run],
            word_chip(part.word if part.seeds >= entry.seeds else NOT_RUN),
            estimate(part),
            f"{part.wins} of {plural(part.seeds, 'seed')}",
            "" if part.p_adjusted is None else number(part.p_adjusted),
        ]
        for run, part in parts.items()
    ]
    note = paragraph(
        "The ratio is that of geometric means over paired seeds, with its 95 % interval. All rows are "
        "corrected together; a factor within 1.15 is a tie.",
        class_="soft",
    )
    title = element("h2", f"Compared with {names[entry.against]}")
    return join([title, note, element("div", table(head, rows), class_="scroll")])


def _row(study: Study, entry: Entry, row: Row) -> Html:
    printed_numbers, k = printed(entry, row), counts(entry, row)[-1]
    results = [study.numbers.summary(entry, row.run, column, k) for column in entry.columns]
    most = max(len(study.numbers.cell(entry, row.run, column, k)) for column in entry.columns)
    cells = [
        _cell(result, printed_numbers.get(column), column_name(column), of_joints=column == "mean", most=most)
        for column, result in zip(entry.columns, results, strict=True)
    ]
    return element("tr", _name(row.label, row.run), *cells, _seeds(results, most))


def _line(study: Study, entry: Entry, source: str) -> Html:
    """A line's numbers; nothing where there are none."""
    k = entry.at[-1]
    results = [study.numbers.summary(entry, source, column, k) for column in entry.columns]
    if not any(results):
        return Html("")
    cells = [_cell(result, None, column_name(c)) for c, result in zip(entry.columns, results, strict=True)]
    return element(
        "tr", _name(line_name(source, study.what), source), *cells, _seeds(results), class_="line-row"
    )


def _name(label: str, source: str) -> Html:
    run = source.partition(":")[0]
    return element("th", label, " ", element("small", link(file_of(f"run-{run}"), source)), scope="row")


def _heading(title: str, column: str) -> Html:
    return element("th", title, scope="col", **({"class_": "mean"} if column == "mean" else {}))


def _cell(
    result: Summary | None, printed_number: float | None, name: str, *, of_joints: bool = False, most: int = 0
) -> Html:
    """Printed over ours, ours over its interval.

    Args:
        name: the heading on a narrow page. of_joints: the thesis does not print this mean.
        most: seeds of the whole row; fewer of them are said.
    """
    tip = "mean of the printed numbers" if of_joints else "printed in the thesis"
    value_text = (
        "" if printed_number is None else f"{printed_number:.{DECIMALS - 1 if of_joints else DECIMALS}f}"
    )
    parts = [element("span", value_text, class_="told", title=tip)] if value_text else []
    parts.append(element("span", number(result.mean) if result else "–", class_="ours"))
    if result and result.n > 1:
        parts.append(element("span", f"[{number(result.low)}, {number(result.high)}]", class_="interval"))
    if most and (result is None or result.n < most):
        some = str(result.n) if result else "none"
        parts.append(element("span", f"{some} of {most} seeds", class_="interval"))
    return element("td", *parts, **{"data-column": name})


def _seeds(results: Sequence[Summary | None], most: int = 0) -> Html:
    n = max((result.n for result in results if result), default=most)
    content = str(n) if n else "not run"
    return element(
        "td", element("span", content, class_="n", title=plural(n, "seed")), **{"data-column": "seeds"}
    )
