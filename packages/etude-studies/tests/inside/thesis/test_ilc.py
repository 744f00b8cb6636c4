"""Iterative learning control: what one motion teaches, without lag, and what it says of others: nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etude.errors import DataError, UsageError
from etude.protocols import Trajectory
from etude.types import Array, Channel, Log, Motion
from etude_studies.thesis.ilc import learned_command
from etude_studies.world import World

ARM = World.of("arm4", "thesis")


def logged(values: Array, lead_in: int = 0) -> Log:
    """A log at 100 Hz with this command (T,)."""
    t = (np.arange(len(values)) - lead_in) / 100.0
    channel = Channel("command", ("a",), ("pwm",), "command")
    return Log(t, {"command": channel}, {"command": values[:, None]})


def motion(seed: int) -> Trajectory:
    """A test motion of the thesis's form, 60 s."""
    return ARM.kind.tests(ARM.spec, ARM.config, np.random.default_rng(seed))["fourier"]


@pytest.mark.parametrize("hz", [0.25, 1.0, 2.0, 4.0])
def test_a_sine_is_made_smaller_and_not_late(hz: float) -> None:
    """The squared gain of a second-order Butterworth low-pass: half at the cutoff, and no phase anywhere."""
    t = np.arange(4000) / 100.0
    passed = learned_command(logged(np.sin(2.0 * math.pi * hz * t))).values[:, 0]
    middle = slice(1000, 3000)  # whole periods, far from the ends
    turn = np.exp(-2j * math.pi * hz * t[middle])
    phasor = 2j * np.mean(passed[middle] * turn)
    assert phasor.real == pytest.approx(1.0 / (1.0 + (hz / 2.0) ** 4), abs=2e-4)
    assert phasor.imag == pytest.approx(0.0, abs=2e-4)


def test_a_straight_line_is_learned_as_it_is_and_from_the_start_of_the_motion() -> None:
    values = 3.0 + 0.01 * np.arange(500.0)
    learned = learned_command(logged(values, lead_in=200))
    np.testing.assert_allclose(learned.t, np.arange(300) / 100.0)
    np.testing.assert_allclose(learned.values[:, 0], values[200:], atol=1e-9)
    planned = learned.planned(Motion(learned.t, np.zeros((3, 300, 1))))
    np.testing.assert_array_equal(planned, learned.values)
    np.testing.assert_array_equal(learned.command(1.004, {})[0], learned.values[100])


def test_repetitions_leave_a_small_part_of_the_error_and_replay_to_the_bit() -> None:
    def errors() -> list[float]:
        controller, found = None, []
        for k in range(5):
            log = ARM.robot.run(motion(0), controller, np.random.default_rng(k))
            found.append(float(ARM.robot.error(log)[0].mean()))
            controller = learned_command(log)
        return found

    found = errors()
    assert found[0] > found[1] > found[2] > found[3] > found[4]
    assert found[1] < 0.25 * found[0]
    assert found[4] < 0.05 * found[0]
    assert errors() == found


def test_on_another_motion_the_command_is_worth_nothing() -> None:
    """Learned on one motion it halves nothing on another of the same length: no model was found."""
    controller = None
    for k in range(3):
        controller = learned_command(ARM.robot.run(motion(0), controller, np.random.default_rng(k)))
    alone, played = (
        ARM.robot.error(ARM.robot.run(motion(7), c, np.random.default_rng(9)))[0].mean()
        for c in (None, controller)
    )
    assert played > 0.5 * alone


def test_a_motion_of_another_length_is_refused() -> None:
    learned = learned_command(logged(np.zeros(300)))
    with pytest.raises(UsageError, match=r"300 ticks over 2.99 s, this one has 200 over 1.99 s"):
        learned.planned(Motion(np.arange(200) / 100.0, np.zeros((3, 200, 1))))
    with pytest.raises(UsageError, match="one motion only"):
        learned.planned(Motion(np.arange(300) / 50.0, np.zeros((3, 300, 1))))


def test_what_teaches_nothing_is_refused() -> None:
    with pytest.raises(UsageError, match=r"cutoff of 0\.0 Hz"):
        learned_command(logged(np.zeros(300)), 0.0)
    with pytest.raises(DataError, match="command of a run"):
        learned_command(logged(np.zeros(300), lead_in=300))
    with pytest.raises(DataError, match="command of a run"):
        learned_command(logged(np.zeros(300)).without("command"))
