"""The scale of commands against a model file: current, percent, a missing gear, gravity taken out already.

Slope and correlation of the command on the file's torque. Judged are commands that follow it (correlation
above 0.7): right ones have a slope near 1, another unit lies a factor of 19 or more away.
"""

from __future__ import annotations

import numpy as np

from etude.logs.checks.filtered_motion import Seen
from etude.logs.checks.finding_texts import accepted, named
from etude.types import Array, Finding, Mask

CHECK, GRAVITY = "scale", "gravity"
FOLLOWS, SLOPE = 0.7, 3.0
HEAVY = 2.0  # deviation of the file's gravity over that of the whole command: it cannot be in it
FAINT = 1e-3  # of the largest torque in the file: what moves by less says nothing of a unit
UNITS = {
    "thousandths of N m": 1e3,
    "kN m": 1e-3,
    "N m taken for degrees": np.pi / 180.0,
    "N m taken for radians": 180.0 / np.pi,
}
NEAR_FACTOR = 1.25


def scale_findings(seen: Seen, torque: Array, static: Array, limit: Array) -> tuple[Finding, ...]:
    """Unit and gravity of commands that ought to be forces.

    Args:
        torque, static: (n, k) what the model file says of the commands, whole and at rest.
        limit: (k,) largest commands, for percents.
    """
    if seen.command is None:
        return ()
    slope, like = slopes(seen.command, torque)
    size = torque.std(axis=0)
    judged = (np.abs(like) > FOLLOWS) & (size > FAINT * size.max())
    wrong = judged & ((np.abs(slope) > SLOPE) | (np.abs(slope) < 1.0 / SLOPE))
    if wrong.any():
        return (_unit(seen, slope, wrong, limit),)
    lacks = _lacks_gravity(seen.command, static, like)
    if lacks.any():
        return (_gravity(seen, lacks),)
    if not judged.any():
        return (Finding(CHECK, "cannot tell", "No command follows the model file closely enough."),)
    values = ", ".join(f"{value:.2g}" for value in slope[judged])
    said = f"Commands of {named(seen.parts, judged)} are {values} times the file's {_words(seen, judged)[0]}."
    return (Finding(CHECK, "green", said),)


def slopes(command: Array, torque: Array) -> tuple[Array, Array]:
    """(k,) slope and correlation of each command on the file's torque; 0 where either is constant."""
    a, b = torque - torque.mean(axis=0), command - command.mean(axis=0)
    product, square, other = (a * b).sum(axis=0), (a * a).sum(axis=0), (b * b).sum(axis=0)
    tiny = np.finfo(float).tiny
    return product / np.maximum(square, tiny), product / np.sqrt(np.maximum(square * other, tiny))


def _lacks_gravity(command: Array, static: Array, like: Array) -> Mask:
    """(k,) joints whose command varies too little to hold the file's gravity, and does not follow it."""
    return np.asarray((static.std(axis=0) > HEAVY * command.std(axis=0)) & (np.abs(like) < FOLLOWS))


def _gravity(seen: Seen, lacks: Mask) -> Finding:
    return Finding(
        GRAVITY,
        "yellow",
        f"The commands of {named(seen.parts, lacks)} hold no gravity, which by the model file is larger than "
        "they are: it seems to be taken out already.",
        "Log the whole command, or check masses and mounting in the model file; " + accepted(GRAVITY) + ".",
        flag=GRAVITY,
    )


def _unit(seen: Seen, slope: Array, wrong: Mask, limit: Array) -> Finding:
    values = ", ".join(f"{value:.3g}" for value in slope[wrong])
    word, unit = _words(seen, wrong)
    return Finding(
        CHECK,
        "yellow",
        f"The commands of {named(seen.parts, wrong)} are {values} times the {word} of the model file: "
        f"{_guess(np.abs(slope[wrong]), limit[wrong]).replace('N m', unit)}",
        "State the unit in the header or in the robot file (command_unit), or convert them; "
        + accepted(CHECK)
        + ".",
        flag=CHECK,
    )


def _words(seen: Seen, joints: Mask) -> tuple[str, str]:
    """What those joints are driven by, and its unit: forces where all of them slide."""
    kinds = {unit for unit, own in zip(seen.units, joints.tolist(), strict=True) if own}
    return {("m",): ("force", "N"), ("m", "rad"): ("torque or force", "N m (N)")}.get(
        tuple(sorted(kinds)), ("torque", "N m")
    )


def _guess(slope: Array, limit: Array) -> str:
    """The factor nearest in logarithm, in words."""
    percent = float(np.exp(np.abs(np.log(slope * limit / 100.0)).max()))
    if percent < NEAR_FACTOR:
        return "they look like percents of the limit."
    middle = float(np.exp(np.median(np.log(slope))))
    name, factor = min(UNITS.items(), key=lambda row: abs(np.log(middle / row[1])))
    if abs(np.log(middle / factor)) < np.log(NEAR_FACTOR):
        return f"they look like {name}."
    if middle < 1.0:
        return f"they look like a current, or like torques before a gear of about {1.0 / middle:.3g}."
    return "they look like another unit."
