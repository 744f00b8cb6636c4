"""etude ask"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, opened, table
from etude.deploy.trajectory_files import to_confirm
from etude.errors import UsageError, typed

if TYPE_CHECKING:
    from etude.campaign.propose.approach import Approached
    from etude.campaign.propose.ask import Proposal
    from etude.campaign.propose.export import ExportedMotion
    from etude.campaign.propose.proposal import Swept
    from etude.campaign.record.folder import Campaign
    from etude.limits.certificate import Certificate
    from etude.types import Proof

ROW = ["axis", "quantity", "planned", "tracking margin", "limit", "used"]
FILES = ("trajectory.csv", "trajectory.json", "certificate.json")
FEEDFORWARD = "feedforward.csv"
SLOWLY = "Run it slowly first, with --speed 50: some tracking margins are assumed, as no log has shown them."
NEAREST = 6
"""Distances that are shown one by one; an arm has dozens."""
DISTANCES = {"clearance": ("distances", "distance (m)", " m")}
"""Quantities without an upper end whose unit is known: what many are, the head of their table, the unit."""


@dataclass(frozen=True, kw_only=True)
class Ask(Common):
    """Write the next trajectory, certified inside the limits; the same one until its log is ingested."""

    folder: Folder
    speed: Literal[25, 50, 100] = 100
    """Speed in per cent. Below 100 the robot follows the same path more slowly, for a careful first run."""
    tasks: Path | None = None
    """The motions that the model is for: a trajectory.json, or a CSV with the time and a column for each
    axis."""
    format: tuple[str, ...] = ()
    """Also write the motion for the program that plays it: ros2, ros2_sqlite, ros2_yaml, ros2_csv, px4,
    crazyflie, lerobot, urscript, urscript_cb, or an exporter of another package. The motion is certified as
    its receiver interpolates it."""
    effort: bool = False
    """Add the learned command in the format's effort field, for controllers that use it (docs/exports.md)."""
    start: Annotated[str, tyro.conf.arg(name="from")] = ""
    """Where the robot is: home, ground (flights), joint=value,... or a CSV whose last row is its position.
    Approach and return are then certified and written too, with take-off and landing for flights. Other
    formats hold all parts in one file."""
    control: Literal["feedback", "file", "learned", ""] = ""
    """Control during the motion: feedback alone, or feedback with the feedforward of the robot file's model
    or of the learned model. Default: learned with --effort, else feedback. Tracking margins come from logs of
    the same control."""
    confirm: bool = False
    """Write a motion that is never used for training. Run it without and with the learned feedforward, then
    ingest both logs with etude tell --confirm."""
    payload: bool = False
    """Write a motion of about 10 s that identifies the payload, for etude payload. It is never used for
    training."""
    new: bool = False
    """Write another trajectory although one is open."""
    go_on: Annotated[bool, tyro.conf.arg(name="continue")] = False
    """Write a trajectory although the stop rule has fired."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.propose.proposal import as_facts

        campaign = opened(self.folder)
        proposal = self._propose(campaign, say)
        unverified, slowly = (
            _unverified(proposal),
            self.speed == 100 and _has_assumed_margin(proposal.certificate),
        )
        files = [str(proposal.folder / name) for name in (*FILES, *((FEEDFORWARD,) if self.confirm else ()))]
        lines = [
            *(f"! {notice}" for notice in proposal.certificate.warnings),
            f"Trajectory {proposal.number}, {proposal.duration:g} s: {proposal.status}",
            *_renewed(proposal),
            table(ROW, _rows([row for row in proposal.certificate.seen if row.upper < math.inf]), keys=2),
            *_distances([row for row in proposal.certificate.seen if row.upper == math.inf]),
            *_swept_table(proposal.swept),
            *_control(proposal.certificate),
            f"Proved for all times{_sampled(proposal.certificate)}; {_ends(proposal.certificate)}.",
            *_to_confirm(campaign.spec),
            "Not verified:",
            *(f"  - {sentence}" for sentence in unverified),
            "Written:",
            *(f"  {name}" for name in files),
            *([] if proposal.approach is None else _approach(proposal.approach)),
            *(line for one in proposal.exported for line in _exported(one)),
            *([] if self.start else _start_poses(campaign)),
            *([SLOWLY] if slowly else []),
            *_next_steps(self),
        ]
        data = {
            "number": proposal.number,
            "new": proposal.new,
            "status": proposal.status,
            "duration": proposal.duration,
            "speed": self.speed,
            "files": files,
            "certified": proposal.certificate.ok,
            "exported": {one.format: [str(path) for path in one.files] for one in proposal.exported},
            "slack": _slack(proposal.certificate.seen),
            "way": [] if proposal.approach is None else [str(path) for path in proposal.approach.files],
            "renewed": _renewed(proposal),
            "to_confirm": to_confirm(campaign.spec),
            "not_verified": unverified,
            "warnings": [one.facts() for one in proposal.certificate.warnings],
            "swept": as_facts(proposal.swept),
        }
        return Outcome("\n".join(lines), data)

    def _propose(self, campaign: Campaign, say: Say) -> Proposal:
        if self.confirm:
            from etude.campaign.evaluate.confirm import ask_to_confirm

            if self.tasks or self.start or self.control or self.speed != 100:
                raise UsageError(
                    "a confirmation motion takes no --tasks, --from, --control or --speed",
                    where="--confirm",
                )
            return ask_to_confirm(campaign, new=self.new, formats=self.format, effort=self.effort, say=say)
        if self.payload:
            from etude.campaign.deployment.payload_motion import ask_to_weigh

            if self.tasks or self.control or self.effort:
                raise UsageError(
                    "a payload motion takes no --tasks, --control or --effort", where="--payload"
                )
            return ask_to_weigh(
                campaign, new=self.new, speed=self.speed, formats=self.format, start=self.start, say=say
            )
        from etude.campaign.propose.ask import ask

        return ask(
            campaign,
            new=self.new,
            go_on=self.go_on,
            speed=self.speed,
            tasks=self.tasks,
            formats=self.format,
            effort=self.effort,
            start=self.start,
            control=self.control,
            say=say,
        )


def _swept_table(rows: Sequence[Swept]) -> list[str]:
    """Table of the range that the segments cover on each axis, and of the limits on it."""
    if not rows:
        return []
    body = [[r.axis, f"{100 * r.of_range:.0f} %", f"{100 * r.of_clear:.0f} %", r.held] for r in rows]
    return [table(["swept", "of the range", "of the collision-free range", "limited by"], body)]


def _next_steps(command: Ask) -> list[str]:
    folder = typed(command.folder)
    if command.payload:
        return [f"Run it with the payload, then: etude payload {folder} --log LOG"]
    if not command.confirm:
        return [f"Run it, then: etude tell {folder} LOG"]
    return [
        f"Run trajectory.csv, the feedback alone: etude tell {folder} LOG --confirm without",
        f"Run {FEEDFORWARD}, which adds the model's commands: etude tell {folder} LOG --confirm with",
    ]


def _renewed(proposal: Proposal) -> list[str]:
    """Sentences on the files that were written anew, with the reasons."""
    sentences = [*proposal.renewed, *(() if proposal.approach is None else proposal.approach.renewed)]
    return [*sentences, *(sentence for one in proposal.exported for sentence in one.renewed)]


def _unverified(proposal: Proposal) -> list[str]:
    """Sentences on what is not verified; without the approach if it was proved."""
    from etude.limits.certificate import APPROACH

    return [one for one in proposal.certificate.not_verified if proposal.approach is None or one != APPROACH]


def _approach(approach: Approached) -> list[str]:
    """Lines on the files of approach and return."""
    pose = ", ".join(f"{axis} = {value:.4g}" for axis, value in approach.pose.items())
    lines = [f"Certified approach from {pose} and return: {approach.folder}"]
    lines += [f"  {path}" for path in approach.files]
    if approach.whole is None:
        lines.append(
            "The plan does not start and end at rest: approach, plan and return are separate motions."
        )
    return lines


def _to_confirm(spec: Any) -> list[str]:
    """Lines on unconfirmed assumptions about the robot."""
    assumed = to_confirm(spec)
    head = "Assumptions about the robot; once one is confirmed, remove its line from confirm in robot.toml:"
    return [head, *(f"  - {sentence}" for sentence in assumed)] if assumed else []


def _control(certificate: Certificate) -> list[str]:
    """Line on the control that the tracking margins apply to."""
    under = next((row.control for row in certificate.seen if row.control), "")
    return [f"Tracking margins: under {under}."] if under else []


def _has_assumed_margin(certificate: Certificate) -> bool:
    """Whether a tracking margin is assumed, without any log behind it."""
    return any(row.tracking_margin > 0.0 and row.confidence == 0.0 for row in certificate.seen)


def _rows(rows: Sequence[Proof]) -> list[list[str]]:
    """Cells of each row; rows with equal axis and quantity also name their part."""
    times = Counter((row.axis, row.quantity) for row in rows)
    parts = [row.where.partition(" at ")[0] if times[row.axis, row.quantity] > 1 else "" for row in rows]
    return [_row(row, part) for row, part in zip(rows, parts, strict=True)]


def _row(row: Proof, part: str) -> list[str]:
    """Cells of one row: planned range, tracking margin and limit."""
    from etude.limits.certificate import tracked_in_words, utilization

    planned = f"{row.proved_lower:.3g}..{row.proved_upper:.3g}"
    limit = f"{row.lower - row.tracking_margin:.3g}..{row.upper + row.tracking_margin:.3g}"
    quantity = f"{row.quantity}, {part}" if part else row.quantity
    return [row.axis, quantity, planned, tracked_in_words(row), limit, f"{100 * utilization(row):.0f} %"]


def _slack(rows: Sequence[Proof]) -> dict[str, float]:
    """Least slack of each axis and quantity, by "axis quantity"."""
    from etude.limits.certificate import slack

    slacks: dict[str, float] = {}
    for row in rows:
        name = f"{row.axis} {row.quantity}"
        slacks[name] = min(slack(row), slacks.get(name, math.inf))
    return slacks


def _distances(rows: Sequence[Proof]) -> list[str]:
    """Lines on quantities without an upper limit, such as distances; each quantity separately."""
    names = dict.fromkeys(row.quantity for row in rows)
    return [line for name in names for line in _least([row for row in rows if row.quantity == name])]


def _least(rows: Sequence[Proof]) -> list[str]:
    """Lines on one such quantity: the rows nearest to their limits. Custom quantities have no known unit."""
    from etude.limits.certificate import place_of, utilization

    rows = sorted(rows, key=utilization, reverse=True)
    name, head, unit = DISTANCES.get(rows[0].quantity, (f"{rows[0].quantity} rows", rows[0].quantity, ""))
    near = [[row.axis, f"{row.proved_lower:.4g}", f"{row.lower:.4g}"] for row in rows[:NEAREST]]
    lines = [table([f"{head} of", "proved at least", "to keep"], near)]
    where = [f"  - {row.axis}: {place_of(row)}" for row in rows[:NEAREST] if place_of(row)]
    lines += ["Places of the least distances:", *where] if where else []
    others = rows[NEAREST:]
    if others:
        least = min(row.proved_lower for row in others)
        lines.append(f"{len(others)} more {name}, all at least {least:.4g}{unit}.")
    return lines


def _sampled(certificate: Certificate) -> str:
    """Clause for each sampled quantity, with its method."""
    rows = {row.quantity: row.method for row in certificate.rows if row.status == "sampled"}
    return "".join(f", except {quantity}: {method.split(';')[0]}" for quantity, method in rows.items())


def _start_poses(campaign: Campaign) -> list[str]:
    """Lines on further start poses of this kind of robot, such as the ground."""
    from etude.campaign.propose.approach import HOME, poses_of

    names = [name for name in poses_of(campaign) if name != HOME]
    return [f"With certified take-off and landing: the same command with --from {name}." for name in names]


def _ends(certificate: Certificate) -> str:
    if certificate.at_rest:
        return "at rest at both ends"
    return (
        f"the plan does not start and end at rest, but at {100 * certificate.end_speed:.0f} % of the speed "
        "limit"
    )


def _exported(one: ExportedMotion) -> list[str]:
    """Lines on the exported files and the certificate of the motion that their receiver plays."""
    missing = [row for row in one.certificate.rows if row.status == "not verified"]
    but = (
        f"; not verified: {', '.join(row.quantity for row in missing)} ({missing[0].method})"
        if missing
        else ""
    )
    head = f"For {one.format}, certified as its receiver interpolates it{but}:"
    return [head, *(f"  {path}" for path in one.files), *one.certificate.notes]
