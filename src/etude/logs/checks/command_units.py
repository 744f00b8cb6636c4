"""Unit of commands by the model file: slope and correlation of each command on the file's torque.

Only commands correlated with it (above 0.7) are judged. Correct ones have a slope near 1; other units differ
by a factor of 19 or more. A joint that hardly moves only reacts to the others, and is not judged. Rotors and
friction raise a slope where the motion has one frequency, as a circle: they are set aside then.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.filtered_motion import Seen, goes_far
from etude.logs.checks.finding_texts import accepted, named
from etude.types import Array, Finding, Mask

SCALE = "scale"
FOLLOWS, SLOPE = 0.7, 3.0  # correlation from which a slope is judged, and how far off it may be
# times the file's torque that rotors and friction may take: those of right logs took 4 to 14
MOST_UNMODELLED = 30.0
FAINT = 1e-3  # of the largest torque in the file: what moves by less says nothing of a unit
STEP = 0.03  # of a joint's top speed, over which friction changes its sign
UNITS = {
    "thousandths of N m": 1e3,
    "kN m": 1e-3,
    "N m converted as if they were degrees": np.pi / 180.0,
    "N m converted as if they were radians": 180.0 / np.pi,
}
NEAR_FACTOR = 1.25  # a known unit explains a slope that is nearer than this
NEAR_FILE = 1.6  # factor that masses of a right file may be off


def scale_finding(motion: Seen, torque: Array, limit: Array) -> Finding | None:
    """Unit of commands that ought to be forces; None where no commands are logged.

    Args:
        torque: (n, k) commands predicted by the model file.
        limit: (k,) largest commands, for percentages.
    """
    if motion.command is None:
        return None
    slope, like = slopes(motion.command, torque)
    size = torque.std(axis=0)
    comparable = (like > FOLLOWS) & (size > FAINT * size.max()) & goes_far(motion.q)
    high = comparable & (slope > SLOPE) & (slope < MOST_UNMODELLED)
    if high.any():  # a unit shows beside what is the joint's own; on a circle that follows the file's torque
        beside, follows = slopes(*_partial_residuals(motion, torque))
        comparable &= ~high | ((beside > SLOPE) & (follows > FOLLOWS))
    wrong = comparable & ((np.abs(slope) > SLOPE) | (np.abs(slope) < 1.0 / SLOPE))
    if wrong.any():
        return unit_finding(motion.parts, motion.units, slope, wrong, limit)
    if not comparable.any():
        return Finding(SCALE, "cannot tell", "No command agrees with the model file closely enough.")
    values = ", ".join(f"{value:.2g}" for value in slope[comparable])
    names, quantity = named(motion.parts, comparable), _quantity(motion.units, comparable)[0]
    fact = f"Commands of {names} are {values} times the file's {quantity}."
    size = np.log(np.abs(slope[comparable]))
    if len(size) > 1 and np.ptp(size) < np.log(NEAR_FACTOR) and np.abs(size).min() > np.log(NEAR_FILE):
        step = (
            "Check the gear ratios, the torque constants, and the masses of the file: all factors are alike."
        )
        return Finding(SCALE, "yellow", fact, step)
    return Finding(SCALE, "green", fact)


def _partial_residuals(motion: Seen, torque: Array) -> tuple[Array, Array]:
    """(n, k) residuals of command and torque after the regression on a constant, inertia and friction. A
    model file need contain neither rotors nor friction.
    """
    assert motion.command is not None
    command, predicted = motion.command.copy(), torque.copy()
    slow = STEP * np.abs(motion.qd).max(axis=0) + np.finfo(float).tiny
    for j, friction in enumerate(np.tanh(motion.qd / slow).T):
        regressors = np.column_stack([np.ones(len(predicted)), motion.qdd[:, j], motion.qd[:, j], friction])
        Q = np.linalg.qr(regressors / np.maximum(np.linalg.norm(regressors, axis=0), np.finfo(float).tiny))[0]
        command[:, j] -= Q @ (Q.T @ command[:, j])
        predicted[:, j] -= Q @ (Q.T @ predicted[:, j])
    return command, predicted


def load_beside(motion: Seen, torque: Array, per_kg: Array) -> float:
    """kg at the last link that explain slopes without a common unit; 0 if they are alike, or no load does.

    Args:
        torque, per_kg: (n, k) commands predicted by the model file, and their change per kg.
    """
    assert motion.command is not None
    mask = goes_far(motion.q) & (motion.command.std(axis=0) > 0.0)
    u, F, C = (part[:, mask] - part[:, mask].mean(axis=0) for part in (motion.command, torque, per_kg))
    u, F, C = (part / motion.command[:, mask].std(axis=0) for part in (u, F, C))
    before, follows = slopes(u, F)
    square = float((C * C).sum())
    kg = float((C * (u - F)).sum()) / square if square > 0.0 else 0.0
    after, comparable = slopes(u, F + kg * C)[0], follows > FOLLOWS
    if not kg > 0.0 or comparable.sum() < 2 or np.ptp(np.log(before[comparable])) < np.log(NEAR_FACTOR):
        return 0.0
    return kg if (np.abs(np.log(np.maximum(after[comparable], FAINT))) < np.log(NEAR_FILE)).all() else 0.0


def slopes(command: Array, torque: Array) -> tuple[Array, Array]:
    """(k,) slope and correlation of each command on the file's torque; 0 where either is constant."""
    a, b = torque - torque.mean(axis=0), command - command.mean(axis=0)
    product, square, other = (a * b).sum(axis=0), (a * a).sum(axis=0), (b * b).sum(axis=0)
    tiny = np.finfo(float).tiny
    return product / np.maximum(square, tiny), product / np.sqrt(np.maximum(square * other, tiny))


