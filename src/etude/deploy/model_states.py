"""Input states of a model, as numbers in a row, and its commands outside of their ranges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.models.learned_model import LearnedModel
from etude.models.selection.member_prediction import level_of
from etude.types import Array, Channel, Log

LEARN_OTHERWISE = (
    'In [model] of campaign.toml set kernel = "structured", process = "exact" and candidates = ["default"]. '
    "Then learn the newest log again: etude untell FOLDER NUMBER, etude tell FOLDER LOG."
)
"""Advice for a model that every export can write, apart from its physics."""
WITHOUT_PHYSICS = (
    'In [model] of campaign.toml set rung = "gp". Then learn the newest log again: etude untell FOLDER '
    "NUMBER, etude tell FOLDER LOG."
)

IN_PYTHON = 'Use the model in Python: etude.load_model("FOLDER").'
"""Text for a kind of robot with inputs that no export can write."""


def labels(channels: Sequence[Channel]) -> list[str]:
    """Names of the numbers, as columns of logs are named."""
    return [f"{c.name}_{part}" if part else c.name for c in channels for part in c.parts]


def training_ranges(model: LearnedModel, channels: Sequence[Channel], unknown: float) -> Array:
    """(2, N) smallest and largest training value of each state; -+ unknown for states that no input uses."""
    ranges = {
        column[:2]: model.ranges[:, i] for i, column in enumerate(model.inputs.columns) if not column[3]
    }
    nowhere = np.array([-unknown, unknown])
    return np.stack([ranges.get((c.name, part), nowhere) for c in channels for part in c.parts], axis=1)


def log_of(channels: Sequence[Channel], states: Array, source: str) -> Log:
    """A log of states (T, N), a row for each."""
    ends = np.cumsum([len(channel.parts) for channel in channels])[:-1]
    values = dict(zip((c.name for c in channels), np.split(states, ends, axis=1), strict=True))
    return Log(np.arange(len(states), dtype=float), {c.name: c for c in channels}, values, source)


def outside_training_sentence(model: LearnedModel) -> str:
    """Sentence on the commands outside of the training ranges."""
    used = [(c, model.behind(c)) for c in model.candidates if c.weights.any()]
    with_physics = [c for c, mean in used if mean is not None]
    physical = {j for c in with_physics for j, weight in zip(c.commands, c.weights, strict=True) if weight}
    bare = [name for j, name in enumerate(model.commands) if j not in physical]
    if not bare:
        return "where the data add nothing to the prior, commands are those of physics alone."
    level = np.zeros(len(model.commands))
    for c, mean in used:
        if mean is None:
            level[list(c.commands)] += c.weights * level_of(c)
    levels = ", ".join(f"{name} {level[model.commands.index(name)]:.3g}" for name in bare)
    return (
        "where the data add nothing to the prior, these commands have no physics. Each fades to a "
        f"constant, the steady part of its mean in training: {levels}. Only your feedback holds the robot "
        "there."
    )
