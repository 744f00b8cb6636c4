"""The driver `mujoco`: any URDF or MJCF as a robot, in real time or on a clock of its own.

In real time it runs in a process of its own: when Étude stalls or dies the robot goes on, comes to rest and
holds, as a real one would.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from etude.drivers import About, Control, Sample
from etude.errors import EtudeError, UsageError
from etude.types import Array
from etude_drivers.machine import LONGEST_BRAKING, Machine, MachineSettings

OPTIONS = ("virtual", "view")
"""Words after a comma of the address."""
SILENCE = 0.3
"""s"""
QUEUED = 8
"""Samples that wait while a cycle of ours is late."""
STARTS = 30.0
"""s in which the process has to come up."""
SHOWN = 1 / 30
"""s between two pictures."""


def driver(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> MujocoRobot:
    """`--on mujoco:MODEL`, `mujoco:MODEL,virtual`, `mujoco:MODEL,view`; [driver] has `MachineSettings`."""
    parts = [word for word in address.split(",") if word]
    table = dict(settings)
    for word in parts:
        table.update({word: True} if word in OPTIONS else {"model": word})
    made = MachineSettings.of(table)
    if made.view and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("there is no display to show the robot on", next_step="Leave view out.")
    if made.view and made.virtual:
        raise UsageError("a robot with a virtual clock is not shown", next_step="Remove view or virtual.")
    return MujocoRobot(joints, made)


class MujocoRobot:
    """A Stream over a `Machine`."""

    def __init__(self, joints: Sequence[str], settings: MachineSettings) -> None:
        self.joints, self.settings = tuple(joints), settings
        self._machine = Machine(joints, settings)  # a wrong model raises here, before anything starts
        self._link: _Link | None = None
        self._stopped = False

    def place(self, pose: Mapping[str, float]) -> None:
        """Begins at that pose, rad or m by joint, unless [driver] has a `start`."""
        if self.settings.start is None:
            self.settings = replace(self.settings, start=dict(pose))
            self._machine.place(pose)

    def about(self) -> About:
        settings, (low, high) = self.settings, self._machine.limits
        return About(
            name=f"MuJoCo, {os.path.basename(settings.model)}",
            identity=f"mujoco {os.path.abspath(settings.model)}",
            joints=self.joints,
            rate=settings.rate,
            command_unit="N m",
            command_of="applied",
            gravity_in_command=not settings.adds_gravity,
            controls=("feedback", "learned"),
            lower=low,
            upper=high,
            command=self._machine.effort_limit,
            can_hold=True,
            on_loss="stops",
            stopping_time=LONGEST_BRAKING,
            silence=SILENCE,
            real=False,
            virtual=settings.virtual,
        )

    def __enter__(self) -> Self:
        if self.settings.virtual:
            self._machine.settle()
        else:
            self._link = _Link(self.joints, self.settings)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stop()
        if self._link is not None:
            self._link.close()
            self._link = None

    @property
    def process(self) -> subprocess.Popen[bytes] | None:
        """Of the robot, while it is connected and in real time."""
        return None if self._link is None else self._link.process

    def state(self) -> Sample:
        if self._link is not None:
            return self._link.newest(SILENCE)
        if self._stopped:
            self._machine.rest()
        return _sample(_state(self._machine), len(self.joints))

    def ready(self, control: Control) -> None:
        if self._link is not None:
            self._link.send(b"R")
        self._stopped = False
        self._machine.ready()

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        if self._link is not None:
            self._link.send(
                b"G" + np.concatenate([q, qd, qdd, 0.0 * q if effort is None else effort]).tobytes()
            )
            return
        self._machine.ask(q, qd, qdd, effort)
        self._machine.cycle()

    def stop(self, kill: bool = False) -> None:
        if self._link is not None:
            self._link.send(b"K" if kill else b"S")
        elif self.settings.virtual:
            self._machine.stop(kill)
            self._stopped = True  # its time goes on when somebody looks, in the thread of the loop


class _Link:
    """The process of the robot, and the socket to it."""

    def __init__(self, joints: Sequence[str], settings: MachineSettings) -> None:
        self.joints = joints
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-P", "-m", "etude_drivers.mujoco", str(theirs.fileno())]
        self.process = subprocess.Popen(
            command, pass_fds=[theirs.fileno()], start_new_session=True, stdin=subprocess.PIPE
        )
        theirs.close()
        assert self.process.stdin is not None
        self.process.stdin.write(repr((tuple(joints), asdict(settings))).encode())
        self.process.stdin.close()
        self._sample: Sample | None = None
        self.newest(STARTS)

    def newest(self, wait: float) -> Sample:
        """The newest sample: what has come in, else the next one; after `wait` s the last one again."""
        data, count = None, 0
        while (later := self._received(0.0)) is not None:
            data, count = later, count + 1
        # nobody listened for long: the socket was full of old ones, and what came later is lost
        if data is None or count > QUEUED:
            data = self._received(wait) or data
        if data is not None:
            self._sample = _sample(np.frombuffer(data), len(self.joints))
        if self._sample is None:
            self.close()
            raise EtudeError(
                "the process of the robot sends no data",
                where="driver mujoco",
                next_step="Its message is above.",
            )
        return self._sample

    def _received(self, wait: float) -> bytes | None:
        """One message; None: nothing came in `wait` s."""
        self.socket.settimeout(wait)
        try:
            return self.socket.recv(1 << 16) or None
        except (TimeoutError, BlockingIOError, ConnectionError):
            return None

    def send(self, data: bytes) -> None:
        """Without a receiver it is lost; `newest` reports that."""
        with contextlib.suppress(OSError):
            self.socket.send(data, socket.MSG_DONTWAIT)

    def close(self) -> None:
        """The process comes to rest and ends."""
        self.socket.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()


def _state(machine: Machine) -> Array:
    """t, q, qd, command, asked in one (1 + 4 J,)."""
    return np.concatenate([[machine.t], machine.q, machine.qd, machine.command, machine.asked])


def _sample(row: Array, joints: int) -> Sample:
    q, qd, command, reference = row[1:].reshape(4, joints)
    return Sample(float(row[0]), q, command, qd, reference)


def serve(joints: Sequence[str], settings: MachineSettings, link: socket.socket) -> None:
    """The robot's own process: a cycle in each period, until nobody is on the other end and it rests."""
    machine = Machine(joints, settings)
    machine.settle()
    link.setblocking(False)
    show, shown = _viewer(machine) if settings.view else None, 0.0
    due, listens = time.monotonic(), True
    while listens or np.abs(machine.qd).max() > 1e-2:
        listens = listens and _process_commands(machine, link)
        machine.cycle()
        try:
            link.send(_state(machine).tobytes())
        except BlockingIOError:
            pass  # it stalls; the newest sample counts, and that comes later
        except OSError:
            listens = False
        if show is not None and machine.t - shown > SHOWN:
            show.sync()
            shown = machine.t
        due = max(due + machine.period, time.monotonic() - 0.1)
        time.sleep(max(due - time.monotonic(), 0.0))


def _process_commands(machine: Machine, link: socket.socket) -> bool:
    """What has come in since the last cycle. False: the other end is gone, and the robot comes to rest."""
    while True:
        try:
            data = link.recv(1 << 16)
        except BlockingIOError:
            return True
        except OSError:
            data = b""
        if data[:1] == b"G":
            machine.ask(*np.frombuffer(data, offset=1).reshape(4, -1))
        elif data[:1] == b"R":
            machine.ready()
        else:
            machine.stop(kill=data[:1] == b"K")
        if not data:
            return False


def _viewer(machine: Machine) -> Any:
    import mujoco.viewer

    return mujoco.viewer.launch_passive(machine.model, machine.data)


if __name__ == "__main__":
    import ast

    names, table = ast.literal_eval(sys.stdin.read())
    serve(names, replace(MachineSettings(), **table), socket.socket(fileno=int(sys.argv[1])))
