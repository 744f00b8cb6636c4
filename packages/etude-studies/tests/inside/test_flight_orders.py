from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_orders import made_up

from etude.design import DesignConfig
from etude.errors import UsageError
from etude.trajectories import FourierTrajectory
from etude_studies import flight_orders
from etude_studies.flight_orders import EXTREME_SEEDS, Cell, designed_flights, extreme_cell, ordinary_cell
from etude_studies.flight_orders_cell import (
    EXTREME,
    Effort,
    cell_measures,
    first_round,
    flown_tests,
    intended_flights,
    mean_speed,
    rounds,
    some_extremes,
)
from etude_studies.flight_orders_judge import Judge, Round, known_by
from etude_studies.flight_orders_world import PRESETS, World

SMALL = Effort(
    arms=("uniform", "mean_variance"),
    flights=2,
    longer=0,
    tests={"uniform": 2, "boundary": 1, "extremes": 2},
    points=120,
    design=DesignConfig(
        sampler="uniform",
        points=10,
        planned_noise=True,
        reference_points=20,
        inducing=30,
        candidates=4,
        refine=1,
        steps=3,
    ),
)
PRESET = "thesis"


@pytest.fixture(scope="module")
def extremes() -> dict[str, list[Any]]:
    found = designed_flights(Cell(PRESET, EXTREME_SEEDS[0]), SMALL, flights=2)["flights"]
    return {name: [np.array(flight) for flight in found[name]] for name in EXTREME}


@pytest.fixture(scope="module")
def cell(extremes: dict[str, list[Any]]) -> dict[str, Any]:
    return cell_measures(PRESET, 3, extremes, SMALL)


@pytest.fixture(scope="module")
def world() -> World:
    return World.of("clean", 600)


@pytest.fixture(scope="module")
def taught(world: World) -> list[Round]:
    first = first_round(world, 3, every_kind=False)
    return [first, *rounds(world, 3, "mean_variance", first, 2, SMALL, every_kind=False)]


def test_arms_share_the_first_flight_and_the_tests(cell: dict[str, Any]) -> None:
    uniform, designed = cell["measured"]["uniform"], cell["measured"]["mean_variance"]
    assert uniform["1"] == designed["1"]
    assert uniform["2"] != designed["2"]
    for kind in ("nominal",):  # learns nothing, so its errors tell whether the tests are the same
        for name in SMALL.tests:
            errors = {own["2"]["tests"][name][kind]["mae"] for own in (uniform, designed)}
            assert len(errors) == 1
    assert cell["speed"]["uniform"][0] == cell["speed"]["mean_variance"][0]


def test_an_arm_does_not_depend_on_the_others(cell: dict[str, Any], extremes: dict[str, list[Any]]) -> None:
    alone = cell_measures(PRESET, 3, extremes, replace(SMALL, arms=("mean_variance",)))
    assert alone["measured"]["mean_variance"] == cell["measured"]["mean_variance"]


def test_figures_are_numbers_or_nothing(cell: dict[str, Any]) -> None:
    json.dumps(cell, allow_nan=False)
    scores = cell["measured"]["uniform"]["2"]["tests"]["uniform"]
    assert {"gp", "identified", "identified+gp", "nominal", "linear", "ladder"} <= set(scores)
    chosen = cell["measured"]["uniform"]["2"]["chosen"]
    assert chosen == "mixed" or scores["ladder"] == scores[chosen]


def test_other_seeds_have_other_tests(world: World, extremes: dict[str, list[Any]]) -> None:
    small = replace(SMALL, tests={"uniform": 1, "boundary": 1, "extremes": 1})
    one, again, other = (flown_tests(world, seed, extremes, small) for seed in (3, 3, 4))
    for name in small.tests:
        assert np.array_equal(one[name].command, again[name].command)
        assert not np.array_equal(one[name].command, other[name].command)


def test_flights_of_a_criterion_are_drawn_alike() -> None:
    flights = {
        "mean_variance": [np.array([k]) for k in range(5)],
        "info_gain": [np.array([10 + k]) for k in range(5)],
    }
    chosen = [int(own[0]) for own in some_extremes(flights, 6, np.random.default_rng(0))]
    assert len(set(chosen)) == 6
    assert sum(own >= 10 for own in chosen) == 3


def test_more_flights_leave_less_deviation(world: World, taught: list[Round]) -> None:
    # a law under common hyperparameters; refitted ones may say otherwise
    first, second = taught
    judge = Judge.of(world, intended_flights(world, 3), first)
    assert len(known_by(second.process)[0].X) == 600  # nothing thinned out
    assert np.isclose(judge.latent(first), judge.latent_common(first), rtol=1e-6)
    assert judge.latent_common(second) < judge.latent_common(first)


