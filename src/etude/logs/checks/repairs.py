"""What a user may ask for in answer to a finding: check -> the log put right, with a sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from etude.errors import UsageError
from etude.logs.checks import rates, sign, swapped
from etude.logs.checks.words import Mendable, named
from etude.types import Channel, Finding, Log


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
    rates.TIME: _scaled,
    rates.DIRECTION: _turned,
    swapped.CHECK: _ordered,
    sign.CHECK: _signed,
}
"""Of the other checks, the answer is to take the log as it is, or to correct it by hand."""
