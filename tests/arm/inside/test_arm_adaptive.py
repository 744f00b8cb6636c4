"""Adaptive control: its proof's law on an arm that the regressor spans, and errors on the simulated arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import Swing, simulated

from etude.errors import UsageError
from etude_arm import ArmPhysics, craig_hsu_sastry, slotine_li
from etude_arm.adaptive_control import CRAIG_HSU_SASTRY, SLOTINE_LI, Adaptation, Tracking, dominant
from etude_arm.physics.reference_regressor import ReferenceRegressor
from etude_arm.physics.regressor import nominal_parameters
from etude_arm.physics.rigid_body import RigidBodyModel

ROBOT = replace(simulated(), lead_in=0.2)
FAST = replace(ROBOT.spec, rate=500.0)
PHYSICS = ArmPhysics(FAST, friction_fraction=0.5)
REGRESSOR = ReferenceRegressor.of(PHYSICS)
GAIN = np.array([0.16, 5.9, 3.1, 1.6])  # N m or N for each unit of command
DAMPING = np.array([40.0, 60.0, 45.0, 30.0])
HOME = 0.5 * (FAST.lower + FAST.upper)
LAWS = {"slotine_li": (slotine_li, SLOTINE_LI), "craig": (craig_hsu_sastry, CRAIG_HSU_SASTRY)}


def true_model(viscous: float = 1.0, friction: float = 1.0) -> RigidBodyModel:
    """The model file's arm behind motors of different gains: what the regressor spans exactly."""
    tree, drives = PHYSICS.geometry.tree, PHYSICS.geometry.drives
    extra = np.zeros((4, 6))
    extra[:, 0] = [5.0, 130.0, 130.0, 120.0]
    extra[:, 1] = viscous * np.array([300.0, 6000.0, 6500.0, 6000.0])
    extra[:, 2:5] = friction * np.array([12.0, 6.0, 3.0])
    extra[:, 5] = [3.0, -2.0, 5.0, 1.0]
    return RigidBodyModel(
        tree,
        drives,
        PHYSICS.friction_velocity,
        np.outer(1.0 / GAIN, nominal_parameters(tree)),
        extra,
        np.zeros(4, dtype=np.int64),
        np.zeros(4),
        np.zeros((4, 6)),
        np.zeros(4),
    )


