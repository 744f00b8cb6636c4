"""Commands before or behind the motion, in all new logs alike or in some of them, or those of one joint.

A delay is of a log, and not of a robot: the rows of a log tell it by themselves. One model of slow and fast
logs together does not: what it lacks of friction at either speed outweighs a delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.logs.checks.exact import CERTAIN, LIKELY
from etude.logs.checks.plausibility import DELAY
from etude.logs.cleaning.smoothing import resample
from etude.logs.evidence.joint_evidence import MOST_GROUPS, Decision, JointEvidence, Level
from etude.logs.evidence.likelihood import CLOCK_TERMS, FEW, LENGTHS, TERMS, WhitenedMotion, least, log_sum
from etude.logs.evidence.rows import AS_LOGGED, DELAYS, commands_of, rows_of
from etude.protocols import Mean
from etude.types import Array, Channel, Log

# Log odds from which a delay is told, and from which commands are shifted
SAID, SHIFT = CERTAIN, math.log(1e10)
LEAST_DELAY = 0.03  # s: real sensors have less without harm
DELAY_PRIOR = 100.0  # 1/s: log prior that falls with a delay


def delays(evidence: JointEvidence, by: float = 0.0) -> Array:
    """(d,) log evidence of each delay, of rows whose commands were shifted by s."""
    whole = _joint_evidences(evidence)
    return np.asarray(whole.sum(axis=0) - DELAY_PRIOR * np.abs(np.array(DELAYS) + by))


def agreed(longer: Array, shorter: Array) -> float:
    """Log odds of one delay against another from evidences (m, c), by class, without the most decisive joint.
    All joints share one clock: a delay in a single joint is its friction or its gear.
    """
    each = least(longer, shorter)
    return float(each.sum() - (each.max() if len(each) > 1 else 0.0))


def disagreement(each: Array, best: int) -> float:
    """What a delay of each joint's own explains beyond a common one, from log evidences (m, d): by so much
    friction looks like a delay.
    """
    return float((each.max(axis=1) - each[:, best]).sum())


def at_edge_of(evidence: JointEvidence) -> bool:
    return int(delays(evidence).argmax()) in (0, len(DELAYS) - 1)


def in_step(evidence: JointEvidence, shifted: Callable[[float], JointEvidence]) -> float:
    """The best delay (s) of the commands of new logs, at a point of the grid or between two; 0 where it is
    uncertain or at an end of the grid.
    """
    total = delays(evidence)
    best = int(total.argmax())
    if at_edge_of(evidence):
        return 0.0
    least_known = total[AS_LOGGED] + CERTAIN
    by, gain = _between(_joint_evidences(evidence), len(evidence.rows.t), best)
    if total[best] + gain >= least_known:
        between = shifted(by).variant(AS_LOGGED).whole().sum() - DELAY_PRIOR * abs(by)
        if between >= max(total[best], least_known):
            return by
    return DELAYS[best] if total[best] >= least_known else 0.0


LEAST_LEFT = 1e-3  # of what a fit leaves at the best delay tried, by a parabola that may fall below zero


def _joint_evidences(evidence: JointEvidence) -> Array:
    """(m, d) log evidence of each delay by joint."""
    return evidence.delayed.whole().reshape(len(evidence.joint_indices), -1)


def _between(each: Array, n: int, best: int) -> tuple[float, float]:
    """Refined delay (s) around the best grid point by a parabola, and its gain in log odds; of n rows, with
    evidences (m, d).

    The residual variance of a command is quadratic in a small shift, since the command is linear in it. The
    log evidence is minus half the logarithm of that variance for each row.
    """
    near = slice(best - 1, best + 2)
    whole = each[:, near]
    left = np.exp(-2.0 / n * (whole - whole[:, 1:2])).mean(axis=0)
    bend = np.polyfit(DELAYS[near], left, 2)
    by = float(np.clip(-0.5 * bend[1] / bend[0], DELAYS[best - 1], DELAYS[best + 1]))
    return by, -0.5 * n * len(whole) * float(np.log(max(float(np.polyval(bend, by)), LEAST_LEFT)))


ROUNDS, SETTLED = 3, 0.005  # of a refined delay; s that a round may still move it by


def refined(late: float, shifted: Callable[[float], JointEvidence]) -> float:
    """The likeliest delay (s, to 1 ms) near `late`. Commands are shifted by it before each parabola: one that
    is drawn from afar leaves half of what it corrects.
    """
    for _ in range(ROUNDS):
        evidence = shifted(late)
        best = int(delays(evidence, late).argmax())
        if best in (0, len(DELAYS) - 1):
            break
        by, _ = _between(_joint_evidences(evidence), len(evidence.rows.t), best)
        late += by
        if abs(by) < SETTLED:
            break
    return round(late, 3)


@dataclass(frozen=True, eq=False)
class Clock:
    """The delay of some of the logs, and the evidence of these by themselves.

    Attributes:
        logs: all. which: those. path: of their positions.
        evidence: `JointEvidence.clock`.
    """

    logs: Sequence[Log]
    path: Channel
    which: tuple[int, ...]
    evidence: JointEvidence

    @classmethod
    def of(
        cls,
        logs: Sequence[Log],
        path: Channel,
        body: Mean | None,
        fresh: Sequence[int],
        alone: JointEvidence | None,
    ) -> Clock | None:
        """Of all new logs, whose evidence is `alone`, or of those that are late while others are not."""
        which = out_of_step(logs, path, fresh)
        if len(which) < len(fresh):
            alone = JointEvidence.of(rows_of([logs[i] for i in which], path, body))
        return None if alone is None else cls(logs, path, which, alone.clock)

    @property
    def excludes_delays(self) -> bool:
        """Whether short delays explain the commands better than longer ones, without the prior."""
        total = delays(self.evidence) + DELAY_PRIOR * np.abs(DELAYS)
        short = np.abs(DELAYS) < LEAST_DELAY
        return float(total[short].max() - total[~short].max()) >= SAID

    def in_step(self) -> list[Log]:
        """All logs, with the commands of these shifted where that is certain."""
        by = in_step(self.evidence, self._shifted)
        return [shifted_log(log, by) if by and i in self.which else log for i, log in enumerate(self.logs)]

    def decision(self) -> Decision | None:
        """A question on a long delay, or a note on one that is tried; its size is refined."""
        far = far_delay(self.evidence, self._shifted, self.which) if at_edge_of(self.evidence) else None
        found = far or late(self.evidence, self.which)
        return found and replace(found, by=(refined(found.by[0], self._shifted),))

    def alone(self) -> Decision | None:
        """A question on one joint whose commands are late or early, while those of the others are not."""
        return late_alone(self.evidence, self._shifted, self.which)

    def _shifted(self, late: float) -> JointEvidence:
        moved = [shifted_log(self.logs[i], late) for i in self.which]
        return self.evidence.with_command(commands_of(moved, self.path, ()))


def out_of_step(logs: Sequence[Log], path: Channel, fresh: Sequence[int]) -> tuple[int, ...]:
    """The new logs that share one delay: all of them, or the few that are late while the others are not."""
    delay_by_log = {i: _log_delay(logs[i], path) for i in fresh[-MOST_GROUPS:] if len(fresh) > 1}
    late = {i: best for i, (best, odds) in delay_by_log.items() if odds >= SHIFT}
    if not late:
        return tuple(fresh)
    most = late[max(late, key=lambda i: delay_by_log[i][1])]
    # neighbours among the delays that are tried are one delay
    alike = [i for i, best in late.items() if abs(best - most) <= 1]
    return tuple(alike) if len(alike) < len(delay_by_log) else tuple(fresh)


def _log_delay(log: Log, path: Channel) -> tuple[int, float]:
    """Index of a log's likeliest delay in DELAYS, and its log odds against the likeliest short one."""
    rows = rows_of([log], path)
    if rows is None or not rows.moving.any():
        return AS_LOGGED, 0.0
    joints, each, command = np.flatnonzero(rows.moving), [], rows.command
    models = ((rows, CLOCK_TERMS), (rows.without_turns(), TERMS))
    for length in LENGTHS:
        grid = tuple(point for point in FEW if point.length == length)
        motions = (WhitenedMotion(one, joints, grid, terms=terms) for one, terms in models)
        each.append(log_sum([motion.free(command, range(len(DELAYS))) for motion in motions], axis=0))
    return _likeliest(np.array(each))


