"""etude plugins"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from etude.cli.outcome import Common, Outcome, Say

if TYPE_CHECKING:
    from etude.plugins import Plugin


@dataclass(frozen=True, kw_only=True)
class Plugins(Common):
    """List what can be exchanged: robots, models, kernels, criteria, readers, exporters and studies."""

    def run(self, _: Say) -> Outcome:
        from etude.plugins import GROUPS, listed

        found = listed(tried=True)
        lines = []
        for group in GROUPS:
            rows = [_row(plugin) for plugin in found if plugin.group == group]
            lines += [group, *(_columns(rows) or ["  none yet"]), ""]
        lines += _problems(found)
        return Outcome("\n".join(lines).rstrip(), {"plugins": [asdict(plugin) for plugin in found]})


def _row(plugin: Plugin) -> tuple[str, str, str]:
    """Name, what it names, and the package that brings it where that is another one."""
    source = "" if plugin.source == "etude" else f"({plugin.source})"
    return f"{plugin.name}{' (!)' if plugin.problem else ''}", plugin.target, source


def _columns(rows: Sequence[tuple[str, str, str]]) -> list[str]:
    """The rows with their columns under each other."""
    first, second = (max((len(row[i]) for row in rows), default=0) for i in (0, 1))
    return [f"  {name:<{first}}  {target:<{second}}  {source}".rstrip() for name, target, source in rows]


def _problems(found: Sequence[Plugin]) -> list[str]:
    return [f"(!) {p.name} of {p.group} ({p.source}): {p.problem}." for p in found if p.problem]
