"""Laws that hold for any arm: energy, rest, friction. Each for both engines and both arms."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from arm_examples import (
    ENGINES,
    MIDDLE,
    actuator_length,
    energy,
    moment_arm,
    open_loop,
    simulated,
    with_motors,
)

from etude_arm.plant.parameters import ArmParameters, Sine, load_parameters

ARMS = ("arm4", "arm4_rough")


def _column(arm: ArmParameters, field: str) -> np.ndarray:
    return np.array([getattr(motor, field) for motor in arm.motors])


def _sines(arm: ArmParameters, length: np.ndarray, field: str) -> np.ndarray:
    waves = [getattr(motor, field) for motor in arm.motors]
    return np.stack(
        [w.amplitude * np.sin(w.wavenumber * length[:, j] + w.phase) for j, w in enumerate(waves)], axis=1
    )


def _friction(arm: ArmParameters, length: np.ndarray, speed: np.ndarray, z: np.ndarray) -> np.ndarray:
    """LuGre force (T, dof) as in Canudas de Wit et al. (1995), without the viscous part."""
    coulomb, static = _column(arm, "coulomb"), _column(arm, "static")
    level = coulomb + (static - coulomb) * np.exp(-((speed / _column(arm, "stribeck")) ** 2))
    level = level * (1.0 + _sines(arm, length, "friction_ripple"))
    stiffness = _column(arm, "stiffness")
    rate = speed - stiffness * np.abs(speed) * z / level
    return stiffness * z + _column(arm, "micro_damping") * rate


def _volts(steps: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(steps)[:, None] / steps
    return np.array([0.0, 5.0, 4.0, 1.0]) + 8.0 * np.sin(2 * np.pi * (3 * t + rng.uniform(0, 1, 4)))


def _imbalance(engine: str, arm: ArmParameters) -> float:
    """Largest |supplied - dissipated - stored| energy over a run, relative to the energy supplied."""
    steps, h = round(0.8 / arm.timestep), arm.timestep
    volts = _volts(steps)
    q, v, z = open_loop(engine, arm, MIDDLE, np.zeros(4), volts)
    length, speed = actuator_length(arm, q), moment_arm(arm, q) * v
    drive = np.array([motor.electrical(arm.controller.supply) for motor in arm.motors])
    middle = 0.5 * (speed[1:] + speed[:-1])
    current = (volts - drive[:, 0] * middle) / drive[:, 1]
    electrical = volts * current
    heat = drive[:, 1] * current**2 + _column(arm, "viscous") * middle**2
    force = _friction(arm, length, speed, z)
    rubbing = 0.5 * (force[1:] + force[:-1]) * middle  # including what the bristles store
    ripple = _sines(arm, length, "cogging")
    cogging = 0.5 * (ripple[1:] + ripple[:-1]) * middle
    stored = energy(arm, q, v)
    supplied = np.cumsum((electrical - heat - rubbing + cogging).sum(axis=1)) * h
    scale = np.abs(electrical).sum() * h
    return float(np.abs(supplied - (stored[1:] - stored[0])).max() / scale)


@pytest.mark.thinned
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ARMS)
def test_power_balance_to_the_order_of_the_integrator(engine: str, name: str) -> None:
    arm = load_parameters(name)
    coarse, fine = (_imbalance(engine, msgspec.structs.replace(arm, timestep=h)) for h in (0.001, 0.00025))
    assert coarse < 0.02
    assert fine < 0.4 * coarse  # first order: a quarter, with room for the next order


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ARMS)
def test_friction_never_adds_energy(engine: str, name: str) -> None:
    arm = load_parameters(name)
    q, v, z = open_loop(engine, arm, MIDDLE, np.zeros(4), _volts(1500, seed=3))
    speed = moment_arm(arm, q) * v
    force = _friction(arm, actuator_length(arm, q), speed, z)
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * 0.5 * (speed[1:] + speed[:-1]), axis=0) * arm.timestep
    stored = 0.5 * _column(arm, "stiffness") * z[1:] ** 2
    lost = work - stored
    worst = np.diff(np.vstack([np.zeros(4), lost]), axis=0).min(axis=0)
    assert (lost[-1] > 0.0).all()
    assert (worst > -1e-4 * lost[-1]).all(), worst


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ARMS)
def test_an_unpowered_arm_only_loses_energy(engine: str, name: str) -> None:
    arm = with_motors(load_parameters(name), cogging=Sine())  # else its potential energy comes on top
    start = np.array([0.3, -0.2, 0.2, -0.3])
    q, v, z = open_loop(engine, arm, MIDDLE, start, np.zeros((1500, 4)))
    total = energy(arm, q, v) + 0.5 * (_column(arm, "stiffness") * z**2).sum(axis=1)
    assert total[-1] < total[0] - 1.0
    assert np.diff(total).max() < 1e-3 * (total[0] - total[-1])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ARMS)
def test_rest_stays_at_rest_under_the_holding_command(engine: str, name: str) -> None:
    robot, arm = simulated(name), load_parameters(name)
    rest = np.zeros((1, 4))
    hold = robot.inverse(MIDDLE[None, :], rest, rest) / arm.controller.resolution * arm.controller.supply
    q, v, _ = open_loop(engine, arm, MIDDLE, np.zeros(4), np.repeat(hold, 2000, axis=0))
    np.testing.assert_allclose(q - MIDDLE, 0.0, atol=1e-10)
    np.testing.assert_allclose(v, 0.0, atol=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_static_friction_holds_up_to_its_level_and_no_further(engine: str) -> None:
    """Loaded slowly, LuGre's bristles give way by -(Fs / s0) ln(1 - F / Fs), and break away at F = Fs."""
    arm = msgspec.structs.replace(load_parameters("arm4"), gravity=0.0)
    waist = arm.motors[0]
    ramp = np.minimum(np.arange(3000) / 2000.0, 1.0)  # a step would overshoot the static level
    ends = []
    for share in (0.9, 1.1):
        volts = np.zeros((3000, 4))
        volts[:, 0] = ramp * share * waist.static / waist.stall * arm.controller.supply
        q, _, _ = open_loop(engine, arm, np.zeros(4), np.zeros(4), volts)
        ends.append(q[-1, 0])
    assert ends[0] == pytest.approx(-waist.static / waist.stiffness * np.log(1.0 - 0.9), rel=0.05)
    assert ends[1] > 5.0 * ends[0]


