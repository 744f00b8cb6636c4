"""Plausibility checks of a log, in an order in which no fault spoils a later check, and their repairs.

A jump of a position is compared with the motion beside it, so that neither a fast flight nor a crash counts.
After a crash a vehicle has another speed. After a reset of its estimate it continues with the same speed at
another place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from etude.abilities import SupportsVariations
from etude.errors import UsageError
from etude.logs.checks import exact, velocities
from etude.logs.checks.command_units import load_beside, scale_finding
from etude.logs.checks.filtered_motion import Seen, joints, runs, seen, states_of
from etude.logs.checks.finding_texts import Excludable, Mendable, named
from etude.logs.checks.velocities import degrees_finding, speed_finding
from etude.logs.cleaning.ranges import top_speed
from etude.logs.cleaning.repairs import leap_finding
from etude.logs.cleaning.smoothing import GAP_FACTOR, median_rate, resample
from etude.logs.columns.units import Limits
from etude.protocols import Mean
from etude.types import Array, Channel, Finding, Log, Mask

SWAPPED, SIGN, DELAY = "swapped", "sign", "delay"
STILL = "Nothing moves: no joint changes its position by more than its noise."


def judge_motion(
    log: Log,
    path: str,
    channels: Sequence[Channel],
    limits: Limits,
    usual: float | None = None,
    motion: Seen | None = None,
) -> tuple[Finding, ...]:
    """Clock, direction and units of the motion.

    Args:
        log: rows in order.
        path: the channel of the positions; without it there are no findings.
        channels: the robot's.
        limits: lower and upper (parts,) by channel.
        usual: Hz at which the robot is logged.
        motion: the filtered motion, if it is computed already.
    """
    if motion is None and path in log:
        motion = seen(log, log.channels[path])
    if motion is None:
        return ()
    if motion.command is not None and not motion.moves.any():
        return (Finding("rest", "red", STILL, "Release the brakes and record a motion."),)
    leap = _leap(log, path, channels, limits)
    if leap is not None:
        return (leap,)
    rate = median_rate(log.t)
    finding = velocities.rate_finding(motion, rate, usual)
    if finding.light == "red":
        return (finding,)
    others = [degrees_finding(motion)]
    top = top_speed(log.channels[path], channels, limits)
    if top is not None and finding.light != "green":
        others.append(speed_finding(motion, top, rate, usual))
    return (finding, *(other for other in others if other is not None))


def _leap(log: Log, path: str, channels: Sequence[Channel], limits: Limits) -> Finding | None:
    """Finding of jumps of a joint's position; the kind itself checks the position of vehicles."""
    channel = log.channels[path]
    top = top_speed(channel, channels, limits)
    if top is None or path not in limits or channel.role != "state":
        return None
    lower, upper = limits[path]
    return leap_finding(log, channel, top, upper - lower)


def judge_unit(log: Log, body: Mean, limit: Array, motion: Seen | None = None) -> Finding | None:
    """Unit of the commands, of a log whose clock and order are right; None where they act on no joint.

    Args:
        body: the model file's prediction of the commands.
        limit: (J,) how far each command reaches.
        motion: the filtered motion, if it is computed already.
    """
    motion, path = motion or commanded(log), joints(log)
    if motion is None or path is None or motion.command is None:
        return None
    states = states_of(motion.t, path, motion.q, motion.qd, motion.qdd)
    torque = body.predict(states)
    finding = scale_finding(motion, torque, limit)
    if finding is None or not finding.flag or not isinstance(body, SupportsVariations):
        return finding
    kg = load_beside(motion, torque, body.links(states)[:, :, -1, 0])
    if not kg:
        return finding
    fact = f"The commands agree with the model file plus {kg:.2g} kg at the last link."
    return Finding(finding.check, "green", fact)


def commanded(log: Log) -> Seen | None:
    """The filtered motion of the joints that commands act on; None without such joints, or if too short."""
    path = joints(log)
    return None if path is None else seen(log, path)


def repaired(log: Log, finding: Finding) -> Log:
    """The repaired log. UsageError: there is no repair for the finding."""
    if not isinstance(finding, Mendable):
        raise UsageError(
            f"there is no repair for the check '{finding.check}' of this log: {finding.sentence}",
            where=log.source,
            next_step=finding.step,
        )
    return REPAIRS[finding.check](log, finding)


def _scaled(log: Log, finding: Mendable) -> Log:
    """by: what to divide the times by."""
    sentence = f"Times were divided by {finding.by[0]:g}, as asked."
    return replace(log, t=log.t / finding.by[0]).repaired(sentence)


