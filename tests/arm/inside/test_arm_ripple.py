"""What returns with a joint's position: found in hinges, kept in a stored model, absent where not asked."""

from __future__ import annotations

import numpy as np
import pytest
from test_arm_turning import FRICTION, INPUTS, SPEC, run, told

from etude.models import followed
from etude.types import Log, Samples
from etude_arm import ArmPhysics
from etude_arm.physics.identification import TURNED, since_reversal
from etude_arm.physics.mean import RigidBodyMean

HINGES = np.array([axis.unit == "rad" for axis in SPEC.axes])
SIZE = 0.02 * SPEC.command * HINGES
PHYSICS = ArmPhysics(SPEC, stick_fraction=0.03)


def cogging(log: Log) -> np.ndarray:
    return SIZE * np.sin(3.0 * log["q"] + 0.5 * np.arange(SPEC.dof))


def samples(log: Log) -> Samples:
    """Friction by speed, and cogging on top; no sample of a slow joint teaches."""
    friction = np.tanh(log["qd"] / (0.1 * PHYSICS.friction_velocity))
    return told(friction + cogging(log) / FRICTION, log)


@pytest.fixture(scope="module")
def learned() -> tuple[Samples, RigidBodyMean]:
    found = PHYSICS.rippled(samples(run(0)))
    assert found is not None
    taught, physics = found
    return taught, physics(taught)


def wanted(log: Log) -> np.ndarray:
    friction = np.tanh(log["qd"] / (0.1 * PHYSICS.friction_velocity))
    return ArmPhysics(SPEC, nominal=True)(None).predict(log) + FRICTION * friction + cogging(log)


def test_it_is_predicted_on_a_run_that_was_not_learned(learned) -> None:
    log = followed(INPUTS, run(2))
    steady = since_reversal(log.t, np.zeros(len(log), dtype=np.int64), log["qd"]) > TURNED
    errors = [
        (mean.predict(log) - wanted(log))[:, HINGES][steady[:, HINGES]]
        for mean in (learned[1], PHYSICS(samples(run(0))))
    ]
    assert np.std(errors[0]) < 0.25 * np.std(errors[1])


def test_slides_have_none(learned) -> None:
    assert learned[1].model.ripple[HINGES].any(axis=1).all()
    np.testing.assert_array_equal(learned[1].model.ripple[~HINGES], 0.0)


def test_slow_samples_tell_it_but_none_near_a_reversal(learned) -> None:
    given, (taught, mean) = samples(run(0)), learned
    near = since_reversal(given.t, given.group, given.log["qd"]) <= TURNED
    assert not (taught.moving & near).any()
    np.testing.assert_allclose(mean.model.friction_velocity, 0.1 * PHYSICS.friction_velocity)


def test_a_stored_model_keeps_it_and_one_without_it_names_none(learned) -> None:
    log = followed(INPUTS, run(3))
    again = PHYSICS.restore(learned[1].arrays())
    np.testing.assert_array_equal(again.predict(log), learned[1].predict(log))
    plain = PHYSICS(samples(run(0)))
    assert "rigid.ripple" not in plain.arrays()
    assert PHYSICS.restore(plain.arrays()).model.ripple is None


def test_the_file_alone_is_not_asked_for_it() -> None:
    assert ArmPhysics(SPEC, nominal=True).rippled(samples(run(0))) is None
