"""Checks of a log's numbers that need no model: held rows and commands, copied or unsigned columns, drives
that are off, wrapped angles, overflow, lost rows.

Each hypothesis has a log odds (natural logarithm) against "recorded as it was". Beyond `CERTAIN` a log is
refused, beyond `LIKELY` it raises a question. Where nothing is lost and the data decide, the log is mended.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from etude.logs.checks.clipped_commands import clipped
from etude.logs.checks.desired_motion import COLUMNS, facts_against_desired
from etude.logs.checks.filtered_motion import goes_far, joints, measured_rates, runs
from etude.logs.checks.finding_texts import Mendable, accepted, both, named, without_spans
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Finding, Log, Mask

CERTAIN, LIKELY = math.log(1e6), math.log(20.0)
BEYOND_CHANCE = 50.0 * math.log(2.0)
"""Log odds of events that never happen by chance with noisy numbers: repeated, equal or zero values."""
HELD, COMMANDS_HELD, UNSIGNED, OFF = "held", "held_commands", "unsigned", "off"
COPIED, TURNS, OVERFLOW, LOST = "copied", "turns", "overflow", "lost"
CLIPPED, DESIRED = "clipped", "desired"
NAMES = (HELD, COMMANDS_HELD, UNSIGNED, OFF, COPIED, TURNS, OVERFLOW, LOST, CLIPPED, DESIRED)


@dataclass(frozen=True, eq=False)
class Numbers:
    """The recorded joint data of a log: T rows, J joints.

    Attributes:
        t: (T,) s. step: median s between rows.
        q, u: (T, J) positions and commands. v: (T, J) velocities; None if none were logged.
        path: of the positions.
        reach, middle: (J,) rad or m, width and middle of each joint's limits; inf and 0 if unknown.
    """

    t: Array
    step: float
    q: Array
    u: Array
    v: Array | None
    path: Channel
    reach: Array
    middle: Array

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.path.parts

    @staticmethod
    def of(log: Log, limits: Limits) -> Numbers | None:
        """The joint data; None if commands act on no joint, or the log is too short."""
        path = joints(log)
        if path is None or len(log) < LEAST_ROWS:
            return None
        channels = log.channels.values()
        command = next(c for c in channels if c.role == "command" and c.acts_on == path.name)
        v = next((log[name] for name in measured_rates(log, path)), None)
        none = np.full(len(path.parts), np.inf)
        lower, upper = limits.get(path.name, (-none, none))
        with np.errstate(invalid="ignore"):
            middle = np.nan_to_num(0.5 * (lower + upper))
        step = float(np.median(np.diff(log.t)))
        return Numbers(log.t, step, log[path.name], log[command.name], v, path, upper - lower, middle)


LEAST_ROWS = 50  # fewer say nothing of a rule


def judge_numbers(log: Log, limits: Limits) -> tuple[Finding, ...]:
    """Findings of a log with ordered rows; a finding that invalidates the other tests is returned alone.

    Args:
        limits: lower and upper (parts,) by channel; those of positions show which joints exceed one turn.
    """
    findings = [*_rows_held(log)] or [*_against_desired(log)]
    numbers = Numbers.of(log, limits)
    if findings or numbers is None:
        return tuple(findings)
    for test in (_blocks_held, _wrapped, _copied, _unsigned, _off, _overflown):
        findings += test(numbers)
    if not findings:
        findings += _clipped(numbers, limits)
    if not any(f.check in (HELD, TURNS) for f in findings):
        findings += _rows_lost(numbers)
    return tuple(findings)


def _possible(check: str, odds: float, fact: str, step: str, *, mend: str = "") -> Iterator[Mendable]:
    """The finding of a hypothesis without automatic repair: certain, likely, or none.

    Args:
        step: what to do about it. mend: what --repair does, in words; "" where nothing does.
    """
    if odds <= LIKELY:
        return
    sentence = fact if odds >= CERTAIN else f"{fact} (odds {_odds(odds)})"
    step = f"{step} {both(check, mend) if mend else accepted(check) + '.'}".strip()
    yield Mendable(
        check, "red" if odds >= CERTAIN else "yellow", f"{sentence}.", step[:1].upper() + step[1:], flag=check
    )


def _against_desired(log: Log) -> Iterator[Mendable]:
    """Finding of positions that deviate from the desired ones of the log by their sign, unit or column."""
    facts = "; ".join(facts_against_desired(log))
    yield from _possible(DESIRED, BEYOND_CHANCE if facts else 0.0, facts[:1].upper() + facts[1:], COLUMNS)


def _odds(odds: float) -> str:
    return f"{float(f'{math.exp(odds):.1g}'):.0f} to 1"


def _mended(check: str, fact: str, done: str) -> Iterator[Mendable]:
    """The finding of a hypothesis that can be repaired without loss."""
    yield Mendable(check, "yellow", f"{fact}: {done}", f"{accepted(check)}.", free=True)


REPEATED = 1.2  # rows per new one, at least: fewer repeats are late packets
REGULAR = 0.8  # of the gaps between new rows are alike
ALIKE_ROWS = 0.1  # of a gap, and one row at least
SEVERAL = 20  # gaps that tell a rule
SLOW_COMMANDS = 2.0, 60.0  # Hz between which commands are held and no program of steps, nor a drive's clock


def new_rows(*blocks: Array) -> Mask:
    """(T,) rows that differ from the row before in any column of blocks (T, k); the first is one."""
    is_new = np.zeros(len(blocks[0]), dtype=np.bool_)
    is_new[0] = True
    for column in (column for block in blocks for column in block.T):
        is_new[1:] |= column[1:] != column[:-1]
    return is_new


def _counted(q: Array) -> bool:
    """Whether columns (T, J) change only by single counts, as for a coarse encoder in slow motion."""
    steps = [step[step > 0.0] for step in np.abs(np.diff(q, axis=0)).T]
    return all((step < 1.5 * step.min()).mean() > REGULAR for step in steps if len(step))


def repeats(new: Mask, motion: Array) -> float:
    """Number of rows per new row (T,), from the faster half of the motion (T, m); 1 if every row is new, or
    repeats are irregular.
    """
    rows = np.flatnonzero(new)
    gaps = np.diff(rows)
    if len(gaps) < SEVERAL or gaps.mean() < REPEATED:
        return 1.0
    travel = np.abs(np.diff(motion[rows], axis=0)) / np.maximum(np.ptp(motion, axis=0), np.finfo(float).tiny)
    far = travel.sum(axis=1)
    gaps = gaps[far >= np.median(far)]
    middle = float(np.median(gaps))
    alike = gaps[np.abs(gaps - middle) <= max(1.0, ALIKE_ROWS * middle)]
    return float(alike.mean()) if len(alike) > REGULAR * len(gaps) else 1.0


def _measured(log: Log) -> list[Array]:
    """All measured and commanded channels, (T, k) each."""
    return [log[n] for n, c in log.channels.items() if c.role in ("state", "aside", "command") and n in log]


def _rows_held(log: Log) -> Iterator[Finding]:
    """Finding that the recorder is faster than the recorded data."""
    blocks = _measured(log)
    if len(log) < LEAST_ROWS or not blocks:
        return
    new = new_rows(*blocks)
    each = 1.0 if new.mean() > 1.0 / REPEATED else repeats(new, np.hstack(blocks))
    if each > REPEATED and not all(map(_counted, blocks)):
        yield from _held_fact("Every row", each, float(np.median(np.diff(log.t))))


def _held_fact(what: str, each: float, step: float) -> Iterator[Finding]:
    rates = f"the sensors give {1.0 / (step * each):.2g} rows a second, the log {1.0 / step:.4g}"
    fact = f"{what} is repeated {each:.2g} times: {rates}"
    yield from _mended(HELD, fact, "repeated rows are dropped.")


def _blocks_held(numbers: Numbers) -> Iterator[Finding]:
    """Finding that commands or positions are updated more slowly than the other channels."""
    motion, rate = (numbers.q,) if numbers.v is None else (numbers.q, numbers.v), 1.0 / numbers.step
    fresh, fresh_commands = new_rows(*motion), new_rows(numbers.u)
    share, others = float(fresh.mean()), float(fresh_commands.mean())
    if min(share, others) > 0.5:
        return
    if share < others:
        if (each := repeats(fresh, numbers.q)) > 2.0 and not _counted(numbers.q):
            yield from _held_fact("Every position", each, numbers.step)
    elif (each := repeats(fresh_commands, numbers.q)) > 2.0 and not _counted(numbers.u):
        slowest, fastest = SLOW_COMMANDS
        if slowest < rate / each < fastest:
            yield from _possible(
                COMMANDS_HELD,
                BEYOND_CHANCE,
                f"Commands change {rate / each:.3g} times a second in a log of {rate:.4g} rows a second: "
                "in between, they are not the commands that move the joints",
                "Log commands at the rate of the positions. If the controller itself has this rate,",
            )


TURN_RAD, TURN_DEGREES = 2.0 * math.pi, 360.0
OF_A_TURN = 0.02  # by which a step may miss one turn
MOSTLY_AGAINST = 0.8  # of the speeds at jumps; where a joint is slow, noise has a sign too
ENDLESS_TURNS = 1.05  # turns: a joint with a wider range may turn endlessly


@dataclass(frozen=True, eq=False)
class Turns:
    """Errors of a log's angles by whole turns.

    Attributes:
        q: (T, J) corrected positions.
        jumps: (J,) number of wraps. away: (J,) turns by which a joint that never wraps is outside its limits.
        opposed: (J,) whether the velocity at the jumps has the opposite sign.
    """

    q: Array
    jumps: Array
    away: Array
    opposed: Mask

    @staticmethod
    def of(numbers: Numbers) -> Turns | None:
        """None where nothing is."""
        hinges = np.array(numbers.path.units) == "rad"
        top = np.where(hinges, np.abs(np.diff(numbers.q, axis=0)).max(axis=0), 0.0)
        turn = TURN_DEGREES if top.max() > 0.5 * TURN_DEGREES else TURN_RAD
        q, jumps, opposed = numbers.q.copy(), np.zeros(len(hinges)), np.zeros(len(hinges), dtype=np.bool_)
        for j in np.flatnonzero(top > 0.5 * turn).tolist():
            steps = _whole_turns(q[:, j], turn)
            q[1:, j] -= turn * np.cumsum(steps)
            jumps[j] = np.abs(steps).sum()
            against = 0.0 * steps if numbers.v is None else -steps * numbers.v[1:, j]
            opposed[j] = against.sum() > MOSTLY_AGAINST * np.abs(against).sum()
        scale = turn / TURN_RAD  # of limits, which are rad
        low, high, reach = q.min(axis=0), q.max(axis=0), scale * numbers.reach
        centre = 0.5 * (low + high) - scale * numbers.middle
        outside = (np.abs(centre) > 0.5 * reach) & (high - low < reach)
        away = np.where(hinges & outside & (jumps == 0.0), np.round(centre / turn), 0.0)
        q -= turn * np.where(jumps > 0.0, np.round(centre / turn), away)
        return Turns(q, jumps, away, opposed) if jumps.any() or away.any() else None


def _whole_turns(q: Array, turn: float) -> Array:
    """(T-1,) turns by which each step of q (T,) wraps, if every step above half a turn is a wrap."""
    step = np.diff(q)
    one = np.abs(np.abs(step) - turn) < OF_A_TURN * turn
    if (np.abs(step) > 0.5 * turn)[~one].any():
        return np.zeros(len(step))
    return np.asarray(np.where(one, np.sign(step), 0.0))


def _wrapped(numbers: Numbers) -> Iterator[Finding]:
    turns = Turns.of(numbers)
    if turns is None:
        return
    times, wrap, far = int(turns.jumps.sum()), turns.jumps > 0.0, turns.away != 0.0
    facts = []
    if times:
        facts.append(f"{named(numbers.parts, wrap)}: {times} jump{'s'[: times > 1]} of one turn")
    if far.any():
        facts.append(f"{named(numbers.parts, far)}: whole turns outside the limits")
    endless = np.isfinite(numbers.reach) & (numbers.reach > ENDLESS_TURNS * TURN_RAD)
    if times and (endless | turns.opposed)[wrap].all():
        findings = _mended(TURNS, "; ".join(facts), "the angles are unwrapped.")
    else:
        odds = max(10.0 + times * math.log(50.0), BEYOND_CHANCE * far.any())
        findings = _possible(TURNS, odds, "; ".join(facts), "The angles wrap.", mend="unwrap them")
    for finding in findings:
        yield replace(finding, by=(*numbers.reach.tolist(), *numbers.middle.tolist()))


def _unwrapped(log: Log, finding: Mendable) -> Log:
    """by: reach and middle of the joints."""
    numbers = Numbers.of(log, {})
    assert numbers is not None
    reach, middle = np.array(finding.by).reshape(2, -1)
    turns = Turns.of(replace(numbers, reach=reach, middle=middle))
    assert turns is not None
    names = named(numbers.parts, (turns.jumps > 0.0) | (turns.away != 0.0))
    return log.put(numbers.path, turns.q).repaired(f"The angles of {names} were unwrapped.")


SAME = 1.0 - 1e-9  # correlation beyond which two columns are one
ENOUGH = 20_000  # rows that tell it


def _copied(numbers: Numbers) -> Iterator[Finding]:
    """Finding of two equal commands, or of a command that equals a position or velocity.

    The command of a joint held by feedback may be exactly proportional to minus its position.
    """
    blocks = {"command": numbers.u, "position": numbers.q}
    blocks |= {} if numbers.v is None else {"velocity": numbers.v}
    every = max(1, len(numbers.t) // ENOUGH)
    units = [_centred(block[::every]) for block in blocks.values()]
    like, J = np.hstack(units)[:, : len(numbers.parts)].T @ np.hstack(units), len(numbers.parts)
    labels = [f"{block} of {part}" for block in blocks for part in numbers.parts]
    like[:J, :J] = np.abs(like[:J, :J])
    moving = np.tile(goes_far(numbers.q), len(blocks))  # computed commands of joints that stand are alike
    pairs = [(a, b) for a, b in np.argwhere(np.triu(like > SAME, 1)).tolist() if moving[a] or moving[b]]
    if pairs:
        names = ", ".join(f"the {labels[a]} and the {labels[b]}" for a, b in pairs)
        step = "Check the names of the columns, and export the log again."
        yield from _possible(COPIED, 100.0, f"These columns are identical: {names}", step)


def _centred(block: Array) -> Array:
    """Columns (T, k) less their means, of length 1; 0 where one is constant but for rounding."""
    centred = block - block.mean(axis=0)
    size = np.linalg.norm(centred, axis=0)
    moves = size > 1e-9 * np.linalg.norm(block, axis=0).max()
    return np.asarray(np.where(moves, centred, 0.0) / np.where(moves, size, 1.0))


AT_ZERO, AWAY = 0.02, 0.05  # of a command's largest: where it comes to zero, and where it has left it
BRIEF_S = 0.25  # s: a longer visit is rest


def _unsigned(numbers: Numbers) -> Iterator[Finding]:
    """Finding of commands without a sign: they touch zero and turn back; others would cross it, 2 to 1."""
    visits = 0
    for command in numbers.u.T:
        size = command if command.max() > -command.min() else -command
        if size.min() < 0.0:
            return
        if size.max() > 0.0:
            visits += _brief_visits(size / size.max(), numbers.step)
    fact = f"No command ever changes its sign, and commands return from zero {visits} times"
    step = "Log commands with their sign, because a model of magnitudes is wrong for the opposite motion."
    if bit := _sign_bit(numbers.u):
        step = f"The sign is in bit {bit}: write {2**bit} - value for values from {2**bit} on."
    yield from _possible(UNSIGNED, visits * math.log(2.0), fact, step)


def _sign_bit(commands: Array) -> int:
    """Bit of integers (T, J) that holds their sign, as of Feetech's servos; 0 for none."""
    bit = int(np.log2(max(float(commands.max()), 1.0)))
    read = np.where(commands >= 2.0**bit, 2.0**bit - commands, commands)
    most, before = (np.abs(np.diff(one, axis=0)).max(initial=0.0) for one in (read, commands))
    # each change of the sign is a jump by the bit: all are gone, and where it is no sign there are more
    jumps = most < 0.5 * 2.0**bit < before
    return bit if jumps and (commands == np.round(commands)).all() else 0


