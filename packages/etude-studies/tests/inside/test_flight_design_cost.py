from __future__ import annotations

import numpy as np

from etude.design import DesignConfig, design_objective
from etude_studies.flight_design_cost import Differenced, design_rows, known_flights
from etude_studies.flight_world import THESIS_ROOM, Flights

SMALL = DesignConfig(
    sampler="uniform", points=10, planned_noise=True, reference_points=20, inducing=30, candidates=6, steps=8
)


def test_rows() -> None:
    rows = {row.metric: row for row in design_rows(np.random.default_rng(0), SMALL, starts=1)}
    assert set(rows) == {"design_cpu_s", "design_value", "design_gradient_speedup", "design_gradient_value"}
    assert rows["design_cpu_s"].value > 0.0
    assert rows["design_value"].reference_value is not None
    assert rows["design_value"].value >= rows["design_value"].reference_value
    ratio = rows["design_gradient_value"].ratio
    assert ratio is not None
    assert np.isclose(ratio, 1.0, rtol=0.1)


def test_differences_agree_with_the_exact_gradient() -> None:
    flights, rng = Flights.of("quadrotor", "low", room=THESIS_ROOM), np.random.default_rng(1)
    model, tasks = known_flights(flights, rng, 1), flights.drawn(rng, 3)
    exact = design_objective(flights.family, model.inputs, model, SMALL, tasks, tasks, rate=10.0).objective
    p = flights.family.parameters(tasks[0])
    (value, gradient), (same, near) = (
        way.value_and_gradient(p) for way in (exact, Differenced(**vars(exact)))
    )
    assert value == same
    assert np.abs(near - gradient).max() < 1e-4 * np.abs(gradient).max()
