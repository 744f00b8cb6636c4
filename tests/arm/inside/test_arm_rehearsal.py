"""A robot made from its model file obeys mechanics, and its loop does what it says."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from rehearsal_examples import ABOUT, ARM, GRAVITY, LEVER, TABLE, Waves, loop_inputs, made, motor, still

from etude.types import Array
from etude_arm import PerfectController
from etude_arm.plant.trace import LoopInputs, Trace
from etude_arm.rehearsal.rehearsed_robot import RehearsedRobot

LOOPS = ("inside", "outside")
FIELDS = ("q", "q_true", "tau", "tau_fb")


def energy(robot: RehearsedRobot, q: Array, qd: Array) -> float:
    model = robot.parameters.rigid
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, qd
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy.sum())


@pytest.mark.parametrize("friction", ["none", "coulomb", "lugre"])
def test_the_motors_work_is_the_change_of_energy_and_what_friction_takes(
    tmp_path: Path, friction: str
) -> None:
    robot = made(tmp_path, ARM, rate=1000.0, friction=friction, motors=(motor("reach", coulomb=5.0),))
    trace = robot.whole(loop_inputs(robot, Waves(3)))
    step, motors = np.diff(trace.q_true, axis=0), robot.parameters.motors
    speed = step / 0.001
    work = np.sum(trace.tau[1:-1] * step[1:])
    gained = energy(robot, trace.q_true[-1], speed[-1]) - energy(robot, trace.q_true[1], speed[0])
    taken = work - gained - np.sum(motors.viscous * speed[1:] * step[1:])
    way = np.abs(step[1:]).sum(axis=0)
    assert work > 10.0  # J: nothing of this is about zero
    if friction == "none":
        assert taken == pytest.approx(0.0, abs=0.02 * work)
    else:
        assert np.sum(motors.coulomb * way) == pytest.approx(taken, rel=0.03)


def test_at_rest_without_gravity_it_stays_at_rest(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE)
    trace = robot.whole(still(robot, np.array([0.3]), 2.0, np.zeros(1)))
    np.testing.assert_array_equal(trace.q_true, np.full((200, 1), 0.3))
    np.testing.assert_allclose(trace.tau, 0.0, atol=1e-9)


@pytest.mark.parametrize("loop", LOOPS)
def test_what_hangs_on_a_servo_pulls_it_off_by_its_weight_over_the_gain(tmp_path: Path, loop: str) -> None:
    robot = made(tmp_path, LEVER, loop=loop, friction="none")
    trace = robot.whole(still(robot, np.array([0.4]), 3.0, np.zeros(1)))
    weight = 3.0 * GRAVITY * 0.3 * np.cos(trace.q_true[-1])
    np.testing.assert_allclose(0.4 - trace.q_true[-1], weight / robot.parameters.motors.kp, rtol=1e-3)
    np.testing.assert_allclose(trace.tau[-1], weight, rtol=2e-3)


def test_friction_may_hold_a_part_of_the_load(tmp_path: Path) -> None:
    robot = made(tmp_path, LEVER)
    trace = robot.whole(still(robot, np.array([0.4]), 3.0, np.zeros(1)))
    off = abs(0.4 - trace.q_true[-1, 0]) * robot.parameters.motors.kp[0]
    weight = 3.0 * GRAVITY * 0.3 * np.cos(0.4)
    assert weight - robot.parameters.motors.static[0] <= off <= weight


@pytest.mark.parametrize("loop", LOOPS)
def test_its_inverse_holds_it_where_it_is(tmp_path: Path, loop: str) -> None:
    robot = made(tmp_path, LEVER, loop=loop)
    q = np.array([[0.4]])
    exact = robot.inverse(q, 0 * q, 0 * q)[0]
    np.testing.assert_allclose(exact, 3.0 * GRAVITY * 0.3 * np.cos(0.4), rtol=1e-9)
    trace = robot.whole(still(robot, q[0], 1.0, exact))
    np.testing.assert_allclose(trace.q_true, 0.4, atol=1e-5)


def steps_of(trace: Trace) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Position, speed and acceleration at each step of 1 ms but the ends, and the speed after it."""
    speed = np.diff(trace.q_true, axis=0) / 0.001
    return (trace.q_true[1:-1], speed[:-1], np.diff(speed, axis=0) / 0.001), speed[1:]


def test_the_inverse_of_a_run_gives_its_commands_back(tmp_path: Path) -> None:
    """Exactly: velocities are those at the end of a step for damping, at its beginning for all else."""
    robot = made(tmp_path, ARM, rate=1000.0, friction="none")
    trace = robot.whole(loop_inputs(robot, Waves(3, 2.0)))
    (q, before, bend), after = steps_of(trace)
    command = robot.inverse(q, before, bend) + robot.parameters.motors.viscous * (after - before)
    np.testing.assert_allclose(command, trace.tau[1:-1], atol=2e-6 * np.abs(trace.tau).max())


