"""The verdict on every claim: its parts' words combined, after the correction for how many are asked at once.

Own claims that rest on the same table or figure first are a family (Holm, 5 %); what the thesis observed,
explained or cited is one more (Benjamini and Hochberg, 10 %), marked exploratory. Only parts that claim a
direction are in a family. A part without a test stays in it with p = 1: a family is as large as planned,
whatever has been run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace as changed_copy
from functools import partial
from typing import TYPE_CHECKING, cast

from etude.errors import UsageError
from etude.types import Array
from etude_studies.thesis import statistics
from etude_studies.thesis.contrasts import Values, contrasts
from etude_studies.thesis.ledger_items import Claim, Part
from etude_studies.thesis.part_verdicts import (
    NOT_RUN,
    SECOND,
    UNDECIDED,
    UNTESTED,
    WORDS,
    PartVerdict,
    Weighed,
    part_verdict,
    weigh,
)
from etude_studies.thesis.settling import HALF
from etude_studies.thesis.verdict_file import Verdict, changed, from_json, to_json

if TYPE_CHECKING:
    from etude_studies.thesis.ledger import Ledger

__all__ = ["Verdict", "changed", "from_json", "judge", "to_json"]

EXPLORATORY = "exploratory"
OWN_LEVEL, EXPLORATORY_LEVEL = 0.05, 0.10


def judge(
    ledger: Ledger,
    results: Values,
    *,
    planned: Mapping[str, int] | None = None,
    blocks: Mapping[str, int] | None = None,
    usual: Mapping[str, Sequence[Weighed]] | None = None,
) -> dict[str, Verdict]:
    """A verdict on every claim, by id, in the ledger's order.

    Args:
        ledger: the claims.
        results: what was measured.
        planned: seeds by run, where that is not the claim's own number; those beyond do not count.
        blocks: by claim the seeds that it has asked for; they count where all its runs have them.
        usual: of another reading what `weighed` finds in the usual one. Parts that are the same keep it;
            those that have not been run so keep its p in the correction of the others.

    Raises:
        UsageError: a part that its statistic can do nothing with, an alias of no claim or of itself, or a
            claim with neither parts nor alias nor reason.
    """
    corrected = weighed(ledger, results, planned=planned, blocks=blocks, usual=usual)
    by_id = {claim.id: claim for claim in ledger.claims}
    verdicts: dict[str, Verdict] = {}
    for claim in ledger.claims:
        _settle(claim.id, by_id, corrected, verdicts, ())
    return {claim.id: verdicts[claim.id] for claim in ledger.claims}


def weighed(
    ledger: Ledger,
    results: Values,
    *,
    planned: Mapping[str, int] | None = None,
    blocks: Mapping[str, int] | None = None,
    usual: Mapping[str, Sequence[Weighed]] | None = None,
) -> dict[str, list[Weighed]]:
    """The parts of every claim with adjusted p; see `judge`."""
    read = partial(_weighed, results=results, planned=planned)
    weighed_parts = {
        claim.id: _block(claim, read, (blocks or {}).get(claim.id, 0)) for claim in ledger.claims
    }
    if usual is None:
        return _corrected(ledger.claims, weighed_parts)
    pairs = {id: list(zip(parts, usual[id], strict=True)) for id, parts in weighed_parts.items()}
    settled = {id: [_settled(one, old) for one, old in parts] for id, parts in pairs.items()}
    corrected = _corrected(ledger.claims, settled)
    return {
        id: [
            old if old.part == one.part else new for (one, old), new in zip(parts, corrected[id], strict=True)
        ]
        for id, parts in pairs.items()
    }


def _settled(one: Weighed, old: Weighed) -> Weighed:
    """A part for the correction of others: with the p of the usual reading where this one has none."""
    if one.part == old.part:
        return old
    return changed_copy(one, p=old.p, p_permutation=old.p_permutation) if one.reason else one


def _block(claim: Claim, read: Callable[..., list[Weighed]], seeds: int) -> list[Weighed]:
    """The parts on the block of seeds that was asked for, if all runs have it; else on the planned seeds."""
    if seeds:
        block_parts = read(claim, block=seeds)
        if block_parts and all(min(one.contrast.stored.values()) >= seeds for one in block_parts):
            return block_parts
    return read(claim)


def _weighed(
    claim: Claim,
    block: int = 0,
    *,
    results: Values,
    planned: Mapping[str, int] | None,
) -> list[Weighed]:
    """The parts of a claim with their own p values."""
    return [
        weigh(index, part, contrast, _printed(part, contrast.k), SECOND if block else 1)
        for index, part in enumerate(() if claim.untestable else claim.parts)
        for contrast in contrasts(part, results, planned=planned, seeds=claim.seeds, block=block)
    ]


def _corrected(
    claims: Sequence[Claim], weighed_parts: Mapping[str, list[Weighed]]
) -> dict[str, list[Weighed]]:
    """The same with adjusted p; parts of one family are adjusted together."""
    families: dict[str, list[tuple[str, int]]] = {}
    for claim in claims:
        directed = [(claim.id, place) for place, one in enumerate(weighed_parts[claim.id]) if one.directed]
        families.setdefault(_family(claim), []).extend(directed)
    out = {id: list(parts) for id, parts in weighed_parts.items()}
    for family, members in families.items():
        for (id, place), one in zip(members, _adjusted(family, [out[i][j] for i, j in members]), strict=True):
            out[id][place] = one
    return out


def _family(claim: Claim) -> str:
    return next(iter(claim.rests_on), claim.id) if claim.kind == "own" else EXPLORATORY


def _adjusted(family: str, parts: Sequence[Weighed]) -> list[Weighed]:
    level, adjust, levels = _correction(family)
    p, flips = [one.p for one in parts], [one.p_permutation for one in parts]
    columns = zip(parts, adjust(p), adjust(flips), levels(p, level), strict=True)
    return [
        changed_copy(
            one, p_adjusted=float(p), p_permutation_adjusted=float(flips), level=level, to_meet=float(at)
        )
        for one, p, flips, at in columns
    ]


def _correction(
    family: str,
) -> tuple[
    float,
    Callable[[Sequence[float]], Array],
    Callable[[Sequence[float], float], Array],
]:
    if family == EXPLORATORY:
        return EXPLORATORY_LEVEL, statistics.benjamini_hochberg, statistics.benjamini_hochberg_levels
    return OWN_LEVEL, statistics.holm, statistics.holm_levels


def _settle(
    id: str,
    claims: Mapping[str, Claim],
    weighed_parts: Mapping[str, list[Weighed]],
    verdicts: dict[str, Verdict],
    chain: tuple[str, ...],
) -> Verdict:
    """The verdict on `id`, those that it says again first."""
    if id in verdicts:
        return verdicts[id]
    if id not in claims or id in chain:
        fact = f"{id!r} is no claim" if id not in claims else f"{id!r} says again itself"
        raise UsageError(fact, where=" -> ".join((*chain, id)), next_step="Correct alias_of in the claims.")
    claim = claims[id]
    if claim.alias_of:
        others = [_settle(other, claims, weighed_parts, verdicts, (*chain, id)) for other in claim.alias_of]
        verdicts[id] = _again(claim, others)
    else:
        verdicts[id] = _verdict(claim, weighed_parts[id])
    return verdicts[id]


def _verdict(claim: Claim, weighed_parts: Sequence[Weighed]) -> Verdict:
    exploratory = claim.kind != "own"
    if claim.untestable:
        return Verdict(claim.id, UNTESTED, (), exploratory, claim.simulated, claim.untestable)
    if not weighed_parts:
        fact = "a claim without parts says neither what it repeats nor why it cannot be tested"
        raise UsageError(fact, where=claim.id, next_step="Give parts, alias_of or untestable.")
    parts = tuple(part_verdict(one) for one in weighed_parts)
    word = _combined(claim.combine, parts)
    block = weighed_parts[0].contrast.planned if weighed_parts[0].looks == SECOND else 0
    asks = None if block or word != UNDECIDED else _asks(parts)
    reason = _reason(word, parts, block)
    return Verdict(claim.id, word, parts, exploratory, claim.simulated, reason, asks=asks, block=block)


def _combined(combine: str, parts: Sequence[PartVerdict]) -> str:
    """The worst word, or of "any" the best part's, where a part with several k has the worst of them."""
    by_part = [
        worst([one.word for one in parts if one.part == index]) for index in sorted({p.part for p in parts})
    ]
    if UNTESTED in by_part or combine == "all":
        return worst(by_part)
    return max(by_part, key=WORDS.index)


