"""Sign test of logs, and the order of their commands: one decision on all joints and logs of a robot.

Hypotheses are weighed in the order in which one spoils the next: signs of some logs against the others,
commands late, columns exchanged, rows reversed, signs of all logs, gravity taken out. Odds are natural
logarithms against the logs as they are. What is decided is put right, and the logs are judged again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import comb, lgamma

import numpy as np

from etude.logs.checks.exact import CERTAIN, LIKELY
from etude.logs.checks.filtered_motion import measured_rates
from etude.logs.checks.plausibility import SIGN, SWAPPED
from etude.logs.checks.velocities import DIRECTION
from etude.logs.evidence.delays import Clock
from etude.logs.evidence.file_hypotheses import positions_odds, weight_elsewhere
from etude.logs.evidence.joint_evidence import MOST_GROUPS, Decision, JointEvidence
from etude.logs.evidence.likelihood import NEITHER, WhitenedMotion, least, log_sum
from etude.logs.evidence.rows import APART, AS_LOGGED, DELAYS, FLOOR, FilteredRows, commands_of, rows_of
from etude.protocols import Mean
from etude.threads import threads_for
from etude.types import Array, Channel, Index, Log, Mask

GRAVITY = "gravity"
LEAST_HALF = 20  # rows of a half: fewer tell nothing
AHEAD = 7.0  # log odds to the next best set of signs: of less, signs that are likely by themselves are named


@threads_for(0)
def sign_decision(
    logs: Sequence[Log],
    path: Channel,
    body: Mean | None = None,
    *,
    fresh: Sequence[int] | None = None,
    force: bool = True,
    accepted: Collection[str] = (),
    described: bool | None = None,
) -> Decision:
    """The decision over all logs together.

    Args:
        logs: with positions `path` and commands on them; their clocks are right.
        body: the model file's prediction of the commands; None without a file.
        fresh: indices of the logs that are new; the others were judged before. None: all.
        force: whether commands are forces in SI, which may hold gravity.
        accepted: checks whose findings the user has accepted.
        described: whether a model file gives the joints' directions, even one that judges no commands; None:
            a body is one. Without a file directions are those of the positions.
    """
    fresh = tuple(range(len(logs)) if fresh is None else fresh)
    groups = groups_of(len(logs), fresh)
    evidence = JointEvidence.of(rows_of(logs, path, body, groups))
    if evidence is None:
        none = np.zeros(len(path.parts))
        return Decision("silent", none, none > 0.0, none > 0.0)

    # logs that were ingested before have their order, direction and clock
    new, whole = [logs[i] for i in fresh], len(fresh) == len(logs)
    alone = evidence if whole else JointEvidence.of(rows_of(new, path, body))
    clock = Clock.of(logs, path, body, fresh, alone)
    # a delay too short to be reported looks like another order or sign
    stepped, right = evidence, logs if clock is None else clock.in_step()
    if any(log is not in_step for log, in_step in zip(logs, right, strict=True)):
        new = [right[i] for i in fresh]
        stepped = evidence.with_command(commands_of(right, path, groups))
        if alone is not None:
            alone = stepped if whole else alone.with_command(commands_of(new, path, ()))
    timed = all(measured_rates(log, path) for log in new)

    def hypotheses() -> Iterator[Decision | None]:
        order = None if alone is None else order_of(alone)
        exchanged = None
        if alone is not None and order is not None and order.odds >= ORDER:
            exchanged = _uncontradicted(_exchanged_columns(alone, new, path, body, order), alone)
        backwards = -np.inf if timed or alone is None else _backwards(alone)
        turned = _uncontradicted(_signs(stepped, fresh, order, backwards), stepped)
        late = None if clock is None else clock.decision()  # it makes an order doubtful
        far = late is not None and late.level == "ask"
        # of a periodic motion a delay of half a period looks like a sign
        late = None if late is None or (turned is not None and turned.odds >= late.odds) else late
        yield late if far else None
        yield exchanged if len(new) == 1 else None
        yield late
        yield turned if turned is not None and len(turned.logs) < len(logs) else None
        yield exchanged  # of several logs, one that is inverted looks like another order
        yield None if timed or alone is None else _reversed_rows(alone)
        yield turned
        yield signs_with_presliding(stepped, fresh, order, timed)
        yield None if clock is None else clock.alone()
        weight = None if alone is None else _weight_question(alone, force)
        yield None if weight is not None and weight_elsewhere(new, path, body) else weight

    decisions = (one for one in hypotheses() if one is not None and one.check not in accepted)
    decision = next(decisions, None)
    if decision is None:
        unknown = clock is not None and not clock.excludes_delays
        joints = tuple(np.flatnonzero(stepped.rows.moving).tolist()) if alone is None else exchangeable(alone)
        return stepped.decision("silent", why="late" if unknown else "", exchangeable=joints)
    decision = decision if decision.logs else replace(decision, logs=fresh)
    positions = _position_odds(decision, stepped, path, body)
    described = body is not None if described is None else described
    either_side = described and decision.check in (SIGN, SWAPPED) and positions > -CERTAIN
    return replace(decision, positions=positions, either_side=either_side)


def _uncontradicted(decision: Decision | None, evidence: JointEvidence) -> Decision | None:
    """The decision; None if the likelihood with presliding friction contradicts it. Friction that turns round
    over a distance makes right commands fit another joint, or the other sign.
    """
    if decision is None or 0 < len(decision.logs) < len(np.unique(evidence.rows.log)):
        return decision  # of some logs against the others: all have the same friction
    by = np.array(decision.by)[evidence.joint_indices]
    if decision.check == SIGN:
        right, inverted = evidence.clock.variant(AS_LOGGED).signs()
        return decision if (inverted >= right)[by < 0.0].all() else None
    fits = _fits(evidence.clock)
    fits = np.take_along_axis(fits, np.searchsorted(evidence.joint_indices, by)[:, None], axis=1)
    return decision if fits.sum() >= 0.0 and (fits >= -LIKELY).all() else None


def signs_with_presliding(
    evidence: JointEvidence, fresh: Sequence[int], order: ColumnOrder | None, timed: bool
) -> Decision | None:
    """A question on signs from the likelihood with presliding friction, where the other leaves them open.
    What that one says against it counts.
    """
    clock = evidence.clock
    decision = _signs(clock, fresh, order, -np.inf if timed else _backwards(clock))
    if decision is None:
        return None
    about = np.array(decision.by)[evidence.joint_indices] < 0.0
    against = np.minimum(_plain_sign_odds(evidence)[about], 0.0)
    # of frictionless arms half a cycle late 7 at most
    return replace(decision, level="ask") if decision.odds + against.sum() >= CERTAIN else None


def _plain_sign_odds(evidence: JointEvidence) -> Array:
    """(m,) log odds of inverted signs, summed over all classes of processes."""
    as_logged = evidence.variant(AS_LOGGED)
    return np.asarray(log_sum(as_logged.inverted, axis=1) - log_sum(as_logged.right, axis=1))


def _position_odds(decision: Decision, evidence: JointEvidence, path: Channel, body: Mean | None) -> float:
    """Log odds that the positions, not the commands, have the decision's signs or order."""
    rows = evidence.rows.take(np.flatnonzero(np.isin(evidence.rows.log, decision.logs)))
    joints = evidence.joint_indices[rows.command[:, evidence.joint_indices, AS_LOGGED].std(axis=0) > 0.0]
    if body is None or decision.check not in (SIGN, SWAPPED) or len(joints) < 2:
        return 0.0
    columns, signs = np.arange(len(path.parts)), np.ones(len(path.parts))
    if decision.check == SIGN:
        signs = np.array(decision.by)
    else:
        columns = np.array(decision.by, dtype=np.int64)
    return positions_odds(rows, joints, path, body, columns, signs)