def _brief_visits(size: Array, step: float) -> int:
    """Number of times that `size` (T,), within 0..1, briefly reaches zero between two larger stretches."""
    near, rows = size < AT_ZERO, np.flatnonzero((size < AT_ZERO) | (size > AWAY))
    visits = [(a, b) for a, b in runs(near[rows]) if a > 0 and b < len(rows)]
    return sum((rows[b - 1] - rows[a] + 1) * step < BRIEF_S for a, b in visits)


OFF_S = 0.3  # s: a shorter zero may be one
MOVING = 0.1  # of the step that 95 % of the rows stay below
MOSTLY = 0.2  # of an off stretch in which something moves
STEEP = 3.0  # times the step that 95 % of the rows stay below: into a rest commands fade


def _off(numbers: Numbers) -> Iterator[Finding]:
    """Finding that all commands are exactly zero during motion: not logged, or the drives were off."""
    zero: Mask = np.asarray((numbers.u == 0.0).all(axis=1))
    stretches = [(a, b) for a, b in runs(zero) if (b - a) * numbers.step > OFF_S]
    if stretches:
        step = np.abs(np.diff(numbers.q, axis=0, prepend=numbers.q[:1]))
        least = np.maximum(MOVING * np.quantile(step, 0.95, axis=0), np.finfo(float).tiny)
        goes: Mask = np.asarray((step > least).any(axis=1))
        falls = np.abs(np.diff(numbers.u, axis=0))
        fell = np.asarray((falls > STEEP * np.quantile(falls, 0.95, axis=0)).any(axis=1))
        stretches = [
            (a, b)
            for a, b in stretches
            if goes[a:b].mean() > MOSTLY and (fell[max(a - 1, 0) : a].any() or fell[b - 1 : b].any())
        ]
    if not stretches or zero.all():
        return
    seconds = sum(b - a for a, b in stretches) * numbers.step
    fact = f"For {seconds:.3g} s all commands are zero while joints move"
    if zero.mean() > 0.5:
        yield from _possible(OFF, BEYOND_CHANCE, fact, "Log the commands of the whole motion.")
        return
    spans = tuple((float(numbers.t[a]), float(numbers.t[min(b, len(zero) - 1)])) for a, b in stretches)
    for finding in _mended(OFF, fact, "that is cut."):
        yield replace(finding, spans=spans)