def test_the_inverse_along_a_run_knows_its_bristles(tmp_path: Path) -> None:
    """The commands of a run, reversals too: steady friction turns over at once, bristles over a way."""
    robot = made(tmp_path, ARM, rate=1000.0, friction="lugre")
    trace = robot.whole(loop_inputs(robot, Waves(3, 2.0)))
    (q, before, bend), after = steps_of(trace)
    damped = robot.parameters.motors.viscous * (after - before)
    resolved = (
        np.abs(before) * 0.001 < 0.2 * robot.parameters.motors.coulomb / robot.parameters.motors.stiffness
    )
    resolved[:100] = False
    left = [
        np.abs(inverse(q, before, bend) + damped - trace.tau[1:-1])
        for inverse in (robot.inverse_along, robot.inverse)
    ]
    for j in range(2):  # the slide leaps over its .2 mm in every step
        near = resolved[:, j]  # steps of the simulation in which bristles bend and do not leap
        assert near.sum() > 50
        # what is left in both is Stribeck's fall of friction within a step, whose speeds are its ends'
        assert left[0][near, j].mean() < 0.5 * left[1][near, j].mean()
    assert left[0][resolved[:, 0], 0].mean() < 0.2 * left[1][resolved[:, 0], 0].mean()


def test_one_rollout_is_a_loop_over_steps(tmp_path: Path) -> None:
    """The drives' servo, written here a second time, step by step, around a bare torque."""
    inside = made(tmp_path, ARM, friction="lugre")
    inputs = loop_inputs(inside, Waves(3, 2.0))
    trace, model = inside.whole(inputs), inside.parameters.driven
    data = mujoco.MjData(model)
    data.qpos[:] = inputs.q_des[0]
    true = []
    for k in range(len(inputs.q_des)):
        true.append(data.qpos.copy())
        for s in range(10):
            after = 0.001 * s
            speed = inputs.qd_des[k] + after * inputs.qdd_des[k]
            place = inputs.q_des[k] + after * (inputs.qd_des[k] + 0.5 * after * inputs.qdd_des[k])
            data.ctrl[:9] = np.stack([place, speed, inputs.tau_ff[k]], axis=1).ravel()
            mujoco.mj_step(model, data)
    np.testing.assert_array_equal(trace.q_true, np.array(true))


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("friction", ["lugre", "coulomb"])
@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_a_run_in_pieces_is_the_whole_run(tmp_path: Path, loop: str, friction: str, delay: float) -> None:
    robot = made(tmp_path, ARM, loop=loop, friction=friction, delay=delay)
    inputs = loop_inputs(robot, Waves(3, 1.0))
    whole, running = robot.whole(inputs), robot.begin(inputs.q_des[0])
    pieces = Trace.joined(
        [running.advance(inputs.tick(k, inputs.tau_ff[k])) for k in range(len(inputs.q_des))]
    )
    for field in FIELDS:
        # the solver of Coulomb's constraint starts elsewhere in a new rollout
        atol = 0.0 if friction == "lugre" else 1e-6
        np.testing.assert_allclose(getattr(pieces, field), getattr(whole, field), rtol=0.0, atol=atol)


def test_the_same_seed_is_the_same_run_to_the_bit(tmp_path: Path) -> None:
    for loop in LOOPS:
        robot = made(tmp_path, ARM, loop=loop)
        first, again, other = (robot.run(Waves(3), None, np.random.default_rng(s)) for s in (1, 1, 2))
        for name in first.values:
            np.testing.assert_array_equal(first[name], again[name])
        assert (first["q"] != other["q"]).any()


def test_positions_come_in_ticks_of_the_motors_encoder(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE, motors=(motor("turn", gear=50.0, encoder_bits=12),))
    log = robot.run(Waves(1), None, np.random.default_rng(0))
    ticks = log["q"] / (2.0 * np.pi / 2**12 / 50.0)
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-6)
    assert np.abs(log["q"] - log["q_true"]).max() < 6.0 * 2.0 * np.pi / 2**12 / 50.0
    assert (log["q"] != log["q_true"]).any()


