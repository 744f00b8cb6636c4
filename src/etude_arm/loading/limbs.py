"""The moving joints of a file as limbs: chains of them, told in the words of a refusal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from os.path import commonprefix

from etude.errors import UsageError

SHORTEST_STROKE = 0.1
"""m: a sliding joint at the very end with less way than this is a finger, not an axis."""
LEG = ("hip", "leg", "thigh")
"""In the name of a limb's first joint: another limb is rather what a person wants to move."""


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


def without_tip(path: list[Moving], found: Sequence[Moving]) -> list[Moving]:
    """The limb, without a finger at its end: one that has a short way, or that others do as."""
    tip = path[-1]
    short = tip.slides and tip.upper - tip.lower <= SHORTEST_STROKE
    is_finger = short or any(joint.leader == tip.name for joint in found)
    return path[:-1] if len(path) > 2 and is_finger else path


def option(limbs: Sequence[Moving], after: Mapping[str, list[Moving]], found: Sequence[Moving]) -> str:
    """What chooses the longest limb that is no leg, without a hand at its end: a pattern, if it means these
    joints and no others, else their names.
    """
    path = [
        max(limbs, key=lambda limb: (not any(part in limb.name.lower() for part in LEG), length(limb, after)))
    ]
    while (following := after[path[-1].name]) and not ends_in_hand(path, following, after):
        path.append(max(following, key=lambda one: length(one, after)))
    names = [joint.name for joint in without_tip(path, found)]
    pattern = f"{commonprefix(names)}*"  # noqa: RUF071 characters are meant
    alone = [joint.name for joint in found if fnmatchcase(joint.name, pattern)] == names
    return f"--joints {repr(pattern) if alone and len(names) > 1 < len(pattern) else ' '.join(names)}"


def ends_in_hand(
    path: Sequence[Moving], following: Sequence[Moving], after: Mapping[str, list[Moving]]
) -> bool:
    """Whether a limb branches into several that are all shorter: fingers, whatever they are called."""
    return len(following) > 1 and all(length(one, after) < len(path) for one in following)


def example(found: Sequence[Moving]) -> str:
    """The option that chooses the longest limb, to end a sentence; "" where nothing moves by itself."""
    own = [joint for joint in found if not joint.leader]
    after = {joint.name: [j for j in own if j.before == joint.name] for joint in own}
    starts = [joint for joint in own if joint.before not in after]
    return f", for example {option(starts, after, found)}" if starts else ""


def described(limbs: Sequence[Moving], after: Mapping[str, list[Moving]]) -> str:
    return ", ".join(f"{joint.name} and {length(joint, after) - 1} more" for joint in limbs)


def no_arm(found: Sequence[Moving], where: str) -> UsageError:
    """Says what moves, what of it was not looked at, and how to choose it all the same."""
    if not found:
        return UsageError(
            "no arm: nothing in the file moves",
            where=where,
            next_step="Name the file of an arm: this one describes an object, or a part without joints. A "
            "vehicle that flies is described in a TOML.",
        )
    return UsageError(
        "no arm: no chain of two or more joints begins at the base, without fingers (by name) and joints "
        f"that follow others (moving joints: {', '.join(joint.name for joint in found)})",
        where=where,
        next_step=f"Choose joints with --joints if it should learn all the same{example(found)}.",
    )
