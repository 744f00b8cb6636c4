"""Choice of the arm's joints: those that the user names, or those of the only limb in the file.

A file does not state whether its base is fixed. So it counts as an arm only if a single chain of two or more
moving joints begins at the base. All other files are refused, with the joints that were found.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from os.path import commonprefix

from etude.errors import UsageError

FINGER = re.compile("grip|finger|jaw|knuckle|thumb", re.IGNORECASE)


@dataclass(frozen=True)
class Choice:
    """The joints that move, and the held positions of the others. Attributes as of `loaded_model.Loaded`."""

    joints: tuple[str, ...]
    held: Mapping[str, float]
    notes: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()


SHORTEST_STROKE = 0.1
"""m: a sliding joint at the tip with less travel is a finger, not an axis."""
LEG = ("hip", "leg", "thigh")
"""Words in the name of a limb's first joint that mark a leg: other limbs are preferred."""


@dataclass(frozen=True)
class Moving:
    """A moving joint of a file: hinge or slide.

    Attributes:
        name: its name.
        before: the moving joint that carries it, "" at the base.
        lower, upper: its range, rad or m; infinite if there is none.
        slides: True for a sliding joint.
        endless: True for a hinge that turns without end.
        leader, factor, offset: of a joint that follows another one (`<mimic>`): position = factor * leader's
            + offset.
        carries: the link that it moves.
    """

    name: str
    before: str
    lower: float = -math.inf
    upper: float = math.inf
    slides: bool = False
    endless: bool = False
    leader: str = ""
    factor: float = 1.0
    offset: float = 0.0
    carries: str = ""


def length(joint: Moving, after: Mapping[str, list[Moving]]) -> int:
    return 1 + max((length(one, after) for one in after[joint.name]), default=0)


def without_tip(path: list[Moving], moving: Sequence[Moving]) -> list[Moving]:
    """The limb without the finger at its end: a joint of short travel, or one that other joints follow."""
    tip = path[-1]
    short = tip.slides and tip.upper - tip.lower <= SHORTEST_STROKE
    is_finger = short or any(joint.leader == tip.name for joint in moving)
    return path[:-1] if len(path) > 2 and is_finger else path


def option(limbs: Sequence[Moving], after: Mapping[str, list[Moving]], moving: Sequence[Moving]) -> str:
    """The option that chooses the longest limb that is no leg, without its hand: a pattern if it matches
    exactly these joints, else their names.
    """
    path = [
        max(limbs, key=lambda limb: (not any(part in limb.name.lower() for part in LEG), length(limb, after)))
    ]
    while (following := after[path[-1].name]) and not ends_in_hand(path, following, after):
        path.append(max(following, key=lambda one: length(one, after)))
    names = [joint.name for joint in without_tip(path, moving)]
    pattern = f"{commonprefix(names)}*"  # noqa: RUF071 characters are meant
    alone = [joint.name for joint in moving if fnmatchcase(joint.name, pattern)] == names
    return f"--joints {repr(pattern) if alone and len(names) > 1 < len(pattern) else ' '.join(names)}"


def ends_in_hand(
    path: Sequence[Moving], following: Sequence[Moving], after: Mapping[str, list[Moving]]
) -> bool:
    """Whether a limb branches into several shorter ones: fingers, whatever their names."""
    return len(following) > 1 and all(length(one, after) < len(path) for one in following)


def example(moving: Sequence[Moving]) -> str:
    """The end of a sentence with the option that chooses the longest limb; "" if no joint moves
    independently.
    """
    independent = [joint for joint in moving if not joint.leader]
    after = {joint.name: [j for j in independent if j.before == joint.name] for joint in independent}
    starts = [joint for joint in independent if joint.before not in after]
    return f", for example {option(starts, after, moving)}" if starts else ""


def described(limbs: Sequence[Moving], after: Mapping[str, list[Moving]]) -> str:
    return ", ".join(f"{joint.name} and {length(joint, after) - 1} more" for joint in limbs)


