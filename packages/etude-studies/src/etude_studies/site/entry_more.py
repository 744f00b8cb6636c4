"""Details of a figure's page: seeds, other tests, other readings, ambiguities, every setting."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

from etude.report import Html, element, join, number, paragraph, table
from etude_studies.site.context import Study
from etude_studies.site.dot_plot import interval_text
from etude_studies.site.marks import figure, style_of
from etude_studies.site.numbers import counts
from etude_studies.site.page import chip, file_of, folded, link
from etude_studies.site.seed_plot import Strip, seed_plot
from etude_studies.site.words import axis_label, column_name, once, source_name, test_name
from etude_studies.thesis.ledger import Entry
from etude_studies.thesis.part_verdicts import NOT_RUN
from etude_studies.thesis.readings import Reading
from etude_studies.thesis.verdict_file import shown

COLUMN = "mean"


def more(study: Study, entry: Entry) -> Html:
    """All folded parts that have something to say."""
    parts = (_seeds, _tests, _sensitivity, _verdicts, _ambiguous, _protocol)
    return join([part for draw in parts if (part := draw(study, entry))])


def _seeds(study: Study, entry: Entry) -> Html:
    """Each seed a point, one drawing for the mean or the first column."""
    if entry.kind == "trace":
        return Html("")
    column = COLUMN if COLUMN in entry.columns else entry.columns[0]
    strips: list[Strip] = []
    for place, row in enumerate(entry.rows):
        k = counts(entry, row)[-1]
        values = study.numbers.cell(entry, row.run, column, k)
        if values:
            hashes = study.numbers.made(row.run).get("hashes", {})
            strips.append((f"{row.label}, after {k}", values, style_of(place), hashes))
    if not strips:
        return Html("")
    title = f"Seeds, {column_name(column)}"
    drawn = seed_plot(title, strips, axis=axis_label(entry.measure, entry.unit))
    note = paragraph(
        "A point is one seed, a line joins the rows of one seed; under the pointer its number and spec."
    )
    return folded("Every seed", note, figure("seeds", drawn))


def _tests(study: Study, entry: Entry) -> Html:
    """The same measure on other tests, where it was taken."""
    if entry.kind == "trace" or not entry.test:
        return Html("")
    column = COLUMN if COLUMN in entry.columns else entry.columns[0]
    tests = once(test for row in entry.rows for test in study.numbers.tests(entry, row.run))
    if len(tests) < 2:
        return Html("")
    header = ["", *(test_name(test) + (" (above)" if test == entry.test else "") for test in tests)]
    rows = []
    for row in entry.rows:
        k = counts(entry, row)[-1]
        results = [study.numbers.summary(entry, row.run, column, k, test) for test in tests]
        rows.append(
            [f"{row.label}, after {k}", *(interval_text(result) if result else "–" for result in results)]
        )
    return folded("Other tests", table(header, rows), note=column_name(column))


def _sensitivity(study: Study, entry: Entry) -> Html:
    """Runs that read the thesis otherwise, as further rows."""
    if not entry.sensitivity or entry.kind == "trace":
        return Html("")
    k, rows = entry.at[-1], []
    column = COLUMN if COLUMN in entry.columns else entry.columns[0]
    for source in entry.sensitivity:
        result = study.numbers.summary(entry, source, column, k)
        name = link(file_of(f"run-{source.partition(':')[0]}"), source_name(source, study.what))
        rows.append(
            [name, interval_text(result) if result else "not run yet", str(result.n) if result else ""]
        )
    header = ["run", f"{column_name(column)}, after {k}", "seeds"]
    return folded("Other readings of the thesis", table(header, rows))


def _verdicts(study: Study, entry: Entry) -> Html:
    """Claims of the entry's own section as columns, readings as rows, the verdict under each."""
    claims = [claim for claim in study.claims_of(entry) if claim.section == entry.section and claim.parts]
    touched = [reading for reading in study.readings if any(_run_so(reading, claim.id) for claim in claims)]
    if not touched:
        return Html("")
    header = ["read so", *(link(file_of(claim.id), claim.id) for claim in claims)]
    first = ["as above", *(chip(study.verdicts[claim.id]) for claim in claims)]
    sources = {source for claim in claims for part in claim.parts for source in part.sources}
    rows = [
        [reading_name(reading, sources), *(_under(reading, claim.id) for claim in claims)]
        for reading in touched
    ]
    return folded("The verdicts under other readings", table(header, [first, *rows]))


def reading_name(reading: Reading, sources: Iterable[str]) -> Html:
    """A reading with what it reads otherwise, and the runs that take the places of those of `sources`."""
    named = {source.partition(":")[0] for source in sources}
    runs = ", ".join(
        f"{new} for {old}" for old, new in reading.replace.items() if new.isalnum() and old in named
    )
    about = f"{reading.ambiguity}: " if reading.ambiguity else ""
    return Html(element("span", f"{about}{reading.name}", " ", element("small", runs, class_="soft")))


def _run_so(reading: Reading, claim: str) -> bool:
    return claim in reading.verdicts and shown(reading.verdicts[claim]) != NOT_RUN


def _under(reading: Reading, claim: str) -> Html:
    return chip(reading.verdicts[claim]) if claim in reading.verdicts else Html("–")


def _ambiguous(study: Study, entry: Entry) -> Html:
    """What the thesis leaves open here, and how it is read."""
    by_id = {ambiguity.id: ambiguity for ambiguity in study.ledger.ambiguities}
    ambiguities = [by_id[id] for id in entry.ambiguous if id in by_id]
    if not ambiguities:
        return Html("")
    items = [
        join([element("dt", f"{ambiguity.id}. {ambiguity.what}"), element("dd", ambiguity.resolution)])
        for ambiguity in ambiguities
    ]
    return folded(
        "What the thesis leaves open", element("dl", *items), note=", ".join(o.id for o in ambiguities)
    )


def _protocol(study: Study, entry: Entry) -> Html:
    """Every setting of the rows, the hash of every spec, and where all other runs are told of."""
    runs = once(source.partition(":")[0] for source in entry.sources)
    entry_runs = once(row.run.partition(":")[0] for row in entry.rows)
    parts = [settings_of(study, run) for run in entry_runs]
    others = [link(file_of(f"run-{run}"), run) for run in runs if run not in entry_runs]
    tail = paragraph("Beside them: ", join(others, ", "), ".") if others else ""
    return folded("Protocol: every setting, and the spec behind every point", *parts, tail)


def settings_of(study: Study, run: str) -> Html:
    """A run's sentence, settings and hashes by seed."""
    made = study.numbers.made(run)
    title = element("h3", link(file_of(f"run-{run}"), run), f" {study.what.get(run, '')}")
    if not made:
        return join([title, paragraph("Not run yet.", class_="missing")])
    settings = json.dumps(made.get("settings", {}), indent=1, sort_keys=True, ensure_ascii=False)
    hashes: Sequence[tuple[str, str]] = sorted(made.get("hashes", {}).items(), key=lambda pair: int(pair[0]))
    listed = element(
        "p", *(element("code", f"{seed}: {digest}  ") for seed, digest in hashes), class_="hashes"
    )
    spent = f"{made.get('function', '')}, {number(float(made.get('cpu_s', 0.0)))} s of processor time in all"
    return join([title, paragraph(spent, class_="soft"), element("pre", element("code", settings)), listed])
