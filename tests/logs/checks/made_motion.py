"""A motion of three joints with friction, inertia and gravity of known sizes, as a log."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Channel, Log

NAMES = ("hip", "knee", "toe")
RATE = 100.0
Q = Channel("q", NAMES, ("rad",) * 3, required=True)
QD = Channel("qd", NAMES, ("rad/s",) * 3, derivative_of="q")
COMMAND = Channel("command", NAMES, ("N m",) * 3, "command", required=True, acts_on="q")
CHANNELS = (Q, QD, COMMAND)
TOP = np.array([2.0, 2.0, 3.0])
LIMITS = {"qd": (-TOP, TOP)}
SPEED = 2.0 * np.pi / 10.0  # of the base frequency, rad/s
INERTIA, VISCOUS, DRY, GRAVITY = np.array(
    [[2.0, 1.0, 0.3], [3.0, 1.0, 0.5], [6.0, 4.0, 1.0], [30.0, 9.0, 2.0]]
)


def moved(seconds: float = 20.0, *, velocities: bool = True, seed: int = 0, pace: float = 1.0) -> Log:
    """Whole periods of sums of sines: a closed motion. pace: of its speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    q, qd, qdd = np.zeros((3, len(t), 3))
    for k in (1, 2, 3):
        phase, size = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.3, 0.6, 3) / k
        rate = k * SPEED * pace
        angle = rate * t[:, None] + phase
        q += size * np.sin(angle)
        qd += size * rate * np.cos(angle)
        qdd -= size * rate**2 * np.sin(angle)
    log = Log(t, {}, {}, "made").put(Q, q).put(COMMAND, command_of(q, qd, qdd))
    return log.put(QD, qd) if velocities else log


def command_of(q: Array, qd: Array, qdd: Array) -> Array:
    """Inertia, friction and gravity, joint by joint."""
    return np.asarray(INERTIA * qdd + VISCOUS * qd + DRY * np.tanh(qd / 0.05) + GRAVITY * np.sin(q))