def _turned(log: Log, _: Mendable) -> Log:
    t = log.t[0] + log.t[-1] - log.t[::-1]
    values = {name: np.ascontiguousarray(part[::-1]) for name, part in log.values.items()}
    return replace(log, t=t, values=values).repaired("The order of the rows was reversed, as asked.")


def _ordered(log: Log, finding: Mendable) -> Log:
    """by: the column of each joint's command."""
    channel, best = _command(log), np.array(finding.by, dtype=np.int64)
    names = named(channel.parts, np.asarray(best != np.arange(len(best))))
    sentence = f"The commands of {names} were put into the order that fits, as asked."
    return log.put(channel, log[channel.name][:, best]).repaired(sentence)


def _signed(log: Log, finding: Mendable) -> Log:
    """by: -1 for each column that is to be turned."""
    channel, signs = _command(log), np.array(finding.by)
    sentence = (
        f"The sign of the commands of {named(channel.parts, np.asarray(signs < 0))} was inverted, as asked."
    )
    return log.put(channel, log[channel.name] * signs).repaired(sentence)


def _shifted(log: Log, finding: Mendable) -> Log:
    """by: s by which the commands are late; rows that have no command then are cut."""
    channel, late = _command(log), finding.by[0]
    inside = (log.t + late >= log.t[0]) & (log.t + late <= log.t[-1])
    command = resample(log.t, log[channel.name], log.t[inside] + late)
    sentence = f"{finding.sentence} They were shifted by this time."
    return log.take(inside).put(channel, command).repaired(sentence)


def _command(log: Log) -> Channel:
    return next(c for c in log.channels.values() if c.role == "command" and c.acts_on in log)


def mended(log: Log, findings: Sequence[Finding]) -> Log:
    """The log after all repairs that lose nothing."""
    for finding in findings:
        log = repaired(log, finding) if isinstance(finding, Mendable) and finding.free else log
    return log


REPAIRS: Mapping[str, Callable[[Log, Mendable], Log]] = {
    **exact.REPAIRS,
    velocities.TIME: _scaled,
    velocities.DIRECTION: _turned,
    SWAPPED: _ordered,
    SIGN: _signed,
    DELAY: _shifted,
}
"""Checks with a repair. For others the user accepts the log unchanged, or corrects it by hand."""


JUMP = "jump"
LEAST_JUMP = 0.2  # m: below, a correction
WILD = 5.0  # times the second difference that 99 % of the rows stay below: noise and acceleration make less
RARE = 0.01  # of the steps may be further than the limits allow: with more, the limits are another vehicle's
MOST_JUMP_ROWS = 4  # rows that a jump may touch, however short the log is
BESIDE_S, BESIDE_ROWS = 0.5, 3  # of the motion to either side, at least
MARGIN_S = 0.1  # left out to either side, or as much as makes a pause
NAMED = 5  # spans in a sentence; the rest are counted


def jump_finding(log: Log, path: str, top: Array) -> Finding:
    """Finding of position steps that neither the speed limits nor the neighbouring motion explain.

    Args:
        log: rows in order. path: the channel of positions, m.
        top: (k,) m/s that each may have.
    """
    if path not in log or len(log) < 2:
        return Finding(JUMP, "cannot tell", f"The log has no {path}.")
    q = log[path]
    # of a slow sensor between whose values others are recorded, the rows that are new
    new = np.flatnonzero(exact.new_rows(q))
    t, q = log.t[new], q[new]
    excess = _excess(t, q, top)
    marked = np.asarray((excess != 0.0).any(axis=1))
    if not marked.any() or marked.sum() > max(RARE * len(marked), MOST_JUMP_ROWS):
        return Finding(JUMP, "green", "No position jumps.")
    margin = max(MARGIN_S, 0.6 * GAP_FACTOR * float(np.median(np.diff(log.t))))
    spans = _jump_spans(t, marked, margin)
    parts = log.channels[path].parts
    sentences = [_jump_sentence(t, excess, parts, span) for span in spans[:NAMED]]
    more = f", and {len(spans) - NAMED} times more" if len(spans) > NAMED else ""
    return Excludable(
        JUMP,
        "yellow",
        f"The {path} jumps faster than the limits allow: {'; '.join(sentences)}{more}.",
        "The rows around the jumps are excluded, and training uses the longest part between them, unless "
        f"ingested with --accept {JUMP}. Was the estimator reset? Altitudes before and after may differ.",
        spans=spans,
    )


