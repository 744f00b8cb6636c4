"""A criterion as a function of a trajectory's parameters, with its gradient, and the states that count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from etude.design.criteria import Criterion, Output, evaluate, value_of
from etude.errors import UsageError
from etude.protocols import Family, Inputs, Trajectory
from etude.types import Array, Index, Planned


class SearchFunction(Protocol):
    """Function of parameters p (P,) that a search of motions maximises.

    of: the same function of another family's parameters.
    """

    @property
    def family(self) -> Family: ...
    def of(self, family: Family, /) -> SearchFunction: ...
    def value(self, p: Array) -> float: ...
    def value_and_gradient(self, p: Array) -> tuple[float, Array]: ...


@dataclass(frozen=True, eq=False)
class Objective:
    """value(p) to be maximised: parameters -> motion -> inputs -> covariances -> criterion, and back.

    Attributes:
        criterion: see `criteria`.
        outputs: L latent functions with their reference states.
        commands: for each latent function the commands that it predicts; it takes their gains.
        inputs: the model's feature map, with what was learned about plans.
        family: the trajectories that the parameters select.
        times: (T,) s, where the motion is sampled.
        keep: of these the planned samples; None: all.
    """

    criterion: Criterion
    outputs: tuple[Output, ...]
    commands: tuple[tuple[int, ...], ...]
    inputs: Inputs
    family: Family
    times: Array
    keep: Index | None = None

    def of(self, family: Family) -> Objective:
        """The same objective for another family's parameters."""
        return replace(self, family=family)

    def planned(self, p: Array) -> Planned:
        """The planned log of the trajectory of p (P,), with the model's inputs."""
        return self.inputs.plan(self.family.motion(p, self.times, self.inputs.orders), self.keep)

    def samples(self, p: Array) -> tuple[Array, Array]:
        """Model inputs X (T, D) along the trajectory and gains (T, L)."""
        planned = self.planned(p)
        return planned.X, gains_of(self.commands, planned.gains)

    def value(self, p: Array) -> float:
        """The criterion alone."""
        return value_of(self.criterion, self.outputs, *self.samples(p))

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """Value and gradient (P,)."""
        planned = self.planned(p)
        gains = gains_of(self.commands, planned.gains)
        value, in_X, in_gains = evaluate(self.criterion, self.outputs, planned.X, gains)
        in_motion = planned.vjp(in_X, vjp_gains(self.commands, planned.gains, in_gains))
        return value, self.family.vjp(p, self.times, in_motion)


def gains_of(commands: Sequence[tuple[int, ...]], gains: Array) -> Array:
    """Gains (T, L) of latent functions from those of the commands (T, J).

    For one command it is that command's gain, sign included. For several, which share samples, it is the root
    of their mean weight.
    """
    return np.column_stack(
        [gains[:, group[0]] if len(group) == 1 else _mean_size(gains[:, group]) for group in commands]
    )


def vjp_gains(commands: Sequence[tuple[int, ...]], gains: Array, in_latents: Array) -> Array:
    """Gradient (T, J) in the commands' gains from that in the latent functions' (T, L).

    Where all gains are 0 it is 0: a criterion is even in the gain.
    """
    out = np.zeros_like(gains)
    for latent, group in enumerate(commands):
        if len(group) == 1:
            out[:, group[0]] += in_latents[:, latent]
            continue
        size = _mean_size(gains[:, group])
        share = in_latents[:, latent] / np.where(size == 0.0, 1.0, len(group) * size)
        out[:, group] += share[:, None] * gains[:, group]
    return out


def instants(duration: float, count: int, rate: float) -> tuple[Array, Index | None]:
    """Times (s) at which a motion is sampled, and the indices of `count` evenly spread ones (None: all).

    Inputs with memory need samples at their rate (Hz) throughout; rate 0: no such inputs.
    """
    midpoints = duration * (np.arange(count) + 0.5) / count
    if rate == 0.0:
        return midpoints, None
    # 1e-12: a duration of whole sample times keeps its last one
    times = np.arange(int(np.floor(duration * rate * (1.0 + 1e-12))) + 1) / rate
    nearest = np.minimum(np.rint(midpoints * rate), len(times) - 1).astype(np.int64)
    return times, nearest[np.diff(nearest, prepend=-1) > 0]  # sorted: drops repeated ones


def _mean_size(gains: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(gains**2, axis=1)))


MOTIONS = 12
"""Number of random motions that replace tasks; more would change reference averages little."""
STATES_PER_MOTION = 1000
"""Enough to see the short moves between long dwells."""
LEAST_GAIN = np.sqrt(0.5)
"""States whose samples would have a weight below one half are left out: commands are arbitrary there."""


def reference_states(
    inputs: Inputs,
    commands: Sequence[tuple[int, ...]],
    count: int,
    motions: Sequence[Trajectory],
    fallback: Sequence[Trajectory] = (),
) -> list[Array]:
    """Per latent function, at most `count` model inputs (r, D) spread evenly over the motions.

    States whose samples would be masked (a joint at rest) are dropped. A function without any state on these
    motions takes its states from `fallback`.

    Args:
        inputs: the model's feature map.
        commands: of each latent function.
        count: states for each.
        motions: motions that the model is needed for.
        fallback: other motions.

    Raises:
        UsageError: no motions, or motions with a wrong number of coordinates.
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
