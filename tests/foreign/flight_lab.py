"""A campaign whose flights rotorpy's vehicle flies, and what leaves it, as a receiver reads it."""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from flights import QUICK
from numpy.typing import NDArray
from rotorpy_vehicle import NED, Airframe, Cascade, Flight, G, Geometric, fly

from etude.cli import main
from etude.trajectories import FourierTrajectory

Array = NDArray[np.float64]

ROBOT = """\
kind = "quadrotor"
name = "foreign"
commands = ["motor_1", "motor_2", "motor_3", "motor_4"]
command_unit = "1"
command_lower = [0.0, 0.0, 0.0, 0.0]
command_upper = [1.0, 1.0, 1.0, 1.0]
rate = 25.0
lower = [-14.0, -14.0, 0.0]
upper = [14.0, 14.0, 6.0]
speed = 8.0
margin = 1.0
vertical_margin = 0.3
"""
USUAL = "attitude_gain = 6.5\nvelocity_damping = 0.2\n"
"""Lines of robot.toml that state PX4's defaults, which its cascade here has."""
PROMPT = "attitude_gain = 1e6\nvelocity_damping = 0.0\n"
"""Lines of robot.toml for a controller that follows an attitude at once: rotorpy's SE(3)."""


def run(*arguments: object) -> str:
    """What the command prints. AssertionError: it failed."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main([str(own) for own in arguments])
    assert code == 0, f"{arguments}: {code}\n{said.getvalue()[-2000:]}"
    return said.getvalue()


def table_of(path: Path, parts: Sequence[str] = ("drag", "cascade")) -> tuple[Array, Array]:
    """Set-points (N, 9), and these parts (N, 3) of their accelerations; all are what is not the motion's own.
    East, north, up.
    """
    header, *rows = csv.reader(io.StringIO(path.read_text()))
    values = np.array(rows, dtype=float)
    place = {name: i for i, name in enumerate(header)}
    names = [prefix + axis for prefix in ("", "v", "a") for axis in ("north", "east", "down")]
    points = values[:, [place[name] for name in names]].reshape(len(values), 3, 3) @ NED.T
    added = np.zeros((len(values), 3))
    for part in parts:
        known = [place[f"{part}_{axis}"] for axis in ("north", "east", "down") if f"{part}_{axis}" in place]
        added += values[:, known] @ NED.T if known else 0.0
    return points.reshape(len(values), 9), added


def learned_lab(
    folder: Path,
    flights: int,
    *,
    seed: int = 0,
    frame: Airframe | None = None,
    controller: type[Cascade] = Geometric,
    quick: bool = False,
    per_step: Any = None,
) -> tuple[Path, list[Flight]]:
    """A campaign that has learned so many of its own proposals, flown with the set-points that it wrote."""
    lab, robot = folder / "lab", folder / "quad.toml"
    robot.write_text(ROBOT + (PROMPT if issubclass(controller, Geometric) else USUAL))
    run("init", lab, "--robot", robot, "--seed", seed)
    if quick:
        text = (lab / "campaign.toml").read_text()
        for old, new in QUICK.items():
            assert old in text
            text = text.replace(old, new)
        (lab / "campaign.toml").write_text(text)
    flown = []
    for number in range(1, flights + 1):
        run("ask", lab, "--format", "px4")
        table, _ = table_of(lab / "proposals" / f"{number:04d}" / "px4" / "setpoints.csv")
        own = fly(table, seed=1000 * seed + number, frame=frame, controller=controller)
        log = folder / f"{number}.csv"
        log.write_text(own.csv())
        run("tell", lab, log, *(("--changed", "same") if number > 1 else ()))
        flown.append(own)
        if per_step:
            per_step(f"flight {number} of seed {seed}: {own.error():.3f} m")
    return lab, flown


def exported(lab: Path, motion: Path, output: Path) -> tuple[Array, Array]:
    """Set-points of a motion of one's own as `etude export` writes them for PX4, and what is added."""
    given = ("--set", f"motion={motion}", "format=px4")
    run("export", lab, "--to", "trajectory", *given, "--output", output)
    return table_of(output / "px4" / "setpoints.csv")


def from_rest(velocity: Array, most: float = 3.3, centre: float = 2.0) -> FourierTrajectory:
    """A flight of 15 s about `centre` m of height, at rest at both ends, with `most` m/s^2 of acceleration.

    Args:
        velocity: (2 N, 3) parts of cosines, then of sines; what moves at the ends is taken out.
    """
    count = len(velocity) // 2
    cosines, sines = velocity[:count].copy(), velocity[count:].copy()
    order = np.arange(1, count + 1)[:, None]
    cosines -= cosines.mean(axis=0)  # speed at the ends
    sines -= order * (order * sines).sum(axis=0) / (order**2).sum()  # acceleration there
    pace, table = 2.0 * np.pi / 15.0, np.concatenate([np.zeros((1, 3)), cosines, sines])
    found = FourierTrajectory(table, pace, 15.0).motion(np.linspace(0.0, 15.0, 600), 3).orders[2]
    table *= most / np.linalg.norm(found, axis=1).max()
    # positions begin at minus the integrals of the sines: the middle of the path comes to lie at the centre
    path = FourierTrajectory(table, pace, 15.0).motion(np.linspace(0.0, 15.0, 600), 1).orders[0]
    table[0] = np.array([0.0, 0.0, centre]) - 0.5 * (path.min(axis=0) + path.max(axis=0))
    return FourierTrajectory(table, pace, 15.0)


def without_acceleration(table: Array) -> Array:
    """Position and velocity alone: what a PID flies."""
    return np.concatenate([table[:, :6], np.zeros((len(table), 3))], axis=1)


def with_drag(table: Array, linear: Array) -> Array:
    """Accelerations that hold against a linear drag (3,) 1/s of the body's axes at heading 0, ENU."""
    out = table.copy()
    up = np.array([0.0, 0.0, G])
    for _ in range(3):  # the lean changes the axes, a little
        z = out[:, 6:9] + up
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
        y = np.cross(z, np.array([1.0, 0.0, 0.0]))
        y = y / np.linalg.norm(y, axis=1, keepdims=True)
        x = np.cross(y, z)
        speed = table[:, 3:6]
        out[:, 6:9] = table[:, 6:9] + sum(
            d * (speed * axis).sum(axis=1, keepdims=True) * axis
            for d, axis in zip(linear, (x, y, z), strict=True)
        )
    return out


def least_squares_drag(flights: list[Flight]) -> Array:
    """(3,) dx, dy of lateral specific force on body velocity, by least squares, and 0 along z."""
    from scipy.spatial.transform import Rotation

    velocity, force = [], []
    for own in flights:
        turn = Rotation.from_quat(own.log[:, [18, 19, 20, 17]])
        velocity.append(turn.inv().apply(own.log[:, 14:17]))
        force.append(own.log[:, 1:4])
    v, f = np.concatenate(velocity), np.concatenate(force)
    return np.array([*(-(v[:, i] @ f[:, i]) / (v[:, i] @ v[:, i]) for i in range(2)), 0.0])