def _likeliest(each: Array) -> tuple[int, float]:
    """Of log evidences (c, m, d) by class and joint; the odds are those of the least favourable class."""
    joints = log_sum(each, axis=0)
    total = joints.sum(axis=0) - DELAY_PRIOR * np.abs(DELAYS)
    best = int(total.argmax())
    near, prior = _likeliest_short(total, best)
    return best, agreed(each[..., best].T, each[..., near].T) + prior - disagreement(joints, best)


def _likeliest_short(total: Array, best: int) -> tuple[int, float]:
    """Index of the likeliest short delay by evidences (d,), and the log prior odds of `best` to it."""
    near = int(np.where(np.abs(DELAYS) >= LEAST_DELAY, -np.inf, total).argmax())
    return near, DELAY_PRIOR * (abs(DELAYS[near]) - abs(DELAYS[best]))


FAR, FARTHEST = (0.25, 0.45), 0.55  # s about which longer delays are looked for, and the longest
# log odds from which a long delay is asked about: right logs had up to 119 (in 160 of a simulated arm)
FAR_ODDS = 9.0 * CERTAIN
MOST_KNOWN = 0.5  # of the joints, at least, whose signs are told with such a delay


def far_delay(
    evidence: JointEvidence, shifted: Callable[[float], JointEvidence], fresh: Sequence[int]
) -> Decision | None:
    """The delay beyond the grid of the rows, by a coarse search and a fine one. None at an end of the
    search, or where signs are wrong at that delay: many delays fit a periodic motion. The result is
    therefore a question, never an automatic shift.
    """
    direction = float(np.sign(DELAYS[int(delays(evidence).argmax())]))
    best, delayed, at = 0.0, evidence, AS_LOGGED
    for centres in ([direction * far for far in FAR], None):
        tried = [(by, shifted(by)) for by in centres or [best]]
        by, delayed = max(tried, key=lambda one: float(delays(one[1], one[0]).max()))
        at = int(delays(delayed, by).argmax())
        best = by + DELAYS[at]
    odds = agreed(delayed.variant(at).by_class(), evidence.variant(AS_LOGGED).by_class())
    odds -= DELAY_PRIOR * abs(best)
    right, inverted = delayed.variant(at).signs()
    is_known = np.abs(right - inverted) >= LIKELY
    clear = is_known.mean() >= MOST_KNOWN and (right > inverted)[is_known].all()
    if odds < FAR_ODDS or not clear or abs(best) >= FARTHEST:
        return None
    return evidence.decision("ask", check=DELAY, logs=tuple(fresh), by=(best,), odds=odds)