@pytest.mark.parametrize("engine", ENGINES)
def test_without_load_and_friction_the_motor_reaches_its_no_load_speed(engine: str) -> None:
    free = with_motors(load_parameters("arm4"), coulomb=1e-9, static=1e-9, viscous=0.0, micro_damping=0.0)
    free = msgspec.structs.replace(free, gravity=0.0)
    volts = np.zeros((5000, 4))
    volts[:, 0] = free.controller.supply
    _, v, _ = open_loop(engine, free, np.zeros(4), np.zeros(4), volts)
    assert v[-1, 0] == pytest.approx(free.motors[0].no_load, rel=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_at_stall_the_motor_gives_its_stall_torque(engine: str) -> None:
    arm = with_motors(load_parameters("arm4"), viscous=0.0, micro_damping=0.0)
    arm = msgspec.structs.replace(arm, timestep=1e-6)
    volts = np.array([[arm.controller.supply, 0.0, 0.0, 0.0]])
    _, v, _ = open_loop(engine, arm, MIDDLE, np.zeros(4), volts)
    unit = np.array([1.0, 0.0, 0.0, 0.0])
    inertia = 2.0 * (energy(arm, MIDDLE[None], unit[None]) - energy(arm, MIDDLE[None], 0 * unit[None]))[0]
    assert inertia * v[1, 0] / arm.timestep == pytest.approx(arm.motors[0].stall, rel=1e-4)


def test_moment_arms_over_the_range_of_motion() -> None:
    robot, arm = simulated("arm4"), load_parameters("arm4")
    arms = moment_arm(arm, np.linspace(robot.spec.lower, robot.spec.upper, 50))
    ends = {"shoulder": (0.080, 0.058), "elbow": (0.060, 0.040), "wrist": (0.032, 0.045)}
    for j, (first, last) in enumerate(ends.values(), start=1):
        assert arms[0, j] == pytest.approx(first, abs=0.0005)
        assert arms[-1, j] == pytest.approx(last, abs=0.0005)
    assert (arms > 0.03).all()  # positive: a positive command raises the joint whatever the gear
