"""What the drives of an arm may be asked: by what was learned, or by the model file before any log."""

from __future__ import annotations

import numpy as np

from etude.contracts import Array, Model, Motion
from etude.limits.commands import CommandLimit, by_model
from etude.limits.open_commands import OpenCommands, kept_at
from etude.robots.arm.of_file import of_file
from etude.robots.arm.physics.mean import FORCES, ArmPhysics
from etude.robots.arm.physics.newton_euler import nominal_commands
from etude.robots.arm.spec import ArmSpec

NOMINAL = "the model file's masses"
OPEN = (
    "Torques are those of the model file's masses alone: friction, rotors, and by how much the file is "
    "wrong, are not in them until a log was learned."
)
_known: dict[str, CommandLimit | OpenCommands] = {}


def commands_of(spec: ArmSpec, model: Model | None, home: Array) -> CommandLimit | OpenCommands | None:
    """The limit; None where there is neither a model nor physics for commands that are forces.

    Args:
        spec: of the robot. model: what was learned, or None.
        home: (J,) a pose inside every limit.
    """
    if model is not None:
        own = by_model(model, _quantity(spec), spec.command_unit, spec.names, _ends(spec), spec.torque_rate)
        return kept_at(own, home)
    if spec.model_file is None or spec.command_unit not in FORCES:
        return None
    return of_file(_known, spec, lambda: kept_at(_nominal(spec), home))


def _nominal(spec: ArmSpec) -> CommandLimit:
    """By the rigid body of the model file."""
    geometry = ArmPhysics(spec, nominal=True).geometry

    def mean(motion: Motion) -> Array:
        return nominal_commands(geometry, *motion.orders[:3])

    ends = _ends(spec)
    return CommandLimit(
        _quantity(spec),
        spec.command_unit,
        spec.names,
        *ends,
        spec.torque_rate,
        mean,
        None,
        NOMINAL,
        said=(OPEN,),
    )


def _quantity(spec: ArmSpec) -> str:
    return "torque" if spec.command_unit in FORCES else "command"


def _ends(spec: ArmSpec) -> tuple[Array, Array]:
    most = np.minimum(spec.command, spec.torque)
    return -most, most
