"""A robot without hardware: joints that follow set-points with a lag, on a clock of its own.

`FakeRobot` is a Stream.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np

from etude.drivers import About, Control, Sample
from etude.types import Array


class FakeRobot:
    """Masses on springs: each joint is pulled to its set-point, and its command is what pulls.

    Args:
        joints: by name. rate: Hz. start: (J,) pose at the beginning.
        stiffness: of the feedback, 1/s^2, at a damping ratio of 1. feedforward: part of the accelerations
            that is fed forward.
        noise: rad, of measured positions. seed: of it.
        virtual: it moves on with each `send`; else it follows our clock.

    Attributes:
        q, qd: (J,) what is true. blocked: (J,) joints that do not move. push: (J,) accelerations from
            outside.
        sent: positions of all set-points. truth: rows of t, q, qd (1 + 2 J,), one after each.
        stopped: calls of stop.
    """

    def __init__(
        self,
        joints: Sequence[str] = ("base", "elbow"),
        rate: float = 250.0,
        start: Array | None = None,
        stiffness: float = 900.0,
        feedforward: float = 0.9,
        noise: float = 2e-5,
        seed: int = 0,
        virtual: bool = True,
    ) -> None:
        self.joints, self.rate, self.virtual = tuple(joints), rate, virtual
        self.stiffness, self.feedforward, self.noise = stiffness, feedforward, noise
        self.q = np.zeros(len(joints)) if start is None else np.array(start, dtype=float)
        self.qd, self.command = np.zeros_like(self.q), np.zeros_like(self.q)
        self.blocked = np.zeros(len(self.q), dtype=bool)
        self.push = np.zeros_like(self.q)
        self.t = 0.0
        self.stopped = 0
        self.follows = False
        self.sent: list[Array] = []
        self.truth: list[Array] = []
        self._stall = 0.0
        self._rng = np.random.default_rng(seed)
        self._asked = self.q.copy()
        self._measured = self.q.copy()

    def about(self) -> About:
        return About(
            name="fake robot",
            identity="fake-1",
            joints=self.joints,
            rate=self.rate,
            command_unit="N m",
            command_of="applied",
            gravity_in_command=True,
            controls=("feedback", "learned"),
            can_hold=True,
            on_loss="holds",
            silence=0.1,
            real=False,
            virtual=self.virtual,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.stop()

    def state(self) -> Sample:
        if not (self.virtual or self.follows):  # it stands, and its clock goes on
            self.t = time.monotonic()
        return Sample(self.t, self._measured.copy(), self.command.copy(), self.qd.copy())

    def ready(self, control: Control) -> None:  # noqa: ARG002
        self.follows, self._asked = True, self.q.copy()

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.sent.append(np.array(q))
        added = self.feedforward * qdd if effort is None else effort
        self._step(self._cycle(), q, qd, added)
        self._stall = 0.0

    def stop(self, kill: bool = False) -> None:  # noqa: ARG002
        self.stopped += 1
        self.follows = False
        self.qd[:] = 0.0

    def stall(self, seconds: float) -> None:
        """The next cycle takes longer."""
        self._stall = seconds

    def _step(self, dt: float, q: Array, qd: Array, added: Array, parts: int = 4) -> None:
        damping = 2.0 * np.sqrt(self.stiffness)
        parts = max(parts, round(dt * self.rate * parts))
        # set-points are steps, and the command within a cycle a sawtooth: its mean moves the masses
        self.command = np.zeros_like(self.q)
        for _ in range(parts):
            command = self.stiffness * (q - self.q) + damping * (qd - self.qd) + added
            self.command += command / parts
            self.qd += dt / parts * (command + self.push)
            self.qd[self.blocked] = 0.0
            self.q += dt / parts * self.qd
        self.t += dt
        self._asked = np.array(q)
        self.truth.append(np.concatenate([[self.t], self.q, self.qd]))
        self._measured = self.q + self.noise * self._rng.standard_normal(len(self.q))

    def _cycle(self) -> float:
        """s of this one; in real time it waits until it is over."""
        if self.virtual:
            return max(1.0 / self.rate, self._stall)
        left = self.t + 1.0 / self.rate - time.monotonic()
        time.sleep(max(left, 0.0))
        return time.monotonic() - self.t