def _without_spans(log: Log, finding: Mendable) -> Log:
    return without_spans(log, finding).repaired(finding.sentence)


def _cut(log: Log, finding: Mendable) -> Log:
    return without_spans(log, finding).repaired(f"{finding.sentence} These parts were cut.")


WHOLE_RANGE, BETWEEN = 0.9, (0.35, 0.65)  # of a command's range: a wrap, and steps that are neither


def _overflown(numbers: Numbers) -> Iterator[Finding]:
    """Finding of jumps of a command from one end of its range to the other: integer overflow."""
    for j, name in enumerate(numbers.parts):
        jumps = _overflows(numbers.u[:, j])
        if jumps > 1:
            top = float(np.abs(numbers.u[:, j]).max())
            fact = f"The command of {name} jumps {jumps} times through its whole range, at {top:.4g}"
            step = "The integer type overflows: log the command in a wider type, or in a larger unit."
            yield from _possible(OVERFLOW, 10.0 * jumps, fact, step)


def _overflows(command: Array) -> int:
    """Number of wraps of a command (T,): jumps between its ends, consistent with the slope beside them.

    A noisy switch jumps between levels further inside, and one with many levels also by half the range.
    """
    step, width = np.abs(np.diff(command)), float(np.ptp(command))
    usual, (low, high) = float(np.median(step)), (width * share for share in BETWEEN)
    rows = 1 + np.flatnonzero(step[1:-1] > WHOLE_RANGE * width)
    between = int(((step > low) & (step < high)).sum())
    if len(rows) < 2 or usual == 0.0 or between > (step > high).sum():
        return 0
    slope = np.where(step > 0.5 * width, width - step, step)
    left = (width - step[rows]) / (slope[rows - 1] + slope[rows + 1] + usual)
    return len(rows) if np.median(left) < 1.0 else 0