def _excess(t: Array, q: Array, top: Array) -> Array:
    """(n - 1, k) m by which each step exceeds the motion beside it; 0 where it is possible."""
    step, dt = np.diff(q, axis=0), np.diff(t)[:, None]
    excess = np.zeros(step.shape)
    if len(q) < 2 * BESIDE_ROWS + 2:
        return excess
    # in a short log one jump is more than one row in a hundred
    share = min(0.99, 1.0 - MOST_JUMP_ROWS / len(q))
    usual = np.quantile(np.abs(np.diff(q, 2, axis=0)), share, axis=0)
    most = np.maximum(top * dt, WILD * usual)
    for k, j in np.argwhere(np.abs(step) > most).tolist():
        rate = _beside(t, step[:, j] / dt[:, 0], np.abs(step[:, j]) > most[:, j], k)
        far = float(step[k, j] - rate * dt[k, 0])
        excess[k, j] = far if abs(far) > most[k, j] and _whole(step[:, j], t, k) > LEAST_JUMP else 0.0
    return excess


def _beside(t: Array, rate: Array, wild: Mask, k: int) -> float:
    """Median rate of the steps around step k, without those that are too long themselves; 0 without any."""
    low, high = np.searchsorted(t[:-1], [t[k] - BESIDE_S, t[k] + BESIDE_S])
    rows = slice(max(min(int(low), k - BESIDE_ROWS), 0), max(int(high), k + BESIDE_ROWS) + 1)
    tame = rate[rows][~wild[rows]]
    return float(np.median(tame)) if len(tame) else float(np.median(rate[rows]))


def _whole(step: Array, t: Array, k: int) -> float:
    """m that the steps within `MARGIN_S` of step k make: a jump may be drawn out by interpolation."""
    low, high = np.searchsorted(t[:-1], [t[k] - MARGIN_S, t[k] + MARGIN_S])
    return max(abs(float(step[int(low) : int(high)].sum())), abs(float(step[k])))


def _jump_spans(t: Array, marked: Mask, margin: float) -> tuple[tuple[float, float], ...]:
    """(s) around the steps that are marked, joined where they meet."""
    spans: list[tuple[float, float]] = []
    for k in np.flatnonzero(marked).tolist():
        start, end = float(t[k]) - margin, float(t[k + 1]) + margin
        if spans and start <= spans[-1][1]:
            start = spans.pop()[0]
        spans.append((start, end))
    return tuple(spans)


def _jump_sentence(t: Array, excess: Array, parts: tuple[str, ...], span: tuple[float, float]) -> str:
    """As "by 1.7 m in x at 12.30 s"."""
    rows = np.flatnonzero((t[:-1] > span[0]) & (t[1:] < span[1]) & (excess != 0.0).any(axis=1))
    moved = np.cumsum(excess[rows], axis=0)  # of a spike the sum is none
    row, j = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
    return f"by {moved[row, j]:.2g} m in {parts[int(j)]} at {t[rows[0]]:.2f} s"


BRAKE = "brake"
WINDOW_S = 0.5  # windows in which standing is judged
UNMOVED_RANGE = 1e-3  # rad or m: by which positions differ in a window
IDLE = 1e-3  # of the limit: commands that are none
LEAST_S = 1.0  # s: between two moves a drive may well have nothing to do


def brake_finding(log: Log, command: Channel, limit: Array) -> Finding:
    """Finding of stretches with drives off; in training they would imply that poses need no command.

    Args:
        log: with positions and the commands that act on them.
        limit: (J,) how far each command reaches.
    """
    off, edges = _off(log, command, limit)
    spans = _off_spans(off, edges)
    if not spans:
        return Finding(BRAKE, "green", "Commands are not zero while the robot is at rest.")
    if off.all():
        fact = "Throughout the log no joint moves and all commands are zero: brakes on, or drives off."
        return Finding(BRAKE, "red", fact, "Release the brakes and record a motion.")
    seconds = sum(end - start for start, end in spans)
    return Excludable(
        BRAKE,
        "yellow",
        f"For {seconds:.3g} s no joint moves and all commands are zero: brakes on, or drives off.",
        f"This part is cut, unless ingested with --accept {BRAKE}.",
        spans=spans,
    )


def _off(log: Log, command: Channel, limit: Array) -> tuple[Mask, Array]:
    """Of each window, whether the drives are off; and its edges (w + 1,) s."""
    number = ((log.t - log.t[0]) / WINDOW_S).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    q, u = log[command.acts_on], np.abs(log[command.name])
    size = np.maximum.reduceat(q, first) - np.minimum.reduceat(q, first)
    still = (size < UNMOVED_RANGE).all(axis=1)
    idle = (np.maximum.reduceat(u, first) <= IDLE * limit).all(axis=1)
    off = np.asarray(still & idle)
    return off, np.append(log.t[first], np.nextafter(log.t[-1], np.inf))


def _off_spans(off: Mask, edges: Array) -> tuple[tuple[float, float], ...]:
    spans = [(float(edges[a]), float(edges[b])) for a, b in runs(off)]
    return tuple((start, end) for start, end in spans if end - start >= LEAST_S)
