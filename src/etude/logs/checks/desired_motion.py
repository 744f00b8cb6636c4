"""Measured motion against the desired one: an opposite sign, degrees, exchanged coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.types import Array, Log

ALIKE = 0.9  # correlation of two motions that are the same but for sign, unit or name
CLEAR_MATCH = 0.5  # rms deviation over the desired spread, up to which a coordinate follows without doubt


@dataclass(frozen=True)
class Unlike:
    """A coordinate that moves unlike its desired motion. other: whose desired motion it follows."""

    coordinate: int
    kind: Literal["opposite", "degrees", "exchanged"]
    other: int


def unlike(measured: Array, desired: Array, each: Array) -> Iterator[Unlike]:
    """Coordinates whose deviation has a simple cause.

    Args:
        measured, desired: (n, k). each: (k,) rms deviation over the desired spread.
    """
    if len(measured) < 2:
        return
    a, b = (values - values.mean(axis=0) for values in (measured, desired))
    # 1e-300: a coordinate at rest correlates with no other
    norms = np.outer(np.sqrt((a * a).sum(axis=0)), np.sqrt((b * b).sum(axis=0))) + 1e-300
    likeness = (a.T @ b) / norms
    slope = (a * b).sum(axis=0) / ((b * b).sum(axis=0) + 1e-300)
    for j in np.flatnonzero(each > CLEAR_MATCH).tolist():
        other = int(np.argmax(likeness[j]))
        if likeness[j, j] < -ALIKE:
            yield Unlike(j, "opposite", j)
        # 180 / π = 57.3, in a log that follows its plan with an error
        elif likeness[j, j] > ALIKE and 40 < slope[j] < 80:
            yield Unlike(j, "degrees", j)
        elif likeness[j, j] < 0.5 and likeness[j, other] > ALIKE:
            yield Unlike(j, "exchanged", other)


COLUMNS = (
    "If positions have a wrong column, sign or unit, correct them in [log.columns] of campaign.toml, as in "
    '"q_elbow" = "-1 * HEADER".'
)
FACTS = {
    "opposite": "the measured position of {own} moves against the desired one",
    "degrees": "the measured position of {own} is about 57 times the desired one, as in degrees",
    "exchanged": "the measured position of {own} follows the desired one of {other}",
}


def facts_against_desired(log: Log) -> tuple[str, ...]:
    """What contradicts the desired motion that the log itself holds, a text for each coordinate."""
    facts = []
    for name, channel in log.channels.items():
        desired = f"{name}_des"
        if channel.derivative_of or desired not in log or log[desired].shape != log[name].shape:
            continue
        measured, planned = log[name], log[desired]
        rows = np.isfinite(measured).all(axis=1) & np.isfinite(planned).all(axis=1)
        measured, planned = measured[rows], planned[rows]
        if len(planned) < 2:
            continue
        spread = np.maximum(planned.std(axis=0), 1e-12)
        each = np.sqrt(((measured - planned) ** 2).mean(axis=0)) / spread
        parts = channel.parts
        facts += [
            FACTS[odd.kind].format(own=parts[odd.coordinate], other=parts[odd.other])
            for odd in unlike(measured, planned, each)
        ]
    return tuple(facts)
