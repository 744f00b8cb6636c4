"""A command that is no law of its tracking error: a joint under real controllers, told by what they add."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from etude.errors import DataError
from etude.types import Channel, Log
from etude_online import feedback_of

RATE, SUBSTEPS, WEIGHT, FRICTION = 100.0, 10, 8.0, 2.0
KP, KD = 250.0, 12.0
CHANNELS = {
    "q": Channel("q", ("hip",), ("rad",)),
    "q_des": Channel("q_des", ("hip",), ("rad",), "plan"),
    "command": Channel("command", ("hip",), ("N m",), "command", acts_on="q"),
}
LIMITS = np.array([-500.0]), np.array([500.0])


@cache
def driven(
    seed: int, ki: float = 0.0, clamp: float = np.inf, added: float = 0.0, seconds: float = 15.0
) -> Log:
    """A joint with weight and friction, integrated by small Euler steps, under kp e + kd de + ki * integral.

    Args:
        ki: 1/s, times kp. clamp: of the integral, rad s. added: what part of weight and friction the
            controller adds by itself.
    """
    rng = np.random.default_rng(seed)
    size, speed, phase = rng.uniform(0.2, 0.5, 3), rng.uniform(0.6, 2.0, 3), rng.uniform(0.0, 6.0, 3)
    t = np.arange(0.0, seconds, 1.0 / RATE)
    soft = np.minimum(t / 3.0, 1.0) ** 2
    wanted = soft * (size * np.sin(np.outer(t, speed) + phase)).sum(axis=1)
    rate = np.gradient(wanted, t)
    q, qd, total, rows = float(wanted[0]), 0.0, 0.0, []
    for goal, pace in zip(wanted, rate, strict=True):
        seen = q + 1e-5 * rng.normal()
        total = float(np.clip(total + (goal - seen) / RATE, -clamp, clamp))
        known = added * (WEIGHT * np.sin(q) + FRICTION * np.tanh(qd / 0.05))
        u = KP * (goal - seen) + KD * (pace - qd) + ki * KP * total + known
        rows.append((seen, goal, u + 0.05 * rng.normal()))
        for _ in range(SUBSTEPS):
            qd += (u - WEIGHT * np.sin(q) - FRICTION * np.tanh(qd / 0.05)) / RATE / SUBSTEPS
            q += qd / RATE / SUBSTEPS
    q_, wanted_, u_ = (np.array(column)[:, None] for column in zip(*rows, strict=True))
    return Log(t, CHANNELS, {"q": q_, "q_des": wanted_, "command": u_})


def put_wrong(log: Log, factor: float = 1.0, offset: float = 0.0) -> Log:
    return log.put(CHANNELS["command"], factor * log["command"] + offset)


def advice(*logs: Log) -> str:
    with pytest.raises(DataError, match="command of hip does not follow") as caught:
        feedback_of(logs, list(CHANNELS.values()), "q", LIMITS, RATE)
    return caught.value.next_step


def test_position_and_velocity_alone_are_a_law() -> None:
    law = feedback_of([driven(0), driven(1)], list(CHANNELS.values()), "q", LIMITS, RATE)
    assert law.kp[0] == pytest.approx(KP, rel=0.05)


@pytest.mark.parametrize(("ki", "clamp"), [(1.0, np.inf), (3.0, np.inf), (10.0, np.inf), (5.0, 0.01)])
def test_an_integral_is_told_with_its_gain(ki: float, clamp: float) -> None:
    """In two logs, in which it begins anew: nothing but the integral of each explains the command."""
    said = advice(driven(0, ki, clamp), driven(1, ki, clamp))
    assert said.startswith("Very probably the controller integrates")
    gain = float(said.split("gain ")[1].split()[0])
    assert gain == pytest.approx(ki * KP, rel=0.05)
    assert "sign" not in said


def test_what_is_no_integral_is_not_called_one() -> None:
    assert advice(put_wrong(driven(0), factor=-1.0)).startswith("Invert the sign")
    assert "holds a constant" in advice(put_wrong(driven(0), offset=60.0))


@pytest.mark.parametrize("log", [driven(0, added=1.0), put_wrong(driven(0, ki=3.0), factor=-1.0)])
def test_where_it_cannot_be_told_all_causes_are_named(log: Log) -> None:
    said = advice(log)
    assert said.startswith("Look at the sign and scale")
    assert "the controller integrates" in said
    assert "command_ff" in said
