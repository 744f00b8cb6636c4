"""The first page: how many claims hold, every claim with its verdict, every figure and table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from etude.report import Html, element, join, number, paragraph
from etude_studies.site import facets
from etude_studies.site.claim_words import deciding, estimate
from etude_studies.site.context import Study
from etude_studies.site.mathematics import prose
from etude_studies.site.page import ABOUT, INDEX, SOURCE, chip, command, file_of, link, page
from etude_studies.site.words import WORDS, entry_name, plural
from etude_studies.thesis.ledger import Claim, Entry
from etude_studies.thesis.part_verdicts import NOT_RUN, UNTESTED
from etude_studies.thesis.verdict_file import shown

TITLE = "Does the thesis hold?"
NUMBERS = (
    "The number at the right is the first comparison that decides, with its 95 % interval: mostly a ratio, "
    "claimed to be below 1. The claim's page says what of what."
)
SECTIONS: Mapping[str, str] = {
    "abstract": "Abstract",
    "1": "1 Introduction",
    "2": "2 Learning control",
    "3": "3 Optimised trajectories",
    "4": "4 Systems",
    "5": "5 Quadrotor",
    "6": "6 Manipulator",
    "7": "7 Conclusions",
}


def overview(study: Study) -> Html:
    """The whole page."""
    tally = Counter(shown(study.verdicts[claim.id]) for claim in _distinct(study))
    return page(
        TITLE,
        element("h1", TITLE),
        paragraph(f"{SOURCE}; every claim, table and figure, run again with seeds.", class_="soft"),
        _counts(tally),
        _totals(study, tally),
        _filters(study, tally),
        element("h2", "Claims", id="claims"),
        element("p", f"{len(study.ledger.claims)} claims", class_="soft", id="count", role="status"),
        paragraph(NUMBERS, class_="soft"),
        *_claims(study),
        element("h2", "Tables and figures", id="tables"),
        element("ul", *(_entry(study, entry) for entry in study.ledger.entries), class_="entries"),
        here=INDEX,
    )


def _distinct(study: Study) -> list[Claim]:
    """Claims that say nothing again."""
    return [claim for claim in study.ledger.claims if not claim.alias_of]


def _counts(tally: Counter[str]) -> Html:
    """A card for each word; what cannot be tested and what has not been run are told apart."""
    cards = []
    for word, term in WORDS.items():
        mark = element("i", term.mark, **{"aria-hidden": "true"})
        inside = element("b", str(tally[word])), element("span", mark, f" {word}")
        where = f"#verdict={term.name}"
        cards.append(element("a", *inside, class_=f"count {term.name}", href=where, title=term.meaning))
    return element("div", *cards, class_="counts", role="list")


def _totals(study: Study, tally: Counter[str]) -> Html:
    answered = sum(n for word, n in tally.items() if word not in (NOT_RUN, UNTESTED))
    runs = [run for run in study.runs if study.numbers.made(run)]
    seeds = sum(len(study.numbers.made(run).get("hashes", {})) for run in runs)
    hours = sum(float(study.numbers.made(run).get("cpu_s", 0.0)) for run in runs) / 3600.0
    totals = (
        f"Of {len(_distinct(study))} distinct claims {answered} are answered, "
        f"from {plural(len(runs), 'run')} with {plural(seeds, 'result')} in all. "
        f"{len(study.ledger.claims) - len(_distinct(study))} more say one of them again. "
        f"“{NOT_RUN.capitalize()}”: their runs are missing or not complete, so they cannot be tested yet. "
    )
    again = paragraph(
        f"The command that computes everything again; {number(hours)} CPU hours, and what is not run yet:",
        class_="soft",
    )
    rule = link(ABOUT, "What the words mean, and how they are decided.")
    return join([paragraph(totals, rule), again, command("etude study run all")])


def _filters(study: Study, tally: Counter[str]) -> Html:
    """Rows of buttons, which the script brings to life, and a search; hidden where there is no script."""
    rows = [
        _group("verdict", [(term.name, f"{term.mark} {word}") for word, term in WORDS.items() if tally[word]])
    ]
    all_facets = [facets.of_claim(study.ledger, claim) for claim in study.ledger.claims]
    all_facets += [facets.of_entry(entry) for entry in study.ledger.entries]
    for name in list(facets.NAMES)[1:]:
        present = {value for facet in all_facets for value in facet[name]}
        rows.append(_group(name, [(value, value) for value in facets.ORDER[name] if value in present]))
    label = element("label", "Search ", Html('<input type="search" id="search" autocomplete="off">'))
    clear = element("button", "Show all", type="button", id="clear")
    return element(
        "form", element("div", label, clear, class_="search"), *rows, class_="filters", hidden="hidden"
    )


def _group(name: str, values: Iterable[tuple[str, str]]) -> Html:
    shown_as = {"1": "chapter 1"}
    buttons = [
        element(
            "button",
            shown_as.get(caption, caption),
            type="button",
            **{"aria-pressed": "false", "data-facet": name, "data-value": value},
        )
        for value, caption in values
    ]
    return element("fieldset", element("legend", facets.NAMES[name]), *buttons)


def _claims(study: Study) -> Iterable[Html]:
    """Claims by chapter, in the order of the thesis."""
    chapters: dict[str, list[Claim]] = {}
    for claim in study.ledger.claims:
        chapters.setdefault(facets.chapter(claim.section), []).append(claim)
    for name in sorted(chapters, key=list(SECTIONS).index):
        items = [_claim(study, claim) for claim in chapters[name]]
        yield element(
            "section", element("h3", SECTIONS[name]), element("ul", *items, class_="claims"), class_="chapter"
        )


def _claim(study: Study, claim: Claim) -> Html:
    """One line: id, verdict, quotation, the first number, and on which reading the verdict depends."""
    verdict = study.verdicts[claim.id]
    part = deciding(verdict)
    facts = estimate(part) if part is not None else ""
    on = study.depends(claim)
    depends = element("span", f"depends on: {'; '.join(on)}", class_="depends") if on else ""
    marks = [
        word for word, yes in (("simulated", verdict.simulated), ("said again", bool(claim.alias_of))) if yes
    ]
    inside = [
        element("span", link(file_of(claim.id), claim.id), class_="id"),
        element("span", chip(verdict), class_="word"),
        element(
            "span",
            element("q", prose(" … ".join(claim.quote))),
            " ",
            element("small", ", ".join(marks)),
            " ",
            depends,
        ),
        element("span", facts, class_="found"),
    ]
    return element("li", *inside, **_data(facets.of_claim(study.ledger, claim), WORDS[shown(verdict)].name))


def _entry(study: Study, entry: Entry) -> Html:
    """A figure or table with the chips of its claims."""
    claims = study.claims_of(entry)
    chips = [
        element("a", chip(study.verdicts[claim.id]), href=file_of(claim.id), title=claim.id)
        for claim in claims
    ]
    names = " ".join(dict.fromkeys(WORDS[shown(study.verdicts[claim.id])].name for claim in claims))
    inside = [
        element("span", link(file_of(entry.id), entry_name(entry.id)), class_="id"),
        element("span", entry.title),
        element("span", join(chips, " "), class_="word"),
    ]
    return element("li", *inside, **_data(facets.of_entry(entry), names))


def _data(by_name: facets.Facets, verdict: str) -> dict[str, str]:
    """Attributes that the script filters by; several values of one are parted by a bar."""
    values = {name: "|".join(group) for name, group in by_name.items()} | {
        "verdict": verdict.replace(" ", "|")
    }
    return {f"data-{name}": value for name, value in values.items()}
