"""Which joints are the arm: those that somebody names, or the one arm that a file has.

A file does not say whether its base is bolted. So it is taken to be one arm only where there is one: a single
chain of two or more moving joints begins at the base. Everything else is refused with what was found.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from etude.errors import UsageError
from etude_arm.loading.limbs import (
    Moving,
    described,
    ends_in_hand,
    length,
    no_arm,
    option,
    without_tip,
)

FINGER = re.compile("grip|finger|jaw|knuckle|thumb", re.IGNORECASE)


@dataclass(frozen=True)
class Choice:
    """The joints that move, where the others are held, and why. Attributes as of `loaded.Loaded`."""

    joints: tuple[str, ...]
    held: Mapping[str, float]
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


def choose(
    found: Sequence[Moving], wanted: Sequence[str] | None, given: Mapping[str, float], where: str
) -> Choice:
    """The choice among a file's moving joints.

    Args:
        found: all of them, each after the one that carries it.
        wanted: names or patterns; None: the one arm.
        given: positions of joints that are held, rad or m.
        where: the file, for messages.

    Raises:
        UsageError: no arm or several, a name that is no moving joint, a position outside its joint's range.
    """
    joints = _only_arm(found, where) if wanted is None else _named(found, wanted, where)
    held, unseen = _held(found, joints, given, where)
    notes = [
        f"{sentence[0].upper()}{sentence[1:]}: clearances and torques of what it carries are wrong."
        for sentence in unseen
    ]
    if wanted is None:
        notes += _left(found, held) + _perhaps_finger(found, joints)
    if held:
        stays = ", ".join(f"{name} at {at:.4g}" for name, at in held.items())
        unseen = [f"held joints are taken to stay where they are: {stays}", *unseen]
    return Choice(joints, held, tuple(notes), tuple(unseen))


def _left(found: Sequence[Moving], held: Mapping[str, float]) -> list[str]:
    """One sentence for all joints that were not taken for the arm's, though they move by themselves."""
    joints = _by_name(found)
    units = {name: "m" if joints[name].slides else "rad" for name in held}
    stand = [f"'{name}' at {at:.4g} {units[name]}" for name, at in held.items() if not joints[name].leader]
    return [f"Joints are held: {', '.join(stand)}. Name in --joints what should move."] if stand else []


def _perhaps_finger(found: Sequence[Moving], joints: Sequence[str]) -> list[str]:
    """A sentence for an arm whose last joint moves a gripper by name, and nothing that moves itself."""
    tip = _by_name(found)[joints[-1]]
    carrying = any(joint.before == tip.name for joint in found)
    if len(joints) < 3 or carrying or not FINGER.search(tip.carries):
        return []
    rest = " ".join(joints[:-1])
    return [f"Joint '{tip.name}' moves '{tip.carries}': if that is a finger, leave it out, --joints {rest}."]


def _by_name(found: Sequence[Moving]) -> dict[str, Moving]:
    return {joint.name: joint for joint in found}


def _leader(found: Sequence[Moving], name: str) -> str:
    return _by_name(found)[name].leader


def _named(found: Sequence[Moving], wanted: Sequence[str], where: str) -> tuple[str, ...]:
    """The joints that names and patterns mean, in their order; those of a pattern from the base outwards."""
    known = [joint.name for joint in found]
    chosen: list[str] = []
    for word in wanted:
        meant = [name for name in known if name == word] or [n for n in known if fnmatchcase(n, word)]
        chosen += [name for name in meant if name not in chosen]
        _require_joints([] if meant else [word], known, where)
    for name in chosen:
        if leader := _leader(found, name):
            raise UsageError(
                f"joint '{name}' follows '{leader}' (<mimic>)",
                where=where,
                next_step=f"Name '{leader}' instead: a joint that follows another is no axis of its own.",
            )
    if not chosen:
        raise UsageError("no joint is named", where=where, next_step=f"Choose of {', '.join(known)}.")
    return tuple(chosen)


def _require_joints(unknown: Sequence[str], known: Sequence[str], where: str) -> None:
    if unknown:
        raise UsageError(
            f"the model has no moving joint {', '.join(unknown)}",
            where=where,
            next_step=f"Its moving joints are {', '.join(known)}.",
        )


