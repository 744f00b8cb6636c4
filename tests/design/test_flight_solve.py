from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flight_design_examples import DRAG, box, flight_model
from scipy.optimize import linprog

from etude.design.flight.config import FlightDesignConfig
from etude.design.flight.reference import IntendedFlights, uniform_intended
from etude.design.flight.refine import refine_flight
from etude.design.flight.solve import FlightDesign, design_flight, flight_objective
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.trajectories.flight.certificate import certify_flight
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import boundary_parameters, uniform_parameters

SMALL = FlightDesignConfig(points=20, reference_points=40, inducing=40, candidates=12, starts=4, steps=24)
FAMILY = FlightFamily()


def designed(config: FlightDesignConfig = SMALL, seed: int = 0, **changes) -> FlightDesign:
    return design_flight(
        flight_model(), box(**changes), FAMILY, config, np.random.default_rng(seed), drag=DRAG
    )


@pytest.mark.parametrize("criterion", ["mean_variance", "info_gain", "ivr", "log_ivr"])
def test_a_design_is_certified_and_better_than_its_best_random_candidate(criterion: str) -> None:
    found = designed(replace(SMALL, criterion=criterion))
    assert certify_flight(found.trajectory, box()) == found.certificate
    assert found.certificate.ok
    assert not found.certificate.at_rest
    assert found.value > found.baseline
    assert found.value == found.found.max()
    assert found.criterion == criterion
    assert found.reference == "uniform feasible flights"
    assert found.deviation_after < found.deviation_before
    assert found.evaluations > 12


def test_the_same_seed_designs_the_same_flight_and_another_seed_another() -> None:
    quick = replace(SMALL, candidates=4, starts=1, steps=8)
    one, again, other = designed(quick), designed(quick), designed(quick, seed=1)
    assert one.trajectory == again.trajectory
    assert one.trajectory != other.trajectory


def test_under_tilt_thrust_and_cylinder() -> None:
    limits = {"tilt": 0.08, "thrust": (9.0, 10.5), "radius": 6.0}
    found = designed(replace(SMALL, criterion="mean_variance", starts=2), **limits)
    assert certify_flight(found.trajectory, box(**limits)).ok
    assert found.value > found.baseline
    # it comes near a limit: more motion is more variance
    assert found.certificate.worst.use > 0.9


def test_a_family_at_rest() -> None:
    family = FlightFamily(harmonics=3, rest=True, free_centre=True)
    found = design_flight(flight_model(), box(), family, SMALL, np.random.default_rng(0))
    assert found.certificate.at_rest
    assert found.certificate.ok


def test_finite_differences_reach_the_same_value_with_many_more_evaluations() -> None:
    one = replace(SMALL, candidates=6, starts=1, criterion="mean_variance", steps=60)
    exact, thesis = designed(one), designed(replace(one, method="finite_differences"))
    assert thesis.value == pytest.approx(exact.value, rel=0.02)
    assert thesis.evaluations > 3 * exact.evaluations


def test_the_forecast_is_what_conditioning_on_the_planned_samples_gives() -> None:
    model = flight_model(outputs=1)
    intended = uniform_intended(np.random.default_rng(5), feasible_flights(box(), FAMILY), FAMILY, 4)
    found = design_flight(model, box(), FAMILY, SMALL, np.random.default_rng(0), intended, DRAG)
    posterior = model.posteriors[0]
    t = FAMILY.duration * (np.arange(20) + 0.5) / 20
    planned = model.features.transform(flat_motion(motion_of(found.trajectory, t), DRAG).states)
    noises = np.concatenate(
        [np.full(40, posterior.noise_variance), np.full(20, posterior.noise_variance / 15)]
    )
    X = np.concatenate([posterior.X, planned])
    grid = np.linspace(0.0, 30.0, 40)
    R = np.concatenate(
        [model.features.transform(flat_motion(motion_of(f, grid), DRAG).states) for f in intended.flights]
    )
    kernel, theta = posterior.kernel, posterior.theta
    cross = kernel.value(theta, R, X)
    K = kernel.value(theta, X, X) + np.diag(noises)
    after = kernel.diagonal(theta, R) - np.einsum("rn,nr->r", cross, np.linalg.solve(K, cross.T))
    rng = np.random.default_rng(0)
    objective = flight_objective(model, box(), FAMILY, SMALL, rng, intended, DRAG)
    chosen = FAMILY.parameters(found.trajectory.coefficients)
    assert found.value == pytest.approx(objective.value(chosen), rel=1e-9)
    # other states of the same flights: equal but for the sampling of a mean
    assert found.deviation_after == pytest.approx(np.sqrt(after.mean()), rel=0.05)


