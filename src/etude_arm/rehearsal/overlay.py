"""Properties of drives that a model file lacks: the tables [simulate] and [[motor]] of robot.toml.

[simulate]                  # all optional
loop = "inside"             # where the feedback runs: in the drives, or "outside" at the robot's rate
friction = "lugre"          # or "coulomb", or "none"
delay = 0.0                 # s from a set-point (inside) or a command (outside) to its effect
timestep = 0.001            # s, of the physics and of drives with the feedback inside
encoder_noise = 1.0         # standard deviation, in ticks of the encoder
velocity_filter = 1.0       # share of each new difference in the velocity that an outside loop feels
[[motor]]                   # of one joint; omitted values are chosen by `defaults` name = "elbow" gear =
100.0                # turns of the motor for one of the joint; all that follows is at the motor armature =
2e-4             # kg m^2 coulomb = 0.05              # N m
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

from etude.errors import UsageError

LOOPS = ("inside", "outside", "")
FRICTIONS = ("lugre", "coulomb", "none")


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """The loop of the simulated robot.

    Attributes:
        loop: "inside", a servo in each drive at 1 / timestep that goes on between the set-points which it
            gets at the robot's rate; "outside", commands held for a tick, from what the encoders say; "":
            inside where commands are forces or currents, outside for volts and pwm.
        friction: "lugre" (Canudas de Wit 1995), "coulomb" (MuJoCo's constraint), or "none"; viscous friction
            is beside each.
        delay: s.
        timestep: s of the physics.
        encoder_noise: standard deviation in ticks.
        velocity_filter: share of each new difference in the filtered velocity, in (0, 1].
    """

    loop: Literal["inside", "outside", ""] = ""
    friction: Literal["lugre", "coulomb", "none"] = "lugre"
    delay: float = 0.0
    timestep: float = 0.001
    encoder_noise: float = 1.0
    velocity_filter: float = 1.0

    def __post_init__(self) -> None:
        good = {
            "loop": self.loop in LOOPS,
            "friction": self.friction in FRICTIONS,
            "delay": 0.0 <= self.delay <= 1.0,
            "timestep": 0.0 < self.timestep <= 0.01,
            "encoder_noise": 0.0 <= self.encoder_noise < math.inf,
            "velocity_filter": 0.0 < self.velocity_filter <= 1.0,
        }
        for name, is_good in good.items():
            if not is_good:
                raise UsageError(f"{name} = {getattr(self, name)!r} is not possible", where="[simulate]")


@dataclass(frozen=True, kw_only=True)
class MotorTable:
    """The known values of the drive of one joint, each at the motor, before the gear.

    Attributes:
        name: the joint's.
        gear: rad of the motor for one rad (m) of the joint.
        armature: kg m^2 of the rotor.
        coulomb, static: friction, N m; viscous: N m s/rad.
        stribeck: rad/s at which static friction has fallen to Coulomb friction.
        stiffness, micro_damping: of LuGre's bristles, N m/rad and N m s/rad.
        torque: N m at the largest command, at rest; no_load: rad/s at which a motor that is given volts or
            pwm has none left.
        encoder_bits: ticks in a turn of the motor are 2 to this power.
        kp, kd: of the feedback, N m/rad and N m s/rad.
    """

    name: str
    gear: float = 1.0
    armature: float | None = None
    coulomb: float | None = None
    static: float | None = None
    viscous: float | None = None
    stribeck: float | None = None
    stiffness: float | None = None
    micro_damping: float | None = None
    torque: float | None = None
    no_load: float | None = None
    encoder_bits: int = 20
    kp: float | None = None
    kd: float | None = None

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self) if f.name != "name"):
            value = getattr(self, name)
            least = (
                0.0 if name in ("armature", "coulomb", "static", "viscous", "micro_damping", "kd") else None
            )
            good = value is None or (math.isfinite(value) and (value > 0.0 or value == least))
            if not good or (name == "encoder_bits" and value > 32):
                raise UsageError(f"{name} = {value!r} is not possible", where=f"[[motor]] '{self.name}'")

    def at_joint(self, name: str) -> float | None:
        """The value of that name at the joint."""
        value = getattr(self, name)
        return None if value is None else float(value) * self.gear ** POWER[name]


POWER = {
    "armature": 2,
    "coulomb": 1,
    "static": 1,
    "viscous": 2,
    "stribeck": -1,
    "stiffness": 2,
    "micro_damping": 2,
    "torque": 1,
    "no_load": -1,
    "kp": 2,
    "kd": 2,
}
"""Power of the gear ratio that converts a motor's value to the joint."""