def groups_of(count: int, fresh: Sequence[int]) -> list[tuple[int, ...]]:
    """Groups of logs that may differ from the others: each log alone, and all new ones."""
    if count < 2:
        return []
    new = tuple(fresh)
    more = [new] if 1 < len(new) < count else []
    return [*((i,) for i in range(max(0, count - MOST_GROUPS), count)), *more]


AS_IS, EACH = 0.9, 0.15  # prior of the logs as they are; of each joint's sign, where some are inverted
ALL, SOME = 0.03, 0.07  # prior that all signs are inverted, or some, in all logs
GROUP, OLD_GROUP = 0.02, 0.002  # in some logs alone; where those were judged before


@dataclass(frozen=True, eq=False)
class Signs:
    """The likeliest signs: turned (m,) in the logs of a group (-1: none is), odds as in `Decision`.

    Attributes:
        each: (m,) log odds that each joint is inverted there.
    """

    turned: Mask
    group: int
    odds: float
    ahead: float
    each: Array

    def named(self) -> Mask:
        """(m,) the joints of the set; where others are nearly as likely, those that are in nearly all."""
        likely = np.asarray(self.each >= LIKELY)
        return likely if self.ahead < AHEAD and likely.any() else self.turned


def signs_of(as_is: Array, turned: Sequence[Array], priors: Sequence[tuple[float, float]]) -> Signs:
    """The most probable set of inverted joints in all groups of logs, without enumeration of the sets.

    A set S of joints that are inverted in one group has evidence sum_{S} turned + sum_{others} as_is. Its
    prior is every [S is every joint] + some EACH^|S| (1 - EACH)^(m - |S|), `priors` (every, some) of its
    group. The second is a product, so its best set and the sum over its others follow joint by joint.

    Args:
        as_is: (m,) evidence of each joint as it is. turned: of each group, (m,) of its negated commands.
    """
    right, whole = np.log1p(-EACH) + as_is, float(as_is.sum())
    nothing = np.zeros(len(as_is), dtype=np.bool_)
    none = [np.log(AS_IS) + whole, *(np.log(some) + right.sum() for _, some in priors)]
    hypotheses, other_scores = [(float(log_sum(none)), nothing, -1)], []
    for g, (inverted, (every, some)) in enumerate(zip(turned, priors, strict=True)):
        other = np.log(EACH) + inverted
        mixed = np.asarray(other > right)
        full = np.logaddexp(np.log(every) + inverted.sum(), np.log(some) + other.sum())
        best = float(np.log(some) + np.maximum(right, other).sum())
        hypotheses.append((float(full), ~nothing, g))
        if mixed.any() and not mixed.all():
            hypotheses.append((best, mixed, g))
        other_scores.append(best + _others(np.abs(other - right)))
    first = max(range(len(hypotheses)), key=lambda i: hypotheses[i][0])
    score, joints, group = hypotheses[first]
    next_ = float(log_sum([*other_scores, *(one[0] for i, one in enumerate(hypotheses) if i != first)]))
    each = np.zeros(len(as_is))
    if group >= 0:
        each = _joint_odds(right, np.log(EACH) + turned[group], *priors[group], hypotheses[0][0])
    return Signs(joints, group, score - hypotheses[0][0], score - next_, each)


