"""Keys of campaign.toml that Étude 0.1 had under other names: read all the same, with a sentence for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from etude.errors import UsageError

KINDS = {"joints": "arm", "vehicle": "quadrotor"}
"""Names that kinds of robot had."""


@dataclass(frozen=True)
class Renamed:
    """One key of old.

    Attributes:
        old: "table.key".
        new: "table.key" that took its place; "" if nothing had to.
        values: old value -> new one, where these changed too; the rule then holds for these values alone.
        reason: why nothing took its place.
    """

    old: str
    new: str
    values: Mapping[str, str] | None = None
    reason: str = ""


RENAMED = (
    Renamed("model.kind", "model.rung"),
    Renamed("model.kernel", "model.sharing", {"shared": "shared", "separate": "separate"}),
    Renamed("model.hyperparameters", "model.schedule", {"refit": "update", "first_flight": "first"}),
    Renamed("model.friction_fraction", "data.friction_fraction"),
    Renamed("model.altitude", "data.altitude"),
    Renamed("model.acceleration", "data.acceleration"),
    Renamed("model.body_velocity", "data.body_velocity"),
    Renamed("model.trims", "data.trims"),
    Renamed("model.guard", "", reason="linear regression is a rung of the ladder now"),
    Renamed("design.starts", "design.refine"),
    Renamed("design.method", "", reason="there is one search, with exact gradients"),
)


def modern(
    table: Mapping[str, Any], known: Mapping[str, tuple[str, ...]], where: str
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The tables of a campaign.toml under today's names, and one sentence for each key that was renamed.

    Args:
        table: what the file says.
        known: today's keys of each table; a key that stands there is not renamed, whatever it was once.
        where: the file.

    Raises:
        UsageError: the file has a key under both names.
    """
    tables = {name: dict(part) if isinstance(part, Mapping) else part for name, part in table.items()}
    sentences = []
    for rule in RENAMED:
        section, key = rule.old.split(".")
        part = tables.get(section)
        if not isinstance(part, dict) or key not in part or (rule.values is None and key in known[section]):
            continue
        if rule.values is not None and part[key] not in rule.values:
            continue
        value = part.pop(key)
        if not rule.new:
            sentences.append(f"{rule.old} in campaign.toml has no use any more: {rule.reason}.")
            continue
        _put(tables, rule, value if rule.values is None else rule.values[value], where)
        sentences.append(f"{rule.old} in campaign.toml is called {rule.new} now; it was read as that.")
    return tables, tuple(sentences)


def _put(tables: dict[str, Any], rule: Renamed, value: Any, where: str) -> None:
    section, key = rule.new.split(".")
    part = tables.setdefault(section, {})
    if isinstance(part, dict) and key in part:
        raise UsageError(f"{rule.old} and {rule.new} say the same thing twice", where=where)
    if isinstance(part, dict):
        part[key] = value
