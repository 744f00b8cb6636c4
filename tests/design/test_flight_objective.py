from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from design_examples import assert_same, differences
from flight_design_examples import DRAG, Columns, box, flight_model

from etude.design.criteria import Output, info_gain, value_of
from etude.design.flight.config import FLIGHT_CRITERIA, FlightDesignConfig
from etude.design.flight.objective import FlightObjective
from etude.design.flight.posterior import PlannedPosterior, distinct, fast_posterior, planned_posteriors
from etude.design.flight.reference import IntendedFlights, flight_reference, uniform_intended
from etude.design.flight.solve import flight_objective
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.samplers import uniform_parameters

FAMILIES = {
    "thesis": FlightFamily(),
    "rest, free centre": FlightFamily(harmonics=4, rest=True, free_centre=True, omega0=4.0 * math.pi / 30.0),
}
KINEMATIC = Columns(("altitude", "acceleration", "rates", "angular_acceleration"))
SMALL = FlightDesignConfig(points=15, reference_points=20, inducing=30)


def aim(criterion: str, family: FlightFamily, columns: Columns, drag=DRAG) -> FlightObjective:
    rng = np.random.default_rng(3)
    config = replace(SMALL, criterion=criterion)
    intended = uniform_intended(rng, feasible_flights(box(), family), family, 4)
    return flight_objective(flight_model(columns), box(), family, config, rng, intended, drag)


@pytest.mark.parametrize("criterion", FLIGHT_CRITERIA)
@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
@pytest.mark.parametrize("columns", [Columns(), KINEMATIC], ids=["specific force", "kinematic"])
def test_gradient_in_the_parameters(criterion: str, family: FlightFamily, columns: Columns) -> None:
    objective = aim(criterion, family, columns)
    at = uniform_parameters(np.random.default_rng(1), feasible_flights(box(), family), 1, 50)[0]
    value, gradient = objective.value_and_gradient(at)
    assert value == pytest.approx(objective.value(at), rel=1e-12)
    assert_same(gradient, differences(objective.value, at, 1e-4))


def test_without_drag_too_and_it_matters() -> None:
    family = FAMILIES["thesis"]
    at = uniform_parameters(np.random.default_rng(1), feasible_flights(box(), family), 1, 50)[0]
    plain, dragged = (aim("ivr", family, Columns(), drag) for drag in ((0.0, 0.0, 0.0), DRAG))
    assert_same(plain.value_and_gradient(at)[1], differences(plain.value, at, 1e-4))
    assert plain.value(at) != pytest.approx(dragged.value(at), rel=1e-3)


def test_planned_samples_stand_for_all_that_are_logged() -> None:
    """15 planned samples for 300 logged: each with a twentieth of the noise."""
    objective, model = aim("info_gain", FAMILIES["thesis"], Columns()), flight_model()
    for output, posterior in zip(objective.outputs, model.posteriors, strict=True):
        assert output.posterior.noise_variance == pytest.approx(posterior.noise_variance * 15 / 300)
    at = uniform_parameters(np.random.default_rng(1), feasible_flights(box(), FlightFamily()), 1, 50)[0]
    X = objective.inputs(at)
    assert len(X) == 15
    # the same posterior with less noise; without the 40 points' approximation by 30
    expected = 0.0
    for output in objective.outputs:
        inner = output.posterior.posterior
        S = inner.covariance(X, X) / output.posterior.noise_variance + np.eye(15)
        expected += 0.5 * np.linalg.slogdet(S)[1]
    assert objective.value(at) == pytest.approx(expected, rel=1e-9)


def test_outputs_of_a_shared_kernel_count_once() -> None:
    first, second = flight_model().posteriors
    twin = replace(first, y=-first.y, alpha=-first.alpha)
    assert distinct([first, twin, second, twin]) == [first, second]
    assert len(planned_posteriors([first, twin, first, twin], 0.25, 300)) == 1


def test_a_posterior_seen_through_its_most_telling_samples() -> None:
    exact = flight_model(points=200, outputs=1).posteriors[0]
    assert fast_posterior(exact, 200) is exact
    X = exact.X[::3] + 0.05
    before = exact.predict(X)[1]
    errors = []
    for count in (20, 60, 199):
        fast = fast_posterior(exact, count)
        assert fast.noise_variance == pytest.approx(exact.noise_variance)
        errors.append(np.abs(fast.predict(X)[1] - before).max() / exact.signal_variance)
    assert errors[2] < 1e-4
    assert errors[0] > errors[1] > errors[2]
    assert fast_posterior(fast, 5) is fast


def test_a_posterior_that_keeps_the_bare_contract() -> None:
    """Without shared factors the criteria use covariances alone."""

    class Bare:
        def __init__(self, inner) -> None:
            self.noise_variance, self.signal_variance = inner.noise_variance, inner.signal_variance
            for name in (
                "predict",
                "covariance",
                "covariance_gradient",
                "variance_gradient",
                "mean_gradient",
            ):
                setattr(self, name, getattr(inner, name))

    inner = flight_model(outputs=1).posteriors[0]
    X = inner.X[:5] + 0.1
    gains, kept = np.ones((5, 1)), [PlannedPosterior(p, 0.01) for p in (inner, Bare(inner))]
    values = [value_of(info_gain, [Output.of(p, X[:0])], X, gains) for p in kept]
    assert values[0] == pytest.approx(values[1])
    np.testing.assert_allclose(PlannedPosterior(inner, 0.1).mean_gradient(X), inner.mean_gradient(X))


def test_reference_states_are_spread_over_the_named_flights() -> None:
    family, rng = FAMILIES["thesis"], np.random.default_rng(0)
    points = uniform_parameters(rng, feasible_flights(box(), family), 3, 50)
    intended = IntendedFlights("inspection", tuple(family.trajectory(p) for p in points))
    reference = flight_reference(rng, Columns(), intended, 30, DRAG)
    assert reference.shape == (30, 13)
    assert len(np.unique(reference[:, 0])) == 30
    assert flight_reference(rng, Columns(), intended, 1, DRAG).shape == (3, 13)
    with pytest.raises(UsageError, match="'nothing' is empty"):
        IntendedFlights("nothing", ())
    falling = np.array(intended.flights[0].coefficients)
    falling[3, 2] = 2000.0
    steep = IntendedFlights("steep", (replace(intended.flights[0], coefficients=falling),))
    with pytest.raises(UnsafeTrajectoryError, match=r"at .* s"):
        flight_reference(rng, Columns(), steep, 30)