def _joint_odds(right: Array, other: Array, every: float, some: float, none: float) -> Array:
    """(m,) log odds of all sets with a joint against all sets without it and the empty set."""
    either = np.logaddexp(right, other)
    others = np.log(some) + either.sum() - either
    whole = np.log(every) - len(right) * np.log(EACH) + other.sum()
    return np.asarray(np.logaddexp(others + other, whole) - np.logaddexp(others + right, none))


SMALL = -30.0  # log: log1p(x) and expm1(x) are x to rounding


def _others(apart: Array) -> float:
    """log(prod(1 + exp(-apart)) - 1), for odds (m,) >= 0 of any size."""
    near = np.log(np.log1p(np.exp(-np.minimum(apart, -SMALL))))
    small = float(log_sum(np.where(apart > -SMALL, -apart, near)))
    return small if small < SMALL else float(np.log(np.expm1(np.exp(small))))


def _signs(
    evidence: JointEvidence, fresh: Sequence[int], order: ColumnOrder | None, backwards: float
) -> Decision | None:
    """The likeliest inverted signs and the logs that have them; None where the logs are right as they are.

    One log's commands are negated. The evidence of right signs is then that of this log inverted. That of
    inverted signs is that of all the others inverted. The least favourable class gives the gain of the
    negation. The gain is at most the sign's log odds after the negation; the loss is at most those before it.
    Without these bounds, friction that looks like a function of the position favours the negation of one log:
    one there and one back agree better then.

    Args:
        order: of columns that may explain the commands better than these, whatever their signs.
        backwards: log odds that the rows run backwards, whatever the signs.
    """
    as_logged = evidence.variant(AS_LOGGED)
    as_is, turned = as_logged.signs()
    whole, classes = np.maximum(as_is, turned), as_logged.by_class()
    lost = np.maximum(np.abs(as_is - turned), LIKELY)
    everyone = tuple(range(int(evidence.rows.log.max()) + 1))
    hypotheses = {everyone: (turned, (ALL, SOME), AS_LOGGED)}
    for g, group in enumerate(evidence.rows.groups):
        others, number = tuple(i for i in everyone if i not in group), len(DELAYS) + g
        negated = evidence.variant(number)
        right, inverted = negated.signs()
        sign_odds = np.abs(right - inverted)
        gain = np.clip(least(negated.by_class(), classes), -np.maximum(lost, sign_odds), sign_odds)
        gain += whole - np.maximum(right, inverted)
        for logs, value in ((group, right + gain), (others, inverted + gain)):
            share = GROUP if set(logs) <= set(fresh) else OLD_GROUP
            hypotheses.setdefault(logs, (value, (share, share), number))
    values, priors, numbers = zip(*hypotheses.values(), strict=True)
    best = signs_of(as_is, values, priors)
    if best.group < 0 or best.odds < LIKELY:
        return None
    logs = list(hypotheses)[best.group]
    part = logs != everyone and not best.turned.all()  # of some logs some joints: rare, and easily misjudged
    ahead = best.ahead
    if logs == everyone:  # `backwards` sums over classes, of which `signs` takes the least favourable
        apart = _plain_sign_odds(evidence) - (turned - as_is)
        ahead = min(ahead, best.odds + float(apart[best.turned].sum()) - backwards)
    # certain only as a whole: a joint that no sign explains makes it a question, and so does another order
    sure = best.odds >= CERTAIN and ahead >= (2.0 if part else 1.0) * CERTAIN
    sure = sure and not evidence.variant(numbers[best.group]).strange().any()
    about = best.named()
    moved = order.with_any(about) if order is not None and logs == everyone else np.zeros_like(about)
    by = np.where(evidence.over(about | moved, False), -1.0, 1.0)
    return evidence.decision(
        "certain" if sure and not moved.any() else "ask",
        numbers[best.group],
        check=SIGN,
        logs=logs,
        by=tuple(by.tolist()),
        odds=best.odds,
        ahead=0.0 if moved.any() else ahead,
        why="order" if moved.any() else "time" if ahead < best.ahead else "",
    )


