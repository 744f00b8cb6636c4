"""Command limits of an arm: by the learned model, or by the model file before any log."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from etude.limits.commands import CommandLimit, OpenCommands, by_model, held_at, kept_at, rest_at, weight_at
from etude.protocols import Model
from etude.types import Array, Motion
from etude_arm.loading.load import of_file
from etude_arm.physics.geometry import file_friction, has_masses
from etude_arm.physics.identification import MASSES_OFF, VISCOUS
from etude_arm.physics.mean import ArmPhysics
from etude_arm.physics.newton_euler import nominal_commands
from etude_arm.spec import FORCES, ArmSpec

NOMINAL = "the model file's masses"
ASSUMED = (
    f"{VISCOUS:.0%} of each limit and {MASSES_OFF:.0%} of each link's mass are assumed as deviations. Rotors "
    "are not in them."
)
OPEN = f"Torques: no log has shown friction yet, or the error of the file's masses. {ASSUMED}"
UNSURE = f"Torques: logs do not determine rest at home well enough, so the file's masses are used. {ASSUMED}"
OF_FILE = "Torques: Coulomb and viscous friction are those of the model file."
NO_MOTION = "No motion is possible with the numbers of the model file"
"""Beginning of a sentence that refuses every motion while the robot's `confirm` contains it."""
MEND = (
    "Correct command (or torque) of [[axis]] in robot.toml, and remove the line about them from confirm "
    "there. With corrected masses begin anew: etude init FOLDER --robot FILE. If the limits are not real "
    "(placeholders, weight carried by springs), only remove the line: forces are then not verified."
)
_cached_limits: dict[str, CommandLimit | OpenCommands] = {}


def commands_of(spec: ArmSpec, model: Model | None, home: Array) -> CommandLimit | OpenCommands | None:
    """The limit; None without a model and without physics for commands that are forces.

    Args:
        spec: of the robot. model: learned, or None.
        home: (J,) a pose inside every limit, rad (m).
    """
    if model is None:
        return _before_logs(spec, home)
    limit = by_model(model, _quantity(spec), spec.command_units, spec.names, _ends(spec), spec.torque_rate)
    kept = kept_at(limit, home)
    # deviations that forbid rest at home show that little is known; a mean, that a limit is wrong
    mean_kept = isinstance(kept_at(replace(limit, deviation=None), home), CommandLimit)
    unsure = isinstance(kept, OpenCommands) and mean_kept
    assumed = _before_logs(spec, home) if unsure else None
    return replace(assumed, gaps=(UNSURE, *assumed.gaps[1:])) if isinstance(assumed, CommandLimit) else kept


def _before_logs(spec: ArmSpec, home: Array) -> CommandLimit | OpenCommands | None:
    """The limit by the model file; None without masses, or if commands are no forces."""
    if not has_masses(spec) or spec.command_unit not in FORCES:
        return None
    return of_file(
        _cached_limits,
        spec,
        lambda: _unless_confirmed(kept_at(held_at(_nominal(spec), home), home), spec, home),
    )


def _unless_confirmed(
    commands: CommandLimit | OpenCommands, spec: ArmSpec, home: Array
) -> CommandLimit | OpenCommands:
    """Open commands, which refuse all motion until a person confirms the line about them; else `commands`."""
    waits = any(line.startswith(NO_MOTION) for line in spec.confirm)
    if not (waits and isinstance(commands, OpenCommands) and commands.limit is not None):
        return commands
    demand = np.abs(commands.limit.mean(rest_at(home, commands.limit.orders))[0])
    beyond = [
        f"{name} takes {most:.4g} {unit} of {end:.4g}"
        for name, unit, most, end in zip(
            spec.names, commands.limit.units, demand.tolist(), commands.limit.upper.tolist(), strict=True
        )
        if most > end
    ]
    return replace(commands, refused=(f"{NO_MOTION}: at rest at home {', '.join(beyond)}", MEND))


def weight_on_drives(spec: ArmSpec) -> Callable[[Array], Array] | None:
    """Poses (n, J) -> (n,) largest part of a limit at rest with room for its deviation; None: not forces.

    Up to 1 a robot without logs keeps its whole assumed deviation at that home.
    """
    if not has_masses(spec) or spec.command_unit not in FORCES:
        return None
    limit = _nominal(spec)
    return lambda poses: weight_at(limit, poses)


def _nominal(spec: ArmSpec) -> CommandLimit:
    """The limit by the rigid body of the model file, with the deviation of identification's prior."""
    prior = ArmPhysics(spec)
    (dry, viscous), turning = file_friction(spec), prior.friction_velocity

    def friction(motion: Motion) -> Array:
        qd = motion.orders[1]
        return np.asarray(dry * np.tanh(qd / turning) + viscous * qd)

    def mean(motion: Motion) -> Array:
        q, qd, qdd = motion.orders[:3]
        return nominal_commands(prior.geometry, q, qd, qdd, friction(motion))

    def both(motion: Motion) -> tuple[Array, Array]:
        q, qd, qdd = motion.orders[:3]
        return prior.before_logs(q, qd, qdd, friction(motion))

    return CommandLimit(
        _quantity(spec),
        spec.command_units,
        spec.names,
        *_ends(spec),
        spec.torque_rate,
        mean,
        lambda motion: both(motion)[1],
        NOMINAL,
        gaps=(OPEN, *[OF_FILE] * bool(dry.any() or viscous.any())),
        both=both,
        lasts=math.inf,
    )


def _quantity(spec: ArmSpec) -> str:
    return "torque" if spec.command_unit in FORCES else "command"


def _ends(spec: ArmSpec) -> tuple[Array, Array]:
    most = np.minimum(spec.command, spec.torque)
    return -most, most
