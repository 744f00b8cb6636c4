"""Whether slow samples tell of friction, or the gear sticks there.

Around a stick-slip a slow sample says nothing of friction at its speed, so slow joints are masked. Where
friction only turns over with the speed, slow samples tell it best. The logs decide, for all joints together:
the rigid body is identified with slow samples too, and friction that turns over ten times faster. They teach
if that predicts them, in blocks held out, much better than the usual model, and the other samples no worse.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.errors import DataError
from etude.logs.cleaning.filters import slower
from etude.types import Array, Index, Mask, Samples
from etude_arm.inputs import friction_speeds
from etude_arm.physics.geometry import has_masses
from etude_arm.physics.mean import ArmPhysics
from etude_arm.spec import PATH, PLAN, ArmSpec

FINER = 0.1
"""Of v0, over which friction turns then, and of the speed below which a joint stands."""
BETTER = 0.8
"""Error of slow samples over that of the usual model, at most. Where friction is a tanh it was 0.48 to 0.72
on single logs of five arms; 0.92 and 1.11 on simulated arms that stick, 0.70 on a recording of a UR10."""
NO_WORSE = 1.02
"""Error of the other samples over that of the usual model, at most: 0.94 to 1.00 on those five arms, 1.05 and
9.5 on the simulated ones, 1.16 on the UR10, where slow samples that teach make the rest worse."""
LEAST = 20
"""Slow samples of which fewer decide nothing."""
BLOCKS, PARTS = 10, 2
"""Blocks of consecutive samples, of which every other one is held out in turn."""


def with_slow(
    samples: Samples, spec: ArmSpec, stick_fraction: float, fraction: float, desired: bool
) -> Samples:
    """The samples with slow ones taken as moving, and the channel of v0, if they tell; else as they are.

    Args:
        stick_fraction: part of the top speed below which joints counted as standing. fraction: v0 of friction
            as a part of the velocity limits. desired: whether models look at the plan.
    """
    if not (stick_fraction and fraction and has_masses(spec)):
        return samples
    speed = samples.log[(PLAN if desired and PLAN[0] in samples.log else PATH)[1]]
    told = np.asarray(samples.moving | ~slower(speed, spec.velocity, FINER * stick_fraction))
    slow = told & ~samples.moving & samples.moving.any(axis=1, keepdims=True) & samples.usable
    if slow.sum() < LEAST or not _explained(samples, told, slow, ArmPhysics(spec, fraction, desired)):
        return samples
    v0 = np.broadcast_to(FINER * friction_speeds(spec, fraction), speed.shape)
    return replace(samples, log=samples.log.put(spec.friction(), v0.copy()), moving=told)


def _explained(samples: Samples, told: Mask, slow: Mask, physics: ArmPhysics) -> bool:
    """Whether slow samples are predicted better than by the usual model, and the others no worse."""
    every = replace(samples, moving=told)
    fold = np.arange(len(samples)) * BLOCKS // len(samples) % PARTS
    fine = replace(physics, friction_fraction=FINER * physics.friction_fraction)
    try:
        found = [_left(fine, every, fold), _left(physics, samples, fold)]
    except DataError:  # a joint moves in one part alone
        return False
    unit = physics.spec.command
    fast = samples.moving & samples.usable
    ratios = []
    for rows in (slow, fast):
        new, old = (float(np.sqrt(np.mean((error / unit)[rows] ** 2))) for error in found)
        ratios.append(new / old)
    return ratios[0] <= BETTER and ratios[1] <= NO_WORSE


def _left(physics: ArmPhysics, samples: Samples, fold: Index) -> Array:
    """(n, J) errors of each part, predicted from the other."""
    said = physics.without(samples, fold)
    if len(said) < PARTS:
        raise DataError("a part alone moves a joint")
    error = np.empty_like(samples.command)
    for number, predicted in said.items():
        error[fold == number] = (samples.command - predicted)[fold == number]
    return error
