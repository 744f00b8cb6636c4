"""Findings of a log as the journal keeps them: facts of its `told` event, under "findings"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from etude.types import Finding

FACT = "findings"
_NAMES = {field.name for field in fields(Finding)}


def as_facts(findings: Sequence[Finding]) -> dict[str, Any]:
    """Facts for the event; none where nothing was found."""
    return {FACT: [asdict(finding) for finding in findings]} if findings else {}


def kept_findings(told: Mapping[str, Any] | None) -> tuple[Finding, ...]:
    """The findings of a `told` event; what a later version adds to them is left out."""
    found = []
    for facts in (told or {}).get(FACT, ()):
        known = {name: value for name, value in facts.items() if name in _NAMES}
        spans = tuple((float(since), float(until)) for since, until in known.pop("spans", ()))
        found.append(Finding(**known, spans=spans))
    return tuple(found)
