"""What has to be known before a robot is moved: each thing that is open is a sentence, and blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.campaign.record.events import MotionSent
from etude.campaign.record.folder import ROBOT, Campaign
from etude.campaign.run.run_history import last_identity, unfinished
from etude.deploy.trajectory_files import command_unit, to_confirm
from etude.drivers import About
from etude.errors import UsageError, typed
from etude.types import Array

STATED = ("command_of", "gravity_in_command")
"""Fields of `About` that may be None, which blocks."""
ORDERS = ("velocity", "acceleration")
SLACK = 1e-6
"""Part of a limit by which the robot's may be narrower: rounding of files."""


@dataclass(frozen=True)
class Open:
    """What blocks. waived: a person may let it pass by agreeing to a motion of a simulation."""

    sentence: str
    step: str
    waived: bool = False


def open_points(campaign: Campaign, about: About, *, resume: bool, identity: str) -> list[Open]:
    """All that blocks this robot from being moved for this campaign.

    Args:
        resume: a person has looked at where a motion without an end has left the robot.
        identity: that the person says the robot has now, though it was another before.
    """
    return [
        *_unstated(about),
        *_joints(campaign, about),
        *_unit(campaign, about),
        *_limits(campaign, about),
        *_confirm(campaign),
        *_identity(campaign, about, identity),
        *_unfinished(campaign, resume),
        *_waiting(campaign),
    ]


def require_none(campaign: Campaign, found: Sequence[Open], *, simulated: bool) -> list[str]:
    """The sentences that a simulation waives. UsageError with all others."""
    blocking = [one for one in found if not (one.waived and simulated)]
    if blocking:
        raise UsageError(
            f"nothing was moved, since this is open: {' '.join(one.sentence for one in blocking)[:-1]}",
            where=str(campaign.path),
            next_step=" ".join(dict.fromkeys(one.step for one in blocking)),
        )
    return [one.sentence for one in found]


def _unstated(about: About) -> list[Open]:
    own = [name for name in STATED if getattr(about, name) is None]
    step = "The driver's About has to say it; nothing of it is guessed."
    return [Open(f"The driver does not say {name} of {about.name}.", step) for name in own]


def _joints(campaign: Campaign, about: About) -> list[Open]:
    lacking = [axis for axis in campaign.axes if axis not in about.joints]
    beyond = [joint for joint in about.joints if joint not in campaign.axes]
    if not lacking and not beyond:
        return []
    parts = [f"it {what} {', '.join(own)}" for what, own in (("lacks", lacking), ("has", beyond)) if own]
    step = f"Name the joints in {ROBOT} and in the driver's settings alike."
    return [Open(f"The joints of {about.name} are not the campaign's: {' and '.join(parts)}.", step)]


def _unit(campaign: Campaign, about: About) -> list[Open]:
    unit = command_unit(campaign.spec)
    if unit in ("", about.command_unit):
        return []
    sentence = f"{about.name} gives commands in {about.command_unit}, and {ROBOT} says {unit}."
    return [Open(sentence, f"Correct command_unit in {ROBOT}, or the driver.")]


def _limits(campaign: Campaign, about: About) -> list[Open]:
    """Where the robot enforces less than the campaign's motions may do."""
    if set(about.joints) != set(campaign.axes):
        return []
    order = np.array([about.joints.index(axis) for axis in campaign.axes])
    limits = campaign.kind.expected(campaign.spec).limits
    path, rates = campaign.kind.path, _rates(campaign)
    own = {name: np.asarray(limits[channel][1]) for name, channel in rates.items() if channel in limits}
    found = []
    for name, mine in own.items():
        theirs: Array | None = getattr(about, name)
        found += [] if theirs is None else _narrower(campaign, about, name, theirs[order], mine)
    lower, upper = limits[path]
    if about.upper is not None:
        found += _narrower(campaign, about, "upper", about.upper[order], np.asarray(upper))
    if about.lower is not None:
        found += _narrower(campaign, about, "lower", -about.lower[order], -np.asarray(lower), sign=-1.0)
    return found


def _rates(campaign: Campaign) -> dict[str, str]:
    """The channels of velocity and acceleration by these names."""
    found, name = {}, campaign.kind.path
    for order in ORDERS:
        name = next((c.name for c in campaign.channels if c.derivative_of == name), "")
        found[order] = name
    return found


def _narrower(
    campaign: Campaign, about: About, name: str, theirs: Array, mine: Array, sign: float = 1.0
) -> list[Open]:
    outside = mine > theirs + SLACK * np.abs(theirs)
    return [
        Open(
            f"{about.name} enforces {name} {sign * theirs[j]:g} of {campaign.axes[j]}, and {ROBOT} allows "
            f"{sign * mine[j]:g}.",
            f"Write what the robot enforces into {ROBOT}.",
        )
        for j in np.flatnonzero(outside)
    ]


def _confirm(campaign: Campaign) -> list[Open]:
    step = f"Take each line out of confirm in {campaign.path / ROBOT} once you know that it is right."
    said = [f"Assumed and not confirmed: {line}" for line in to_confirm(campaign.spec)]
    return [Open(one, step, waived=True) for one in said]


def _identity(campaign: Campaign, about: About, stated: str) -> list[Open]:
    before = last_identity(campaign.events())
    if not about.identity:
        return [Open(f"{about.name} has no identity.", "The driver's About has to say it.")]
    if before in ("", about.identity) or stated == about.identity:
        return []
    sentence = f"Earlier recordings are of {before}, and this robot is {about.identity}."
    step = f"If it is the same robot: --identity {typed(about.identity)}. Else start a campaign of its own."
    return [Open(sentence, step)]


def _unfinished(campaign: Campaign, resume: bool) -> list[Open]:
    left = unfinished(campaign.events())
    if left is None or resume:
        return []
    fact: Any = left.fact
    assert isinstance(fact, MotionSent)
    sentence = (
        f"The {fact.part} of proposal {left.number} was sent at {left.time[:16]} and nothing says how it "
        "ended: the robot may have moved."
    )
    step = "Look where the robot stands; then run again with --resume. Nothing is replayed."
    return [Open(sentence, step)]


def _waiting(campaign: Campaign) -> list[Open]:
    held = campaign.state().awaiting_answer
    if not held:
        return []
    step = f"etude tell {typed(campaign.path)} --changed new (or forget, or same)."
    return [Open(f"Log {held[0].number} waits for the answer to whether the robot has changed.", step)]
