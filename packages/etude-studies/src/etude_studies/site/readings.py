"""Other readings of the thesis: which runs take which runs' places, and what the verdicts then are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace as changed_copy

from etude_studies.site.context import Reading
from etude_studies.thesis.contrasts import Values
from etude_studies.thesis.ledger import Claim, Ledger
from etude_studies.thesis.verdicts import Verdict, judge, touches

FADED = {run: f"{run}:faded" for run in ("A1", "A7", "S1", "S9")}
READINGS: Sequence[Reading] = (
    Reading("random trajectories drawn again", "", {"A1": "X1"}),
    Reading("feedforward fades", "R1", FADED),
    Reading("random amplitudes, flights of random size", "R2", {"A1": "X2", "Q1": "Q2", "P1": "P3"}),
    Reading("random flights on the edge", "R2", {"Q1": "Q3"}),
    Reading("a base frequency for each joint", "R3", {"A1": "X3", "A7": "X4"}),
    Reading(
        "steps are evaluations of the likelihood", "R4", {"A1": "X5a", "A3": "X5b", "S1": "X6a", "S2": "X6b"}
    ),
    Reading("reinitialised with as many steps in all", "R4", {"A3": "X7"}),
    Reading("designs from one random start", "R5", {"A7": "X8", "Q4": "Q5", "P2": "P4"}),
    Reading("spectrum on all samples", "R7", {"S1": "X11"}),
    Reading("kinematic acceleration on the Pelican", "R12", {"P1": "P5u", "P2": "P5d"}),
    Reading("a noise floor of 0.2 deviations", "", {"Q1": "Q6u", "Q4": "Q6d"}),
    Reading("flights up to 3 m/s", "", {"Q1": "Q7u", "Q4": "Q7d"}),
    Reading("five harmonics", "", {"Q1": "Q8u", "Q4": "Q8d"}),
    Reading("best of 24 random, not refined", "", {"A7": "X13"}),
    Reading("default protocol, process alone", "", {"A1": "DP1", "A7": "DP2"}),
    Reading("default protocol, ladder", "", {"A1": "DP3", "A7": "DP4"}),
)


def readings(
    ledger: Ledger,
    results: Values,
    *,
    planned: Mapping[str, int] | None = None,
    among: Sequence[Reading] = READINGS,
) -> list[Reading]:
    """Each with the verdicts on the claims that it touches."""
    out = []
    for own in among:
        found = judge(ledger, results, replace=own.replace, planned=planned)
        out.append(changed_copy(own, verdicts=_touched(ledger, found, own.replace)))
    return out


def _touched(ledger: Ledger, found: Mapping[str, Verdict], replace: Mapping[str, str]) -> dict[str, Verdict]:
    def changes(claim: Claim) -> bool:
        said = [ledger.claim(id) for id in claim.alias_of] or [claim]
        return any(touches(one, replace) for one in said)

    return {claim.id: found[claim.id] for claim in ledger.claims if changes(claim)}
