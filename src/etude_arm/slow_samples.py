"""Whether slow samples tell of friction, or the gear sticks there.

Around a stick-slip a slow sample says nothing of friction at its speed, so slow joints are masked. Where
friction only turns over with the speed, slow samples tell it best. The logs decide, for all joints together:
the rigid body is identified with slow samples too, and friction that turns over ten times faster. They teach
if that predicts them, in blocks held out, much better than without them and not much worse than the others.
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
"""Error of slow samples over that of the model that learned from the others alone, at most. Where friction is
a tanh it was 0.29 to 0.74 on single logs of six arms; 0.86 to 0.97 on simulated arms that stick, which a
margin keeps out."""
AS_WELL = 2.9
"""Root mean square error of slow samples over that of the others, at most; 1.3 to 2.8 on those
six arms, 2.9 to 3.3 on `arm4`, 3.0 on a recording of a UR10."""
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
    """Whether slow samples are predicted about as well as the others, and better than by the usual model."""
    every = replace(samples, moving=told)
    fold = np.arange(len(samples)) * BLOCKS // len(samples) % PARTS
    fine = replace(physics, friction_fraction=FINER * physics.friction_fraction)
    try:
        found = [_left(fine, every, fold), _left(physics, samples, fold)]
    except DataError:  # a joint moves in one part alone
        return False
    unit = physics.spec.command
    fast = samples.moving & samples.usable
    new, old = (np.sqrt(np.mean((error / unit)[slow] ** 2)) for error in found)
    others = np.sqrt(np.mean((found[0] / unit)[fast] ** 2))
    return bool(new <= AS_WELL * others and new <= BETTER * old)


def _left(physics: ArmPhysics, samples: Samples, fold: Index) -> Array:
    """(n, J) errors of each part, predicted from the other."""
    said = physics.without(samples, fold)
    if len(said) < PARTS:
        raise DataError("a part alone moves a joint")
    error = np.empty_like(samples.command)
    for number, predicted in said.items():
        error[fold == number] = (samples.command - predicted)[fold == number]
    return error
