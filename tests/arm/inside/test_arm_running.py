"""A run in pieces is the whole run; a robot that changes on its way is another one from then on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from arm_examples import MIDDLE, Sines, simulated

from etude.errors import UsageError
from etude_arm.plant import compiled
from etude_arm.plant.compiled import RunningArm
from etude_arm.plant.feedback_loop import control_times
from etude_arm.plant.parameters import load_parameters
from etude_arm.plant.robot import with_friction, with_payload
from etude_arm.plant.trace import LoopInputs, Trace

FIELDS = ("q", "q_true", "tau", "tau_fb")


def loop_inputs(seconds: float = 6.0, seed: int = 0) -> LoopInputs:
    rng = np.random.default_rng(seed)
    q, qd, _ = Sines(seconds).motion(control_times(seconds, 100.0)).orders
    noise = rng.normal(0.0, 3e-4, q.shape)
    return LoopInputs(q, qd, rng.uniform(-80.0, 80.0, q.shape), noise, 10)


def part(inputs: LoopInputs, rows: slice) -> LoopInputs:
    arrays = (inputs.q_des, inputs.qd_des, inputs.tau_ff, inputs.noise)
    return LoopInputs(*(a[rows] for a in arrays), inputs.substeps)


def in_pieces(running: RunningArm, inputs: LoopInputs, edges: list[int]) -> list[Trace]:
    return [running.advance(part(inputs, slice(a, b))) for a, b in itertools.pairwise(edges)]


def joined(traces: list[Trace], field: str) -> np.ndarray:
    return np.concatenate([getattr(trace, field) for trace in traces])


@pytest.mark.parametrize("name", ["arm4", "arm4_rough"])
@pytest.mark.parametrize("edges", [[0, 1, 2, 3, 50, 600], list(range(601)), [0, 600]])
def test_a_run_in_pieces_is_the_whole_run_to_the_bit(name: str, edges: list[int]) -> None:
    arm, inputs = load_parameters(name), loop_inputs()
    whole = compiled.simulate(arm, inputs)
    pieces = in_pieces(RunningArm(arm, inputs.q_des[0]), inputs, edges)
    for field in FIELDS:
        np.testing.assert_array_equal(joined(pieces, field), getattr(whole, field))


def test_parameters_swapped_for_themselves_change_nothing_and_others_only_what_follows() -> None:
    arm, inputs = load_parameters("arm4"), loop_inputs()
    whole = compiled.simulate(arm, inputs)
    runs = {}
    for name, changed in (("same", arm), ("loaded", with_payload(arm, 1.0))):
        running = RunningArm(arm, inputs.q_des[0])
        first = in_pieces(running, inputs, [0, 300])
        running.change(changed)
        runs[name] = joined(first + in_pieces(running, inputs, [300, 600]), "q_true")
    np.testing.assert_array_equal(runs["same"], whole.q_true)
    np.testing.assert_array_equal(runs["loaded"][:301], whole.q_true[:301])
    assert np.abs(runs["loaded"][310:] - whole.q_true[310:]).max() > 1e-4


def test_the_run_does_not_touch_the_angles_it_was_started_from() -> None:
    start = MIDDLE.copy()
    inputs = loop_inputs()
    RunningArm(load_parameters("arm4"), start).advance(inputs)
    np.testing.assert_array_equal(start, MIDDLE)


def test_a_robot_that_changes_on_its_way_is_as_before_until_then() -> None:
    heavier = {1.0: simulated().changed(payload=1.0)}
    with pytest.raises(UsageError, match='Use "compiled"'):
        simulated("arm4", "mujoco").run(Sines(2.0), None, None, heavier)
    before, after = (simulated().run(Sines(2.0), None, None, changes) for changes in (None, heavier))
    until = before.t <= 1.0
    np.testing.assert_array_equal(before["q_true"][until], after["q_true"][until])
    assert np.abs(before["q_true"] - after["q_true"]).max() > 1e-4


def test_a_payload_weighs_and_turns_as_two_bodies_would() -> None:
    """Mass, static moment and inertia about the last joint are those of hand and point mass together."""
    arm = load_parameters("arm4")
    hand, loaded = arm.links[-1], with_payload(arm, 0.7).links[-1]
    assert loaded.mass == pytest.approx(hand.mass + 0.7)
    assert loaded.mass * loaded.center == pytest.approx(hand.mass * hand.center + 0.7 * hand.length)
    about_joint = [link.inertia_across + link.mass * link.center**2 for link in (hand, loaded)]
    assert about_joint[1] - about_joint[0] == pytest.approx(0.7 * hand.length**2)
    assert with_payload(arm, 0.0).links[-1].inertia_across == pytest.approx(hand.inertia_across)
    q = np.tile(MIDDLE, (1, 1))
    still = [compiled.inverse(a, q, 0 * q, 0 * q) for a in (arm, with_payload(arm, 0.7))]
    assert (np.abs(still[1] - still[0])[0, 1:] > 1.0).all()
    assert still[1][0, 0] == pytest.approx(still[0][0, 0])  # the waist turns about the vertical


def test_friction_grows_in_every_motor_and_nothing_else_changes() -> None:
    arm = load_parameters("arm4")
    changed = with_friction(arm, 1.5)
    for before, after in zip(arm.motors, changed.motors, strict=True):
        assert (after.coulomb, after.static, after.viscous) == pytest.approx(
            (1.5 * before.coulomb, 1.5 * before.static, 1.5 * before.viscous)
        )
        assert (after.stall, after.stribeck, after.armature) == (
            before.stall,
            before.stribeck,
            before.armature,
        )
    assert changed.links == arm.links


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_impossible_changes_are_refused(bad: float) -> None:
    arm = load_parameters("arm4")
    with pytest.raises(UsageError, match="payload"):
        with_payload(arm, bad)
    with pytest.raises(UsageError, match="factor"):
        with_friction(arm, bad)