def worst(words: Sequence[str]) -> str:
    """The word furthest from "holds"."""
    return min(words, key=WORDS.index)


def _asks(parts: Sequence[PartVerdict]) -> int | None:
    """Seeds that would decide every part that is not decided; None: no number would."""
    needed = [part.needed for part in parts if part.word == UNDECIDED]
    return None if None in needed else max(cast(list[int], needed))


def _reason(word: str, parts: Sequence[PartVerdict], block: int) -> str:
    if word == UNTESTED:
        return _untested(dict.fromkeys(part.reason for part in parts if part.reason))
    if word != UNDECIDED:
        return ""
    power = min(part.power or 0.0 for part in parts if part.word == UNDECIDED)
    weak = [f"cannot tell at this n (power {power:.2f})"] if power < HALF else []
    seeds = _asks(parts) or "no number of"
    hint = f"its block of {block} seeds is used" if block else f"{seeds} seeds would decide at this spread"
    return "; ".join([*weak, hint])


def _untested(reasons: Iterable[str]) -> str:
    """The reasons, runs that are missing named once."""
    waits = f"{NOT_RUN}: runs "
    lack = [reason.removeprefix(waits) for reason in reasons if reason.startswith(waits)]
    runs = dict.fromkeys(name for names in lack for name in names.split(", "))
    others = [reason for reason in reasons if not reason.startswith(waits)]
    return "; ".join([*([waits + ", ".join(runs)] if runs else []), *others])


def _again(claim: Claim, others: Sequence[Verdict]) -> Verdict:
    word = worst([other.word for other in others])
    requests = [other.asks for other in others if other.word == UNDECIDED]
    reasons = dict.fromkeys(other.reason for other in others if other.word == word and other.reason)
    return Verdict(
        claim.id,
        word,
        tuple(part for other in others for part in other.parts),
        any(other.exploratory for other in others),
        claim.simulated or any(other.simulated for other in others),
        "; ".join(reasons),
        tuple(claim.alias_of),
        asks=None if None in requests else max(cast(list[int], requests), default=None),
    )


def _printed(part: Part, k: int | None) -> float | None:
    """The thesis's own number; of "ratio_each" it stands at the last count, as its tables do."""
    return part.printed if k is None or k == part.at[-1] else None
