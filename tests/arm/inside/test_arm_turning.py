"""Friction that turns round over a way: chosen where samples say so, remembered along runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude import plugins
from etude.campaign import states_for
from etude.models import followed
from etude.types import Log, Motion, Samples
from etude_arm import ArmInputs, ArmPhysics
from etude_arm.memory import remembered, turning
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.rigid_body import EXTRA_TERMS, NARROW
from etude_arm.physics.transmission import Drive
from etude_arm.spec import PRESLIDING_DISTANCES, TURNING
from etude_online import Planned

ARM = plugins.load("etude.robots", "arm")
SPEC = ARM.spec(ARM.built_in()["mobile_arm"])  # every drive is a joint's own
RATE, COUNT = 100.0, 3000
INPUTS = ArmInputs.of(SPEC, 0.02, physics=True)
FRICTION = 0.1 * SPEC.command


def run(seed: int) -> Log:
    """Slow swings to and fro, sampled as a log is."""
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / RATE
    pace = rng.uniform(0.5, 0.9, SPEC.dof)
    size = np.minimum(0.4 * (SPEC.upper - SPEC.lower), 0.3 * SPEC.velocity / pace)
    angle = pace * t[:, None] + rng.uniform(0.0, 6.0, SPEC.dof)
    middle = 0.5 * (SPEC.upper + SPEC.lower)
    q, qd, qdd = middle + size * np.sin(angle), size * pace * np.cos(angle), -size * pace**2 * np.sin(angle)
    channels = {c.name: c for c in SPEC.channels()}
    values = {"q": q, "qd": qd, "qdd": qdd}
    return Log(t, {name: channels[name] for name in values}, values)


def told(friction: np.ndarray, log: Log) -> Samples:
    """Samples of the model file's masses and that friction (T, J), every fifth row of the log."""
    masses = ArmPhysics(SPEC, nominal=True)(None).predict(log)
    rng = np.random.default_rng(5)
    command = masses + FRICTION * friction + 1e-3 * SPEC.command * rng.normal(size=masses.shape)
    whole = followed(INPUTS, log).put({c.name: c for c in SPEC.channels()}["command"], command)
    moving = np.abs(log["qd"]) > 0.05 * np.abs(log["qd"]).max(axis=0)
    every = np.ones_like(moving)
    return Samples(whole, np.zeros(len(log), dtype=np.int64), every, moving).take(np.arange(20, COUNT, 5))


def over(way: float, q: np.ndarray) -> np.ndarray:
    return remembered(q, np.zeros(SPEC.dof), SPEC.presliding(way))[:, 0]


@pytest.fixture(scope="module")
def learned() -> tuple[RigidBodyMean, Log]:
    log = run(0)
    return ArmPhysics(SPEC)(told(over(0.004, log["q"]), log)), log


def test_the_way_that_made_the_samples_is_found(learned) -> None:
    np.testing.assert_array_equal(learned[0].model.way, 0.004)
    found = learned[0].model.extra[:, NARROW]
    np.testing.assert_allclose(np.abs(found), FRICTION, rtol=0.1)


def test_friction_that_turns_round_at_once_is_found() -> None:
    log = run(6)
    mean = ArmPhysics(SPEC)(told(np.sign(log["qd"]), log))
    hinges = np.array([axis.unit == "rad" for axis in SPEC.axes])  # slides pass both .01 and .05 mm in a step
    np.testing.assert_array_equal(mean.model.way[hinges], PRESLIDING_DISTANCES[0])


def test_friction_lets_go_at_rest(learned) -> None:
    """A joint whose friction vanishes at rest would creep while its command holds what it remembers."""
    mean, _ = learned
    there = 0.2 * np.sin(np.minimum(np.arange(300) / 100.0, np.pi / 2))[:, None] * np.ones(SPEC.dof)
    speed = np.gradient(there, 0.01, axis=0)
    path = 0.5 * (SPEC.upper + SPEC.lower) + there
    ended = INPUTS.states(Motion(np.arange(300) / 100.0, np.stack([path, speed, 0.0 * speed])))
    pushed = mean.predict(ended) - mean.static(ended)
    assert np.all(np.abs(pushed[100]) > 0.9 * FRICTION)
    np.testing.assert_allclose(pushed[-1], 0.0, atol=1e-9 * SPEC.command.max())


def test_friction_that_turns_over_with_speed_is_left_there() -> None:
    log = run(1)
    v0 = ArmPhysics(SPEC).friction_velocity
    model = ArmPhysics(SPEC)(told(np.tanh(log["qd"] / v0), log)).model
    np.testing.assert_array_equal(model.way, 0.0)


def test_a_run_that_was_not_learned_is_predicted_through_its_reversals(learned) -> None:
    log = run(2)
    mean, friction = learned[0], over(0.004, log["q"])
    wanted = ArmPhysics(SPEC, nominal=True)(None).predict(log) + FRICTION * friction
    turns = (np.abs(friction) < 0.9) & (np.arange(COUNT) > 50)[:, None]
    left = [np.abs(mean.predict(each) - wanted)[turns] for each in (followed(INPUTS, log), log)]
    limit = np.broadcast_to(SPEC.command, turns.shape)[turns]
    assert np.mean(left[0] / limit) < 0.1 * np.mean(left[1] / limit)


