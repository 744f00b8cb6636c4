"""The sign of a command by its power: over a closed motion conservative power cancels, friction's is lost.

rho_j = sum(command qd) / sum(|command qd|) over moving samples. A reversed time axis turns it too, in every
joint; `rates` tells the two apart where velocities are logged.
"""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Finding, Mask
from etude.logs.truth.seen import Seen
from etude.logs.truth.words import Mendable, both, named

CHECK = "sign"
SURE = 0.3  # |rho|: right logs of real arms begin at 0.39, inverted ones end at -0.39
LEAST_S = 5.0  # s of motion: a shorter one is not closed


def agreement(seen: Seen) -> Array:
    """(k,) rho of each joint, in [-1, 1]; NaN of a joint that hardly moves or is not commanded."""
    if seen.command is None:
        return np.full(len(seen.parts), np.nan)
    power = np.where(seen.moving, seen.command * seen.qd, 0.0)
    total = np.abs(power).sum(axis=0)
    told = (seen.seconds >= LEAST_S) & (total > 0.0)
    return np.where(told, power.sum(axis=0) / np.where(total > 0.0, total, 1.0), np.nan)


def inverted(seen: Seen) -> Mask:
    """(k,) joints whose command takes power out of the motion."""
    return np.asarray(np.nan_to_num(agreement(seen)) < -SURE)


def sign_finding(seen: Seen) -> Finding:
    """Which commands have the wrong sign, very probably: a question, since a brake takes power out too."""
    rho = agreement(seen)
    wrong, known = inverted(seen), np.abs(np.nan_to_num(rho)) > SURE
    if wrong.any():
        return _question(seen, rho, wrong)
    if not known.any():
        return Finding(
            CHECK,
            "cannot tell",
            "The power of the commands is near zero in sum, so nothing tells their sign: they hold no "
            "friction, or the motion is short.",
            "A longer motion that ends where it began tells more.",
        )
    unsure = named(seen.parts, ~known)
    rest = f" Of {unsure} it cannot be told." if unsure else ""
    return Finding(
        CHECK, "green", f"Commands drive the motion: the sign of {named(seen.parts, known)} is right.{rest}"
    )


def _question(seen: Seen, rho: Array, wrong: Mask) -> Finding:
    share = ", ".join(f"{value:.2f}" for value in rho[wrong])
    told = np.isfinite(rho) & (np.abs(rho) > SURE)
    everywhere = wrong.sum() > max(1, told.sum() / 2) and seen.logged is None
    cause = "the sign of these commands is inverted, or the rows run backwards in time"
    turned = " If the rows run backwards, turn the file round instead." if everywhere else ""
    guess = cause if everywhere else "their sign is inverted"
    return Mendable(
        CHECK,
        "yellow",
        f"The commands of {named(seen.parts, wrong)} take power out of the motion (power over its absolute "
        f"value: {share}; friction makes it positive): very probably {guess}.",
        both(CHECK, f"turn the sign of {named(seen.parts, wrong)}") + turned,
        flag=CHECK,
        by=tuple(np.where(wrong, -1.0, 1.0).tolist()),
    )
