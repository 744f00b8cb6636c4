"""The logs of the truth table: real ones of the package or of a user's folder, and simulated ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from etude.errors import DataError
from etude.types import Array, Channel, Log
from etude_studies.real_logs import EXAMPLES, REAL_LOGS, arm_log
from etude_studies.world import World

ARMS = ("arm4", "arm4_rough")
FLIGHT = "quadrotor"
OF_FIVE = (*ARMS, *ARMS, FLIGHT)
"""The robots of five simulated logs in a row."""
DRIVE_S = 0.01
"""Time constant of the low-pass of a drive's velocity."""
TIAGO_JOINTS = 5
"""Of eight: the others have no effort."""


@dataclass(frozen=True)
class Source:
    """One log of the table.

    Attributes:
        name: of the log; simulated ones end with their seed.
        real: recorded.
        path: of a recorded one; "" of a simulated one.
        seed: of a simulated one.
        velocities: whether velocities are logged: as they were, or as a drive would have them.
    """

    name: str
    real: bool
    path: str = ""
    seed: int = 0
    velocities: bool = False

    @property
    def key(self) -> str:
        """Unique, and a file's name."""
        return self.name + ("_velocities" if self.velocities else "")


def real_sources(logs: Path | None) -> list[Source]:
    """The recordings that are there, with velocities where they have them."""
    sources = []
    for recording in REAL_LOGS:
        path = recording.find(logs) if recording.name != "sarcos" else None
        if path is not None:
            velocities = (False, True) if recording.name in ("ur10", "panda") else (False,)
            sources += [Source(recording.name, True, str(path), velocities=v) for v in velocities]
    tiago = None if logs is None else logs / "tiago_exciting.npz"
    if tiago is not None and tiago.is_file():
        sources.append(Source("tiago", True, str(tiago), velocities=True))
    flights = sorted((EXAMPLES / "crazyflie").glob("*.csv"))
    return [*sources, *(Source(f"crazyflie_{path.stem}", True, str(path)) for path in flights)]


def simulated_sources(count: int, seed: int) -> list[Source]:
    """`count` logs, two fifths of them of each arm and a fifth of the quadrotor; every other one with
    velocities.
    """
    return [
        Source(f"{OF_FIVE[i % 5]}_{seed + i:04d}", False, seed=seed + i, velocities=i % 2 == 1)
        for i in range(count)
    ]


def load(source: Source) -> tuple[World, Log]:
    """The robot and its log as it was recorded, not yet cleaned. DataError: not such a file."""
    if not source.real:
        return _simulated(source)
    if source.name.startswith("crazyflie"):
        world = World.of(EXAMPLES / "crazyflie" / "crazyflie.toml")
        return world, world.read(Path(source.path))
    if source.name == "tiago" and source.velocities:
        return _tiago(Path(source.path))
    log, world = arm_log(source.name, Path(source.path))
    if source.name == "panda" and source.velocities:
        log = _with_velocities(world, log, Path(source.path))
    return world, log if source.velocities else log.without("qd")


def _with_velocities(world: World, log: Log, path: Path) -> Log:
    with np.load(path) as arrays:
        t, qd = arrays["t"], arrays["qd"]
    rows = np.clip(np.searchsorted(t - t[0], log.t - 1e-9), 0, len(t) - 1)
    return log.put(_channel(world, "qd"), np.asarray(qd[rows], dtype=np.float64))


def _tiago(path: Path) -> tuple[World, Log]:
    world = World.of(EXAMPLES / "tiago" / "tiago.toml")
    with np.load(path) as arrays:
        columns = {name: np.asarray(arrays[name], dtype=np.float64) for name in ("t", "q", "qd", "effort")}
    if columns["q"].shape[1] < TIAGO_JOINTS:
        raise DataError("this is not the recording of the TIAGo", where=path.name)
    log = Log(columns["t"] - columns["t"][0], {}, {}, path.name)
    for name, array in (("q", "q"), ("qd", "qd"), ("command", "effort")):
        log = log.put(_channel(world, name), np.ascontiguousarray(columns[array][:, :TIAGO_JOINTS]))
    return world, log


@cache
def _world(robot: str) -> World:
    return World.of(robot)


def _simulated(source: Source) -> tuple[World, Log]:
    world = _world(source.name.rsplit("_", 1)[0])
    rng = np.random.default_rng([source.seed, 14])
    log = world.robot.run(world.motion(rng), None, rng)
    asides = [name for name, c in log.channels.items() if c.role in ("plan", "truth")]
    log = log.without(*asides, "command_ff", "command_fb")
    if world.kind.path == "q":
        return world, _driven(world, log) if source.velocities else log
    return world, _estimated(world, log) if source.velocities else log


def _driven(world: World, log: Log) -> Log:
    """With velocities as a drive logs them: differences of its encoder behind a first-order low-pass."""
    step = float(np.median(np.diff(log.t)))
    raw = np.diff(log["q"], axis=0, prepend=log["q"][:1]) / step
    speed, share = np.zeros_like(raw), step / (DRIVE_S + step)
    for k in range(1, len(raw)):
        speed[k] = speed[k - 1] + share * (raw[k] - speed[k - 1])
    return log.put(_channel(world, "qd"), speed)


def _estimated(world: World, log: Log) -> Log:
    """With velocities as a state estimate has them: the slope of the position."""
    slope: Array = np.gradient(log["position"], log.t, axis=0)
    return log.put(_channel(world, "velocity"), slope)


def _channel(world: World, name: str) -> Channel:
    channels: Mapping[str, Channel] = {c.name: c for c in world.kind.channels(world.spec)}
    return channels[name]


def as_recorded(log: Log) -> Log:
    """Without the sentences of its first reading."""
    return replace(log, repairs=())