def test_rows_alone_turn_over_with_speed(learned) -> None:
    mean, log = learned
    alone = replace(mean, model=replace(mean.model, way=np.zeros(SPEC.dof)))
    np.testing.assert_array_equal(mean.predict(log), alone.predict(followed(INPUTS, log)))


def test_perfect_runs_remember_and_single_instants_do_not() -> None:
    log = run(3)
    motion = Motion(log.t, np.stack([log["q"], log["qd"], log["qdd"]]))
    states = INPUTS.states(motion)
    np.testing.assert_array_equal(states[TURNING], followed(INPUTS, log)[TURNING])
    first = Motion(motion.t[:1], motion.orders[:, :1])
    assert TURNING not in INPUTS.states(first)
    assert TURNING not in ArmInputs.of(SPEC, 0.02).states(motion)


def test_a_table_of_a_motion_is_predicted_as_one(learned) -> None:
    """Rows of a file follow one another, whatever reads it."""
    model: Any = SimpleNamespace(columns=INPUTS.columns, inputs=INPUTS)
    campaign: Any = None  # the states are all there
    np.testing.assert_array_equal(
        learned[0].predict(states_for(campaign, model, learned[1])),
        learned[0].predict(followed(INPUTS, learned[1])),
    )
    assert TURNING in states_for(campaign, model, learned[1])


def test_instants_one_after_another_are_commanded_as_their_plan_at_once(learned) -> None:
    """Learning on line may be given rows alone; what it carries from one to the next is a run's memory."""
    mean, log = learned[0], run(7).take(slice(0, 400))
    model: Any = SimpleNamespace(columns=INPUTS.columns, inputs=INPUTS, mean=mean.predict)
    wanted = mean.predict(followed(INPUTS, log))
    channels = {c.name: c for c in SPEC.channels()}
    planned = Planned(model, channels, None, (), RATE)
    rows = [{name: values[i] for name, values in log.values.items()} for i in range(len(log))]
    found = [planned.instant(float(t), row)[2] for t, row in zip(log.t, rows, strict=True)]
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * SPEC.command.max())
    assert np.abs(wanted - mean.predict(log)).max() > 0.05 * FRICTION.max()


def test_each_way_is_a_memory_of_its_own_and_noise_hides_half_of_one_at_most() -> None:
    q = np.cumsum(np.random.default_rng(4).normal(size=(300, 2)), axis=0) * 1e-3
    approaches, play = np.array([[0.001, 0.002], [0.004, 0.008]]), np.array([0.0008, 0.0008])
    found = turning(q, play, approaches).reshape(300, 2, 2)
    for number, way in enumerate(approaches):
        alone = remembered(q, np.minimum(play, 0.5 * way), way)[:, 0]
        np.testing.assert_allclose(found[:, number], alone, atol=1e-14)


def test_a_model_that_was_stored_before_knows_no_way(learned) -> None:
    mean, log = learned
    older = {name: array for name, array in mean.arrays().items() if name != "rigid.way"}
    again = ArmPhysics(SPEC).restore(older)
    np.testing.assert_array_equal(again.model.way, 0.0)
    np.testing.assert_array_equal(again.predict(followed(INPUTS, log)), mean.predict(log))


def test_a_drive_turns_the_joint_or_against_it_or_is_not_its_own() -> None:
    none, points = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    assert Drive(3.0, np.array([0.0, -1.0]), none, points).side(1) == -1.0
    assert Drive(-3.0, np.array([0.0, -1.0]), none, points).side(1) == 1.0
    assert Drive(3.0, np.array([0.5, 1.0]), none, points).side(1) == 0.0
    assert Drive(3.0, np.array([1.0, 0.0]), none, points).side(1) == 0.0
    assert Drive(1.0, np.array([0.0, 1.0]), np.array([0, 1]), np.zeros((2, 3))).side(1) == 0.0


def test_a_drive_against_its_joint_has_friction_against_it_too(learned) -> None:
    """The column of a way stands for tanh of the drive's own speed, so its sign is the drive's."""
    mean, log = learned
    model = mean.model
    backward = tuple(replace(drive, gear=-drive.gear) for drive in model.drives)
    extra = model.extra.copy()
    extra[:, :NARROW] = extra[:, NARROW + 1 :] = 0.0
    only = replace(model, inertial=0.0 * model.inertial, extra=extra)
    states = followed(INPUTS, log)[TURNING].reshape(COUNT, len(PRESLIDING_DISTANCES), -1)
    motion = log["q"], log["qd"], log["qdd"]
    forth, back = only.predict(*motion, states), replace(only, drives=backward).predict(*motion, states)
    np.testing.assert_allclose(back, -forth)
    assert EXTRA_TERMS[NARROW] == "friction 1 v0"
    assert (np.sign(forth) == np.sign(only.predict(*motion)))[
        np.abs(log["qd"]) > 0.2 * SPEC.velocity
    ].mean() > 0.99
