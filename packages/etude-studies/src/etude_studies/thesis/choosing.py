"""Meaning of an id: a run, a figure or table, a claim, or a group of runs."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from functools import cache

from etude.errors import UsageError
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.ledger import Claim, Entry, Ledger, load_ledger

PROTOCOL = "ABSQPKTYLW"
"""First letters of the runs that the thesis's own tables, figures and claims rest on."""
GROUPS: Mapping[str, str] = {
    "thesis": "every table, figure and claim of the thesis, in its own protocol",
    "sensitivity": "what the thesis leaves open, read otherwise",
    "default": "the same questions in Étude's default protocol",
    "beyond": "criteria, unmodelled physics and ablations in Étude's default protocol; other methods",
    "descent": "steps of the training as steps of fixed rate along the gradient",
    "rounding": "the runs of chapter 6.3 on logs with other last digits",
    "plants": "the headline claims of chapter 6 on arms with other gains, friction and noise, new seeds",
    "miniature": "a run of each family that takes seconds",
    "all": "all but the miniature",
}
VARIED = {"G": "descent", "U": "rounding", "V": "plants"}
"""Groups by the first letter of their runs."""
SENSITIVITY = ("Q6u", "Q6d", "Q7u", "Q7d", "Q8u", "Q8d", "P5u", "P5d", "P6u", "P6d")


@cache
def ledger() -> Ledger:
    """Claims and tables, read once."""
    return load_ledger()


def ids() -> tuple[str, ...]:
    """Everything that can be run or shown."""
    claims_ledger = ledger()
    return (
        *GROUPS,
        *(e.id for e in claims_ledger.entries),
        *(c.id for c in claims_ledger.claims),
        *catalogue(),
    )


def runs_of(id: str) -> tuple[str, ...]:
    """Names of the runs behind an id, those in front that its own rows show.

    Raises:
        UsageError: there is no such id (with the nearest), or a claim that no run answers (with the reason).
    """
    claims_ledger = ledger()
    if id in catalogue():
        return (id,)
    if id in GROUPS:
        whole = [group for group in GROUPS if group not in ("miniature", "all")]
        selected = whole if id == "all" else [id]
        return tuple(name for name in catalogue() if group_of(name) in selected)
    entry = next((one for one in claims_ledger.entries if one.id == id), None)
    if entry is not None:
        over_time = "t" if entry.kind == "trace" else ""
        return _there((*(row.run + over_time for row in entry.rows), *entry.lines))
    claim = next((one for one in claims_ledger.claims if one.id == id), None)
    if claim is None:
        raise unknown(id)
    return _of_claim(claims_ledger, claim)


def group_of(name: str) -> str:
    """The group that a run belongs to."""
    if name.startswith("m"):
        return "miniature"
    if name.startswith("DP"):
        return "default"
    if name.startswith(("D", "R", "M")):
        return "beyond"
    if name[0] in VARIED:
        return VARIED[name[0]]
    return "thesis" if name[0] in PROTOCOL and name not in SENSITIVITY else "sensitivity"


def entries_of(id: str) -> tuple[Entry, ...]:
    """The figures and tables that an id shows: itself, or what a claim rests on."""
    claims_ledger = ledger()
    if any(entry.id == id for entry in claims_ledger.entries):
        return (claims_ledger.entry(id),)
    if any(claim.id == id for claim in claims_ledger.claims):
        return tuple(claims_ledger.entry(name) for name in claims_ledger.claim(id).rests_on)
    return claims_ledger.entries if id in ("thesis", "all") else ()


def unknown(id: str) -> UsageError:
    """What to say of an id that is none."""
    near = difflib.get_close_matches(id, ids(), 1, cutoff=0.4)
    hint = f"Did you mean {near[0]}? " if near else ""
    return UsageError(
        f"there is no {id!r} in the thesis's study", next_step=f"{hint}etude study list shows all ids."
    )


def _of_claim(claims_ledger: Ledger, claim: Claim) -> tuple[str, ...]:
    if claim.untestable:
        raise UsageError(f"{claim.id} cannot be tested here: {claim.untestable}")
    parts = [part for one in claim.alias_of or (claim.id,) for part in claims_ledger.claim(one).parts]
    return _there([source for part in parts for source in part.sources])


def _there(sources: Sequence[str]) -> tuple[str, ...]:
    """Runs of the sources, each once, that are studies of their own left out."""
    names = dict.fromkeys(source.partition(":")[0] for source in sources)
    return tuple(name for name in names if name in catalogue())
