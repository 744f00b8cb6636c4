"""Checks of the ledger's files taken together; each refusal names the file and the id."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from etude.errors import UsageError, did_you_mean
from etude_studies.thesis import parts

if TYPE_CHECKING:
    from etude_studies.thesis.ledger_items import Claim, Entry, Ledger, Part

Item = TypeVar("Item")

CLAIMS, TABLES, BEYOND = "claims.toml", "tables.toml", "beyond.toml"
OWN = "beyond-"
"""How ids of entries begin that the thesis has not."""
SOURCE = re.compile(r"([A-Z]{1,2}\d+[a-z]?|D[ACEU]_[a-z_]+)(:\w+)?")
"""A run, or one and a model beside its own."""
FIGURES = ("2.3", *(f"5.{i}" for i in range(1, 9)), *(f"6.{i}" for i in range(1, 19)))
TABLES_PRINTED = tuple(f"6.{i}" for i in range(1, 13))
ENTRIES = (*(f"figure-{i}" for i in FIGURES), *(f"table-{i}" for i in TABLES_PRINTED))
"""All figures with something computed in them, and all tables, of the thesis."""
MEASURES = (
    *("error", "error_rms", "effort", "angle"),
    *("variance", "variance_noisy", "deviation", "z2", "coverage68", "coverage95", "spearman"),
    *("nmse", "nlpd", "nlpd_train", "nlml"),
    *("command", "feedback_share", "feedback_median", "feedback_p95"),
    *("jerk", "reversal_share", "undershoot", "undershoot_max", "undershoot_min", "spike", "stuck_share"),
    *("after_reversal", "after_reversal_time", "stuck_after"),
    *("position", "speed", "mae", "mae_late", "nearest", "fill", "gap95", "ahead_variance", "ahead_mae"),
    *("length", "length_change", "signal_sd", "noise_sd", "kernel_rms"),
    *("cpu_train", "cpu_train_hours", "cpu_predict", "cpu_design", "cpu_swap"),
    *("cpu_slope_mean", "cpu_slope_variance", "cpu_slope_train", "seconds_until"),
)
"""Columns of results that a part or an entry may name; `length` stands for those of all inputs."""
OPTIONAL: Mapping[str, tuple[str, ...]] = {
    "rises": ("b",),
    "slope": ("b", "against"),
    "value": ("bound",),
    "gap": ("c", "bound"),
    "spread": ("bound",),
}
"""By statistic, what it may have beside what it needs. Anything else would be read by nobody."""


def check(ledger: Ledger) -> None:
    """Raises UsageError for the first thing that is wrong in it."""
    _unique([claim.id for claim in ledger.claims], CLAIMS)
    _unique([one.id for one in ledger.ambiguities], TABLES)
    _complete([entry.id for entry in ledger.entries if not entry.id.startswith(OWN)])
    _unique([entry.id for entry in ledger.entries], BEYOND)
    kinds = {claim.id: claim.kind for claim in ledger.claims}
    ambiguities = [one.id for one in ledger.ambiguities]
    for claim in ledger.claims:
        _check_claim(claim, kinds)
    for entry in ledger.entries:
        _check_entry(entry, ambiguities)
    for why in ledger.whys:
        where = f"{BEYOND}, why {', '.join(why.claims)}"
        _require_known(why.claims, kinds, "claim", where)
        for part in why.parts:
            _check_part(part, where)


def _check_claim(claim: Claim, kinds: Mapping[str, str]) -> None:
    where = f"{CLAIMS}, {claim.id}"
    _require_known(claim.rests_on, ENTRIES, "figure or table", where)
    if not claim.quote or not all(piece.strip() for piece in claim.quote):
        _refuse("has no quotation", where, "Quote the sentence of the thesis.")
    if (claim.kind == "alias") != bool(claim.alias_of):
        _refuse("is an alias of nothing, or names others and is none", where, "Give both kind and alias_of.")
    _require_known(claim.alias_of, kinds, "claim", where)
    for other in claim.alias_of:
        if kinds[other] == "alias":
            _refuse(f"is an alias of {other}, itself an alias", where, "Name the claim that is tested.")
    answers = [bool(claim.alias_of), bool(claim.parts), bool(claim.untestable)]
    if sum(answers) != 1:
        _refuse("needs one of parts, alias_of and untestable", where, "Keep the one that answers it.")
    for number, part in enumerate(claim.parts, start=1):
        _check_part(part, f"{where}, part {number}")


def _check_part(part: Part, where: str) -> None:
    try:
        parts.check(part)
    except UsageError as error:
        _refuse(error.fact, where, error.next_step)
    used = {*parts.NEEDS[part.statistic], *OPTIONAL.get(part.statistic, ())}
    for key in ("a", "b", "c", "among", "bound", "against"):
        if key not in used and getattr(part, key) not in ("", (), None):
            _refuse(f"has {key}, which {part.statistic} does not use", where, "Take it out.")
    if part.c and part.bound is not None:
        _refuse("has both c and a bound", where, "A gap is over another gap, or over a bound.")
    _sources(part.sources, where)
    _measure(part.measure, where)


def _check_entry(entry: Entry, ambiguities: Sequence[str]) -> None:
    where = f"{BEYOND if entry.id.startswith(OWN) else TABLES}, {entry.id}"
    _require_known(entry.ambiguous, ambiguities, "ambiguity", where)
    _sources(entry.sources, where)
    _measure(entry.measure, where)
    if not entry.rows or not entry.columns:
        _refuse("has no row or no column", where, "Add what the thesis shows.")
    if entry.against and entry.against not in [row.run for row in entry.rows]:
        _refuse(f"is compared with {entry.against}, which is no row of it", where, "Name the run of a row.")
    printed = [column for column in entry.columns if column != "mean"]
    for row in entry.rows:
        if row.printed and len(row.printed) != len(printed):
            fact = f"prints {len(row.printed)} numbers for {len(printed)} columns in {row.label!r}"
            _refuse(fact, where, "Copy the row from the thesis; the mean is not printed there.")


def _complete(ids: Sequence[str]) -> None:
    _require_known(ids, ENTRIES, "figure or table", TABLES)
    _unique(ids, TABLES)
    missing = [id for id in ENTRIES if id not in ids]
    if missing:
        raise UsageError(
            f"no entry for {', '.join(missing)}", where=TABLES, next_step="Add an [[entry]] each."
        )


def _unique(ids: Iterable[str], where: str) -> None:
    for id, count in Counter(ids).items():
        if count > 1:
            raise UsageError(f"{id} stands there {count} times", where=where, next_step="Keep one.")


def _require_known(ids: Iterable[str], valid: Iterable[str], what: str, where: str) -> None:
    names = list(valid)
    for id in ids:
        if id not in names:
            step = did_you_mean(id, names).rstrip() or "Correct it."
            raise UsageError(f"there is no {what} {id}", where=where, next_step=step)


def _sources(sources: Iterable[str], where: str) -> None:
    for source in sources:
        if not SOURCE.fullmatch(source):
            _refuse(
                f"names {source!r}, which is no run", where, 'Write "A1", or "A1:linear" for a model beside.'
            )


def _measure(name: str, where: str) -> None:
    if name not in MEASURES:
        step = did_you_mean(name, MEASURES).rstrip() or f"There are {', '.join(MEASURES)}."
        _refuse(f"names the measure {name!r}, which is not recorded", where, step)


def _refuse(fact: str, where: str, step: str) -> None:
    raise UsageError(fact, where=where, next_step=step)