@pytest.mark.parametrize("loop", LOOPS)
def test_a_delay_of_three_ticks_is_the_same_run_three_ticks_later(tmp_path: Path, loop: str) -> None:
    """Without feedback, since a delay in a loop changes it."""
    free = (motor("turn", kp=1e-9, kd=0.0),)
    now, late = (made(tmp_path, TABLE, loop=loop, delay=d, motors=free) for d in (0.0, 0.03))
    inputs = still(now, np.zeros(1), 1.0, np.zeros(1))
    push = inputs.tau_ff.copy()
    push[20:] = 7.0
    pushed = LoopInputs(inputs.q_des, inputs.qd_des, push, inputs.noise, inputs.substeps)
    first, second = now.whole(pushed).q_true, late.whole(pushed).q_true
    assert first[-1, 0] > 0.1
    np.testing.assert_allclose(second[3:], first[:-3], rtol=0.0, atol=1e-9)
    assert abs(second[3] - first[1]).max() == 0.0 < abs(second[30] - first[28])


@pytest.mark.parametrize("loop", LOOPS)
def test_what_was_sent_before_the_start_is_the_start(tmp_path: Path, loop: str) -> None:
    now, late = (
        made(tmp_path, LEVER, loop=loop, delay=d, motors=(motor("lift", kp=50, kd=5),)) for d in (0, 0.02)
    )
    first, second = (r.whole(still(r, np.array([0.4]), 0.03, np.array([8.0]))) for r in (now, late))
    np.testing.assert_allclose(second.q_true, first.q_true, atol=1e-3)
    assert second.q_true.min() > 0.39


@pytest.mark.parametrize("loop", LOOPS)
def test_a_command_goes_no_further_than_its_limit(tmp_path: Path, loop: str) -> None:
    robot = made(tmp_path, TABLE, command=5.0, loop=loop)
    for push in (-50.0, 50.0):
        trace = robot.whole(still(robot, np.zeros(1), 0.05, np.array([push])))
        np.testing.assert_allclose(trace.tau, np.copysign(5.0, push))


def test_an_encoder_without_noise_is_half_a_tick_off_at_most(tmp_path: Path) -> None:
    for loop in LOOPS:
        robot = made(tmp_path, TABLE, loop=loop, motors=(motor("turn", encoder_bits=10),))
        trace = robot.whole(loop_inputs(robot, Waves(1)))
        off = (trace.q - trace.q_true) / (2.0 * np.pi / 2**10)
        assert 0.45 < np.abs(off).max() <= 0.5 + 1e-9
        assert abs(off.mean()) < 0.05


def test_slow_sliding_rubs_up_to_static_friction(tmp_path: Path) -> None:
    motors = made(tmp_path, TABLE).parameters.motors  # Coulomb 1.8, static 2.34, Stribeck 0.02, viscous 0.9
    rub = motors.friction(np.array([[0.0], [0.02], [-1e-9]]), "lugre")
    np.testing.assert_allclose(rub, [[0.0], [1.8 + 0.54 / np.e + 0.018], [-2.34]], atol=1e-8)


@pytest.mark.parametrize(("friction", "level"), [("coulomb", 1.8), ("lugre", 1.8), ("none", 0.0)])
def test_sliding_steadily_costs_coulomb_and_viscous_friction(
    tmp_path: Path, friction: str, level: float
) -> None:
    """At 40 times the Stribeck speed LuGre's bristles are bent as far as Coulomb friction bends them."""
    robot = made(tmp_path, TABLE, friction=friction)
    t = np.arange(200) / 100.0
    q, qd = 0.8 * t[:, None] - 0.8, np.full((200, 1), 0.8)
    trace = robot.whole(LoopInputs(q, qd, 0 * q, 0 * q, robot.substeps, 0 * q))
    viscous = 0.03 * 60.0 / 2.0  # of the torque limit over the speed limit
    np.testing.assert_allclose(trace.tau[150:], level + 0.8 * viscous, rtol=1e-3)
    expected = robot.parameters.motors.friction(np.array([[0.8]]), friction)
    np.testing.assert_allclose(expected, level + 0.8 * viscous, rtol=1e-9)


def test_below_its_breakaway_lugre_friction_is_a_spring(tmp_path: Path) -> None:
    """dz = (1 - sigma_0 z / g) dx along a slow push F = sigma_0 z gives x = -(g / sigma_0) ln(1 - F / g)."""
    robot = made(tmp_path, TABLE, motors=(motor("turn", kp=1e-9, kd=0.0),))
    motors = robot.parameters.motors
    inputs = still(robot, np.zeros(1), 6.0, np.zeros(1))
    push = np.linspace(0.0, 1.0, 600)[:, None] * motors.coulomb
    slow = LoopInputs(inputs.q_des, inputs.qd_des, push, inputs.noise, inputs.substeps)
    level = motors.static / motors.stiffness
    expected = -level * np.log(1.0 - push / motors.static)
    np.testing.assert_allclose(robot.whole(slow).q_true[100:], expected[100:], rtol=0.02)


