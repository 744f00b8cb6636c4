"""etude promote, etude rollback, etude watch"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, code_of, opened, table
from etude.codes import Refusal
from etude.errors import typed

if TYPE_CHECKING:
    from etude.campaign.deployment.monitor import Watched, WatchedLog
    from etude.campaign.deployment.promote import Promotion

REFUSED = 3  # exit code of docs/reference: the model is not better
MORE_LOGS = (Refusal.NOT_DECIDED, Refusal.NOT_CALIBRATED)
"""Objections that another log answers, whatever the stop rule says."""


@dataclass(frozen=True, kw_only=True)
class Promote(Common):
    """Put the newest model in use if it is better on unseen motion than the model in use and no worse than
    physics.

    Exit code 3: it is not better, or the data do not decide.
    """

    folder: Folder
    force: bool = False
    """Put the model in use whatever the errors are. The journal records this with the reason."""
    reason: str = ""
    """The reason. Required with --force."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.promote import promote
        from etude.campaign.record.known_faults import affected
        from etude.cli.status import faults

        campaign = opened(self.folder)
        promotion = promote(campaign, force=self.force, reason=self.reason, say=say)
        data = asdict(promotion) | {"decisions": [one.decision for one in promotion.compared]}
        lines = _lines(promotion, campaign.command.parts)
        left = affected(campaign, campaign.state())
        data |= {"refused": [one.facts() for one in promotion.refused]}
        data |= {"known_faults": [asdict(one) for one in left]}
        lines += faults([asdict(one) | {"sentence": one.sentence} for one in left])
        if any(one.code in MORE_LOGS for one in promotion.refused) and not promotion.promoted:
            lines.append(f"Next: etude ask {typed(self.folder)} --continue, then run it and ingest its log.")
        if promotion.promoted:
            lines.append(
                f"Next: etude export {typed(self.folder)} --to c, and etude watch {typed(self.folder)} LOG."
            )
        text = "\n".join(lines)
        return Outcome(text, data, 0 if promotion.promoted else REFUSED)


def _lines(promotion: Promotion, commands: Sequence[str]) -> list[str]:
    model = f"The model of log {promotion.number} ({promotion.sha256[:12]})"
    if promotion.repeated:
        return [f"{model} is already in use."]
    rows = [
        [
            one.against,
            str(one.segments),
            f"{one.ratio:.3f}",
            f"{one.lower:.3f} .. {one.upper:.3f}",
            *("-" if math.isnan(ratio) else f"{ratio:.3f}" for ratio in one.by_command),
            one.decision,
        ]
        for one in promotion.compared
    ]
    lines = ["Errors on segments that neither model was trained on, relative to:"] if rows else []
    lines += [table(["", "segments", "ratio", "95 %", *commands, ""], rows)] if rows else []
    if promotion.wide:
        parts = [
            [name, *("-" if part is None else f"{100 * part:.0f} %" for part in shares)]
            for name, shares in (("50 %", promotion.narrow), ("95 %", promotion.wide))
        ]
        lines += ["Held-out commands inside its intervals:", table(["interval", *commands], parts)]
    lines += [f"{one.sentence[:1].upper()}{one.sentence[1:]}." for one in promotion.refused]
    if not promotion.promoted:
        return [*lines, f"{model} is not promoted. --force --reason WHY puts it in use anyway."]
    return [*lines, f"{model} is in use now{', forced' if promotion.forced else ''}."]


@dataclass(frozen=True, kw_only=True)
class Rollback(Common):
    """Go back to the model that was in use before the last promotion; nothing is deleted."""

    folder: Folder
    reason: str = ""
    """The reason, for the journal."""

    def run(self, _: Say) -> Outcome:
        from etude.campaign.deployment.promote import rollback

        left, back = rollback(opened(self.folder), reason=self.reason)
        text = f"The model of log {left} is no longer in use; that of log {back} is."
        return Outcome(text, {"left": left, "in_use": back})


@dataclass(frozen=True, kw_only=True)
class Watch(Common):
    """Compare logs of any motion with the model in use; nothing is learned.

    Exit code 6: the robot has changed. Exit code 3: a log cannot be used.
    """

    folder: Folder
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG...")] = ()
    """Logs in any format that etude tell reads, oldest first."""
    degrees: bool = False
    """All angles and rates of the logs are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: use the logs without a repair. Can be given several times."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: repair the logs. Can be given several times."""
    no_ask: bool = False
    """Do not propose a motion if the robot has changed."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.deployment.monitor import watch

        watched = watch(
            opened(self.folder),
            self.logs,
            degrees=self.degrees,
            accept=self.accept,
            repair=self.repair,
            propose=not self.no_ask,
            say=say,
        )
        refused = any(one.verdict == "refused" for one in watched.logs)
        code = code_of(changed=watched.changed, refused=refused)
        return Outcome("\n".join(_watched_lines(watched, self.folder)), _data(watched), code)


def _watched_lines(watched: Watched, folder: Path) -> list[str]:
    width = max(len(one.path.name) for one in watched.logs)
    lines = [f"{one.path.name.ljust(width)}  {_verdict_prefix(one)}{one.sentence}" for one in watched.logs]
    lines.append(watched.sentence)
    if watched.proposal is not None:
        made = watched.proposal
        lines.append(f"Proposed: trajectory {made.number}, {made.duration:g} s, in {made.folder}")
        lines.append(f"Run it, then: etude tell {typed(folder)} LOG --changed new")
        lines.append(
            f"Then one more: etude ask {typed(folder)}. One log alone may contain less information than the "
            "earlier logs."
        )
    elif watched.no_proposal:
        lines.append(f"No motion is proposed: {watched.no_proposal}.")
    return lines


def _verdict_prefix(one: WatchedLog) -> str:
    return "refused: " if one.verdict == "refused" else ""


def _data(watched: Watched) -> dict[str, Any]:
    names = ("verdict", "sentence", "seconds", "kind", "cause", "evidence", "z2", "command")
    made = watched.proposal
    return {
        "model": {
            "number": watched.used.number,
            "sha256": watched.used.sha256,
            "promoted": watched.used.promoted,
        },
        "logs": [
            {"path": str(one.path), **{name: getattr(one, name) for name in names}} for one in watched.logs
        ],
        "changed": watched.changed,
        "kind": watched.kind,
        "onset": watched.drift_onset,
        "sentence": watched.sentence,
        "proposal": None
        if made is None
        else {"number": made.number, "folder": str(made.folder), "duration": made.duration},
    }
