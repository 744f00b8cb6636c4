"""etude watch"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, code_of, opened

if TYPE_CHECKING:
    from etude.campaign.deployment.monitor import Watched, WatchedLog


@dataclass(frozen=True, kw_only=True)
class Watch(Common):
    """Hold logs of any motion against the model in use; nothing is learned. Exit code 6: the robot has
    changed; 3: a log cannot be used.
    """

    folder: Folder
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG...")] = ()
    """Files of any format that tell takes, oldest first."""
    degrees: bool = False
    """All angles and rates of the logs are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose question is answered: the logs are taken as they are. May be given again."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose finding is put right. May be given again."""
    no_ask: bool = False
    """Propose no motion where the robot has changed."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.monitor import watch

        found = watch(
            opened(self.folder),
            self.logs,
            degrees=self.degrees,
            accept=self.accept,
            repair=self.repair,
            propose=not self.no_ask,
            say=say,
        )
        refused = any(one.verdict == "refused" for one in found.logs)
        code = code_of(changed=found.changed, refused=refused)
        return Outcome("\n".join(_lines(found, self.folder)), _data(found), code)


def _lines(found: Watched, folder: Path) -> list[str]:
    width = max(len(one.path.name) for one in found.logs)
    lines = [f"{one.path.name.ljust(width)}  {_word(one)}{one.sentence}" for one in found.logs]
    lines.append(found.sentence)
    if found.proposal is not None:
        made = found.proposal
        lines.append(f"Proposed: trajectory {made.number}, {made.duration:g} s, in {made.folder}")
        lines.append(f"Run it, then: etude tell {folder} LOG --changed new")
        lines.append(f"Then one more: etude ask {folder}. One log alone may teach less than is known.")
    elif found.no_proposal:
        lines.append(f"No motion is proposed: {found.no_proposal}.")
    return lines


def _word(one: WatchedLog) -> str:
    return "refused: " if one.verdict == "refused" else ""


def _data(found: Watched) -> dict[str, Any]:
    names = ("verdict", "sentence", "seconds", "kind", "cause", "evidence", "z2", "command")
    made = found.proposal
    return {
        "model": {
            "number": found.used.number,
            "sha256": found.used.sha256,
            "promoted": found.used.promoted,
        },
        "logs": [
            {"path": str(one.path), **{name: getattr(one, name) for name in names}} for one in found.logs
        ],
        "changed": found.changed,
        "kind": found.kind,
        "manner": found.manner,
        "sentence": found.sentence,
        "proposal": None
        if made is None
        else {"number": made.number, "folder": str(made.folder), "duration": made.duration},
    }