def test_the_first_flight_of_every_arm_is_the_common_one(taught: list[Round]) -> None:
    first, second = taught
    assert second.parameters[0] is first.parameters[0]
    assert second.logs[0] is first.logs[0]
    assert len(second.logs) == 2


def test_mean_speed_of_a_circle(world: World) -> None:
    table = np.zeros((5, 3))
    table[0, 2], table[1, 0], table[3, 1] = 2.0, 4.0, 4.0  # x = 4 sin, y = 4 cos of the first harmonic
    family = world.flights.family
    duration = family.trajectory(np.zeros(family.size)).duration
    omega0 = 2.0 * np.pi / duration
    parameters = family.parameters(FourierTrajectory(table, omega0, duration))
    flight = family.trajectory(parameters).motion(np.linspace(0.0, duration, 7), 1).orders[0]
    radius = np.hypot(flight[:, 0], flight[:, 1])
    assert np.ptp(radius) < 1e-9
    assert np.isclose(mean_speed(world, parameters), radius[0] * omega0)


def test_a_finished_cell_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(*_: Any) -> dict[str, Any]:
        calls.append(1)
        return {"cpu_s": float(len(calls)), "measured": {}}

    monkeypatch.setattr(flight_orders, "cell_measures", counted)
    extremes: dict[str, dict[str, list[Any]]] = {PRESET: {}}
    one = ordinary_cell(Cell(PRESET, 3), tmp_path, SMALL, extremes)
    assert ordinary_cell(Cell(PRESET, 3), tmp_path, SMALL, extremes) == one
    assert len(calls) == 1
    # figures of other settings are not these
    other = ordinary_cell(Cell(PRESET, 3), tmp_path, replace(SMALL, flights=3), extremes)
    assert other["cpu_s"] == 2.0
    assert ordinary_cell(Cell(PRESET, 4), tmp_path, SMALL, extremes)["cpu_s"] == 3.0
    noisy = replace(PRESETS[PRESET], drag_aware=True)
    monkeypatch.setitem(PRESETS, PRESET, noisy)
    assert ordinary_cell(Cell(PRESET, 4), tmp_path, SMALL, extremes)["cpu_s"] == 4.0


def test_extremes_are_of_other_seeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given, designed = {}, []

    def flights(cell: Cell, _: Effort) -> dict[str, Any]:
        designed.append(cell.seed)
        return {"flights": {name: [[float(cell.seed)]] for name in EXTREME}, "cpu_s": 0.0}

    def figures(preset: str, seed: int, extremes: Any, _: Effort) -> dict[str, Any]:
        given[preset, seed] = [float(own[0]) for name in EXTREME for own in extremes[name]]
        return {"cpu_s": 0.0}

    monkeypatch.setattr(flight_orders, "each", lambda work, cells, _: map(work, cells))
    monkeypatch.setattr(flight_orders, "designed_flights", flights)
    monkeypatch.setattr(flight_orders, "cell_measures", figures)
    found = flight_orders.study_cells(range(5, 7), tmp_path, SMALL)
    assert [own["seed"] for own in found["thesis"]] == [5, 6]
    assert set(designed) == set(EXTREME_SEEDS)
    for (_, seed), sources in given.items():
        assert set(sources) == set(EXTREME_SEEDS)
        assert seed not in sources
    designed.clear()
    flight_orders.study_cells(range(5, 8), tmp_path, SMALL)
    assert designed == []
    assert len(given) == 3 * len(PRESETS)
    assert extreme_cell(Cell("clean", EXTREME_SEEDS[1]), tmp_path, SMALL)["flights"]["info_gain"] == [
        [1_000_001.0]
    ]


def test_seeds_of_extreme_tests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="kept for the extreme tests"):
        flight_orders.study_cells(range(999_999, 1_000_001), tmp_path, SMALL)
    with pytest.raises(UsageError, match="2 seeds"):
        flight_orders.run(json=True, seed=0, seeds=1, folder=tmp_path)


def test_the_line_of_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = [made_up(s, lambda *_: 0.01) for s in (0, 1)]
    monkeypatch.setattr(flight_orders, "study_cells", lambda *_: {"thesis": cells, "clean": cells})
    flight_orders.run(json=True, seed=0, seeds=2, folder=tmp_path)
    said = json.loads(capsys.readouterr().out)
    assert said["command"] == "etude study quadrotor --seed 0 --seeds 2"
    names = [row["metric"] for row in said["rows"]]
    assert {"thesis_ivr_vs_random_mae_uniform", "verdict_clean_z2_gp"} <= set(names)
    assert len(names) == len(set(names))