def _clipped(numbers: Numbers, limits: Limits) -> Iterator[Finding]:
    """Finding of commands that stay at their extreme while the joint continues to move."""
    lower, upper = limits.get(COMMAND, (np.array(-np.inf), np.array(np.inf)))
    reach = np.minimum(-lower, upper) * np.ones(len(numbers.parts))
    clipping = clipped(numbers.q, numbers.u, reach)
    if clipping is None:
        return
    levels = ", ".join(f"{level:.4g}" for level in clipping.levels[clipping.joints])
    share = 100.0 * float(clipping.rows.mean())
    names = named(numbers.parts, clipping.joints)
    fact = f"The commands of {names} stay at {levels} while the joints move, "
    fact += f"{share:.3g} % of the log: they were clipped"
    step = "If the recorder clips, log the whole range. If the drive saturates, its limit is smaller."
    t, stretches = numbers.t, runs(clipping.rows)
    spans = tuple((float(t[a]), float(t[b - 1] + numbers.step)) for a, b in stretches)
    for finding in _possible(CLIPPED, BEYOND_CHANCE, fact, step, mend="cut these stretches"):
        yield replace(finding, spans=spans)


COMMAND = "command"
EVEN = 0.05  # of a step, deviation of stamps: a clock that counts rows; others show what was lost
SHARES = (0.003, 0.01, 0.03, 0.1, 0.2)  # of the rows that may be lost
NOISIEST, BIASED = 0.3, 0.25  # of a step: scale of r, and its median from 1; beyond, r tells nothing
LEAST_SCALE = 0.02  # of r
SLOW = 0.1  # of the longest step: shorter ones are left out
LATE_ROWS = 5  # after a row that repeats, within which the sensor has caught up
LEAST_STEPS = 100  # fast ones, whose spread tells what a lost row is against


