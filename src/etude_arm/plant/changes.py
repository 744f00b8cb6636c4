"""What happens to an arm in its life: it takes up a load, its friction grows."""

from __future__ import annotations

import math

from msgspec.structs import replace

from etude.errors import UsageError
from etude_arm.plant.parameters import ArmParameters


def with_payload(arm: ArmParameters, mass: float) -> ArmParameters:
    """The arm with a point mass (kg) at the end of its last link.

    Raises:
        UsageError: a mass below zero or not finite.
    """
    if not (math.isfinite(mass) and mass >= 0.0):
        raise UsageError(f"a payload of {mass} kg is not possible", next_step="Give 0 kg or more.")
    hand = arm.links[-1]
    total = hand.mass + mass
    center = (hand.mass * hand.center + mass * hand.length) / total
    shift, reach = center - hand.center, hand.length - center
    across = hand.inertia_across + hand.mass * shift**2 + mass * reach**2  # parallel axes
    loaded = replace(hand, mass=total, center=center, inertia_across=across)
    return replace(arm, links=(*arm.links[:-1], loaded))


def with_friction(arm: ArmParameters, factor: float) -> ArmParameters:
    """The arm with Coulomb, static and viscous friction of every motor times `factor`.

    Raises:
        UsageError: a factor that is not a positive number.
    """
    if not (math.isfinite(factor) and factor > 0.0):
        raise UsageError(f"friction cannot change by a factor of {factor}", next_step="Give a positive one.")
    motors = tuple(
        replace(m, coulomb=factor * m.coulomb, static=factor * m.static, viscous=factor * m.viscous)
        for m in arm.motors
    )
    return replace(arm, motors=motors)