ORDER = CERTAIN  # log odds from which anything is said: of 430 right logs one had more, and its halves less
PAIR, ANY_ORDER = 0.05, 0.005  # prior of one exchanged pair, of any other order


def _fits(evidence: JointEvidence) -> Array:
    """(m, m) log odds of column k against joint j's own column, by the least favourable class."""
    size, m = evidence.crossed.by_class(), len(evidence.joint_indices)
    diagonal = np.tile(size[np.arange(m) * m + np.arange(m)], (m, 1))
    return least(size, diagonal).reshape(m, m)


def _gains(evidence: JointEvidence) -> Array:
    """(m, m) as `_fits`, bounded by the log odds of the sign of column k at joint j. A function of the
    position fits any joint by chance.
    """
    right, inverted = evidence.crossed.signs()
    gains = np.minimum(_fits(evidence), np.abs(right - inverted).reshape(len(evidence.joint_indices), -1))
    np.fill_diagonal(gains, 0.0)
    return gains


@dataclass(frozen=True, eq=False)
class ColumnOrder:
    """The best order besides the logged one: the column of each moving joint (m,), odds as in `Decision`."""

    columns: Index
    odds: float
    ahead: float

    def with_any(self, joints: Mask) -> Mask:
        """(m,) joints that exchange columns with any of `joints` (m,); none of an unlikely order."""
        if self.odds <= -LIKELY:
            return np.zeros_like(joints)
        reached = joints
        for _ in self.columns:
            reached = reached | reached[self.columns]
        return np.asarray(reached & (self.columns != np.arange(len(self.columns))))

    @property
    def usual(self) -> bool:
        """One exchanged pair, or the reversal of all: what happens to tables."""
        count = np.arange(len(self.columns))
        return int((self.columns != count).sum()) == 2 or bool((self.columns == count[::-1]).all())