AROUND = (1, 2, 4)  # steps to either side whose mean speed may tell a step


def _beside_late(numbers: Numbers) -> Mask:
    """(T-1,) steps beside a late packet: one of length 0 is followed by one of length 2."""
    late = ~new_rows(numbers.q, numbers.u)[1:]
    return np.convolve(late, np.ones(LATE_ROWS + 1), "full")[: len(late)] > 0.0


def _predicted_steps(increments: Array, dt: Array, by_velocity: Array | None) -> Array:
    """The best predictor of a joint's steps `increments` (T-1,) over the times `dt` (T-1,) of the stamps: its
    velocity, or the mean speed around. A gap in the stamps is no loss of rows.
    """
    predictors = [] if by_velocity is None else [by_velocity]
    for count in AROUND:
        window = np.full(2 * count + 1, 1.0 / (2 * count))
        window[count] = 0.0
        predictors.append(np.convolve(increments / dt, window, "same") * dt)
    return min(predictors, key=lambda steps: float(np.median(np.abs(increments - steps))))


@dataclass(frozen=True, eq=False)
class Steps:
    """Length of each step relative to the one predicted from the speed.

    Attributes:
        r: (T-1,) 1 of a step that lost no row, 2 of one that lost one. scale: (T-1,) of r.
        fast: (T-1,) steps that are far enough to count as evidence.
    """

    r: Array
    scale: Array
    fast: Mask

    @staticmethod
    def of(numbers: Numbers) -> Steps | None:
        """The steps; None if time stamps are those of the sensor, or steps are too noisy."""
        dt = np.diff(numbers.t)
        if dt.std() > EVEN * numbers.step:
            return None
        size, product = np.zeros((2, len(dt)))  # sums over joints, in units of their noise
        for j, q in enumerate(numbers.q.T):
            v = None if numbers.v is None else numbers.v[:, j]
            increments = np.diff(q)
            predicted = _predicted_steps(increments, dt, None if v is None else 0.5 * (v[1:] + v[:-1]) * dt)
            goes = np.abs(predicted) > SLOW * np.abs(predicted).max()
            noise = max(float(np.abs(increments - predicted)[goes].mean()), 1e-12) if goes.any() else np.inf
            size += np.where(goes, predicted / noise, 0.0) ** 2
            product += np.where(goes, predicted * increments / noise**2, 0.0)
        valid = (size > 0.0) & ~_beside_late(numbers)
        r = np.divide(product, size, out=np.ones(len(dt)), where=valid)
        spread = 1.0 / np.sqrt(np.maximum(size, np.finfo(float).tiny))
        fast = valid & (spread < NOISIEST)
        if fast.sum() < LEAST_STEPS:
            return None
        middle = float(np.median(r[fast]))
        scale = 1.5 * float(np.median(np.abs(r[fast] - middle)))
        if scale > NOISIEST or abs(middle - 1.0) > BIASED:
            return None
        return Steps(r, np.maximum(max(scale, LEAST_SCALE), spread), fast)

    def near(self, count: float | Array, wider: float = 1.0) -> Array:
        """(T-1,) log density of r about `count`: Student's, 3 degrees of freedom, as real tails are."""
        scale = wider * self.scale
        return np.asarray(-2.0 * np.log1p(((self.r - count) / scale) ** 2 / 3.0) - np.log(scale))

    def odds(self) -> tuple[float, float]:
        """Log odds that rows were lost, and the best share; tails on both sides of 1 do not count as loss."""
        one = self.near(1.0)
        lost = np.logaddexp(math.log(0.9) + self.near(2.0, 1.3), math.log(0.1) + self.near(3.0, 2.0))
        tails = np.logaddexp(self.near(2.0, 1.3), self.near(0.0, 1.3)) - math.log(2.0)

        def best(other: Array) -> tuple[float, float]:
            mixed = (np.logaddexp(math.log1p(-p) + one, math.log(p) + other)[self.fast].sum() for p in SHARES)
            return max(zip(map(float, mixed), SHARES, strict=True))

        fit, share = best(lost)
        return fit - max(float(one[self.fast].sum()), best(tails)[0]), share

    def counts(self, share: float) -> Array:
        """(T-1,) most likely number of rows that each step represents."""
        whole = np.maximum(np.round(self.r), 2.0)
        more = math.log(share) + self.near(whole, 1.3) > math.log1p(-share) + self.near(1.0)
        return np.where(more & (self.r > 1.5), whole, 1.0)


