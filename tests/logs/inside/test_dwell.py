"""A joint that dwells at reversals moves on later than smooth positions say: its commands are not early."""

from __future__ import annotations

import numpy as np

from etude.logs import judge
from etude.logs.checks.plausibility import DELAY
from etude.types import Channel, Log

J, RATE, SECONDS = 3, 250.0, 25.0
INERTIA, GRAVITY = 0.02, 0.4
FRICTION, STICTION = 0.3, 0.1  # N m
CREEP, DIP = 0.008, 0.06  # rad/s: where friction turns over, and where stiction has fallen


def driven(seed: int, late: float) -> Log:
    """Joints under PD control at 1 kHz, logged as positions and torques that are `late` by so many s."""
    rng, dt = np.random.default_rng(seed), 1e-3
    t = np.arange(round(SECONDS / dt)) * dt
    paces, phases = rng.uniform(0.3, 1.6, (3, J)), rng.uniform(0.0, 6.0, (3, J))
    wanted = sum(0.4 / (k + 1) * np.sin(paces[k] * t[:, None] + phases[k]) for k in range(3))
    speeds = np.gradient(wanted, dt, axis=0)
    q, v, rows = wanted[0].copy(), np.zeros(J), []
    for reference, pace in zip(wanted, speeds, strict=True):
        torque = INERTIA * (30.0**2 * (reference - q) + 50.0 * (pace - v))
        dry = (FRICTION + STICTION * np.exp(-((v / DIP) ** 2))) * np.tanh(v / CREEP)
        secant = np.where(np.abs(v) < 1e-9, (FRICTION + STICTION) / CREEP, dry / np.where(v == 0.0, 1.0, v))
        v = (INERTIA * v + dt * (torque - GRAVITY * np.sin(q))) / (INERTIA + dt * secant)
        q = q + dt * v
        rows.append((q, torque))
    positions, torques = np.array(rows).transpose(1, 0, 2)
    torques += 0.005 * rng.standard_normal(torques.shape)
    at = np.arange(0.5, SECONDS - 0.5, 1.0 / RATE)
    told = [
        np.stack([np.interp(s, t, x) for x in own.T], axis=1)
        for s, own in ((at, positions), (at - late, torques))
    ]
    parts = tuple(f"j{i}" for i in range(J))
    log = Log(at, {}, {}, "made").put(Channel("q", parts, ("rad",) * J, required=True), told[0])
    return log.put(Channel("command", parts, ("N m",) * J, "command", required=True, acts_on="q"), told[1])


def test_commands_in_step_are_left() -> None:
    log = driven(1, 0.0)
    assert judge([log], log.channels["q"]).level == "silent"


def test_late_commands_are_shifted_by_what_they_are_late() -> None:
    log = driven(2, 0.048)
    found = judge([log], log.channels["q"])
    assert (found.level, found.check) == ("note", DELAY)
    assert abs(found.by[0] - 0.048) < 0.013