@pytest.mark.parametrize("loop", LOOPS)
def test_with_its_exact_inverse_it_follows_where_feedback_alone_lags(tmp_path: Path, loop: str) -> None:
    robot = made(tmp_path, ARM, loop=loop)
    alone, exact = (
        robot.run(Waves(3), controller, np.random.default_rng(0))
        for controller in (None, PerfectController(robot))
    )
    _, units = robot.error(alone)
    assert units == ("% of range",) * 3
    errors, exact_errors = (
        robot.error(log)[0] * [0.04 * 180 / np.pi, 0.04 * 180 / np.pi, 0.04] for log in (alone, exact)
    )
    if loop == "inside":  # |e| <= |feedback| / Kp, by the choice of the gains: 1.5 deg, 2.6 mm on the slide
        assert (errors < [1.5, 1.5, 0.0026]).all()
    assert (exact_errors < (0.12 if loop == "inside" else 0.2) * errors).all()


def test_volts_come_short_at_speed_and_pwm_is_whole(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE, unit="pwm", command=255.0, motors=(motor("turn", no_load=5.0, coulomb=0),))
    motors = robot.parameters.motors
    assert robot.parameters.loop.loop == "outside"
    assert motors.torque[0] == 60.0  # the effort in the file
    assert robot.parameters.driven.dof_damping[0] == pytest.approx(motors.viscous[0] + 60.0 / 5.0)
    qd = np.array([[2.0]])
    need = robot.inverse(0 * qd, qd, 0 * qd)[0, 0] * 60.0 / 255.0
    assert need == pytest.approx((60.0 / 5.0 + motors.viscous[0]) * 2.0)
    log = robot.run(Waves(1), None, np.random.default_rng(0))
    np.testing.assert_array_equal(log["command"], np.rint(log["command"]))
    assert np.abs(log["command"]).max() <= 255.0


def test_a_torque_limit_holds_for_the_command_alone(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE, command=5.0)
    trace = robot.whole(still(robot, np.zeros(1), 0.2, np.array([50.0])))
    np.testing.assert_allclose(trace.tau, 5.0)
    # so the table speeds up by what friction leaves
    speed = np.diff(trace.q_true[:, 0]) * 100.0
    about = ABOUT + robot.parameters.motors.armature[0]
    assert 2.5 / about < (speed[1] - speed[0]) * 100.0 < 5.0 / about


def test_a_payload_weighs_at_the_tip_and_friction_grows(tmp_path: Path) -> None:
    robot = made(tmp_path, ARM)
    level = np.array([[0.0, 0.0, 0.2]])  # stretched out: the telescope's frame at 0.4 + 0.2 from the lift
    zero = np.zeros_like(level)
    loaded = robot.changed(payload=2.0)
    more = loaded.inverse(level, zero, zero) - robot.inverse(level, zero, zero)
    np.testing.assert_allclose(more, [[0.0, 2.0 * GRAVITY * 0.6, 0.0]], atol=1e-6)
    slow = np.array([[0.5, -0.5, 0.5]])
    dry, rough = (
        r.inverse(level, slow, zero) - r.inverse(level, -slow, zero)
        for r in (robot, robot.changed(friction=1.5))
    )
    np.testing.assert_allclose(rough, 1.5 * dry, rtol=1e-9)
    log = robot.run(Waves(3, 2.0), None, np.random.default_rng(0), changes={1.0: loaded})
    plain = robot.run(Waves(3, 2.0), None, np.random.default_rng(0))
    same = log["q_true"] == plain["q_true"]
    assert same[log.t < 1.0].all()
    assert not same[log.t > 1.1].any()


class Asked:
    """Says the same as what is planned, tick by tick; remembers what it was shown."""

    def __init__(self, commands: Array) -> None:
        self.commands, self.seen = commands, 0

    def planned(self, motion: object) -> Array | None:
        return None

    def command(self, t: float, row: object) -> tuple[Array, Array]:
        command = self.commands[max(0, round(100 * t))]
        return command, 0.0 * command

    def observe(self, t: float, row: object) -> None:
        self.seen += 1


class Ahead(Asked):
    def planned(self, motion: object) -> Array | None:
        return self.commands


@pytest.mark.parametrize("loop", LOOPS)
def test_asked_tick_by_tick_is_planned_ahead(tmp_path: Path, loop: str) -> None:
    robot = made(tmp_path, TABLE, loop=loop)
    commands = np.sin(np.arange(400)[:, None] / 20.0)
    asked, ahead = Asked(commands), Ahead(commands)
    logs = [robot.run(Waves(1), c, np.random.default_rng(0)) for c in (asked, ahead)]  # type: ignore[arg-type]
    np.testing.assert_array_equal(logs[0]["q_true"], logs[1]["q_true"])
    assert asked.seen == len(logs[0])
