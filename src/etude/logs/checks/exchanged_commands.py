"""Exchanged command columns, found without a model: friction and inertia tie a command to its own joint.

C_jk = n_j / 2 log(residual variance / variance) of command k, regressed on (1, qdd_j, qd_j, tanh(qd_j /
5 % of its top)) over the moving samples of joint j; the least sum over all assignments (Kuhn 1955) against
that of the order given. n_j counts independent samples, less one for each regressor: of a short stretch with
slow commands few are left, and some other column fits by chance.

A weight is tied to no joint: it depends on all positions, and where every joint moves by a frequency of its
own, as exciting motions do, it fits another joint's motion as well as friction would. So another order is a
question only where every command that it moves has Coulomb friction of its joint in it, or is the torque of
the model file; else nobody can tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.logs.checks.command_sign import ALIKE, SURE, likeness
from etude.logs.checks.filtered_motion import MOVING, Seen, memory
from etude.logs.checks.finding_texts import Mendable, accepted, named
from etude.types import Array, Finding, Index, Mask

CHECK = "swapped"
MARGIN = 10.0  # log likelihood: whole right logs of arms have none, stretches of 5 s and more stay below
DOUBT = 3.0  # log likelihood, one in twenty: above, the order is not called right either
APART_S = 0.5  # s between independent samples, at least
LEAST_ROWS = 20


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
        return Finding(CHECK, "cannot tell", fact)
    if not found.doubtful:
        return Finding(CHECK, "green", "Every command fits the joint that it is named after.")
    if not found.named:
        return _doubt(found, parts)
    pairs = ", ".join(
        f"{parts[j]} fits the column of {parts[found.best[j]]}" for j in np.flatnonzero(found.moved)
    )
    return Mendable(
        CHECK,
        "yellow",
        f"The commands of {named(parts, found.moved)} are very probably swapped: {pairs} (likelihood "
        f"e^{found.margin:.0f}).",
        f"Tell it with --repair {CHECK} to put them into this order; {accepted(CHECK)}.",
        flag=CHECK,
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
    return Finding(CHECK, "cannot tell", fact, f"Check the order of the columns; {step}.")
