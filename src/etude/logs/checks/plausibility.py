"""All plausibility checks over a log, in the order in which one spoils the next, and their repairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from etude.errors import UsageError
from etude.logs.checks import command_sign, exchanged_commands, velocities
from etude.logs.checks.command_scale import scale_findings
from etude.logs.checks.filtered_motion import Seen, joints, seen
from etude.logs.checks.finding_texts import Mendable, named
from etude.logs.checks.velocities import degrees_finding, speed_finding
from etude.logs.cleaning.ranges import top_speed
from etude.logs.cleaning.repairs import leap_finding
from etude.logs.cleaning.smoothing import median_rate
from etude.logs.columns.units import Limits
from etude.protocols import Mean
from etude.types import Array, Channel, Finding, Log

SHORT = (
    f"Less than {command_sign.LEAST_S:g} s of motion: "
    "too little to tell whose a command is, its sign or unit."
)
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
        path: the channel of the positions; a log without it shows nothing.
        channels: the robot's.
        limits: lower and upper (parts,) by channel.
        usual: Hz at which the robot is logged.
        motion: what is seen of it, if that is known already.
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
    found = velocities.rate_finding(motion, rate, usual)
    if found.light == "red":
        return (found,)
    others = [degrees_finding(motion)]
    top = top_speed(log.channels[path], channels, limits)
    if top is not None and found.light != "green":
        others.append(speed_finding(motion, top, rate, usual))
    return (found, *(other for other in others if other is not None))


def _leap(log: Log, path: str, channels: Sequence[Channel], limits: Limits) -> Finding | None:
    """A joint's position that jumps; of a vehicle's place the kind itself looks."""
    channel = log.channels[path]
    top = top_speed(channel, channels, limits)
    if top is None or path not in limits or channel.role != "state":
        return None
    lower, upper = limits[path]
    return leap_finding(log, channel, top, upper - lower)


def judge_commands(
    log: Log, body: Mean | None = None, limit: Array | None = None, motion: Seen | None = None
) -> tuple[Finding, ...]:
    """Order, sign and scale of the commands, of a log whose clock is right; nothing where they act on no
    joint.

    Args:
        body: what a model file says of the commands, by itself; None without one.
        limit: (J,) how far each command reaches.
        motion: what is seen of it, if that is known already.
    """
    motion = motion or commanded(log)
    if motion is None or motion.command is None:
        return ()
    if len(motion.t) * motion.step < command_sign.LEAST_S:
        return (Finding("commands", "cannot tell", SHORT),)
    path = joints(log)
    assert path is not None
    states = None if body is None else _states(motion, path)
    torque = None if body is None or states is None else body.predict(states)
    order = exchanged_commands.order_of(motion, torque)
    found = (exchanged_commands.finding_of(order, motion.parts), _sign(motion, order, torque))
    if body is None or states is None or torque is None or (order is not None and order.doubtful):
        return found
    reach = np.full(len(motion.parts), np.inf) if limit is None else limit
    return (*found, *scale_findings(motion, torque, body.static(states), reach))


def commanded(log: Log) -> Seen | None:
    """What is seen of the joints that commands act on; None of a robot without, or of too short a log."""
    path = joints(log)
    return None if path is None else seen(log, path)


def _states(motion: Seen, path: Channel) -> Log:
    """The motion as a log of states, for a mean to predict commands of."""
    log = Log(motion.t, {}, {}, "seen").put(path, motion.q)
    for name, values in ((f"{path.name}d", motion.qd), (f"{path.name}dd", motion.qdd)):
        log = log.put(replace(path, name=name), values)
    return log


def _sign(motion: Seen, order: exchanged_commands.Order | None, torque: Array | None) -> Finding:
    """Signs of the commands in the order that fits; exchanged ones say nothing."""
    if order is None or not order.doubtful:
        return command_sign.sign_finding(motion, torque)
    if motion.command is None or not order.named:
        fact = "Which command is whose is not known, so neither is a sign."
        return Finding(command_sign.CHECK, "cannot tell", fact)
    own = command_sign.sign_finding(replace(motion, command=motion.command[:, order.best]), torque)
    if not isinstance(own, Mendable):
        return own
    # of the columns as they stand in the log
    return replace(own, by=tuple(own.by[j] for j in np.argsort(order.best)))


def repaired(log: Log, finding: Finding) -> Log:
    """The log put right. UsageError: nothing repairs what was found."""
    if not isinstance(finding, Mendable):
        raise UsageError(
            f"nothing repairs the check '{finding.check}' of this log: {finding.sentence}",
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
    return replace(log, t=t, values=values).repaired("The rows were turned round in time, as asked.")


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
        f"The sign of the commands of {named(channel.parts, np.asarray(signs < 0))} was turned, as asked."
    )
    return log.put(channel, log[channel.name] * signs).repaired(sentence)


def _command(log: Log) -> Channel:
    return next(c for c in log.channels.values() if c.role == "command" and c.acts_on in log)


REPAIRS: Mapping[str, Callable[[Log, Mendable], Log]] = {
    velocities.TIME: _scaled,
    velocities.DIRECTION: _turned,
    exchanged_commands.CHECK: _ordered,
    command_sign.CHECK: _signed,
}
"""Of the other checks, the answer is to take the log as it is, or to correct it by hand."""
