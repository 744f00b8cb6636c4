"""Preconditions of a motion: each one that is not met is a sentence, and blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.abilities import SupportsJointTables
from etude.campaign.record.alerts import motion_open
from etude.campaign.record.controls import LEARNED
from etude.campaign.record.folder import ROBOT, Campaign
from etude.campaign.run.run_history import last_identity
from etude.deploy.trajectory_files import command_unit, to_confirm
from etude.drivers import About, VelocityEnvelope
from etude.drivers.contract import is_identity_of
from etude.drivers.within_limits import velocity_range
from etude.errors import UsageError, typed
from etude.types import Array

STATED = ("command_of", "gravity_in_command")
"""Fields of `About` that may be None, which blocks."""
ENFORCED = ("lower", "upper", "velocity", "acceleration", "jerk", "command", "torque_rate")
"""Fields of `About` and keys of the robot's file."""
LONGEST_SILENCE = 0.4
"""s within which a lost link has to be noticed."""
FEWEST_SAMPLES = 2.0
"""In that time, or in a shorter silence of the driver: one that is late is no lost link."""
POSES = 1001
"""Of each joint at which velocities by position are compared."""
SLACK = 1e-6
"""Part of a limit by which the robot's may be narrower: rounding of files."""


@dataclass(frozen=True)
class Open:
    """A precondition that is not met. waived: a person may waive it for a motion of a simulation."""

    sentence: str
    step: str
    waived: bool = False


def open_points(campaign: Campaign, about: About, *, resume: bool, identity: str) -> list[Open]:
    """All preconditions of moving this robot in this campaign that are not met.

    Args:
        resume: a person has looked at where a motion without an end has left the robot.
        identity: that the person says the robot has now, though it was another before.
    """
    return [
        *_unstated(about),
        *_link(about),
        *_joints(campaign, about),
        *_unit(campaign, about),
        *_limits(campaign, about),
        *_confirm(campaign),
        *_identity(campaign, about, identity),
        *_unfinished(campaign, resume),
        *_waiting(campaign),
    ]


def require_none(campaign: Campaign, points: Sequence[Open], *, simulated: bool) -> list[str]:
    """The sentences that a simulation waives. UsageError: any other point is open."""
    blocking = [one for one in points if not (one.waived and simulated)]
    if blocking:
        raise UsageError(
            f"nothing moved, because of open points: {' '.join(one.sentence for one in blocking)[:-1]}",
            where=str(campaign.path),
            next_step=" ".join(dict.fromkeys(one.step for one in blocking)),
        )
    return [one.sentence for one in points]


def _unstated(about: About) -> list[Open]:
    names = [name for name in STATED if getattr(about, name) is None]
    step = "The driver's About has to state it, because it is never guessed."
    return [Open(f"The driver does not state {name} of {about.name}.", step) for name in names]


def _link(about: About) -> list[Open]:
    """Where a lost link would be noticed late, or where a late sample would be one."""
    least = FEWEST_SAMPLES / about.rate if about.rate > 0.0 else np.inf
    if least <= about.silence <= LONGEST_SILENCE:
        return []
    if least > LONGEST_SILENCE:
        step = (
            f"It has to accept set-points and return samples at {FEWEST_SAMPLES / LONGEST_SILENCE:g} Hz or "
            "more."
        )
        return [
            Open(f"{about.name} sends {about.rate:g} samples a second, too few to stop it in time.", step)
        ]
    sentence = f"The link to {about.name} is regarded as lost after {about.silence:g} s without a sample."
    step = f"The driver's About has to state a silence from {least:g} to {LONGEST_SILENCE:g} s."
    return [Open(sentence, step)]


def _joints(campaign: Campaign, about: About) -> list[Open]:
    lacking = [axis for axis in campaign.axes if axis not in about.joints]
    beyond = [joint for joint in about.joints if joint not in campaign.axes]
    if not lacking and not beyond:
        return []
    parts = [
        f"it {what} {', '.join(joints)}" for what, joints in (("lacks", lacking), ("has", beyond)) if joints
    ]
    step = f"Use the same joint names in {ROBOT} and in the driver's settings."
    return [Open(f"The joints of {about.name} are not the campaign's: {' and '.join(parts)}.", step)]


def _unit(campaign: Campaign, about: About) -> list[Open]:
    unit = command_unit(campaign.spec)
    if unit in ("", about.command_unit):
        return []
    sentence = f"{about.name} gives commands in {about.command_unit}, but {ROBOT} states {unit}."
    return [Open(sentence, f"Correct command_unit in {ROBOT}, or the driver.")]