def _only_arm(found: Sequence[Moving], where: str) -> tuple[str, ...]:
    """The one chain of joints from the base to its tip, without fingers."""
    free = _without_fingers(found)
    after = {joint.name: [j for j in free if j.before == joint.name] for joint in free}
    starts = [joint for joint in free if joint.before == ""]
    limbs = [joint for joint in starts if length(joint, after) >= 2]
    if len(limbs) > 1:
        raise UsageError(
            f"several limbs begin at the base: {described(limbs, after)}",
            where=where,
            next_step="Is the base bolted down? Then choose an arm, for example "
            f"{option(limbs, after, found)}. Robots that walk or fly are none of this kind.",
        )
    if not limbs:
        if len(free) == 1 and math.isfinite(free[0].upper - free[0].lower) and _carries_all(free[0], found):
            return (free[0].name,)
        raise no_arm(found, where)
    path = limbs
    while following := _next(path, after, found, where):
        path.append(following)
    return tuple(joint.name for joint in without_tip(path, found))


def _carries_all(one: Moving, found: Sequence[Moving]) -> bool:
    """Whether all other joints that move by themselves hang on this one: else it is a finger of a hand."""
    carried = {one.name}
    for joint in found:  # each after the one that carries it
        if joint.before in carried:
            carried.add(joint.name)
    return all(joint.leader or joint.name in carried for joint in found)


def _without_fingers(found: Sequence[Moving]) -> list[Moving]:
    """Joints that follow no other and are no finger; nor is what fingers carry. A finger alone is the arm."""
    left: list[Moving] = []
    dropped: set[str] = set()
    for joint in found:
        if joint.leader or joint.before in dropped or FINGER.search(joint.name):
            dropped.add(joint.name)
        else:
            left.append(joint)
    return left or [joint for joint in found if not joint.leader]


def _next(
    path: Sequence[Moving], after: Mapping[str, list[Moving]], found: Sequence[Moving], where: str
) -> Moving | None:
    """The joint that carries the arm on; None at its tip, where several single joints are a hand."""
    branches = after[path[-1].name]
    if len(branches) == 1:
        return branches[0]
    long = [one for one in branches if length(one, after) >= 2]
    if len(long) > 1:
        hand = ends_in_hand(path, branches, after)
        choose = "Are they a hand? Then choose what carries it" if hand else "Choose one"
        shown = option(path[:1] if hand else long, after, found)
        raise UsageError(
            f"several limbs begin after joint '{path[-1].name}': {described(long, after)}",
            where=where,
            next_step=f"{choose}, for example {shown}; the others are held.",
        )
    return long[0] if long else None


def _held(
    found: Sequence[Moving], chosen: Sequence[str], given: Mapping[str, float], where: str
) -> tuple[dict[str, float], list[str]]:
    """Positions of all joints that are not chosen, and followers that stand still although they should move.

    Without a given one: 0 if that is in range, else the limit next to it.
    """
    joints = _by_name(found)
    _require_joints([name for name in given if name not in joints], list(joints), where)
    for name, at in given.items():
        _check_given(joints[name], at, chosen, where)
    stand = {name: given.get(name, min(max(0.0, one.lower), one.upper)) for name, one in joints.items()}
    unseen = []
    for name, joint in joints.items():
        if joint.leader in joints and name not in given:
            stand[name] = joint.factor * stand[joint.leader] + joint.offset
            if joint.leader in chosen:
                unseen.append(f"joint '{name}' follows '{joint.leader}' (<mimic>), here it stands still")
    return {name: stand[name] for name in joints if name not in chosen}, unseen


def _check_given(joint: Moving, at: float, chosen: Sequence[str], where: str) -> None:
    if joint.name in chosen:
        raise UsageError(
            f"joint '{joint.name}' moves, so it cannot be held",
            where=where,
            next_step="Leave it out of --joints, or out of --hold.",
        )
    slack = 1e-6
    if not joint.lower - slack <= at <= joint.upper + slack:
        raise UsageError(
            f"joint '{joint.name}' cannot be held at {at:g}: its range is {joint.lower:g} to {joint.upper:g}",
            where=where,
            next_step="Positions are in rad, or m for a sliding joint.",
        )
