"""Feedforward of flights: each part does in the loop what it is for, gates hold, and runs are judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from etude.errors import DataError, NumericalError, UsageError
from etude.limits import FeasibleSet, uniform
from etude.protocols import Candidate, Trajectory
from etude.types import Array, Log, Motion
from etude_quadrotor import (
    KIND,
    FlightConfig,
    FlightFeedforward,
    GatedVoltages,
    QuadrotorInputs,
    flight_family,
    flight_plan,
    nominal_inverse,
)
from etude_quadrotor.channels import POSITION, POSITION_DES
from etude_quadrotor.controller import (
    LARGEST_CORRECTION,
    PID_ALONE,
    LinearDrag,
    learned,
    states_of,
    thrust_voltage,
)
from etude_quadrotor.flatness import flat_motion
from etude_quadrotor.motions import home, limits
from etude_quadrotor.plant.simulated_vehicle import simulated_vehicle
from etude_quadrotor.preprocessing import FlightData
from etude_quadrotor.vehicle import GRAVITY

PLANT = simulated_vehicle("quadrotor")
SPEC = KIND.spec(KIND.built_in()["quadrotor"])
CONFIG = SimpleNamespace(trajectory=FlightConfig(start="moving"), data=FlightData())
FAMILY = flight_family(CONFIG.trajectory)
NOMINAL = nominal_inverse(PLANT.vehicle)
EXACT = LinearDrag(tuple(PLANT.parameters.drag_per_mass.tolist()))


@pytest.fixture(scope="module")
def trajectories() -> list[Trajectory]:
    feasible = FeasibleSet.of(limits(SPEC, CONFIG.trajectory, {}), FAMILY, home(SPEC))
    return [FAMILY.trajectory(p) for p in uniform(np.random.default_rng(8), feasible, 3)]


def error(trajectory: Trajectory, feedforward: FlightFeedforward) -> tuple[float, float]:
    """Mean distance after 5 s in calm air, m, and mean |z| error."""
    plan = flight_plan(trajectory, feedforward, PLANT.vehicle, PLANT.rate)
    flight = PLANT.fly(plan, None, start="moving")
    assert flight.ended is None
    away = (flight.position - plan.position)[5000:]
    return np.linalg.norm(away, axis=1).mean(), np.abs(away[:, 2]).mean()


def test_each_part_helps_on_every_flight(trajectories) -> None:
    for trajectory in trajectories:
        pid, _ = error(trajectory, PID_ALONE)
        accelerated, _ = error(trajectory, FlightFeedforward())
        leaning, _ = error(trajectory, FlightFeedforward(drag=EXACT))
        planned, _ = error(trajectory, FlightFeedforward(drag=EXACT, voltages=NOMINAL))
        assert accelerated < pid
        assert leaning < 0.25 * accelerated
        assert planned < 1.01 * leaning


def test_hovering_needs_no_feedforward() -> None:
    still = FAMILY.trajectory(FAMILY.parameters(np.vstack([[0.0, 0.0, 2.0], np.zeros((4, 3))])))
    plan = flight_plan(still, FlightFeedforward(drag=EXACT, voltages=NOMINAL), PLANT.vehicle, PLANT.rate)
    np.testing.assert_allclose(plan.acceleration_ff, 0.0, atol=1e-12)
    np.testing.assert_allclose(plan.voltage_ff, 0.0, atol=1e-9)
    assert thrust_voltage(PLANT.vehicle, np.array([GRAVITY])) == pytest.approx(PLANT.vehicle.hover_voltage)


def test_the_lean_balances_the_drag(trajectories) -> None:
    """With drag d v the plan's acceleration is a + R D R' v: what flatness with that drag demands."""
    motion = trajectories[0].motion(np.linspace(0.0, 30.0, 40), 5)
    R, d = flat_motion(motion, EXACT.coefficients).R_world_body, np.array(EXACT.coefficients)
    force = np.einsum("tij,j,tkj,tk->ti", R, d, R, motion.orders[1])
    plan = flight_plan(trajectories[0], FlightFeedforward(drag=EXACT), PLANT.vehicle, PLANT.rate)
    found = np.stack([np.interp(motion.t, plan.t, column) for column in plan.acceleration_ff.T], axis=1)
    np.testing.assert_allclose(found, motion.orders[2] + force, atol=2e-4)


@dataclass(frozen=True)
class Unlearned:
    """A process that knows nothing: its deviation before data."""

    signal_variance: Array
    noise_variance: Array


@dataclass(frozen=True, eq=False)
class Guess:
    """A model that is wrong by 3 V, with a stated deviation."""

    deviation: float
    calibrated: bool = True
    ranges: Array | None = None
    inputs: QuadrotorInputs = QuadrotorInputs()  # noqa: RUF009

    @property
    def candidates(self) -> list[Candidate]:
        process = Unlearned(np.full(4, 0.03), np.full(4, 0.01))
        units, every = np.stack([np.zeros(4), np.ones(4)]), (0, 1, 2, 3)
        return [Candidate("gp", every, np.ones(4), None, process, units, np.ones(4))]  # type: ignore[arg-type]

    def posterior(self, log: Log) -> tuple[Array, Array]:
        return NOMINAL.predict(log) + 3.0, np.full((len(log), 4), self.deviation**2)


def planned(trajectory: Trajectory) -> Log:
    return states_of(flat_motion(trajectory.motion(np.linspace(0.0, 30.0, 20), 5)))


def test_a_wild_model_is_clipped_and_an_unsure_one_is_not_asked(trajectories) -> None:
    log = planned(trajectories[0])
    safe = NOMINAL.predict(log)
    sure = GatedVoltages(Guess(0.01), NOMINAL).predict(log)
    np.testing.assert_allclose(sure, safe + LARGEST_CORRECTION)
    np.testing.assert_allclose(GatedVoltages(Guess(0.2), NOMINAL).predict(log), safe)


def test_with_few_flights_a_model_is_asked_only_where_they_were(trajectories) -> None:
    log = planned(trajectories[0])
    safe, X = NOMINAL.predict(log), QuadrotorInputs().of_log(log)
    seen = np.stack([X.min(axis=0), X.max(axis=0)])
    for ranges, more in ((seen, LARGEST_CORRECTION), (seen + np.eye(13)[0] * 100.0, 0.0)):
        asked = GatedVoltages(Guess(0.01, False, ranges), NOMINAL).predict(log)
        np.testing.assert_allclose(asked, safe + more)


def test_a_learned_feedforward_has_what_the_vehicle_takes() -> None:
    drawn = learned(SPEC, Guess(0.01))  # type: ignore[arg-type]
    assert isinstance(drawn.voltages, GatedVoltages)
    assert learned(KIND.spec(KIND.built_in()["pelican"]), Guess(0.01)).voltages is None  # type: ignore[arg-type]
    log = planned(FAMILY.trajectory(np.full(FAMILY.size, 0.1)))
    row = {name: values[3] for name, values in log.values.items()}
    command, _ = drawn.command(0.0, row)
    np.testing.assert_allclose(command, drawn.voltages.predict(log)[3], rtol=1e-12)
    with pytest.raises(DataError, match="only accelerations are planned"):
        PID_ALONE.command(0.0, row)


def test_a_plan_that_is_not_finite_is_refused(trajectories) -> None:
    class Broken:
        def predict(self, log: Log) -> Array:
            return np.full((len(log), 4), np.nan)

    with pytest.raises(NumericalError, match="voltage is not finite"):
        flight_plan(trajectories[0], FlightFeedforward(voltages=Broken()), PLANT.vehicle, PLANT.rate)


def test_any_controller_may_plan_voltages(trajectories) -> None:
    class Other:
        def planned(self, motion: Motion) -> Array | None:
            return NOMINAL.predict(states_of(flat_motion(motion)))

    own, other = (
        flight_plan(trajectories[0], c, PLANT.vehicle, PLANT.rate)  # type: ignore[arg-type]
        for c in (FlightFeedforward(voltages=NOMINAL), Other())
    )
    np.testing.assert_array_equal(own.voltage_ff, other.voltage_ff)
    np.testing.assert_array_equal(own.acceleration_ff, other.acceleration_ff)


def test_quiet_and_noisy_air_differ_little(trajectories) -> None:
    plan = flight_plan(trajectories[0], FlightFeedforward(drag=EXACT), PLANT.vehicle, PLANT.rate)
    quiet = PLANT.fly(plan, None, start="moving").position
    noisy = replace(PLANT, noise="low").fly(plan, np.random.default_rng(0), start="moving").position
    assert 0.0 < np.abs(quiet - noisy).max() < 0.1


def test_the_robot_flies_in_its_room_and_is_judged_outside_too(trajectories) -> None:
    robot = KIND.robot(SPEC, CONFIG)
    x, y, _ = trajectories[0].motion(np.zeros(1), 1).orders[0, 0]
    room = replace(SPEC, lower=(x - 1.0, y - 1.0, 0.0), upper=(x + 1.0, y + 1.0, 5.0))
    tight = replace(robot, spec=room)
    cut, whole = (run(trajectories[0], None, np.random.default_rng(1)) for run in (tight.run, tight.test))
    assert "left the room" in cut.repairs[0]
    assert whole.repairs == ()
    assert len(cut) < len(whole) == 300
    for name in whole.values:
        np.testing.assert_array_equal(cut[name], whole[name][: len(cut)])


def test_the_error_of_a_flight_that_broke_off_goes_on() -> None:
    robot = KIND.robot(SPEC, CONFIG)
    t = np.arange(300) / 10.0 + 0.05
    log = Log(t, {}, {})
    off = np.zeros((300, 3))
    off[50:, 0], off[100:, 2] = 0.3, 0.4
    log = log.put(POSITION_DES, np.ones((300, 3))).put(POSITION, 1.0 - off)
    error, units = robot.error(log)
    np.testing.assert_allclose(error, [0.3, 0.0, 0.4 * 0.8, 0.3 * 0.2 + 0.5 * 0.8])
    assert units == ("m",) * 4
    np.testing.assert_allclose(robot.error(log.take(slice(0, 120)))[0], error, rtol=2e-3)


def test_what_a_vehicle_can_suffer(trajectories) -> None:
    robot = KIND.robot(SPEC, CONFIG)
    plain = robot.test(trajectories[0], None, np.random.default_rng(1))
    for what in ({"payload": 0.05}, {"drag": 1.5}, {"sag": 0.05}, {"wind": 2.0}):
        other = robot.changed(**what).test(trajectories[0], None, np.random.default_rng(1))
        assert np.abs(other["position"] - plain["position"]).max() > 1e-3, what
    for wrong in ({"friction": 1.0}, {"payload": -1.0}, {"drag": float("nan")}, {"sag": 2.0}):
        with pytest.raises(UsageError):
            robot.changed(**wrong)
    nobody = replace(SPEC, plant=None)
    assert KIND.robot(nobody, CONFIG) is None
    with pytest.raises(UsageError, match="zeppelin"):
        KIND.robot(replace(SPEC, plant="zeppelin"), CONFIG)


PINNED = {
    "quadrotor": [0.3997818945, 0.3273045878, 0.03000089765, 0.3193531848, 0.2577328369, 0.02381755180],
    "pelican": [0.04483912480, 0.02562484166, 0.003591574581, 0.03024996477, 0.01821336845, 0.004509757650],
}


@pytest.mark.parametrize("name", [pytest.param("quadrotor", marks=pytest.mark.slow), "pelican"])
def test_the_simulated_world_stays_as_it_is(name: str) -> None:
    """Errors in m of version 0.1, to which figures that were published refer."""
    spec = KIND.spec(KIND.built_in()[name])
    robot, baselines = KIND.robot(spec, CONFIG), KIND.baselines(spec, CONFIG)
    tests = KIND.tests(spec, CONFIG, np.random.default_rng(7))
    found = [
        robot.error(robot.test(tests[test], controller, np.random.default_rng(3)))[0][3]
        for test in tests
        for controller in baselines.values()
    ]
    np.testing.assert_allclose(found, PINNED[name], rtol=1e-6)