def _limits(campaign: Campaign, about: About) -> list[Open]:
    """Limits that the robot enforces below those of the campaign, with the lines for the robot file."""
    if set(about.joints) != set(campaign.axes):
        return []
    sentences: list[str] = []
    lines: list[str] = []
    for axis, stated in zip(campaign.axes, _stated(campaign), strict=True):
        j = about.joints.index(axis)
        rows = [*_narrower(about, j, stated), *_slower(about, j, stated)]
        sentences += [
            f"{about.name} enforces {what} of {axis}, but {ROBOT} {allows}." for what, allows, _ in rows
        ]
        lines += [f"{axis}: {', '.join(line for _, _, line in rows)}"] if rows else []
    step = f"Write the limits that the robot enforces into {ROBOT}: {'; '.join(lines)}."
    return [Open(sentence, step) for sentence in sentences]


def _stated(campaign: Campaign) -> Sequence[Mapping[str, Any]]:
    """Limits of each axis in the robot file, by the names of `About`; None: no limit."""
    if isinstance(campaign.spec, SupportsJointTables):
        return campaign.spec.joint_tables
    limits, name = campaign.kind.expected(campaign.spec).limits, campaign.kind.path
    rows = [{"lower": low, "upper": high} for low, high in zip(*limits[name], strict=True)]
    for order in ("velocity", "acceleration"):
        name = next((c.name for c in campaign.channels if c.derivative_of == name), "")
        for row, most in zip(rows, limits[name][1] if name in limits else (), strict=False):
            row[order] = most
    return rows


def _narrower(about: About, j: int, stated: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """For joint j: the limit that the robot enforces, the one in the file, and the file's new line."""
    rows = []
    for name in (name for name in ENFORCED if name in stated):
        enforced: Array | None = getattr(about, name)
        if name == "torque_rate" and LEARNED not in about.controls:
            continue  # its own feedback's alone
        value = np.inf if enforced is None else float(enforced[j])
        if name == "velocity" and about.envelope is not None:
            value = min(value, float(about.envelope.most[j]))
        sign, limit = (-1.0 if name == "lower" else 1.0), np.inf if stated[name] is None else stated[name]
        if np.isfinite(value) and sign * limit > sign * value + SLACK * abs(value):
            allows = f"allows {limit:g}" if np.isfinite(limit) else "has no such limit"
            rows.append((f"{name} {value:g}", allows, f"{name} = {value!r}"))
    return rows


def _slower(about: About, j: int, stated: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """As `_narrower`, for velocity limits by position."""
    if about.envelope is None or "envelope" not in stated:
        return []
    ends = {"lower": stated["lower"], "upper": stated["upper"]}
    file_envelope = stated["envelope"] or {"offset": np.inf, "slope": 0.0, **ends}
    robot_envelope = {name: float(values[j]) for name, values in vars(about.envelope).items()}
    most = min(stated["velocity"], robot_envelope["most"])
    q = np.linspace(stated["lower"], stated["upper"], POSES)
    allowed, enforced = _speed_limits({**file_envelope, "most": most}, q), _speed_limits(robot_envelope, q)
    k = int((allowed - enforced).argmax())
    if allowed[k] - enforced[k] <= SLACK * most:
        return []
    line = ", ".join(f"{name} = {robot_envelope[name]!r}" for name in ("offset", "slope", "lower", "upper"))
    what = f"velocity {enforced[k]:.3g} at {np.tile(q, 2)[k]:.3g}"
    return [(what, f"allows {allowed[k]:.3g} there", f"envelope = {{ {line} }}")]


def _speed_limits(envelope: Mapping[str, float], q: Array) -> Array:
    """(2 n,) speeds of one joint at positions q (n,), towards its upper and its lower end."""
    limits = VelocityEnvelope(**{name: np.array([value]) for name, value in envelope.items()})
    down, up = velocity_range(limits, q[:, None])
    return np.concatenate([up[:, 0], -down[:, 0]])


def _confirm(campaign: Campaign) -> list[Open]:
    step = f"Once an assumption is confirmed, remove its line from confirm in {campaign.path / ROBOT}."
    sentences = [f"Assumed and not confirmed: {line}" for line in to_confirm(campaign.spec)]
    return [Open(one, step, waived=True) for one in sentences]


def _identity(campaign: Campaign, about: About, stated: str) -> list[Open]:
    before = last_identity(campaign.events())
    if not about.identity:
        return [Open(f"{about.name} has no identity.", "The driver's About has to state it.")]
    now = about.answers_as
    if not before or is_identity_of(before, about) or is_identity_of(stated, about):
        return []
    sentence = f"Earlier recordings are of {before}, but this robot is {now}."
    step = f"To continue the campaign with this robot: --identity {typed(now)}. Else create another campaign."
    return [Open(sentence, step)]


def _unfinished(campaign: Campaign, resume: bool) -> list[Open]:
    points = () if resume else motion_open(campaign.state(), campaign.path)
    return [Open(f"{one.sentence[:1].upper()}{one.sentence[1:]}.", one.step) for one in points]


def _waiting(campaign: Campaign) -> list[Open]:
    waiting = campaign.state().awaiting_answer
    if not waiting:
        return []
    step = f"etude tell {typed(campaign.path)} --changed new (or forget, or same)."
    return [Open(f"Log {waiting[0].number} waits for an answer about a change of the robot.", step)]