def no_arm(moving: Sequence[Moving], where: str) -> UsageError:
    """The error for a file without an arm: what moves, what is not verified, and how to choose joints."""
    if not moving:
        return UsageError(
            "no arm: nothing in the file moves",
            where=where,
            next_step="Name the file of an arm: this one describes an object, or a part without joints. A "
            "vehicle that flies is described in a TOML.",
        )
    return UsageError(
        "no arm: no chain of two or more joints begins at the base, without fingers (by name) and joints "
        f"that follow others (moving joints: {', '.join(joint.name for joint in moving)})",
        where=where,
        next_step=f"Choose joints with --joints to learn it anyway{example(moving)}.",
    )


def choose(
    moving: Sequence[Moving], patterns: Sequence[str] | None, positions: Mapping[str, float], where: str
) -> Choice:
    """The choice among a file's moving joints.

    Args:
        moving: all of them, each after the one that carries it.
        patterns: names or patterns; None: the one arm.
        positions: of joints that are held, rad or m.
        where: the file, for messages.

    Raises:
        UsageError: no arm or several, an unknown moving joint, or a position outside its joint's range.
    """
    joints = _only_arm(moving, where) if patterns is None else _selected(moving, patterns, where)
    held, unverified = _held_positions(moving, joints, positions, where)
    notes = [
        f"{sentence[0].upper()}{sentence[1:]}: clearances and torques of what it carries are wrong."
        for sentence in unverified
    ]
    if patterns is None:
        notes += _held_sentences(moving, held) + _finger_sentences(moving, joints)
    if held:
        stays = ", ".join(f"{name} at {at:.4g}" for name, at in held.items())
        unverified = [f"fixed joints are assumed to stay at their positions: {stays}", *unverified]
    return Choice(joints, held, tuple(notes), tuple(unverified))


def _held_sentences(moving: Sequence[Moving], held: Mapping[str, float]) -> list[str]:
    """One sentence on all independent joints that are not part of the arm."""
    joints = _by_name(moving)
    units = {name: "m" if joints[name].slides else "rad" for name in held}
    stand = [f"'{name}' at {at:.4g} {units[name]}" for name, at in held.items() if not joints[name].leader]
    return [f"These joints are fixed: {', '.join(stand)}. Name moving joints in --joints."] if stand else []


def _finger_sentences(moving: Sequence[Moving], joints: Sequence[str]) -> list[str]:
    """A sentence for an arm whose last joint moves a link named as a gripper, without moving fingers."""
    tip = _by_name(moving)[joints[-1]]
    carrying = any(joint.before == tip.name for joint in moving)
    if len(joints) < 3 or carrying or not FINGER.search(tip.carries):
        return []
    others = " ".join(joints[:-1])
    return [
        f"Joint '{tip.name}' moves '{tip.carries}': if that is a finger, exclude it with --joints {others}."
    ]


def _by_name(moving: Sequence[Moving]) -> dict[str, Moving]:
    return {joint.name: joint for joint in moving}


def _leader(moving: Sequence[Moving], name: str) -> str:
    return _by_name(moving)[name].leader


def _selected(moving: Sequence[Moving], patterns: Sequence[str], where: str) -> tuple[str, ...]:
    """The joints that names and patterns select, in their order; those of a pattern from the base
    outwards.
    """
    names = [joint.name for joint in moving]
    chosen: list[str] = []
    for word in patterns:
        matches = [name for name in names if name == word] or [n for n in names if fnmatchcase(n, word)]
        chosen += [name for name in matches if name not in chosen]
        _require_joints([] if matches else [word], names, where)
    for name in chosen:
        if leader := _leader(moving, name):
            raise UsageError(
                f"joint '{name}' follows '{leader}' (<mimic>)",
                where=where,
                next_step=f"Name '{leader}' instead: a joint that follows another is not a separate axis.",
            )
    if not chosen:
        raise UsageError("no joint is named", where=where, next_step=f"Choose of {', '.join(names)}.")
    return tuple(chosen)


def _require_joints(unknown: Sequence[str], names: Sequence[str], where: str) -> None:
    if unknown:
        raise UsageError(
            f"the model has no moving joint {', '.join(unknown)}",
            where=where,
            next_step=f"Its moving joints are {', '.join(names)}.",
        )


