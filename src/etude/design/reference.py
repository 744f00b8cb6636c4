"""Reference states: where the model's variance matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models.features import FeatureMap
from etude.robots.spec import RobotSpec
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.random import random_trajectory
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

MOTIONS = 12
"""Random motions that stand in for tasks; more than that changes reference averages little."""
STATES_PER_MOTION = 1000
"""Enough to see the short moves between long dwells."""


def reference_states(
    features: FeatureMap,
    stick_velocity: Array,
    count: int,
    motions: Sequence[Trajectory],
    fallback: Sequence[Trajectory] = (),
) -> list[Array]:
    """Per output, at most `count` model inputs (r, D) spread evenly over the motions.

    States whose samples would be masked (|qd_j| below the stick velocity of output j) are dropped, because
    commands there are arbitrary. An output whose joint never moves takes its states from `fallback`.

    Raises:
        UsageError: no motions, or the wrong number of joints.
    """
    if not motions or count < 1:
        raise UsageError(
            f"reference states need at least one motion and one state, not {len(motions)}, {count}"
        )
    first, second = (_states(features, group) for group in (motions, fallback))
    references = []
    for j, threshold in enumerate(stick_velocity):
        for X, qd in (first, second, first):
            usable = X[np.abs(qd[:, j]) >= threshold] if len(X) else X
            if len(usable):
                break
        else:
            usable = first[0]
        picked = np.linspace(0, len(usable) - 1, min(count, len(usable))).round().astype(int)
        references.append(usable[picked])
    return references


def random_motions(
    rng: np.random.Generator, spec: RobotSpec, family: TrajectoryFamily, count: int = MOTIONS
) -> list[Trajectory]:
    """`count` limit-scaled random members of the family, the reference where no tasks are given."""
    return [random_trajectory(rng, spec, family) for _ in range(count)]


def _states(features: FeatureMap, motions: Sequence[Trajectory]) -> tuple[Array, Array]:
    """Model inputs (n, D) and velocities (n, dof) of all motions, each sampled evenly in time."""
    inputs, velocities = [np.zeros((0, features.width))], [np.zeros((0, features.dof))]
    for motion in motions:
        if motion.dof != features.dof:
            raise UsageError(f"a task motion moves {motion.dof} joints, the model has {features.dof}")
        t = motion.duration * (np.arange(STATES_PER_MOTION) + 0.5) / STATES_PER_MOTION
        samples = motion.sample(t)
        inputs.append(features.transform(samples.q, samples.qd, samples.qdd))
        velocities.append(samples.qd)
    return np.concatenate(inputs), np.concatenate(velocities)
