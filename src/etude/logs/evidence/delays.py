"""Commands before or behind the motion: in all new logs alike, in one of them, or by a long time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from etude.logs.checks.exact import CERTAIN, LIKELY
from etude.logs.checks.plausibility import DELAY
from etude.logs.cleaning.smoothing import resample
from etude.logs.evidence.joint_evidence import MOST_GROUPS, Decision, JointEvidence
from etude.logs.evidence.likelihood import FEW, WhitenedMotion, least
from etude.logs.evidence.rows import AS_LOGGED, DELAYS
from etude.types import Array, Log

# log odds from which commands are shifted: 15 in a right simulated log, 28 in real ones
SHIFT = 3.0 * CERTAIN
LEAST_DELAY = 0.03  # s: real sensors have less without harm
DELAY_PRIOR = 100.0  # 1/s: log prior that falls with a delay


def delays(judged: JointEvidence, by: float = 0.0) -> Array:
    """(d,) log evidence of each delay, of rows whose commands were shifted by s."""
    whole = judged.columns.whole().reshape(len(judged.own), -1)[:, : len(DELAYS)]
    return np.asarray(whole.sum(axis=0) - DELAY_PRIOR * np.abs(np.array(DELAYS) + by))


def at_edge_of(judged: JointEvidence) -> bool:
    return int(delays(judged).argmax()) in (0, len(DELAYS) - 1)


def in_step(judged: JointEvidence) -> float:
    """s by which the commands of new logs fit the motion best; 0 where that is not certain, or at an end."""
    total = delays(judged)
    certain = total.max() - total[AS_LOGGED] >= CERTAIN and not at_edge_of(judged)
    return DELAYS[int(total.argmax())] if certain else 0.0


FAR, FARTHEST = (0.25, 0.45), 0.55  # s about which longer delays are looked for, and the longest
# log odds from which a long delay is asked about: right logs of an arm that sticks had 74, late ones 430
FAR_ODDS = 150.0
MOST_KNOWN = 0.5  # of the joints, at least, whose signs are told with such a delay


def far_delay(
    judged: JointEvidence, shifted: Callable[[float], JointEvidence], fresh: Sequence[int]
) -> Decision | None:
    """The same beyond the delays of the rows: first coarsely, then about the best of them. None at an end of
    what is tried, and where signs are not right then: of a periodic motion many delays fit somehow. So this
    is a question, and nothing is shifted unasked.
    """
    way = float(np.sign(DELAYS[int(delays(judged).argmax())]))
    best, own, at = 0.0, judged, AS_LOGGED
    for centres in ([way * far for far in FAR], None):
        tried = [(by, shifted(by)) for by in centres or [best]]
        by, own = max(tried, key=lambda one: float(delays(one[1], one[0]).max()))
        at = int(delays(own, by).argmax())
        best = by + DELAYS[at]
    odds = float(least(own.variant(at).by_class(), judged.variant(AS_LOGGED).by_class()).sum())
    odds -= DELAY_PRIOR * abs(best)
    right, inverted = own.variant(at).signs()
    known = np.abs(right - inverted) >= LIKELY
    clear = known.mean() >= MOST_KNOWN and (right > inverted)[known].all()
    if odds < FAR_ODDS or not clear or abs(best) >= FARTHEST:
        return None
    return judged.decision("ask", check=DELAY, logs=tuple(fresh), by=(round(best, 3),), odds=odds)


def shifted_log(log: Log, late: float) -> Log:
    """The log with the commands of so many s later; at the ends the last ones."""
    command = next(c for c in log.channels.values() if c.role == "command" and c.acts_on in log)
    return log.put(command, resample(log.t, log[command.name], log.t + late))


def late(judged: JointEvidence, fresh: Sequence[int]) -> Decision | None:
    """Commands of the new logs before or behind the motion, alike in all joints."""
    total = delays(judged)
    long = np.abs(DELAYS) >= LEAST_DELAY
    best, near = int(total.argmax()), int(np.where(long, -np.inf, total).argmax())
    if not long[best] or best in (0, len(DELAYS) - 1):  # beyond what is tried it may be any
        return None
    sizes = [judged.variant(i).by_class() for i in (best, near)]
    odds = float(least(*sizes).sum() + DELAY_PRIOR * (abs(DELAYS[near]) - abs(DELAYS[best])))
    if odds < SHIFT:
        return None
    return judged.decision("note", check=DELAY, logs=tuple(fresh), by=(DELAYS[best],), odds=odds)


def late_alone(judged: JointEvidence, fresh: Sequence[int]) -> Decision | None:
    """Commands of one of several new logs before or behind the motion, unlike those of the others."""
    rows, found = judged.rows, []
    motion = WhitenedMotion(rows, judged.own, FEW)
    for i in fresh[-MOST_GROUPS:] if len(fresh) > 1 else ():
        own = (rows.log == i)[:, None, None]
        command = np.where(own, rows.command, rows.command[..., AS_LOGGED, None])
        total = motion.free(command, range(len(DELAYS))).sum(axis=0) - DELAY_PRIOR * np.abs(DELAYS)
        best = int(total.argmax())
        if abs(DELAYS[best]) >= LEAST_DELAY and 0 < best < len(DELAYS) - 1:
            found.append((float(total[best] - total[AS_LOGGED]), i, DELAYS[best]))
    odds, log, late = max(found, default=(0.0, -1, 0.0))
    if odds < SHIFT:
        return None
    return judged.decision("note", check=DELAY, logs=(log,), by=(late,), odds=odds)
