"""What is said of a rehearsed robot before it runs: its drives, with every figure, and what it cannot do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.rehearsal.motors import Motors
from etude_arm.rehearsal.overlay import Simulate
from etude_arm.rehearsal.scales import Scales
from etude_arm.spec import ArmSpec

HARD = 0.95
"""Part of the torque limit beyond which a motion is hardly possible."""
LARGE = 1000.0
"""Torque limits of so many times what a motion asks for are placeholders."""
DEFAULTS = "What is not in [simulate] and [[motor]] of robot.toml is a default."


def too_heavy(spec: ArmSpec, gravity: Array, torque: Array) -> None:
    """Refuses a robot that cannot carry its own weight: a simulation would only show how it falls.

    Raises:
        UsageError: naming the joints and the part of their weight that they carry.
    """
    needed = np.abs(gravity).max(axis=0)
    weak = [
        f"joint '{name}' can carry {100.0 * part:.0f} % of its own weight"
        for name, part in zip(spec.names, (torque / np.maximum(needed, 1e-12)).tolist(), strict=True)
        if part < 1.0
    ]
    if weak:
        raise UsageError(
            f"with the masses and efforts of its file {'; '.join(weak)}: it is not simulated",
            where=spec.name,
            next_step="Is the arm counterbalanced, is the base mounted otherwise, or is a limit wrong? "
            "Correct the command limits in robot.toml or the masses in the model file; or say in [[motor]] "
            "what its drives give (torque), if the limits are no more than placeholders.",
        )


def sentences(
    spec: ArmSpec, loop: Simulate, motors: Motors, said: Mapping[str, Array], scales: Scales
) -> tuple[str, ...]:
    """The loop, one line for each drive, what of the file is not used, and what the drives cannot do."""
    found = [f"{_loop(spec, loop)} {DEFAULTS}"]
    found += [_motor(spec, motors, j) for j in range(spec.dof)]
    unused = [
        f"{name} (damping {d:g}, friction {f:g})"
        for name, d, f in zip(spec.names, said["damping"].tolist(), said["friction"].tolist(), strict=True)
        if d or f
    ]
    if unused:
        found.append(f"The file's own damping and friction are not used: {', '.join(unused)}.")
    return tuple(found + _hard(spec, motors, scales) + _large(spec, motors, scales))


def _loop(spec: ArmSpec, loop: Simulate) -> str:
    place = {
        "inside": f"a servo in each drive at {1.0 / loop.timestep:g} Hz",
        "outside": f"a loop at {spec.rate:g} Hz outside the drives",
    }[loop.loop]
    late = f", delay {1e3 * loop.delay:g} ms" if loop.delay else ""
    return f"The simulated {spec.name} has {place}, {loop.friction} friction{late}, no contacts."


def _motor(spec: ArmSpec, motors: Motors, j: int) -> str:
    axis = spec.axes[j]
    force = "N m" if axis.unit == "rad" else "N"
    inertia = "kg m²" if axis.unit == "rad" else "kg"
    return (
        f"{axis.name}: armature {motors.armature[j]:.3g} {inertia}, Coulomb {motors.coulomb[j]:.3g} {force}, "
        f"viscous {motors.viscous[j]:.3g} {force} s/{axis.unit}, Kp {motors.kp[j]:.4g} {force}/{axis.unit}, "
        f"Kd {motors.kd[j]:.3g} {force} s/{axis.unit}, torque {motors.torque[j]:.4g} {force}"
    )


def _hard(spec: ArmSpec, motors: Motors, scales: Scales) -> list[str]:
    """Joints that reach their limits of speed and acceleration only with more torque than they have."""
    needed = np.quantile(np.abs(scales.gravity), 0.95, axis=0) + motors.coulomb
    needed = needed + (scales.median + motors.armature) * spec.acceleration + motors.viscous * spec.velocity
    parts = needed / motors.torque
    hard = [f"{name} ({p:.1f} times)" for name, p in zip(spec.names, parts.tolist(), strict=True) if p > HARD]
    if not hard:
        return []
    return [
        f"At the limits of acceleration and speed these joints need more torque than they have: "
        f"{', '.join(hard)}. Motions near them will not be followed."
    ]


def _large(spec: ArmSpec, motors: Motors, scales: Scales) -> list[str]:
    """Joints whose torque limits no motion comes near, while friction and rotors are made from them."""
    needed = np.quantile(np.abs(scales.gravity), 0.95, axis=0) + scales.median * spec.acceleration
    parts = motors.torque / np.maximum(needed, 1e-12)
    large = [
        f"{name} ({p:.0f} times)" for name, p in zip(spec.names, parts.tolist(), strict=True) if p > LARGE
    ]
    if not large:
        return []
    return [
        f"The torque limits of {', '.join(large)} are far beyond what their fastest motions ask for. "
        "Friction and rotors here follow them: correct command in robot.toml if they are placeholders."
    ]
