"""play.py as it is exported, its messages in PX4's cascade and the vehicle's state back: arming to landing.

PX4 here arms and changes the mode when the pilot says so, takes offboard mode only while set-points come, and
leaves it when none has come for a second (COM_OF_LOSS_T); its position mode holds the vehicle before.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights import AFTER, Array, Planned, planned, vehicle, wrong
from px4_cascade import Body, Vehicles

from etude_quadrotor import NED
from ros_stubs import Record, Ros, installed, loaded

MANUAL, OFFBOARD, DISARMED, ARMED = 2, 14, 1, 2
ARMS, SWITCHES = 6.0, 10.0
"""s after the player was started at which the pilot does so."""
LOST = 1.0
TICK = 0.02


@dataclass(eq=False)
class Autopilot:
    """PX4 behind its bridge: what it publishes and what it hears, at the player's rate.

    Attributes:
        off: (3,) m, where it hovers beside the first set-point. version: of the messages; None: 1.14.
        takes_over: s after offboard mode began; the pilot then flies. Nothing: the test ends it.
    """

    ros: Ros
    own: Planned
    body: Body = field(default_factory=Body)
    off: tuple[float, float, float] = (0.0, 0.0, 0.0)
    version: int | None = None
    takes_over: float = np.inf

    def __post_init__(self) -> None:
        first = self.own.rows[:1, :3] + np.array(self.off)
        floor = np.array([-self.own.spec.floor if self.own.ground else np.nan])
        self.plant = Vehicles(first, floor, body=self.body)
        self.hold = np.concatenate([first, np.zeros((1, 6))], axis=1)
        self.offboard, self.begun, self.failed = False, None, False
        self.read, self.rows = 0, []
        self.seen: list[tuple[float, Array, Array, Array]] = []
        suffix = "" if not self.version else f"_v{self.version}"
        self.topics = [f"/fmu/out/vehicle_{name}{suffix}" for name in ("local_position", "status")]

    def __call__(self, ros: Ros) -> bool:
        """A tick: what was heard is flown, and the state is told. False once all is over."""
        t = ros.now * 1e-9
        self._hear(t)
        self._mode(t)
        row = self.rows[-1][1] if self.offboard and self.rows else self.hold
        for _ in range(round(TICK / self.plant.dt)):
            self.seen.append((t, self.plant.position[0], row[0, :3], self.plant.velocity[0]))
            t += self.plant.dt
            self.plant.step(row)
        place, speed = self.plant.position[0], self.plant.velocity[0]
        state = dict(zip(("x", "y", "z", "vx", "vy", "vz"), [*place, *speed], strict=True))
        self._tell(self.topics[0], Record(**state, xy_valid=True, z_valid=True))
        mode, armed = OFFBOARD if self.offboard else MANUAL, ARMED if t > ARMS else DISARMED
        self._tell(self.topics[1], Record(nav_state=mode, arming_state=armed))
        end = len(self.own.rows) / 50.0 + AFTER
        return self.begun is None or t - self.begun < min(end, self.takes_over + AFTER)

    def _tell(self, topic: str, message: Any) -> None:
        if topic in self.ros.callbacks:
            self.ros.callbacks[topic](message)

    def _hear(self, t: float) -> None:
        for topic, message in self.ros.sent[self.read :]:
            if topic == "/fmu/in/trajectory_setpoint":
                values = [*message.position, *message.velocity, *message.acceleration]
                self.rows.append((t, np.array([values], dtype=float)))
        self.read = len(self.ros.sent)

    def _mode(self, t: float) -> None:
        comes = bool(self.rows) and t - self.rows[-1][0] < LOST
        if self.begun is None and t > SWITCHES and comes:
            self.offboard, self.begun = True, t
        over = self.begun is not None and t - self.begun > self.takes_over
        if self.offboard and (over or not comes):
            self.failed = not over
            self.offboard = False
            self.hold = np.concatenate([self.plant.position, np.zeros((1, 6))], axis=1)

    def wrong(self) -> list[str]:
        """Sentences about limits and margins, from when the player was started to the end."""
        assert self.begun is not None
        t, place, plan, velocity = (np.array(part) for part in zip(*self.seen, strict=True))
        return wrong(self.own, t - self.begun, place @ NED.T, plan @ NED.T, velocity)


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Ros:
    return installed(monkeypatch)


def played(ros: Ros, folder: Path, own: Planned, monkeypatch: pytest.MonkeyPatch, **how: Any) -> Any:
    """The exit code of the exported program, and PX4."""
    folder.mkdir()
    for name, data in own.files.items():
        (folder / name).write_bytes(data)
    pilot = Autopilot(ros, own, **how)
    if pilot.version is not None:
        messages = sys.modules["px4_msgs.msg"]
        for kind in ("VehicleStatus", "VehicleLocalPosition"):
            made = type(kind, (getattr(messages, kind),), {"MESSAGE_VERSION": pilot.version})
            monkeypatch.setattr(messages, kind, made)
    ros.script = pilot
    return loaded(folder / "play.py").main([]), pilot


@pytest.mark.parametrize(
    ("seed", "ground", "how"),
    [
        (1, True, {"version": 1}),
        pytest.param(3, True, {"body": Body(hover=0.53, drag=0.2)}, marks=pytest.mark.slow),
        pytest.param(2, False, {"off": (0.12, -0.12, 0.08)}, marks=pytest.mark.slow),
    ],
    ids=["from the ground", "heavier than it thinks", "it hovers beside the start"],
)
def test_from_arming_to_the_end(
    seed: int, ground: bool, how: Any, ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = planned(vehicle(seed), seed, ground=ground)
    code, pilot = played(ros, tmp_path / "px4", own, monkeypatch, **how)
    assert code == 0
    assert not pilot.failed
    assert pilot.wrong() == []
    sent = np.concatenate([row for _, row in pilot.rows])
    first = [int((table != table[0]).any(axis=1).argmax()) for table in (sent, own.rows)]
    sent = sent[first[0] - first[1] :]
    np.testing.assert_array_equal(sent[: len(own.rows)], own.rows)
    assert len(sent) > len(own.rows) + 9.0 * 50.0
    assert (sent[len(own.rows) :] == own.rows[-1]).all(), "the last row is held"
    assert np.abs(pilot.plant.velocity).max() < 0.01


def test_the_pilot_takes_over_in_the_middle(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = planned(vehicle(1), 1, ground=True)
    code, pilot = played(ros, tmp_path / "px4", own, monkeypatch, takes_over=9.0)
    assert code == 1
    assert "the pilot has the vehicle" in capsys.readouterr().err
    assert not pilot.failed
    assert ros.now * 1e-9 - pilot.begun < 9.1
