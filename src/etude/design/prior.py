"""What is known of a robot before any log: its limits, as a prior process for each group of commands."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from etude.design.view import Latent
from etude.models.config import ModelConfig
from etude.models.data.fit import kernel_for
from etude.models.gp.exact import posterior_given
from etude.protocols import Inputs
from etude.types import Array

SIGNAL, NOISE = 0.3, 0.01
"""Deviations of each term of a command and of its noise, parts of the command's limit."""
PLAN = "_des"
"""Ends the names of planned channels, which have the limits of what is planned."""


def prior_latents(
    inputs: Inputs,
    ranges: Mapping[str, tuple[Array, Array]],
    limit: Array,
    config: ModelConfig,
    commands: tuple[str, ...],
) -> tuple[Latent, ...] | None:
    """The model's own kernel for each group of commands, with lengths from the limits; nothing was measured.

    Commands count in parts of their limits. One sample, zero at rest in the middle of the ranges, is there
    for the form's sake.

    Args:
        inputs: of the model. ranges: lower and upper (parts,) of channels. limit: (J,) of the commands.
        config: of the model. commands: names of the J commands.

    Returns:
        None where an input has no limits: nothing then says how far it reaches.
    """
    reach = _reach(inputs, ranges)
    if reach is None:
        return None
    middle, half = reach
    every = tuple(range(len(commands)))
    found = []
    for group in [every] if config.sharing == "shared" else [(j,) for j in every]:
        names = tuple(commands[j] for j in group)
        kernel = kernel_for(config.kernel, inputs.columns, names, middle[None])
        theta = kernel.initial(half, SIGNAL)
        posterior = posterior_given(kernel, theta, NOISE**2, middle[None], np.zeros(1))
        found.append(Latent(posterior, group, np.asarray(limit, dtype=float)[list(group)]))
    return tuple(found)


def _reach(inputs: Inputs, ranges: Mapping[str, tuple[Array, Array]]) -> tuple[Array, Array] | None:
    """(D,) middle and half range of every input; of one with an op 0 and 1."""
    middle, half = [], []
    place: dict[str, int] = {}
    for channel, _, _, op in inputs.columns:
        if op:
            middle.append(0.0)
            half.append(1.0)
            continue
        name = channel.removesuffix(PLAN)
        number = place[name] = place.get(name, -1) + 1
        if name not in ranges or number >= len(ranges[name][0]):
            return None
        low, high = (float(end[number]) for end in ranges[name])
        if not (math.isfinite(high - low) and high > low):
            return None
        middle.append(0.5 * (low + high))
        half.append(0.5 * (high - low))
    return np.array(middle), np.array(half)
