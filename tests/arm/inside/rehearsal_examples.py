"""Small robots whose every figure is known, to be rehearsed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.types import Array, Motion
from etude_arm import ArmSpec, Axis
from etude_arm.plant.feedback_loop import control_times
from etude_arm.plant.trace import LoopInputs
from etude_arm.rehearsal.overlay import MotorTable, Simulate
from etude_arm.rehearsal.rehearsed_robot import RehearsedRobot, rehearsed

GRAVITY = 9.81
LINK = '<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="{2}"/>{3}</inertial></link>'
INERTIA = '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4} 0 0"/>'
    '<axis xyz="{5}"/><limit lower="-2" upper="2" velocity="2" effort="60"/><dynamics damping="7"/></joint>'
)


def link(name: str, centre: float, mass: float) -> str:
    return LINK.format(name, centre, mass, INERTIA)


def urdf(*parts: str) -> str:
    return f'<robot name="made"><link name="base"/>{"".join(parts)}</robot>'


# a turntable, a shoulder that lifts, and a telescope
ARM = urdf(
    link("table", 0.0, 2.0),
    link("upper", 0.3, 3.0),
    link("fore", 0.2, 1.0),
    JOINT.format("turn", "revolute", "base", "table", 0.0, "0 0 1"),
    JOINT.format("lift", "revolute", "table", "upper", 0.1, "0 -1 0"),
    JOINT.format("reach", "prismatic", "upper", "fore", 0.4, "1 0 0"),
)
# one heavy link that turns about the vertical, where gravity does no work
TABLE = urdf(link("table", 0.3, 3.0), JOINT.format("turn", "revolute", "base", "table", 0.0, "0 0 1"))
# the same, upright: gravity is m g 0.3 cos(q)
LEVER = urdf(link("lever", 0.3, 3.0), JOINT.format("lift", "revolute", "base", "lever", 0.0, "0 -1 0"))
ABOUT = 0.02 + 3.0 * 0.3**2
"""kg m^2 of table and lever about their joint."""


def made(
    folder: Path, text: str, *, rate: float = 100.0, unit: str = "N m", command: float = 60.0, **what: object
) -> RehearsedRobot:
    """The robot of a URDF; `what` goes into [simulate], but for motors=(...)."""
    return rehearsed(spec_of(folder, text, rate=rate, unit=unit, command=command, **what))


def spec_of(folder: Path, text: str, *, rate: float, unit: str, command: float, **what: object) -> ArmSpec:
    path = folder / "made.urdf"
    path.write_text(text)
    motors = what.pop("motors", ())
    names = [name for name in ("turn", "lift", "reach") if f'joint name="{name}"' in text]
    axes = tuple(Axis(n, -2.0, 2.0, 2.0, 4.0, command, "m" if n == "reach" else "rad") for n in names)
    spec = ArmSpec("made", axes, unit, rate, path)
    loop = Simulate(**what) if what else None  # type: ignore[arg-type]
    return replace(spec, simulate=loop, motors=motors)  # type: ignore[arg-type]


def motor(name: str, **what: float) -> MotorTable:
    return MotorTable(name=name, **what)  # type: ignore[arg-type]


class Waves:
    """A sine for each joint, from rest; a Trajectory."""

    form = "waves"

    def __init__(self, joints: int, duration: float = 4.0, height: float = 0.5) -> None:
        self.duration, self.height = duration, height
        self.omega = np.pi / duration * 2.0 * np.arange(1, joints + 1)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        angle = self.omega * t[:, None]
        w, h = self.omega, self.height
        q, qd, qdd = h * (1 - np.cos(angle)), h * w * np.sin(angle), h * w**2 * np.cos(angle)
        return Motion(t, np.stack([q, qd, qdd])[:orders])


def loop_inputs(robot: RehearsedRobot, trajectory: Waves, feedforward: Array | None = None) -> LoopInputs:
    """Without lead-in and noise."""
    q, qd, qdd = robot.planned(trajectory).orders
    ff = np.zeros_like(q) if feedforward is None else feedforward
    return LoopInputs(q, qd, ff, np.zeros_like(q), robot.substeps, qdd)


def still(robot: RehearsedRobot, q: Array, seconds: float, feedforward: Array) -> LoopInputs:
    """Held at q (J,) with a feedforward (J,)."""
    count = len(control_times(seconds, robot.spec.rate))
    rows = [np.tile(np.asarray(row, dtype=float), (count, 1)) for row in (q, 0.0 * q, feedforward, 0.0 * q)]
    return LoopInputs(*rows, robot.substeps)
