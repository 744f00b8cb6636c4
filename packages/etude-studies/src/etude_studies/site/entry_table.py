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
    for name, source, own in sources:
        found = study.numbers.curve(entry, source, column, own)
        if not found and (name, source, own) not in sources[: len(entry.rows)]:
            continue
        cells = [_cell(found.get(k), None, f"after {k}") for k in at]
        rows.append(element("tr", _name(name, source), *cells, _seeds([*found.values()])))
    parts = element("thead", head), element("tbody", *rows)
    return element("div", element("table", *parts, class_="values"), class_="scroll")


def comparison(study: Study, entry: Entry) -> Html:
    """Every row over the one that the entry names: ratio over paired seeds, and the word on "less"."""
    found = compared_rows(entry, study.numbers)
    if not found:
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
        for run, part in found.items()
    ]
    told = paragraph(
        "The ratio is that of geometric means over paired seeds, with its 95 % interval. All rows are "
        "corrected together; a factor within 1.15 is a tie.",
        class_="soft",
    )
    title = element("h2", f"Compared with {names[entry.against]}")
    return join([title, told, element("div", table(head, rows), class_="scroll")])


def _row(study: Study, entry: Entry, row: Row) -> Html:
    told, k = printed(entry, row), counts(entry, row)[-1]
    found = [study.numbers.summary(entry, row.run, column, k) for column in entry.columns]
    most = max(len(study.numbers.cell(entry, row.run, column, k)) for column in entry.columns)
    cells = [
        _cell(own, told.get(column), column_name(column), of_joints=column == "mean", most=most)
        for column, own in zip(entry.columns, found, strict=True)
    ]
    return element("tr", _name(row.label, row.run), *cells, _seeds(found, most))


def _line(study: Study, entry: Entry, source: str) -> Html:
    """A line's numbers; nothing where there are none."""
    k = entry.at[-1]
    found = [study.numbers.summary(entry, source, column, k) for column in entry.columns]
    if not any(found):
        return Html("")
    cells = [_cell(own, None, column_name(c)) for c, own in zip(entry.columns, found, strict=True)]
    return element(
        "tr", _name(line_name(source, study.what), source), *cells, _seeds(found), class_="line-row"
    )


def _name(label: str, source: str) -> Html:
    run = source.partition(":")[0]
    return element("th", label, " ", element("small", link(file_of(f"run-{run}"), source)), scope="row")


def _heading(words: str, column: str) -> Html:
    return element("th", words, scope="col", **({"class_": "mean"} if column == "mean" else {}))


def _cell(
    found: Summary | None, told: float | None, name: str, *, of_joints: bool = False, most: int = 0
) -> Html:
    """Printed over ours, ours over its interval.

    Args:
        name: the heading on a narrow page. of_joints: `told` is a mean that the thesis does not print.
        most: seeds of the whole row; fewer of them are said.
    """
    tip = "mean of the printed numbers" if of_joints else "printed in the thesis"
    words = "" if told is None else f"{told:.{DECIMALS - 1 if of_joints else DECIMALS}f}"
    parts = [element("span", words, class_="told", title=tip)] if words else []
    parts.append(element("span", number(found.mean) if found else "–", class_="ours"))
    if found and found.n > 1:
        parts.append(element("span", f"[{number(found.low)}, {number(found.high)}]", class_="interval"))
    if most and (found is None or found.n < most):
        some = str(found.n) if found else "none"
        parts.append(element("span", f"{some} of {most} seeds", class_="interval"))
    return element("td", *parts, **{"data-column": name})


def _seeds(found: Sequence[Summary | None], most: int = 0) -> Html:
    n = max((own.n for own in found if own), default=most)
    words = str(n) if n else "not run"
    return element(
        "td", element("span", words, class_="n", title=plural(n, "seed")), **{"data-column": "seeds"}
    )