def order_of(evidence: JointEvidence) -> ColumnOrder | None:
    """The best other order of the columns; None where the logged order is the best."""
    gains = _gains(evidence)
    columns, odds = _assigned(gains)
    if (columns == np.arange(len(columns))).all():
        return None
    others = []
    for j, k in enumerate(columns.tolist()):
        barred = gains.copy()
        barred[j, k] = -1e9
        others.append(_assigned(barred)[1])
    return ColumnOrder(columns, odds, odds - max(others))


def exchangeable(evidence: JointEvidence) -> tuple[int, ...]:
    """Joints that exchange columns with another one at no loss: whether they are exchanged cannot be told."""
    gains = _gains(evidence)
    alike = gains + gains.T > -LIKELY
    np.fill_diagonal(alike, False)
    return tuple(evidence.joint_indices[alike.any(axis=1)].tolist())


def _assigned(gains: Array) -> tuple[Index, float]:
    """The assignment of columns (m,) with the largest gain, and its log odds."""
    from scipy.optimize import linear_sum_assignment

    columns, m = np.asarray(linear_sum_assignment(-gains)[1]), len(gains)
    moved = int((columns != np.arange(m)).sum())
    prior = np.log(PAIR / comb(m, 2)) if moved == 2 else np.log(ANY_ORDER) - lgamma(m + 1) if moved else 0.0
    return columns, float(gains[np.arange(m), columns].sum() + prior)


def _exchanged_columns(
    evidence: JointEvidence, logs: Sequence[Log], path: Channel, body: Mean | None, order: ColumnOrder
) -> Decision | None:
    """Exchanged columns, if both halves of the logs support the exchange together."""
    m = len(order.columns)
    joints = evidence.joint_indices
    halves = [_half_gain(logs, path, body, joints, order.columns, first) for first in (True, False)]
    if sum(halves) < LIKELY:
        return None
    explained = not evidence.crossed.take(np.arange(m) * m + order.columns).strange().any()
    sure = order.usual and explained and min(halves) >= LIKELY and order.ahead >= CERTAIN
    best = np.arange(len(evidence.rows.parts))
    best[joints] = joints[order.columns]
    return evidence.decision(
        "certain" if sure else "ask",
        check=SWAPPED,
        by=tuple(best.astype(np.float64).tolist()),
        odds=order.odds,
        ahead=order.ahead,
    )


def _half_gain(
    logs: Sequence[Log], path: Channel, body: Mean | None, joints: Index, order: Index, first: bool
) -> float:
    """Log odds of the order in one half of every log."""
    parts = [log.take((log.t <= 0.5 * (log.t[0] + log.t[-1])) == first) for log in logs]
    rows = rows_of(parts, path, body)
    if rows is None or len(rows.t) < LEAST_HALF:
        return 0.0
    gains = _gains(JointEvidence(rows, joints, WhitenedMotion.of(rows, joints)))
    return float(gains[np.arange(len(joints)), order].sum())


BACKWARDS = float(np.log(0.02))  # log prior of reversed rows
EXPLAINED = 0.7  # of the joints, at least, that reversed rows explain


def _backwards(evidence: JointEvidence) -> float:
    """Log odds that the rows run backwards, with right or inverted signs, against the logs as they are."""
    as_logged = evidence.variant(AS_LOGGED)
    right, back, opposed = (
        log_sum(x, axis=1) for x in (as_logged.right, as_logged.reversed, as_logged.opposed)
    )
    either = np.logaddexp(np.log1p(-EACH) + back, np.log(EACH) + opposed)
    signs = [np.log(AS_IS) + back.sum(), np.log(SOME) + either.sum(), np.log(ALL) + opposed.sum()]
    return float(BACKWARDS - np.log(AS_IS) + log_sum(signs) - right.sum())


