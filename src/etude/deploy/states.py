"""The states that a model reads, as numbers in a row: their names, the ranges trained on, rows as a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.models.model import LearnedModel
from etude.types import Array, Channel, Log


def labels(channels: Sequence[Channel]) -> list[str]:
    """Names of the numbers, as columns of logs are named."""
    return [f"{c.name}_{part}" if part else c.name for c in channels for part in c.parts]


def trained(model: LearnedModel, channels: Sequence[Channel], unknown: float) -> Array:
    """(2, N) least and largest that each was trained on; -+ unknown of those that inputs are not made of."""
    known = {column[:2]: model.ranges[:, i] for i, column in enumerate(model.inputs.columns) if not column[3]}
    nowhere = np.array([-unknown, unknown])
    return np.stack([known.get((c.name, part), nowhere) for c in channels for part in c.parts], axis=1)


def log_of(channels: Sequence[Channel], states: Array, source: str) -> Log:
    """A log of states (T, N), a row for each."""
    ends = np.cumsum([len(channel.parts) for channel in channels])[:-1]
    values = dict(zip((c.name for c in channels), np.split(states, ends, axis=1), strict=True))
    return Log(np.arange(len(states), dtype=float), {c.name: c for c in channels}, values, source)
