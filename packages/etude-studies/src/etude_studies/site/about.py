"""The page about the pages: words, the rule behind them, open points of the thesis, and every run."""

from __future__ import annotations

from etude.report import Html, element, join, paragraph, table
from etude_studies.site.context import Study
from etude_studies.site.page import ABOUT, file_of, link, page, word_chip
from etude_studies.site.words import WORDS, plural
from etude_studies.thesis.part_verdicts import FAILED
from etude_studies.thesis.parts import MARGIN
from etude_studies.thesis.verdicts import EXPLORATORY_LEVEL, OWN_LEVEL

RULE = (
    "Every claim is one number a seed, paired: all rows of a seed share the first trajectory, the tests and "
    "the noise. Most are logarithms of a ratio; shown is the factor, with its plain 95 % interval.",
    "A difference is found where a paired t test and random sign flips both fall below "
    f"{OWN_LEVEL:.0%}, corrected for how many comparisons rest on the same table or figure (Holm). "
    "Explanations, single observations and cited results are exploratory, and corrected at "
    f"{EXPLORATORY_LEVEL:.0%} (Benjamini and Hochberg).",
    f"Where none is found, it is a tie if the 90 % interval lies within a factor of {MARGIN:g} both ways, "
    "and the test would find a difference of that size more often than not (its power); otherwise it is not "
    "decided.",
    "The number of seeds that would settle a claim stands beside it, with its price. That number counts "
    "once, as one block with twice the p, and neither fewer nor more.",
    "Another reading exchanges every side of a comparison that it concerns.",
    f"There is no verdict where runs are missing, or more than {FAILED:.0%} of the seeds have no number.",
    "The rule was fixed before any result was looked at, and changed once, before any word under it was: "
    "families by table, power, extra seeds.",
)


def about_page(study: Study) -> Html:
    """The whole page."""
    return page(
        "How to read",
        element("h1", "How to read these pages"),
        *_vocabulary(),
        element("h2", "The rule", id="rule"),
        *(paragraph(rule) for rule in RULE),
        _tables(),
        _ambiguities(study),
        _runs(study),
        here=ABOUT,
    )


def _vocabulary() -> list[Html]:
    rows = [[word_chip(word), term.meaning] for word, term in WORDS.items()]
    return [element("h2", "The words"), table(["word", "meaning"], rows)]


def _tables() -> Html:
    return join(
        [
            element("h2", "The tables and pictures"),
            paragraph(
                "Small and grey above each number, and as a hollow diamond: what the thesis printed, from "
                "one run. Its tables have no mean over the joints; that of its numbers is taken here."
            ),
            paragraph(
                "Beside the thesis's rows stand PD alone and the exact inverse, between which a number means "
                "something, linear regression, and identified physics on the same data."
            ),
        ]
    )


def _ambiguities(study: Study) -> Html:
    # spans: words that begin with a number are no number
    rows = [
        [ambiguity.id, ambiguity.what, element("span", ambiguity.resolution)]
        for ambiguity in study.ledger.ambiguities
    ]
    header = ["", "what the thesis leaves open", "how it is read here"]
    return join([element("h2", "What the thesis leaves open", id="open"), table(header, rows)])


def _runs(study: Study) -> Html:
    rows = [
        [link(file_of(f"run-{run}"), run), study.what.get(run, ""), _seeds(study, run)] for run in study.runs
    ]
    return join([element("h2", "Runs", id="runs"), table(["run", "what", "results"], rows)])


def _seeds(study: Study, run: str) -> Html:
    n = len(study.numbers.results.seeds(run))
    return Html(plural(n, "seed") if n else "not run yet")