def unit_finding(
    parts: Sequence[str], units: Sequence[str], slope: Array, wrong: Mask, limit: Array, why: str = ""
) -> Finding:
    """The finding that the commands of joints `wrong` (k,) have another unit.

    Args:
        units: of the positions. slope: (k,) factors of the model file's commands. limit: as above.
        why: what the fact rests on, beside the factors.
    """
    values = ", ".join(f"{value:.3g}" for value in slope[wrong])
    word, unit = _quantity(units, wrong)
    return Finding(
        SCALE,
        "yellow",
        f"The commands of {named(parts, wrong)} are {values} times the {word} of the model file{why}: "
        f"{_guess(np.abs(slope[wrong]), limit[wrong]).replace('N m', unit)}",
        "State the unit in the header or in the robot file (command_unit), or convert them; "
        + accepted(SCALE)
        + ".",
        flag=SCALE,
    )


def _quantity(units: Sequence[str], joints: Mask) -> tuple[str, str]:
    """Kind and unit of those joints' commands: forces if all of them slide, else torques."""
    kinds = {unit for unit, selected in zip(units, joints.tolist(), strict=True) if selected}
    return {("m",): ("force", "N"), ("m", "rad"): ("torque or force", "N m (N)")}.get(
        tuple(sorted(kinds)), ("torque", "N m")
    )


def _guess(slope: Array, limit: Array) -> str:
    """The factor nearest in logarithm, in words."""
    percent = float(np.exp(np.abs(np.log(slope * limit / 100.0)).max()))
    if percent < NEAR_FACTOR:
        return "they look like per cent of the limit."
    middle = float(np.exp(np.median(np.log(slope))))
    name, factor = min(UNITS.items(), key=lambda row: abs(np.log(middle / row[1])))
    if abs(np.log(middle / factor)) < np.log(NEAR_FACTOR):
        return f"they look like {name}."
    if middle < 1.0:
        return (
            "they look like a current, or like torques at the motor with a gear ratio of about "
            f"{1.0 / middle:.3g}."
        )
    return "they look like another unit, or the masses of that file are placeholders."