def _only_arm(moving: Sequence[Moving], where: str) -> tuple[str, ...]:
    """The one chain of joints from the base to its tip, without fingers."""
    free = _without_fingers(moving)
    after = {joint.name: [j for j in free if j.before == joint.name] for joint in free}
    starts = [joint for joint in free if joint.before == ""]
    limbs = [joint for joint in starts if length(joint, after) >= 2]
    if len(limbs) > 1:
        raise UsageError(
            f"several limbs begin at the base: {described(limbs, after)}",
            where=where,
            next_step="If the base is bolted down, choose one arm, for example "
            f"{option(limbs, after, moving)}. Walking or flying robots do not belong to this kind.",
        )
    if not limbs:
        if len(free) == 1 and math.isfinite(free[0].upper - free[0].lower) and _carries_all(free[0], moving):
            return (free[0].name,)
        raise no_arm(moving, where)
    path = limbs
    while following := _next(path, after, moving, where):
        path.append(following)
    return tuple(joint.name for joint in without_tip(path, moving))


def _carries_all(one: Moving, moving: Sequence[Moving]) -> bool:
    """Whether this joint carries all other independent joints; otherwise it is a finger."""
    carried = {one.name}
    for joint in moving:  # each after the one that carries it
        if joint.before in carried:
            carried.add(joint.name)
    return all(joint.leader or joint.name in carried for joint in moving)


def _without_fingers(moving: Sequence[Moving]) -> list[Moving]:
    """Independent joints without fingers and without joints that fingers carry. A single finger alone is the
    arm.
    """
    independent: list[Moving] = []
    dropped: set[str] = set()
    for joint in moving:
        if joint.leader or joint.before in dropped or FINGER.search(joint.name):
            dropped.add(joint.name)
        else:
            independent.append(joint)
    return independent or [joint for joint in moving if not joint.leader]


def _next(
    path: Sequence[Moving], after: Mapping[str, list[Moving]], moving: Sequence[Moving], where: str
) -> Moving | None:
    """The next joint of the arm; None at its tip, where several single joints are a hand."""
    branches = after[path[-1].name]
    if len(branches) == 1:
        return branches[0]
    long = [one for one in branches if length(one, after) >= 2]
    if len(long) > 1:
        hand = ends_in_hand(path, branches, after)
        choose = "If they are a hand, choose the arm that carries it" if hand else "Choose one"
        shown = option(path[:1] if hand else long, after, moving)
        raise UsageError(
            f"several limbs begin after joint '{path[-1].name}': {described(long, after)}",
            where=where,
            next_step=f"{choose}, for example {shown}; the others are fixed.",
        )
    return long[0] if long else None


def _held_positions(
    moving: Sequence[Moving], chosen: Sequence[str], positions: Mapping[str, float], where: str
) -> tuple[dict[str, float], list[str]]:
    """Positions of all joints that are not chosen, and the followers that are held although they should move.

    A joint without a given position is held at 0 if that is in its range, else at the nearest limit.
    """
    joints = _by_name(moving)
    _require_joints([name for name in positions if name not in joints], list(joints), where)
    for name, at in positions.items():
        _check_given(joints[name], at, chosen, where)
    stand = {name: positions.get(name, min(max(0.0, one.lower), one.upper)) for name, one in joints.items()}
    unverified = []
    for name, joint in joints.items():
        if joint.leader in joints and name not in positions:
            stand[name] = joint.factor * stand[joint.leader] + joint.offset
            if joint.leader in chosen:
                unverified.append(f"joint '{name}' follows '{joint.leader}' (<mimic>), but is fixed here")
    return {name: stand[name] for name in joints if name not in chosen}, unverified


def _check_given(joint: Moving, at: float, chosen: Sequence[str], where: str) -> None:
    if joint.name in chosen:
        raise UsageError(
            f"joint '{joint.name}' moves, so it cannot be fixed",
            where=where,
            next_step="Remove it from --joints or from --hold.",
        )
    # rad or m: positions in files have six digits
    slack = 1e-6
    if not joint.lower - slack <= at <= joint.upper + slack:
        raise UsageError(
            f"joint '{joint.name}' cannot be fixed at {at:g}: its range is {joint.lower:g} to "
            f"{joint.upper:g}",
            where=where,
            next_step="Positions are in rad, or m for a sliding joint.",
        )
