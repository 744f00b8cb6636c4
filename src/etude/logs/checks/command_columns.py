"""Commands against the motion: their sign by power, exchanged columns, and their scale against a model file.

Sign: over a closed motion conservative power cancels, and what friction takes is lost.

rho_j = sum(command qd) / sum(|command qd|) over moving samples. A reversed time axis turns it too, in every
joint; `velocities` tells the two apart where velocities are logged. Over a short motion even conservative
power has a sign, by chance: what counts as one is more than that.

Scale: slope and correlation of the command on the file's torque. Judged are commands that follow it
(correlation above 0.7): right ones have a slope near 1, another unit lies a factor of 19 or more away.

Exchanged columns: C_jk = n_j / 2 log(residual variance / variance) of command k, regressed on (1, qdd_j,
qd_j, tanh(qd_j / 5 % of its top)) over the moving samples of joint j; the least sum over all assignments
(Kuhn 1955) against that of the order given. n_j counts independent samples, less one for each regressor: of a
short stretch with slow commands few are left, and some other column fits by chance.

A weight is tied to no joint: it depends on all positions, and where every joint moves by a frequency of its
own, as exciting motions do, it fits another joint's motion as well as friction would. So another order is a
question only where every command that it moves has Coulomb friction of its joint in it, or is the torque of
the model file; else nobody can tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.logs.checks.filtered_motion import MOVING, Seen, memory
from etude.logs.checks.finding_texts import Mendable, accepted, both, named
from etude.types import Array, Finding, Index, Mask

SIGN = "sign"
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
            SIGN,
            "cannot tell",
            "The power of the commands is near zero in sum, so nothing tells their sign: they hold no "
            "friction, or the motion is short.",
            "A longer motion that ends where it began tells more.",
        )
    return Finding(
        SIGN, "green", f"Commands drive the motion: the sign of {named(seen.parts, known)} is right.{rest}"
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
        SIGN,
        "yellow",
        f"{_facts(seen, rho, by_power, opposed)}: very probably {guess}.{rest}",
        both(SIGN, f"turn the sign of {named(seen.parts, wrong)}") + turned,
        flag=SIGN,
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


SCALE, GRAVITY = "scale", "gravity"
FOLLOWS, SLOPE = 0.7, 3.0  # correlation from which a slope is judged, and how far off it may be
HEAVY = 2.0  # deviation of the file's gravity over that of the whole command: it cannot be in it
FAINT = 1e-3  # of the largest torque in the file: what moves by less says nothing of a unit
UNITS = {
    "thousandths of N m": 1e3,
    "kN m": 1e-3,
    "N m taken for degrees": np.pi / 180.0,
    "N m taken for radians": 180.0 / np.pi,
}
NEAR_FACTOR = 1.25  # a known unit explains a slope that is nearer than this


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
        return (Finding(SCALE, "cannot tell", "No command follows the model file closely enough."),)
    values = ", ".join(f"{value:.2g}" for value in slope[judged])
    said = f"Commands of {named(seen.parts, judged)} are {values} times the file's {_words(seen, judged)[0]}."
    return (Finding(SCALE, "green", said),)


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
        SCALE,
        "yellow",
        f"The commands of {named(seen.parts, wrong)} are {values} times the {word} of the model file: "
        f"{_guess(np.abs(slope[wrong]), limit[wrong]).replace('N m', unit)}",
        "State the unit in the header or in the robot file (command_unit), or convert them; "
        + accepted(SCALE)
        + ".",
        flag=SCALE,
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


SWAPPED = "swapped"
MARGIN = 10.0  # log likelihood: whole right logs of arms have none, stretches of 5 s and more stay below
DOUBT = 3.0  # log likelihood, one in twenty: above, the order is not called right either
APART_S = 0.5  # s between independent samples, at least
LEAST_ROWS = 20  # a correlation of fewer is chance


@dataclass(frozen=True, eq=False)
class Order:
    """Which command belongs to which joint.

    Attributes:
        best: (k,) the column of the command that fits each joint.
        margin: how much likelier that is than the order given, in log likelihood; 0 where it is the same.
        tied: (k,) whether the command that fits has the joint's friction in it, or is the file's torque.
    """

    best: Index
    margin: float
    tied: Mask

    @property
    def moved(self) -> Mask:
        """(k,) joints that another command fits better."""
        return np.asarray(self.best != np.arange(len(self.best)))

    @property
    def named(self) -> bool:
        """Whether the order is known, and not only that another fits better."""
        return self.margin > MARGIN and bool(self.tied[self.moved].all())

    @property
    def doubtful(self) -> bool:
        """Whether another order is likelier, so that the commands' signs and units say nothing."""
        return self.margin > DOUBT


def order_of(seen: Seen, torque: Array | None = None) -> Order | None:
    """The best assignment; None where fewer than two joints move under a command for long enough.

    Args:
        torque: (n, k) what a model file says of each joint's command, as one more regressor.
    """
    able = np.flatnonzero(seen.moves & (seen.moving.sum(axis=0) >= LEAST_ROWS))
    if seen.command is None or len(able) < 2:
        return None
    costs = {j: cost for j in able.tolist() if (cost := _costs(seen, j, torque)) is not None}
    if len(costs) < 2:
        return None
    own = np.array(list(costs))
    C = np.array([cost[own] for cost in costs.values()])
    chosen = assigned(C)
    best = np.arange(len(seen.parts))
    best[own] = own[chosen]
    margin = float(np.trace(C) - C[np.arange(len(own)), chosen].sum())
    return Order(best, margin, _tied(seen, best, torque))


