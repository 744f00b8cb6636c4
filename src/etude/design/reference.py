"""Reference states: where the model's variance matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.design.objective import gains_of, instants
from etude.errors import UsageError
from etude.protocols import Inputs, Trajectory
from etude.types import Array

MOTIONS = 12
"""Random motions that stand in for tasks; more than that changes reference averages little."""
STATES_PER_MOTION = 1000
"""Enough to see the short moves between long dwells."""
LEAST_GAIN = np.sqrt(0.5)
"""States whose samples would count for less than half are left out: commands there are arbitrary."""


def reference_states(
    inputs: Inputs,
    commands: Sequence[tuple[int, ...]],
    count: int,
    motions: Sequence[Trajectory],
    fallback: Sequence[Trajectory] = (),
) -> list[Array]:
    """Per latent function, at most `count` model inputs (r, D) spread evenly over the motions.

    States whose samples would be masked (a joint that stands) are dropped. A function whose commands say
    nothing on these motions takes its states from `fallback`.

    Args:
        inputs: the model's feature map.
        commands: of each latent function.
        count: states for each.
        motions: what the model is for.
        fallback: other motions.

    Raises:
        UsageError: no motions, or of the wrong number of coordinates.
    """
    if not motions or count < 1:
        raise UsageError(
            f"reference states need at least one motion and one state, not {len(motions)}, {count}"
        )
    first, second = (_states(inputs, commands, group) for group in (motions, fallback))
    references = []
    for latent in range(len(commands)):
        for X, gains in (first, second):
            usable = X[np.abs(gains[:, latent]) >= LEAST_GAIN]
            if len(usable):
                break
        else:
            usable = first[0]
        picked = np.linspace(0, len(usable) - 1, min(count, len(usable))).round().astype(int)
        references.append(usable[picked])
    return references


def _states(
    inputs: Inputs, commands: Sequence[tuple[int, ...]], motions: Sequence[Trajectory]
) -> tuple[Array, Array]:
    """Model inputs (n, D) and gains (n, L) of all motions, each sampled evenly in time."""
    states, gains = [np.zeros((0, len(inputs.columns)))], [np.zeros((0, len(commands)))]
    for motion in motions:
        times, keep = instants(motion.duration, STATES_PER_MOTION, inputs.rate)
        planned = inputs.plan(motion.motion(times, inputs.orders), keep)
        states.append(planned.X)
        gains.append(gains_of(commands, planned.gains))
    return np.concatenate(states), np.concatenate(gains)