def test_intended_flights_are_what_a_reference_criterion_looks_at() -> None:
    points = uniform_parameters(np.random.default_rng(2), feasible_flights(box(), FAMILY), 2, 50)
    intended = IntendedFlights("survey", tuple(FAMILY.trajectory(p) for p in points))
    found = design_flight(flight_model(), box(), FAMILY, SMALL, np.random.default_rng(0), intended, DRAG)
    assert found.reference == "survey"


@pytest.mark.parametrize("limits", [{}, {"speed": 0.7}, {"radius": 3.0, "speed": 2.0}])
@pytest.mark.parametrize("steps", [1, 12])
def test_a_search_from_outside_ends_inside(limits, steps: int) -> None:
    feasible, rng = feasible_flights(box(**limits), FAMILY), np.random.default_rng(0)
    intended = uniform_intended(rng, feasible, FAMILY, 4)
    objective = flight_objective(flight_model(), box(), FAMILY, SMALL, rng, intended, DRAG)
    outside = feasible.centre + 3.0 * (uniform_parameters(rng, feasible)[0] - feasible.centre)
    assert not feasible.contains(outside)
    end = refine_flight(objective, feasible, outside, criterion="log_ivr", steps=steps)
    assert feasible.contains(end.parameters)
    assert end.value == objective.value(end.parameters)


class Slope:
    """A linear function of the parameters instead of a criterion."""

    def __init__(self, gradient: np.ndarray) -> None:
        self.gradient = gradient

    def value(self, parameters: np.ndarray) -> float:
        return float(self.gradient @ parameters)

    def value_and_gradient(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        return self.value(parameters), self.gradient


@pytest.mark.parametrize("method", ["gradient", "finite_differences"])
def test_the_search_finds_the_optimum_where_it_is_known(method) -> None:
    """Linear programming on box and lift alone; under a tight speed limit no feasible flight is better."""
    rng = np.random.default_rng(4)
    for seed in range(3):
        slope = Slope(np.random.default_rng(seed).standard_normal(FAMILY.size))
        options = {"criterion": "mean_variance", "steps": 60, "method": method}
        wide = feasible_flights(box(speed=100.0), FAMILY)
        rows = np.concatenate([wide.slabs, -wide.slabs])
        ends = np.concatenate([1.0 + wide.middle, 1.0 - wide.middle])
        best = linprog(-slope.gradient, A_ub=rows, b_ub=ends, bounds=(None, None))
        start = uniform_parameters(rng, wide, 1, 50)[0]
        assert refine_flight(slope, wide, start, **options).value == pytest.approx(-best.fun, rel=1e-4)
        slow = feasible_flights(box(speed=1.0), FAMILY)
        start = uniform_parameters(rng, slow, 1, 50)[0]
        end = refine_flight(slope, slow, start, **options)
        # at an optimum every feasible direction leads down; and it is on the edge
        others = boundary_parameters(rng, slow, 400) - end.parameters
        assert (others @ slope.gradient).max() < 1e-3 * abs(end.value)
        assert slow.furthest(end.parameters - slow.centre) == pytest.approx(1.0, abs=1e-4)
        ahead = slow.shrink(end.parameters + 0.1 * slope.gradient)
        assert slope.value(ahead) <= end.value * (1.0 + 1e-4)


def test_without_searches_the_best_random_flight_is_proposed() -> None:
    found = designed(replace(SMALL, starts=0))
    assert found.value == found.baseline
    assert found.evaluations == 12
    assert found.certificate.ok


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"margin": 3.0}, "margins of 3 m"), ({"speed": 0.0}, "speed limit"), ({"radius": 0.4}, "margin")],
)
def test_infeasible_limits_are_refused(changes, message: str) -> None:
    with pytest.raises(UnsafeTrajectoryError, match=message):
        designed(**changes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "d_opt"}, "no criterion 'd_opt' for flights"),
        ({"criterion": "best"}, "no criterion"),
        ({"method": "guess"}, "method"),
        ({"points": 0}, "points must be"),
        ({"inducing": 0}, "inducing must be"),
        ({"starts": 101}, "starts"),
        ({"steps": -1}, "steps"),
    ],
)
def test_bad_options(options, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        FlightDesignConfig(**options)
