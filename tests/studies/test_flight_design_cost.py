from __future__ import annotations

import numpy as np

from etude.design.flight.config import FlightDesignConfig
from etude_studies.flight_design_cost import DRAG, design_rows, known_flights, thesis_room
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import uniform_parameters


def test_rows() -> None:
    small = FlightDesignConfig(points=10, reference_points=20, inducing=30, candidates=6, starts=1, steps=8)
    rows = {row.metric: row for row in design_rows(np.random.default_rng(0), small, starts=1)}
    assert set(rows) == {"design_cpu_s", "design_value", "design_gradient_speedup", "design_gradient_value"}
    assert rows["design_cpu_s"].value > 0.0
    assert rows["design_value"].value >= rows["design_value"].reference_value
    assert np.isclose(rows["design_gradient_value"].ratio, 1.0, rtol=0.1)


def test_the_model_has_seen_its_flights_and_not_others() -> None:
    spec, family, rng = thesis_room(), FlightFamily(), np.random.default_rng(0)
    model = known_flights(rng, spec, family, 2)
    posterior = model.posteriors[0]
    assert len(posterior.X) == 600
    assert np.abs(np.ptp(posterior.X, axis=0) - 2.0).max() < 1e-12
    other = family.trajectory(uniform_parameters(rng, feasible_flights(spec, family))[0])
    X = model.features.transform(flat_motion(motion_of(other, np.linspace(0.0, 30.0, 50)), DRAG).states)
    assert posterior.predict(X)[1].mean() > 10.0 * posterior.predict(posterior.X[::12])[1].mean()