def assigned(C: Array) -> Index:
    """(k,) the columns of the least sum, one of each row.

    The order given has it unless a cycle of exchanges is cheaper (Klein 1967), so that of a right log nothing
    is optimised, and what optimises need not be loaded.
    """
    away = C - np.diagonal(C)[:, None]
    for middle in range(len(C)):  # Floyd and Warshall: the cheapest chain of exchanges from each to each
        away = np.minimum(away, away[:, [middle]] + away[middle])
    if (np.diagonal(away) >= 0.0).all():
        return np.arange(len(C))
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(C)[1])


def _costs(seen: Seen, j: int, torque: Array | None) -> Array | None:
    """(k,) of each command, for joint j; None if it moves too briefly to tell commands apart."""
    assert seen.command is not None
    rows = seen.moving[:, j]
    columns = _regressors(seen, j)
    if torque is not None:
        columns.append(torque[rows, j])
    Q = np.linalg.qr(np.column_stack(columns))[0]
    Y = seen.command[rows] - seen.command[rows].mean(axis=0)
    left = Y - Q @ (Q.T @ Y)
    count = seen.seconds[j] / _apart(left[:, [j]], seen.step) - Q.shape[1]
    if count <= 0.0:
        return None
    whole = (Y * Y).sum(axis=0)
    share = np.where(whole > 0.0, (left * left).sum(axis=0) / np.where(whole > 0.0, whole, 1.0), 1.0)
    return np.asarray(0.5 * count * np.log(np.clip(share, 1e-9, 1.0)))


def _regressors(seen: Seen, j: int) -> list[Array]:
    """(n,) each, of the moving samples of a joint: constant, inertia, viscous and Coulomb friction."""
    rows = seen.moving[:, j]
    speed = seen.qd[rows, j]
    return [
        np.ones_like(speed),
        seen.qdd[rows, j],
        speed,
        np.tanh(speed / (MOVING * np.abs(speed).max())),
    ]


def _apart(left: Array, step: float) -> float:
    """s between independent samples, by what the joint's own column leaves (n, 1).

    If that column is the joint's, its memory is that of the noise; if it is another's, it is longer, as the
    weight that the other carries. So the truth lies between it and APART_S, and their geometric mean is
    taken: with APART_S alone 24 of 374 right stretches of 5 to 12 s are asked about, with the mean none, and
    with the memory alone a third fewer exchanged columns without friction in them are found.
    """
    return float(np.sqrt(APART_S * max(APART_S, float(memory(left, step)[0]))))


def _tied(seen: Seen, best: Index, torque: Array | None) -> Mask:
    """(k,) where the command that fits has friction in it, or is like the model file's torque.

    Friction: what a weight by the joint's own position and its inertia leave has power of one sign, and a
    Coulomb part that pushes the same way. What is in phase with the speed by chance has the power, and a
    Coulomb part of any sign.
    """
    assert seen.command is not None
    own = replace(seen, command=seen.command[:, best])
    tied = np.abs(likeness(own, torque)) > ALIKE
    for j in np.flatnonzero(seen.moves & ~tied).tolist():
        rows = seen.moving[:, j]
        q, y = seen.q[rows, j], seen.command[rows, best[j]]
        one, inertia, viscous, coulomb = _regressors(seen, j)
        X = np.column_stack([one, np.sin(q), np.cos(q), inertia, viscous, coulomb])
        found = np.linalg.lstsq(X, y, rcond=None)[0]
        power = (y - X[:, :4] @ found[:4]) * viscous
        tied[j] = abs(power.sum()) > SURE * np.abs(power).sum() and power.sum() * found[-1] > 0.0
    return np.asarray(tied)


def swap_finding(seen: Seen, torque: Array | None = None) -> Finding:
    """Whether columns of commands are exchanged; a question, with the order where it is known."""
    return finding_of(order_of(seen, torque), seen.parts)


def finding_of(found: Order | None, parts: tuple[str, ...]) -> Finding:
    """What is said of the likeliest order of the commands of these joints."""
    if found is None:
        fact = "Fewer than two joints move under a command for long enough to tell whether any are swapped."
        return Finding(SWAPPED, "cannot tell", fact)
    if not found.doubtful:
        return Finding(SWAPPED, "green", "Every command fits the joint that it is named after.")
    if not found.named:
        return _doubt(found, parts)
    pairs = ", ".join(
        f"{parts[j]} fits the column of {parts[found.best[j]]}" for j in np.flatnonzero(found.moved)
    )
    return Mendable(
        SWAPPED,
        "yellow",
        f"The commands of {named(parts, found.moved)} are very probably swapped: {pairs} (likelihood "
        f"e^{found.margin:.0f}).",
        f"Tell it with --repair {SWAPPED} to put them into this order; {accepted(SWAPPED)}.",
        flag=SWAPPED,
        by=tuple(found.best.astype(np.float64).tolist()),
    )


def _doubt(found: Order, parts: tuple[str, ...]) -> Finding:
    """Another order fits better, which proves nothing."""
    if found.margin <= MARGIN:
        better, why, step = "a little better", "in so short or slow a motion", "a longer motion tells more"
    else:
        better, why = "better", "where no friction of a joint is seen in its command"
        step = "the torques of a model file tell, if gravity's direction in it is the robot's"
    fact = (
        f"The commands of {named(parts, found.moved)} fit each other's joints {better} (likelihood "
        f"e^{found.margin:.0f}), which {why} may be chance."
    )
    return Finding(SWAPPED, "cannot tell", fact, f"Check the order of the columns; {step}.")
