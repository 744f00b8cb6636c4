"""By what claims and entries can be filtered: robot, model, motions, chapter, verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from etude_studies.thesis.ledger import Claim, Entry, Ledger

ROBOTS: Mapping[str, str] = {
    "Q": "quadrotor",
    "L": "quadrotor",
    "P": "Pelican",
    "K": "none",
    "T": "none",
    "Y5": "quadrotor",
    "M2": "quadrotor",
}
"""By run, or by its first letter; others are of the arm."""
MODELS: Mapping[str, str] = {
    "A": "dictionary",
    "X": "dictionary",
    "S": "SSGP",
    "Q": "full GPR",
    "P": "full GPR",
    "D": "default protocol",
    "K": "SSGP",
    "Y2": "others",
    "Y3": "others",
    "Y4": "others",
    "Y7": "others",
    "Y5:dictionary_error": "dictionary",
    "Y5:dictionary_variance": "dictionary",
    "Y5:ssgp_learned": "SSGP",
    "Y5:ssgp_fixed": "SSGP",
    "Y5:exact": "full GPR",
    "M1:process": "full GPR",
    "M2:process": "full GPR",
    "M": "others",
    "W1": "dictionary",
    "A6": "full GPR",
    "X14": "full GPR",
    "X6a": "SSGP",
    "X6b": "SSGP",
    "X11": "SSGP",
}
"""By run, by its first letters, or by a line of it; other lines, and controllers that learn no process, have
none."""
RUNS_OF_OTHERS = ("R1",)
"""Whose lines are runs: "R1:A7" has a figure of A7."""
RUNS_OF_METHODS = ("M",)
"""First letters of runs whose every line is a model that learns."""
DESIGNED = ("A7", "S9", "X4", "X8", "Q4", "Q5", "Q6d", "Q7d", "Q8d", "P2", "P4", "P5d")
WITHOUT_MOTIONS = ("B", "K", "T", "L", "O", "Y", "W0")
LATE = {"DP2": "log_ivr", "DP4": "log_ivr", "X13": "best of 24 random"}
CRITERION = "DC_"
"""How runs that design by another criterion begin."""
Facets = Mapping[str, tuple[str, ...]]
NAMES: Mapping[str, str] = {
    "verdict": "Verdict",
    "robot": "Robot",
    "model": "Model",
    "motions": "Motions",
    "chapter": "Chapter",
}
"""Of the facets, in the order of the page."""
ORDER: Mapping[str, tuple[str, ...]] = {
    "robot": ("arm", "quadrotor", "Pelican"),
    "model": ("dictionary", "SSGP", "full GPR", "physics or linear", "default protocol", "others"),
    "motions": ("random", "maximum variance", "best of 24 random", "log_ivr", "other criteria"),
    "chapter": ("abstract", "1", "2", "3", "4", "5", "6", "7", "beyond"),
}


def of_claim(ledger: Ledger, claim: Claim) -> Facets:
    """Facets of a claim: of its parts' sources, or of what it says again, or of the entries it rests on."""
    claims = [ledger.claim(id) for id in claim.alias_of] or [claim]
    sources = [source for one in claims for part in one.parts for source in part.sources]
    if not sources:
        sources = [row.run for id in claim.rests_on for row in ledger.entry(id).rows]
    return of_sources(sources) | {"chapter": (chapter(claim.section),)}


def of_entry(entry: Entry) -> Facets:
    """Facets of a figure or table, by its rows."""
    return of_sources(row.run for row in entry.rows) | {"chapter": (chapter(entry.section),)}


def of_sources(sources: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Robot, model and motions, each in its order."""
    facets: dict[str, set[str]] = {"robot": set(), "model": set(), "motions": set()}
    for source in sources:
        run, _, line = source.partition(":")
        if run in RUNS_OF_OTHERS and line[:1].isupper():
            run, line = line, ""
        facets["robot"].add(ROBOTS.get(run, ROBOTS.get(run[0], "arm")))
        facets["model"].add(_model(run, line))
        facets["motions"].add(_motions(run))
    return {name: tuple(v for v in ORDER[name] if v in values) for name, values in facets.items()}


def chapter(section: str) -> str:
    """ "6" of "6.2"; the abstract is its own."""
    return section.partition(".")[0]


def _model(run: str, line: str) -> str:
    if f"{run}:{line}" in MODELS:
        return MODELS[f"{run}:{line}"]
    if line and line not in ("faded", "again") and run[0] not in RUNS_OF_METHODS:
        return "physics or linear"
    for name in (run, run[:2], run[0]):
        if name in MODELS:
            return MODELS[name]
    return "physics or linear" if run[0] in "BW" else ""


def _motions(run: str) -> str:
    if run in LATE:
        return LATE[run]
    if run.startswith(CRITERION):
        return "other criteria"
    if run.endswith("_designed"):
        return "log_ivr"
    if run.startswith(WITHOUT_MOTIONS):
        return ""
    return "maximum variance" if run in DESIGNED else "random"