def shifted_log(log: Log, late: float) -> Log:
    """The log with the commands of `late` s later; the ends repeat the outermost ones."""
    command = next(c for c in log.channels.values() if c.role == "command" and c.acts_on in log)
    return log.put(command, resample(log.t, log[command.name], log.t + late))


def late(clock: JointEvidence, fresh: Sequence[int]) -> Decision | None:
    """The delay or lead of the new logs' commands, common to all joints: a note or a question."""
    best = int(delays(clock).argmax())
    if abs(DELAYS[best]) < LEAST_DELAY or best in (0, len(DELAYS) - 1):  # beyond what is tried it may be any
        return None
    odds = _odds_of(clock, best)
    if odds < SAID:
        return None
    level: Level = "note" if odds >= SHIFT else "ask"
    return clock.decision(level, check=DELAY, logs=tuple(fresh), by=(DELAYS[best],), odds=odds)


def _odds_of(evidence: JointEvidence, best: int) -> float:
    """Log odds of one of DELAYS against the likeliest short one, by the agreement of the joints."""
    near, prior = _likeliest_short(delays(evidence), best)
    joints = _joint_evidences(evidence)
    odds = agreed(*(evidence.variant(i).by_class() for i in (best, near))) + prior
    return odds - disagreement(joints, best)


ALONE = 0.01  # prior that one joint has a clock of its own
MOST_SLOW = 0.5  # of the rows of such a joint: of one burst, or of a wild position, any delay is told


def late_alone(
    evidence: JointEvidence, shifted: Callable[[float], JointEvidence], fresh: Sequence[int]
) -> Decision | None:
    """A question on the joint that is likeliest late or early by itself, where others are not. None at an end
    of the delays that are tried, or of the next ones, and where its sign is not told at that delay.
    """
    candidate = _out_of_step_alone(evidence)
    if candidate is None:
        return None
    j, near, others = candidate
    by, delayed, first = 0.0, evidence, j * len(DELAYS)
    for _ in range(2):
        own = _joint_evidences(delayed)[j]
        at = int((own - DELAY_PRIOR * np.abs(np.array(DELAYS) + by)).argmax())
        if 0 < at < len(DELAYS) - 1:
            break
        by += DELAYS[at]
        delayed = shifted(by)
    else:
        return None
    late = delayed.delayed.take(slice(first + at, first + at + 1))
    size = by + _between(own[None], len(evidence.rows.t), at)[0]
    odds = float(least(late.by_class(), evidence.delayed.by_class()[first + near, None])[0])
    odds += math.log(ALONE / len(evidence.joint_indices)) - DELAY_PRIOR * abs(size) - others
    right, inverted = late.signs()
    if odds < SAID or right[0] - inverted[0] < LIKELY:  # many delays fit a periodic motion
        return None
    by_joint = (size, float(evidence.joint_indices[j]))
    return evidence.decision("ask", check=DELAY, logs=tuple(fresh), by=by_joint, odds=odds)


def _out_of_step_alone(evidence: JointEvidence) -> tuple[int, int, float] | None:
    """The joint with the clearest delay, the index of its likeliest short one, and log odds by which others
    are late, too; None where those are nearly as large.
    """
    each = _joint_evidences(evidence)
    total = each - DELAY_PRIOR * np.abs(DELAYS)
    short = np.where(np.abs(DELAYS) >= LEAST_DELAY, -np.inf, total)
    slow = evidence.rows.turning[:, evidence.joint_indices].mean(axis=0)
    gains = np.where(slow > MOST_SLOW, 0.0, total.max(axis=1) - short.max(axis=1))
    j = int(gains.argmax())
    others = float(gains.sum() - gains[j])
    # free commands where it turns round fit either direction alike
    opposite = np.array(DELAYS) * DELAYS[int(total[j].argmax())] <= -(LEAST_DELAY**2)
    ahead = float(each[j].max() - each[j, opposite].max(initial=-np.inf))
    clear = len(each) > 1 and min(gains[j] - others, ahead) >= SAID
    return (j, int(short[j].argmax()), others) if clear else None
