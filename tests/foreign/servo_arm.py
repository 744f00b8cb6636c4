"""An arm of position servos that Étude did not make, as an SO-101: counts, a dead band, backlash.

A servo takes a position and pushes by a count of its full voltage, sign-magnitude, a P controller in its own
steps. Counts within the dead band do nothing. The motor pushes the link through a gear that is loose by the
backlash; the encoder is at the horn, as of an STS3215 or XL330, or at the motor. What is logged: positions
in encoder steps and counts. Nothing of Étude is imported; rigid bodies by pinocchio.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

pin = pytest.importorskip(
    "pinocchio", reason="pinocchio has no wheel for this Python or system: pip install pin"
)

Array = NDArray[np.float64]
SUBSTEP, PERIOD, RATE = 4e-4, 2e-3, 100.0
"""s of the integration and of the servo's controller, and Hz of the log."""
FULL = 1000.0
"""Counts of the full voltage."""
STEP = 2.0 * np.pi / 4096
STALL, TOP_SPEED = 2.9, 4.7
"""N m and rad/s of an STS3215 at 12 V."""
KP, KD = 3500.0, 20.0
"""Counts per rad, and per rad/s."""
CONTACT, DAMPING = 400.0, 0.1
"""N m/rad and N m s/rad of the teeth."""

JOINTS = ("pan", "lift", "elbow", "flex", "roll")
_LINKS = ((0.10, 0.0, 0.03), (0.11, 0.0, 0.055), (0.10, 0.01, 0.06), (0.07, 0.0, 0.03), (0.09, 0.03, 0.04))
_PLACES = ((0, 0, 0.05), (0, 0, 0.06), (0, 0, 0.116), (0, 0, 0.135), (0, 0, 0.06))
_AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")


def urdf() -> str:
    """Of five joints with servos of 55 g in the links."""
    parts, parent = ['<robot name="servos"><link name="base"/>'], "base"
    for name, (mass, x, z), place, axis in zip(JOINTS, _LINKS, _PLACES, _AXES, strict=True):
        xyz = " ".join(map(str, place))
        parts.append(
            f'<link name="{name}_link"><inertial><origin xyz="{x} 0 {z}"/><mass value="{mass + 0.055}"/>'
            f'<inertia ixx="1e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            f'<limit lower="-1.7" upper="1.7" velocity="2.0" effort="{STALL}"/></joint>'
        )
        parent = f"{name}_link"
    return "".join([*parts, "</robot>"])


@dataclass(frozen=True, eq=False)
class Servos:
    """Each (J,).

    Attributes:
        band: counts that make no torque. backlash: rad. coulomb, stiction: N m. gain: N m per count.
        viscous: N m s/rad, with the back-EMF. armature: kg m^2. at_motor: where the encoder is.
    """

    model: object
    band: Array
    backlash: Array
    coulomb: Array
    stiction: Array
    gain: Array
    viscous: Array
    armature: Array
    at_motor: bool


def servos(seed: int, *, band: bool, backlash: bool, at_motor: bool) -> Servos:
    """Drawn servos and masses; without a dead band or backlash they are zero."""
    rng = np.random.default_rng(seed)
    model, n = pin.buildModelFromXML(urdf()), len(JOINTS)
    for i in range(1, model.njoints):
        body, factor = model.inertias[i], 1.2 ** rng.uniform(-1.0, 1.0)
        lever = body.lever + rng.uniform(-0.008, 0.008, 3)
        model.inertias[i] = pin.Inertia(body.mass * factor, lever, body.inertia * factor)

    def drawn(level: float) -> Array:
        return np.asarray(level * 1.3 ** rng.uniform(-1.0, 1.0, n))

    gain = drawn(STALL / FULL)
    own = Servos(
        model, drawn(30.0), drawn(0.025), drawn(0.05), drawn(0.02), gain, drawn(STALL / TOP_SPEED),
        drawn(0.02), at_motor,
    )  # fmt: skip
    return replace(own, band=own.band * band, backlash=own.backlash * backlash)


def friction(own: Servos, speed: Array) -> Array:
    """(J,) N m."""
    level = own.coulomb + own.stiction * np.exp(-((speed / 0.15) ** 2))
    return np.asarray(level * np.tanh(speed / 0.01) + own.viscous * speed)


def run(own: Servos, goals: Array, seed: int) -> tuple[Array, Array, Array]:
    """t (T,) s, positions (T, J) rad and counts (T, J) at RATE, for goals (G, J) at each PERIOD."""
    rng, data = np.random.default_rng(seed), own.model.createData()  # type: ignore[attr-defined]
    motor, link = goals[0].copy(), goals[0].copy()
    speed, rate = np.zeros(len(link)), np.zeros(len(link))
    before, slope, each, rows = link.copy(), np.zeros(len(link)), round(1.0 / (RATE * PERIOD)), []
    for k, goal in enumerate(goals):
        seen = np.round((motor if own.at_motor else link) / STEP) * STEP
        before, slope = seen, slope + 0.2 * ((seen - before) / PERIOD - slope)
        counts = np.round(np.clip(KP * (goal - seen) - KD * slope, -FULL, FULL))
        if k % each == 0:
            rows.append((k * PERIOD, seen, counts + np.round(rng.normal(0.0, 2.0, len(counts)))))
        push = own.gain * np.sign(counts) * np.maximum(np.abs(counts) - own.band, 0.0)
        mass = pin.crba(own.model, data, link)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(own.model, data, link, rate)
        if own.backlash.any():
            motor, speed, link, rate = _loose(own, push, mass, bias, (motor, speed, link, rate))
            continue
        whole = mass + np.diag(own.armature)
        for _ in range(round(PERIOD / SUBSTEP)):
            # friction by its secant, implicit: it acts half a step early, so steps are short
            drag = SUBSTEP * np.diag(friction(own, _moving(rate)) / _moving(rate))
            rate = np.linalg.solve(whole + drag, whole @ rate + SUBSTEP * (push - bias))
            link = link + SUBSTEP * rate
        motor = link
    t, q, counts = (np.array(part) for part in zip(*rows, strict=True))
    return t, q, counts


def _moving(speed: Array) -> Array:
    return np.where(np.abs(speed) < 1e-9, 1e-9, speed)


def _loose(own: Servos, push: Array, mass: Array, bias: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
    """Motor, its speed, link and its speed a PERIOD later: two bodies, and teeth that touch or do not."""
    motor, speed, link, rate = state
    inverse = np.linalg.inv(mass)
    for _ in range(round(PERIOD / SUBSTEP)):
        apart = motor - link
        bite = apart - np.clip(apart, -0.5 * own.backlash, 0.5 * own.backlash)
        teeth = CONTACT * bite + DAMPING * (speed - rate) * (bite != 0.0)
        rate = rate + SUBSTEP * inverse @ (teeth - bias)
        drag = SUBSTEP * friction(own, _moving(speed)) / _moving(speed)
        speed = (own.armature * speed + SUBSTEP * (push - teeth)) / (own.armature + drag)
        link, motor = link + SUBSTEP * rate, motor + SUBSTEP * speed
    return motor, speed, link, rate


def log(t: Array, q: Array, counts: Array) -> bytes:
    """CSV, as a user's script writes it."""
    names = ["t", *(f"q_{name}" for name in JOINTS), *(f"load_{name}" for name in JOINTS)]
    lines = [",".join(f"{x:.6g}" for x in row) for row in np.column_stack([t, q, counts]).tolist()]
    return ("\n".join([",".join(names), *lines]) + "\n").encode()
