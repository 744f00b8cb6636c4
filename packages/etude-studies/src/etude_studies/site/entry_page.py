"""The page of one figure or table: verdicts, picture, the thesis's layout, and what is behind it."""

from __future__ import annotations

from collections.abc import Sequence

from etude.report import Html, element, join, missing_data, paragraph
from etude_studies.site.claim_words import deciding, evidence
from etude_studies.site.context import Study
from etude_studies.site.downloads import data_links
from etude_studies.site.entry_more import more
from etude_studies.site.entry_pictures import joints, pictures
from etude_studies.site.entry_table import comparison, table_of, table_over_k
from etude_studies.site.mathematics import prose
from etude_studies.site.page import INDEX, chip, command, file_of, folded, link, page
from etude_studies.site.words import BEYOND, axis_label, entry_name, plural, section_name, unit_name
from etude_studies.thesis.ledger import Claim, Entry
from etude_studies.thesis.part_verdicts import NOT_RUN
from etude_studies.thesis.verdict_file import shown

ONE_RUN = "The thesis: one run of each row, so that nothing is known of its spread."


def entry_page(study: Study, entry: Entry) -> Html:
    """The whole page."""
    name = entry_name(entry.id)
    return page(
        f"{name}: {entry.title}",
        _top(study, entry, name),
        _answers(study, entry),
        _thesis_notes(entry),
        pictures(study, entry),
        *_tables(study, entry),
        comparison(study, entry),
        _again(study, entry),
        joints(study, entry),
        more(study, entry),
        _neighbours(study, entry),
    )


def _top(study: Study, entry: Entry, name: str) -> Html:
    unit = unit_name(entry.unit)
    small = section_name(entry.section) + (f" · in {unit}" if unit else "")
    lack = sorted({row.run.partition(":")[0] for row in entry.rows} - {*study.numbers.results.runs})
    waits = missing_data(f"Not run yet: {', '.join(lack)}.") if lack and entry.kind != "trace" else ""
    return join([element("h1", f"{name}: {entry.title}"), paragraph(small, class_="soft"), waits])


def _answers(study: Study, entry: Entry) -> Html:
    """Claims of the entry's own section that are no repetition; the others folded."""
    claims = study.claims_of(entry)
    direct = [claim for claim in claims if claim.section == entry.section and not claim.alias_of]
    others = [claim for claim in claims if claim not in direct]
    more = (
        folded(f"{plural(len(others), 'claim')} elsewhere that rest on it", *_lines(study, others))
        if others
        else ""
    )
    return element("div", *_lines(study, direct), more, class_="answers")


def _lines(study: Study, claims: Sequence[Claim]) -> list[Html]:
    """The verdict on each in one line."""
    out = []
    for claim in claims:
        verdict = study.verdicts[claim.id]
        part = deciding(verdict)
        facts = evidence(part) if part is not None and shown(verdict) != NOT_RUN else ""
        quote = element("q", prose(" … ".join(claim.quote)))
        out.append(
            element("p", chip(verdict), " ", link(file_of(claim.id), claim.id), " ", quote, f" {facts}")
        )
    return out


def _thesis_notes(entry: Entry) -> Html:
    notes = [f"The thesis, in words: {entry.printed_words}."] if entry.printed_words else []
    notes += [ONE_RUN] if entry.kind != "trace" and entry.section != BEYOND else []
    notes += [entry.note] if entry.note else []
    return paragraph(" ".join(notes), class_="soft")


def _tables(study: Study, entry: Entry) -> Sequence[Html]:
    if entry.kind == "trace":
        return []
    if entry.kind == "table":
        printed = (
            "Small and grey: printed in the thesis. Below: the"
            if any(r.printed for r in entry.rows)
            else "The"
        )
        caption = f"{printed} mean over seeds with its 95 % interval."
        return [paragraph(caption, class_="soft"), table_of(study, entry)]
    column = "mean" if "mean" in entry.columns else entry.columns[0]
    label = axis_label(entry.measure, entry.unit)
    caption = f"The {label}: mean over seeds with its 95 % interval, by the number along the figure's axis."
    return [paragraph(caption, class_="soft"), table_over_k(study, entry, column)]


def _again(study: Study, entry: Entry) -> Html:
    seeds = plural(entry.seeds, "seed") + study.price(entry.id, entry.seeds)
    intro = paragraph(f"The command that computes it again, with {seeds}:")
    return join([intro, command(f"{entry.command} --seeds {entry.seeds}"), data_links(entry.id)])


def _neighbours(study: Study, entry: Entry) -> Html:
    """The pages before and after this one."""
    entries = study.ledger.entries
    place = entries.index(entry)
    before = [
        link(file_of(neighbour.id), f"◂ {entry_name(neighbour.id)}")
        for neighbour in entries[max(0, place - 1) : place]
    ]
    after = [
        link(file_of(neighbour.id), f"{entry_name(neighbour.id)} ▸")
        for neighbour in entries[place + 1 : place + 2]
    ]
    return element("nav", *before, link(f"{INDEX}#tables", "all tables and figures"), *after, class_="bottom")