def states(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = rng.uniform(FAST.lower, FAST.upper)
    return np.stack([q, *rng.uniform(-1.0, 1.0, (3, 4))])


def inertia(q: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The joints' inertia matrix, kg m^2, by way of drives and motors."""
    still = np.zeros(4)
    at = REGRESSOR.at(q, still, still, still)
    return at.moment.T @ (GAIN[:, None] * np.einsum("jni,jn->ji", at.inertia, weights))


def test_along_the_measured_motion_it_is_the_identified_model() -> None:
    model = true_model()
    weights = REGRESSOR.weights(model)
    for seed in range(4):
        q, qd, qdd, _ = states(seed)
        command = np.sum(REGRESSOR.at(q, qd, qd, qdd).features * weights, axis=1)
        np.testing.assert_allclose(command, model.predict(q[None], qd[None], qdd[None])[0], rtol=1e-9)


def test_inertia_is_symmetric_and_its_rate_less_twice_coriolis_is_skew() -> None:
    """s^T (H' / 2 - C) s = 0 for every s: no law of the laws' family is stable without it."""
    weights = REGRESSOR.weights(true_model(viscous=0.0, friction=0.0))
    for seed in range(4):
        q, qd, s, _ = states(seed)
        still, step = np.zeros(4), 1e-5
        matrix = inertia(q, weights)
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-9)
        assert np.linalg.eigvalsh(matrix).min() > 0.0
        rate = (inertia(q + step * qd, weights) - inertia(q - step * qd, weights)) / (2.0 * step)
        at, rest = REGRESSOR.at(q, qd, s, still), REGRESSOR.at(q, qd, still, still)
        mixed = at.moment.T @ (GAIN * np.sum((at.features - rest.features) * weights, axis=1))
        assert abs(s @ rate @ s) > 1e-3
        assert 0.5 * s @ rate @ s == pytest.approx(s @ mixed, rel=1e-6, abs=1e-9)


def followed(controller, offset: float, ticks: int, fed_back: bool = True):
    """The ideal arm under the controller: true weights, s and Lyapunov function of each tick, last error."""
    true, vjp = REGRESSOR.weights(true_model()), controller.law.adaptation.bandwidth
    step, omega = 1.0 / FAST.rate, np.array([1.3, 2.1, 1.7, 1.9])
    q, qd = HOME + offset, 0.05 * omega
    energy = []
    for k in range(ticks):
        phase = omega * k * step
        plan = np.stack(
            [
                HOME + 0.05 * np.sin(phase),
                0.05 * omega * np.cos(phase),
                -0.05 * omega**2 * np.sin(phase),
            ]
        )
        rows = dict(zip(("q_des", "qd_des", "qdd_des"), plan, strict=True))
        behind = plan[1] - qd + vjp * (plan[0] - q)
        wrong = controller.weights - true
        energy.append(
            0.5 * behind @ inertia(q, true) @ behind
            + 0.5 * np.sum(GAIN * np.sum(wrong**2, axis=1) / controller.law.gain)
        )
        command = controller.command(k * step, rows)[0] + fed_back * DAMPING * behind
        controller.observe(k * step, {**rows, "q": q, "command": command})
        at = REGRESSOR.at(q, qd, qd, np.zeros(4))
        push = command - np.sum(at.features * true, axis=1)
        qd = qd + step * np.linalg.solve(np.einsum("jni,jn->ji", at.inertia, true), push)
        q = q + step * qd
    return np.array(energy), plan[0] - q


def test_the_lyapunov_function_of_slotine_and_li_falls() -> None:
    start = slotine_li(PHYSICS, Adaptation(bandwidth=6.0, rate=20.0, smoothing=0.0, leak=0.0))
    energy, error = followed(start, offset=0.04, ticks=150)
    assert np.all(np.diff(energy[5::25]) < 0.0)
    assert energy[-1] < 0.9 * energy[0]
    assert np.abs(error).max() < 0.02


@pytest.mark.parametrize("law", LAWS)
def test_parameters_that_are_right_stay_right(law: str) -> None:
    make, settings = LAWS[law]
    start = make(PHYSICS, replace(settings, smoothing=0.0, leak=0.0), true_model())
    before = start.weights.copy()
    _, error = followed(start, offset=0.0, ticks=100)
    assert np.abs(error).max() < 2e-4
    assert np.abs(start.weights - before).max() < 0.01 * np.abs(before).max()


@pytest.mark.slow
@pytest.mark.parametrize(("law", "seconds", "part"), [("slotine_li", 6.0, 0.2), ("craig", 12.0, 0.4)])
def test_the_simulated_arm_errs_less_from_run_to_run(law: str, seconds: float, part: float) -> None:
    make, _ = LAWS[law]
    robot, controller = ROBOT, make(ArmPhysics(ROBOT.spec))
    swing = Swing(robot, seconds)
    pd = robot.error(robot.run(swing, None, np.random.default_rng(0)))[0].mean()
    runs = [robot.run(swing, controller, np.random.default_rng(k)) for k in range(2)]
    errors = [robot.error(run)[0].mean() for run in runs]
    assert errors[0] < part * pd
    assert errors[1] < 0.9 * errors[0]
    assert np.abs(runs[1]["command_ff"]).max() <= 255.0


def test_a_replay_gives_the_same_bits_and_nothing_but_weights_is_carried() -> None:
    swing = Swing(ROBOT, 0.5)
    controllers = [slotine_li(ArmPhysics(ROBOT.spec)) for _ in range(2)]
    first, again = (ROBOT.run(swing, c, np.random.default_rng(0)) for c in controllers)
    for name in first.values:
        np.testing.assert_array_equal(first[name], again[name])
    fresh = replace(controllers[1], weights=controllers[1].weights)
    second, other = (ROBOT.run(swing, c, np.random.default_rng(1)) for c in (controllers[0], fresh))
    np.testing.assert_array_equal(second["q"], other["q"])
    assert np.any(second["command_ff"] != first["command_ff"])


@pytest.mark.parametrize("law", LAWS)
def test_a_law_far_too_fast_stays_in_its_box(law: str) -> None:
    make, settings = LAWS[law]
    controller = make(ArmPhysics(ROBOT.spec), replace(settings, rate=1e5, bound=0.5))
    log = ROBOT.run(Swing(ROBOT, 1.0), controller, np.random.default_rng(0))
    assert 0.49 < np.abs(controller.weights).max() <= 0.5
    assert np.abs(log["command_ff"]).max() <= 255.0


def test_estimates_of_a_saturated_command_rest() -> None:
    controller = slotine_li(PHYSICS)
    rows = {"q_des": HOME, "qd_des": np.zeros(4), "qdd_des": np.zeros(4)}
    controller.command(0.0, rows)
    command = np.array([255.0, 0.0, -255.0, 254.0])
    controller.observe(0.0, {**rows, "q": HOME - 0.1, "command": command})
    np.testing.assert_array_equal(np.any(controller.weights != 0.0, axis=1), [False, True, False, True])


def test_without_an_error_estimates_leak_away() -> None:
    start = slotine_li(PHYSICS, replace(SLOTINE_LI, leak=0.1), true_model())
    before, rows = start.weights, {"q_des": HOME, "qd_des": np.zeros(4), "qdd_des": np.zeros(4)}
    for k in range(50):
        start.command(k / FAST.rate, rows)
        start.observe(k / FAST.rate, {**rows, "q": HOME, "command": np.zeros(4)})
    np.testing.assert_allclose(start.weights, before * np.exp(-0.1 * 50 / FAST.rate), rtol=1e-5)


def test_an_estimated_inertia_is_kept_invertible() -> None:
    floor = np.full(2, 0.5)
    good = np.array([[2.0, 1.0], [-0.5, 1.0]])
    np.testing.assert_array_equal(dominant(good, floor), good)
    np.testing.assert_array_equal(dominant(np.zeros((2, 2)), floor), np.diag(floor))
    bad = dominant(np.array([[1.0, 4.0], [4.0, -1.0]]), floor)
    np.testing.assert_allclose(bad, [[1.0, 0.9], [0.45, 0.5]])


def test_the_derivatives_of_a_parabola_are_found() -> None:
    t, tracking = np.arange(1, 400) * 0.01, Tracking.still(np.zeros(1))
    for e in 0.5 * t**2:
        tracking = tracking.after(np.array([e]), 0.01, 0.05)
    assert tracking.ed[0] == pytest.approx(t[-1] - 0.055, abs=1e-9)  # the filter's lag and half a tick
    assert tracking.edd[0] == pytest.approx(1.0, abs=1e-9)


def test_what_cannot_be_started_is_refused() -> None:
    with pytest.raises(UsageError, match="rate is 0"):
        Adaptation(bandwidth=1.0, rate=0.0)
    with pytest.raises(UsageError, match=r"smoothing is -1\.0"):
        Adaptation(bandwidth=1.0, rate=1.0, smoothing=-1.0)
    with pytest.raises(UsageError, match="cannot be used as a start"):
        replace(slotine_li(PHYSICS), weights=np.zeros((4, 2)))
    with pytest.raises(UsageError, match="no model_file"):
        slotine_li(ArmPhysics(replace(FAST, model_file=None)))
