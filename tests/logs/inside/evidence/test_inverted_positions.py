"""Slides whose positions, or whose commands, are inverted: a weight that never varies shows which."""

from __future__ import annotations

import numpy as np
import pytest

from etude.logs import sign_decision
from etude.types import Array, Channel, Log

PATH = Channel("q", ("x", "z"), ("m", "m"), "measured")
COMMAND = Channel("command", ("x", "z"), ("N", "N"), "command", acts_on="q")
RATE, SECONDS, EARTH = 100.0, 25.0, 9.81
MASSES = np.array([12.0, 4.0])


class Gantry:
    """Forces of two slides with masses; z is positive downwards. Both carry an arm that couples them."""

    def predict(self, log: Log) -> Array:
        q, qdd = log["q"], log["qdd"]
        coupling = 0.3 * MASSES[1] * np.sin(3.0 * q[:, :1]) * qdd[:, ::-1]
        return np.asarray(MASSES * qdd - [0.0, EARTH * MASSES[1]] + coupling)

    def static(self, log: Log) -> Array:
        return np.tile([0.0, -EARTH * MASSES[1]], (len(log), 1))


def recorded(seed: int = 0) -> Log:
    """A right log, with Coulomb and viscous friction and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    phases, sizes = rng.uniform(0.0, 6.0, (4, 2)), rng.uniform(0.1, 0.2, (4, 2))
    w = 2.0 * np.pi * np.array([0.1, 0.2, 0.3, 0.5])[:, None, None]
    angles = w * t[None, :, None] + phases[:, None, :]
    q = (sizes[:, None, :] * np.sin(angles)).sum(axis=0)
    qd = (w * sizes[:, None, :] * np.cos(angles)).sum(axis=0)
    qdd = -(w**2 * sizes[:, None, :] * np.sin(angles)).sum(axis=0)
    states = Log(t, {"q": PATH}, {"q": q, "qdd": qdd}, "made")
    friction = [6.0, 3.0] * np.tanh(qd / 0.01) + [8.0, 5.0] * qd
    force = Gantry().predict(states) + friction + 0.1 * rng.standard_normal(q.shape)
    measured = q + 1e-5 * rng.standard_normal(q.shape)
    return Log(t, {"q": PATH, "command": COMMAND}, {"q": measured, "command": force}, "made")


@pytest.mark.parametrize("column", ["q", "command"])
def test_a_constant_weight_shows_which_is_inverted(column: str) -> None:
    log = recorded()
    wrong = log.put(log.channels[column], log[column] * [1.0, -1.0])
    decision = sign_decision([wrong], PATH, Gantry())
    assert (decision.check, decision.by) == ("sign", (1.0, -1.0))
    assert (decision.positions > 14.0) is (column == "q")
    assert (decision.positions < -14.0) is (column == "command")


def test_a_right_log_is_silent() -> None:
    assert sign_decision([recorded()], PATH, Gantry()).level == "silent"
