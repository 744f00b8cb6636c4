"""Faults in online learning: of the learner's inputs, and of the robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from etude.protocols import Controller
from etude.types import Array, Motion, Row

LENGTH_S = 40.0
"""Of a run."""
FIRST_S, LAST_S = 2.0, 10.0
"""When a fault begins."""
SHORTEST_S, LONGEST_S, PERMANENT = 2.0, 15.0, 0.25
"""How long it lasts, and the part of faults that never end."""
NEVER = np.inf
MEMORY = 64
"""Ticks that a wire may be late."""


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: a name in WIRES or PLANTS. onset, end: s of the run; end may be NEVER.
        part: of the channel. size: in [0, 1], as each kind takes it. seed: of its own random numbers.
    """

    kind: str
    onset: float
    end: float
    part: int
    size: float
    seed: int

    def acts(self, t: float) -> bool:
        """Whether it is there at time t, s."""
        return self.onset <= t < self.end

    @property
    def of_robot(self) -> bool:
        """Whether the robot itself is another one."""
        return self.kind in (*PLANTS, DRIVE)


def drawn(kind: str, parts: int, rng: np.random.Generator) -> Fault:
    """A fault of that kind: when, how long, of which part and how large."""
    onset = float(rng.uniform(FIRST_S, LAST_S))
    length = NEVER if rng.random() < PERMANENT else float(rng.uniform(SHORTEST_S, LONGEST_S))
    return Fault(
        kind, onset, onset + length, int(rng.integers(parts)), float(rng.random()), int(rng.integers(2**31))
    )


@dataclass(eq=False)
class FaultyWire:
    """A controller whose measurements pass a faulty wire (implements `protocols.Controller`).

    Attributes:
        own: what learns. fault: of the wire, or of the robot: then it passes all. path: channel of the path.
        limit: (J,) of the commands.
    """

    own: Controller
    fault: Fault
    path: str
    limit: Array
    past: deque[Row] = field(default_factory=lambda: deque(maxlen=MEMORY))
    held: Row | None = None

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.fault.seed)

    def planned(self, motion: Motion) -> Array | None:
        ahead = self.own.planned(motion)
        return (
            None
            if ahead is None
            else np.array([self._driven(t, u) for t, u in zip(motion.t, ahead, strict=True)])
        )

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        command, deviation = self.own.command(t, row)
        return self._driven(t, command), deviation

    def _driven(self, t: float, command: Array) -> Array:
        """What the drive makes of it, which nobody is told."""
        if self.fault.kind != DRIVE or not self.fault.acts(t):
            return command
        most = (0.05 + 0.25 * self.fault.size) * self.limit
        return np.clip(command, -most, most)

    def observe(self, t: float, row: Row) -> None:
        self.past.append(row)
        if self.fault.acts(t) and self.fault.kind in WIRES:
            self.held = row if self.held is None else self.held
            t, row = WIRES[self.fault.kind](self, t, row)
        self.own.observe(t, row)


def _with(row: Row, name: str, part: int, value: float) -> Row:
    values = np.array(row[name], dtype=float)
    values[part % len(values)] = value
    return {**row, name: values}


def _sign(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:  # noqa: ARG001
    """Of all commands."""
    return t, {**row, "command": -row["command"]}


def _sign_of_one(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    return t, _with(row, "command", wire.fault.part, -row["command"][wire.fault.part])


def _spikes(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    """One row in fifty: half to twenty times the limit, either way; one in a thousand beyond any range."""
    if wire.rng.random() > 0.02:
        return t, row
    part, sign = wire.fault.part, float(wire.rng.choice([-1.0, 1.0]))
    size = 1e200 if wire.rng.random() < 0.05 else wire.limit[part] * (0.5 + 20.0 * wire.fault.size**2)
    return t, _with(row, "command", part, sign * size)


def _spikes_of_path(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    """One row in fifty, up to half a unit."""
    if wire.rng.random() > 0.02:
        return t, row
    part = wire.fault.part % len(row[wire.path])
    off = (0.02 + 0.5 * wire.fault.size) * float(wire.rng.choice([-1.0, 1.0]))
    return t, _with(row, wire.path, part, row[wire.path][part] + off)


def _stuck(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    assert wire.held is not None
    return t, _with(row, "command", wire.fault.part, wire.held["command"][wire.fault.part])


def _stuck_path(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    assert wire.held is not None
    part = wire.fault.part % len(row[wire.path])
    return t, _with(row, wire.path, part, wire.held[wire.path][part])


def _late(wire: FaultyWire, name: str) -> Array:
    """That channel 30 to 500 ms ago."""
    ticks = 3 + round(47 * wire.fault.size)
    return np.asarray(wire.past[max(0, len(wire.past) - 1 - ticks)][name])


def _delay(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    return t, {**row, "command": _late(wire, "command")}


def _delay_of_path(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    return t, {**row, wire.path: _late(wire, wire.path)}


def _clock_back(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    return t - 10.0 ** (4.0 * wire.fault.size), row


def _clock_forward(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    return t + 10.0 ** (4.0 * wire.fault.size), row


def _clock_stuck(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:  # noqa: ARG001
    return wire.fault.onset, row


def _nan(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    """One row in two to twenty, in the command or in the path."""
    if wire.rng.random() > 0.05 + 0.45 * wire.fault.size:
        return t, row
    name = str(wire.rng.choice(["command", wire.path]))
    return t, _with(row, name, wire.fault.part, np.nan)


def _saturated(wire: FaultyWire, t: float, row: Row) -> tuple[float, Row]:
    """The reading stops at 5 to 40 % of the limit."""
    most = (0.05 + 0.35 * wire.fault.size) * wire.limit
    return t, {**row, "command": np.clip(row["command"], -most, most)}


WIRES: dict[str, Callable[[FaultyWire, float, Row], tuple[float, Row]]] = {
    "sign": _sign,
    "sign_of_one": _sign_of_one,
    "spikes": _spikes,
    "spikes_of_path": _spikes_of_path,
    "stuck": _stuck,
    "stuck_path": _stuck_path,
    "delay": _delay,
    "delay_of_path": _delay_of_path,
    "clock_back": _clock_back,
    "clock_forward": _clock_forward,
    "clock_stuck": _clock_stuck,
    "nan": _nan,
    "saturated_reading": _saturated,
}
"""Faults on the way from the robot to what learns; the robot's own feedback measures rightly."""
PLANTS: dict[str, tuple[str, float, float]] = {
    "payload": ("payload", 0.1, 0.5),
    "friction": ("friction", 1.1, 1.8),
}
"""Faults of the robot: what `Robot.changed` takes, least and largest."""
DRIVE = "saturated_drive"
"""The drive gives what is fed forward up to 5 to 30 % of the limit."""
KINDS = (*WIRES, *PLANTS, DRIVE)


def change(fault: Fault) -> dict[str, float]:
    """What the robot's fault is, as `Robot.changed` takes it."""
    name, least, most = PLANTS[fault.kind]
    return {name: least + fault.size * (most - least)}