def _rows_lost(numbers: Numbers) -> Iterator[Finding]:
    steps = Steps.of(numbers)
    if steps is None:
        return
    odds, share = steps.odds()
    count = int((steps.counts(share) > 1.0).sum())
    fact = (
        f"{count} steps are twice as long as the speed predicts: rows were lost, and the times are row "
        "numbers"
    )
    if odds >= CERTAIN and numbers.v is not None:
        yield from _mended(LOST, fact, "the times are corrected with the velocities.")
    elif count:
        yield from _possible(LOST, odds, fact, "Log the time stamps of the sensor.", mend="correct the times")


def _retimed(log: Log, _: Mendable) -> Log:
    numbers = Numbers.of(log, {})
    steps = None if numbers is None else Steps.of(numbers)
    if numbers is None or steps is None:
        return log
    counts = steps.counts(steps.odds()[1])
    t = np.concatenate([log.t[:1], log.t[0] + np.cumsum(np.diff(log.t) * counts)])
    lost = int((counts - 1.0).sum())
    return replace(log, t=t).repaired(f"Times were corrected where {lost} rows had been lost.")


def _fresh_rows(log: Log, finding: Mendable) -> Log:
    """The log reduced to the rows at which the held channel changes."""
    path = joints(log)
    blocks = _measured(log)
    new = new_rows(*blocks)
    if path is not None and repeats(new, np.hstack(blocks)) < REPEATED:
        new = new_rows(log[path.name], *(log[name] for name in measured_rates(log, path)))
    return log.take(new).repaired(finding.sentence)


REPAIRS: dict[str, Callable[[Log, Mendable], Log]] = {
    HELD: _fresh_rows,
    TURNS: _unwrapped,
    OFF: _without_spans,
    CLIPPED: _cut,
    LOST: _retimed,
}
