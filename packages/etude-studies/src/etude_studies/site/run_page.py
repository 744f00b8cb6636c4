"""The page of one run: what it is, its settings, its specs, and where its results come from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import stdev
from typing import Any

from etude.report import Html, element, join, number, paragraph, table
from etude_studies.site.context import Study
from etude_studies.site.entry_more import settings_of
from etude_studies.site.page import command, file_of, link, page
from etude_studies.site.words import entry_name
from etude_studies.thesis.arm import PRIMARY
from etude_studies.thesis.arm_runs import ROUNDS


def run_page(study: Study, run: str) -> Html:
    """The whole page."""
    made = study.numbers.made(run)
    return page(
        f"Run {run}",
        element("h1", f"Run {run}"),
        settings_of(study, run),
        _origin(made) if made else "",
        _rounding(study, run),
        paragraph(f"The command that computes it again{_cost(made)}:"),
        command(f"etude study run {run}"),
        _shown_in(study, run),
    )


def _cost(made: Mapping[str, Any]) -> str:
    """Of a seed, by those that were run."""
    seeds = len(made.get("hashes", {}))
    return f"; {number(float(made['cpu_s']) / seeds)} CPU seconds a seed" if seeds else ""


def _origin(made: Mapping[str, Any]) -> Html:
    """Commit, versions, machine and time."""
    versions = ", ".join(f"{name} {value}" for name, value in made.get("versions", {}).items())
    machine = ", ".join(str(value) for value in made.get("machine", {}).values())
    rows = [
        ["commit", element("code", str(made.get("commit", "")))],
        ["versions", versions],
        ["machine", machine],
        ["processor time", f"{number(float(made.get('cpu_s', 0.0)))} s"],
        ["finished", str(made.get("date", ""))],
    ]
    return join([element("h2", "Where its results come from"), table(["", ""], rows)])


def _rounding(study: Study, run: str) -> Html:
    """How far other last digits of the logs move the error, beside how far seeds do."""
    original, moved = (
        study.numbers.results.values(name, "error", ROUNDS, PRIMARY) for name in (run, f"U{run}")
    )
    both = sorted({*original} & {*moved})
    if len(both) < 2:
        return Html("")
    # each side of a pair has the deviation of rounding
    rounding = stdev(math.log(moved[seed] / original[seed]) for seed in both) / math.sqrt(2.0)
    seeds = stdev(math.log(original[seed]) for seed in both)
    return paragraph(
        f"Other last digits of the logs (run U{run}) move the error of a seed after {ROUNDS} trajectories by "
        f"{rounding:.0%}, and seeds differ by {seeds:.0%}: deviations of logarithms over {len(both)} seeds. "
        "Intervals over seeds contain both."
    )


def _shown_in(study: Study, run: str) -> Html:
    """Figures, tables and claims that use it."""
    entries = [e for e in study.ledger.entries if run in {s.partition(":")[0] for s in e.sources}]
    claims = [
        claim
        for claim in study.ledger.claims
        if run in {s.partition(":")[0] for part in claim.parts for s in part.sources}
    ]
    links = [link(file_of(e.id), entry_name(e.id)) for e in entries]
    links += [link(file_of(claim.id), claim.id) for claim in claims]
    return join([element("h2", "Used in"), paragraph(join(links, ", "))]) if links else Html("")