def _reversed_rows(evidence: JointEvidence) -> Decision | None:
    """Rows that run backwards: inertia and weight have the right sign, friction is inverted. Inverted signs
    look similar; where the data do not separate the two, the question on signs names both.
    """
    as_logged = evidence.variant(AS_LOGGED)
    right, inverted, back = (
        log_sum(x, axis=1) for x in (as_logged.right, as_logged.inverted, as_logged.reversed)
    )
    turned = BACKWARDS + float((back - right).sum())
    flipped = float(np.log(ALL)) + float((inverted - right).sum())
    as_is, other = as_logged.signs()
    signs = signs_of(as_is, [other], [(ALL, SOME)])
    rival_odds = max(flipped, -np.inf if signs.group < 0 or signs.turned.all() else signs.odds)
    explained = np.mean(back > log_sum(as_logged.free, axis=1) + NEITHER) > EXPLAINED
    if turned < LIKELY or turned < rival_odds + LIKELY or not explained:
        return None
    sure = turned >= CERTAIN and turned > rival_odds + CERTAIN
    return evidence.decision(
        "certain" if sure else "ask", check=DIRECTION, by=(-1.0,), odds=turned, ahead=turned - rival_odds
    )


SURE, UPSIDE_DOWN, LITTLE = 6.0, 0.4, 0.25  # deviations; parts of the file's gravity
HEAVY = 0.5  # of a command's deviation that is weight by the file: of less, masses that are off make any sign


@dataclass(frozen=True, eq=False)
class Weight:
    """Of the model file's gravity: the part that commands hold, over all joints and by joint (m,), and the
    deviations of both.

    Attributes:
        sizes: (m,) deviation of the file's gravity in parts of the command's.
    """

    part: float
    deviation: float
    parts: Array
    deviations: Array
    sizes: Array


def weight_of(rows: FilteredRows, joints: Index) -> Weight | None:
    """The weight in the commands by least squares, beside the file's other torques, inertia and friction. The
    residual variance weighs each joint. None without a model file, or where the file has no weight.
    """
    if rows.torque is None or rows.static is None:
        return None
    product, square = np.zeros(len(joints)), np.zeros(len(joints))
    for i, j in enumerate(joints.tolist()):
        y, g = rows.command[:, j, AS_LOGGED], rows.static[:, j]
        others = [np.ones_like(y), rows.torque[:, j] - g, rows.qdd[:, j], rows.qd[:, j], rows.friction[:, j]]
        Q = np.linalg.qr(np.column_stack(others))[0]
        g, z = g - Q @ (Q.T @ g), y - Q @ (Q.T @ y)
        if (size := float(g @ g)) > FAINT:
            left = float(((z - g * (g @ z) / size) ** 2).mean()) + FLOOR * float(y.var())
            product[i], square[i] = float(g @ z) / left, size / left
    if not square.any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        parts, deviations = np.where(square > 0.0, product / square, 0.0), np.sqrt(APART / square)
    command = rows.command[:, joints, AS_LOGGED]
    return Weight(
        float(product.sum() / square.sum()),
        float(np.sqrt(APART / square.sum())),
        parts,
        deviations,
        rows.static[:, joints].std(axis=0) / np.maximum(command.std(axis=0), FAINT),
    )


FAINT = 1e-12  # squared N m: no weight


def _weight_question(evidence: JointEvidence, force: bool) -> Decision | None:
    """A question on an inverted weight in a joint without clear friction, or on a missing weight."""
    weight = weight_of(evidence.rows, evidence.joint_indices)
    if weight is None:
        return None
    significant = (np.abs(weight.parts) > SURE * weight.deviations) & (np.abs(weight.parts) > UPSIDE_DOWN)
    right, inverted = evidence.variant(AS_LOGGED).signs()
    heavy = np.abs(weight.parts) * weight.sizes > HEAVY
    down = evidence.over(significant & heavy & (weight.parts < 0.0) & (right - inverted < LIKELY), False)
    if down.any():
        by = tuple(np.where(down, -1.0, 1.0).tolist())
        # masses or a mounting that are wrong in the file turn a weight as well, so nothing is repaired
        return evidence.decision("ask", check=SIGN, by=by, odds=SURE, ahead=0.0, why="weight")
    little = abs(weight.part) < LITTLE and (1.0 - weight.part) > SURE * weight.deviation
    if force and little and not significant.any():
        by = (weight.part, weight.deviation)
        return evidence.decision("ask", check=GRAVITY, by=by, odds=SURE)
    return None
