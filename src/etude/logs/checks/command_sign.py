"""The sign of a command by its power: over a closed motion conservative power cancels, friction's is lost.

rho_j = sum(command qd) / sum(|command qd|) over moving samples. A reversed time axis turns it too, in every
joint; `rates` tells the two apart where velocities are logged. Over a short motion even conservative power
has a sign, by chance: what counts as one is more than that.
"""

from __future__ import annotations

import numpy as np

from etude.logs.checks.filtered_motion import Seen, memory
from etude.logs.checks.finding_texts import Mendable, both, named
from etude.types import Array, Finding, Mask

CHECK = "sign"
ALIKE = 0.9  # |cosine| of command and the model file's torque: gravity tells their sign
SURE = 0.3  # |rho|: right logs of real arms begin at 0.39, inverted ones end at -0.39
CLOSED = 0.2  # of the work that a weight may do between the ends: below, the motion counts as closed
LEAST_S = 5.0  # s of motion: a shorter one is not closed


def agreement(seen: Seen) -> Array:
    """(k,) rho of each joint, in [-1, 1]; NaN of a joint that hardly moves or is not commanded."""
    if seen.command is None:
        return np.full(len(seen.parts), np.nan)
    power = np.where(seen.moving, seen.command * seen.qd, 0.0)
    total = np.abs(power).sum(axis=0)
    told = (seen.seconds >= LEAST_S) & (total > 0.0)
    return np.where(told, power.sum(axis=0) / np.where(total > 0.0, total, 1.0), np.nan)


def lifted(seen: Seen) -> Array:
    """(k,) how much of rho a weight may make that is lifted or let down between the motion's ends: the
    largest command over the way between them. 0 of a motion that is nearly closed by its mean command.
    """
    if seen.command is None:
        return np.zeros(len(seen.parts))
    work = seen.step * np.abs(np.where(seen.moving, seen.command * seen.qd, 0.0)).sum(axis=0)
    way = np.abs(seen.q[-1] - seen.q[0]) / np.maximum(work, np.finfo(float).tiny)
    size = np.abs(seen.command)
    return np.where(size.mean(axis=0) * way > CLOSED, size.max(axis=0) * way, 0.0)


def by_chance(seen: Seen) -> Array:
    """(k,) the standard error of rho: what the sum of as many independent powers of any sign comes to.

    On stretches of 5 to 12 s of torques without friction in them (Panda) rho reaches -0.55 and never once its
    error; of real and simulated arms' whole logs every sign stays told.
    """
    if seen.command is None:
        return np.zeros(len(seen.parts))
    power = np.where(seen.moving, seen.command * seen.qd, 0.0)
    sums = power.std(axis=0) * np.sqrt(len(power) * memory(power, seen.step) / seen.step)
    return np.asarray(sums / np.maximum(np.abs(power).sum(axis=0), np.finfo(float).tiny))


def powered(seen: Seen) -> Array:
    """(k,) -1 where the command takes power out of the motion, 1 where it drives it, 0 where nobody knows."""
    rho = np.nan_to_num(agreement(seen))
    least = np.maximum(SURE + lifted(seen), by_chance(seen))
    return np.where(np.abs(rho) > least, np.sign(rho), 0.0)


def inverted(seen: Seen) -> Mask:
    """(k,) joints whose command takes power out of the motion."""
    return np.asarray(powered(seen) < 0.0)


def by_file(seen: Seen, torque: Array | None) -> Array:
    """(k,) for joints whose power says nothing: 1 where the command is like the model file's torque, its mean
    included, -1 where it is the opposite, 0 where neither can be told.

    A joint that holds much weight and has little friction has no power to speak of, and a torque of one sign.
    """
    like = likeness(seen, torque)
    untold = powered(seen) == 0.0
    return np.where(untold & (np.abs(like) > ALIKE), np.sign(like), 0.0)


def likeness(seen: Seen, torque: Array | None) -> Array:
    """(k,) cosine of command and the model file's torque; 0 without one."""
    if seen.command is None or torque is None:
        return np.zeros(len(seen.parts))
    size = np.linalg.norm(seen.command, axis=0) * np.linalg.norm(torque, axis=0)
    return np.asarray((seen.command * torque).sum(axis=0) / np.maximum(size, np.finfo(float).tiny))


def sign_finding(seen: Seen, torque: Array | None = None) -> Finding:
    """Which commands have the wrong sign, very probably: a question, since a brake takes power out too.

    Args:
        torque: (n, k) what a model file says of the commands; None without one.
    """
    rho, like = agreement(seen), by_file(seen, torque)
    opposed = np.asarray(like < 0.0)
    wrong, known = inverted(seen) | opposed, (powered(seen) != 0.0) | (like != 0.0)
    unsure = named(seen.parts, ~known)
    rest = f" Of {unsure} it cannot be told." if unsure else ""
    if wrong.any():
        return _question(seen, rho, opposed, rest if (wrong == known).all() else "")
    if not known.any():
        return Finding(
            CHECK,
            "cannot tell",
            "The power of the commands is near zero in sum, so nothing tells their sign: they hold no "
            "friction, or the motion is short.",
            "A longer motion that ends where it began tells more.",
        )
    return Finding(
        CHECK, "green", f"Commands drive the motion: the sign of {named(seen.parts, known)} is right.{rest}"
    )


def _question(seen: Seen, rho: Array, opposed: Mask, rest: str) -> Finding:
    """rest: what is said of the others, if all that tell their sign have the wrong one."""
    by_power = inverted(seen)
    wrong = by_power | opposed
    told = powered(seen) != 0.0
    everywhere = by_power.sum() >= max(2, told.sum() / 2) and seen.logged is None and not opposed.any()
    cause = "the sign of these commands is inverted, or the rows run backwards in time"
    turned = " If the rows run backwards, turn the file round instead." if everywhere else ""
    guess = cause if everywhere else "their sign is inverted"
    return Mendable(
        CHECK,
        "yellow",
        f"{_facts(seen, rho, by_power, opposed)}: very probably {guess}.{rest}",
        both(CHECK, f"turn the sign of {named(seen.parts, wrong)}") + turned,
        flag=CHECK,
        by=tuple(np.where(wrong, -1.0, 1.0).tolist()),
    )


def _facts(seen: Seen, rho: Array, by_power: Mask, opposed: Mask) -> str:
    facts = []
    if by_power.any():
        share = ", ".join(f"{value:.2f}" for value in rho[by_power])
        facts.append(
            f"commands of {named(seen.parts, by_power)} take power out of the motion (power over its "
            f"absolute value: {share}; friction makes it positive)"
        )
    if opposed.any():
        facts.append(f"commands of {named(seen.parts, opposed)} are opposite to the model file's torque")
    return "The " + ", and the ".join(facts)
