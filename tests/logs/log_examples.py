"""A small robot, motions of it, and files made from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from etude.protocols import Trajectory
from etude.types import Array, Channel, Log, Motion

JOINTS = ("pan_joint", "lift_joint", "elbow_joint")
LOWER, UPPER = np.array([-1.0, -2.0, -1.5]), np.array([1.0, 1.0, 1.5])
VELOCITY, COMMAND = np.array([2.0, 2.0, 3.0]), np.array([40.0, 60.0, 20.0])
RATE = 100.0
LIMITS = {"q": (LOWER, UPPER), "qd": (-VELOCITY, VELOCITY), "command": (-COMMAND, COMMAND)}
SCALE = UPPER - LOWER


def joint_channels(names: tuple[str, ...] = JOINTS, unit: str = "N m") -> tuple[Channel, ...]:
    """What a log of a robot of these joints may hold."""
    units = [(f"rad{per}",) * len(names) for per in ("", "/s", "/s^2")]
    commands = (unit,) * len(names)
    return (
        Channel("q", names, units[0], required=True),
        Channel("qd", names, units[1], derivative_of="q"),
        Channel("qdd", names, units[2], derivative_of="qd"),
        Channel("q_des", names, units[0], "plan"),
        Channel("qd_des", names, units[1], "plan", derivative_of="q_des"),
        Channel("qdd_des", names, units[2], "plan", derivative_of="qd_des"),
        Channel("command", names, commands, "command", required=True, acts_on="q"),
        Channel("command_ff", names, commands, "aside"),
        Channel("command_fb", names, commands, "aside"),
        Channel("q_true", names, units[0], "truth"),
    )


CHANNELS = joint_channels()
BY_NAME = {channel.name: channel for channel in CHANNELS}


def vector(name: str, unit: str, role: str = "state", required: bool = False) -> Channel:
    return Channel(name, ("x", "y", "z"), (unit,) * 3, role, required)  # type: ignore[arg-type]


MOTORS = ("front_right", "back_right", "back_left", "front_left")
FLIGHT_CHANNELS = (
    Channel("command", MOTORS, ("V",) * 4, "command", required=True),
    Channel("altitude", ("z",), ("m",)),
    vector("specific_force", "m/s^2", required=True),
    vector("rates", "rad/s", required=True),
    vector("position", "m", "aside"),
    vector("velocity", "m/s", "aside"),
    Channel("orientation", ("w", "x", "y", "z"), ("1",) * 4, "aside"),
    Channel("attitude", ("roll", "pitch", "yaw"), ("rad",) * 3, "aside"),
    vector("position_des", "m", "plan"),
    Channel("attitude_des", ("roll", "pitch", "yaw"), ("rad",) * 3, "plan"),
)
FLIGHT_LIMITS = {"command": (np.zeros(4), np.full(4, 11.1))}
FLIGHT_RATE = 200.0


@dataclass(frozen=True)
class Sines:
    """Each joint a sum of two sines at rest at both ends, as a Trajectory."""

    frequencies: tuple[float, ...] = (0.2, 0.3, 0.35)
    amplitudes: tuple[float, ...] = (0.8, 0.7, 0.9)
    duration: float = 20.0
    form: str = field(default="sines", init=False)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        omega = 2 * np.pi * np.array(self.frequencies)
        phase = np.clip(t, 0.0, self.duration)[:, None] * omega
        size = np.array(self.amplitudes) / 1.3
        rows = [
            np.sin(phase + k * np.pi / 2) - 2**k * np.sin(2 * phase + k * np.pi / 2) / 2 for k in range(3)
        ]
        return Motion(t, np.stack([size * omega**k * row for k, row in enumerate(rows)])[:orders])

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        return ((0.0, "segment", self),)

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:
        raise NotImplementedError

    def slowed(self, factor: float) -> Sines:
        raise NotImplementedError

    def to_json(self) -> str:
        raise NotImplementedError


MOTION = Sines()


def log_with(t: Array, source: str = "log", **values: Array) -> Log:
    """A log of these channels of the small robot."""
    return Log(t, {name: BY_NAME[name] for name in values}, values, source)


def make_log(motion: Sines = MOTION, rate: float = RATE, noise: float = 1e-4, start: float = 0.0) -> Log:
    """A log of the motion: position with white noise, command of a damped mass."""
    rng = np.random.default_rng(0)
    t = start + np.arange(0.0, motion.duration - start, 1.0 / rate)
    q, qd, qdd = motion.motion(t).orders
    command = 0.5 * qdd + 3.0 * qd + 5.0 * q
    return log_with(t, q=q + noise * rng.standard_normal(q.shape), command=command)


def with_values(log: Log, **values: Array) -> Log:
    """The log with other values in channels of the small robot."""
    for name, own in values.items():
        log = log.put(BY_NAME[name], own)
    return log


def at(log: Log, t: Array) -> Log:
    """The log at other times."""
    return replace(log, t=t)


def columns_of(log: Log, pattern: str = "{channel}_{joint}") -> dict[str, Array]:
    """Header -> column, of t, q and command (as tau)."""
    columns = {"t": log.t}
    for channel, word in (("q", "q"), ("command", "tau")):
        for j, joint in enumerate(log.channels[channel].parts):
            columns[pattern.format(channel=word, joint=joint)] = log[channel][:, j]
    return columns


def write_csv(path: Path, columns: dict[str, Array], separator: str = ",") -> Path:
    """The columns as CSV with every digit."""
    rows = np.column_stack(list(columns.values()))
    lines = [separator.join(columns), *(separator.join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path
