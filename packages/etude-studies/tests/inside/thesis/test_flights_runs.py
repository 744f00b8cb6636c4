"""The runs of chapter 5: what all arms of a seed share, exactness of what is grown, figures counted again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import lru_cache

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm, spearmanr

from etude.campaign import CampaignConfig, preset_config
from etude.models import ExactGP, SquaredExponential
from etude.types import Array
from etude_quadrotor import KIND, QuadrotorInputs
from etude_studies.flight_world import SAMPLERS
from etude_studies.measured import comparable, measured_table
from etude_studies.thesis import flight_members, flight_tests
from etude_studies.thesis.flight_measures import (
    PARTS,
    by_command,
    coverage_figures,
    means_at,
    own_figures,
    variances_at,
)
from etude_studies.thesis.flight_rounds import FIRST, Round, between_ground, extended, first_round, rounds
from etude_studies.thesis.flight_settings import FlightSettings, Learning, Place, flights_of
from etude_studies.thesis.flight_tests import FlightSet, flown_tests
from etude_studies.thesis.flights import FLIGHT_RUNS, flight_traces, run_flights

SEED = 3
STEPS = 5
"""Of the training, which is not what is tested."""
IDS = ["Q1", "Q2", "Q3", "Q4", "Q5", "Q6u", "Q6d", "Q7u", "Q7d", "Q8u", "Q8d"]
IDS += ["P1", "P2", "P3", "P4", "P6u", "P6d", "P5u", "P5d"]


@pytest.fixture(scope="module", autouse=True)
def _hardly_trained() -> Iterator[None]:
    caches = (first_round, flight_tests._flown_tests, flight_tests.extreme_flights, flight_tests.reference)
    whole = Learning.config.fget

    def quick(learning: Learning) -> CampaignConfig:
        config = whole(learning)
        return replace(config, model=replace(config.model, steps=STEPS))

    for cache in caches:
        cache.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Learning, "config", property(quick))
        yield
    for cache in caches:
        cache.cache_clear()


def small(run: str) -> FlightSettings:
    """Few flights and tests, and a design that hardly searches; none is extreme, which takes many designs."""
    settings = FLIGHT_RUNS[run][1]
    return replace(settings, flights=2, candidates=2, refine=1, steps=3, points=15, tests=(2, 1, 0))


@lru_cache(maxsize=20)
def table(run: str, seed: int = SEED) -> pl.DataFrame:
    return comparable(measured_table(run_flights(small(run), seed, {}), run))


@lru_cache(maxsize=4)
def played(run: str) -> list[Round]:
    return list(rounds(small(run), SEED))


def value(
    found: pl.DataFrame, measure: str, k: int, test: str = "uniform", part: str = "mean", line: str = ""
) -> float:
    keys = {"measure": measure, "k": k, "test": test, "part": part, "model": line}
    (row,) = found.filter(*(pl.col(name) == own for name, own in keys.items())).rows()
    return float(row[-1])


def test_every_run_of_the_chapter_is_there_and_survives_json() -> None:
    assert list(FLIGHT_RUNS) == IDS
    assert len({words for words, _ in FLIGHT_RUNS.values()}) == len(IDS)
    assert len({settings for _, settings in FLIGHT_RUNS.values()}) == len(IDS)
    for _, settings in FLIGHT_RUNS.values():
        assert FlightSettings(**json.loads(json.dumps(asdict(settings)))) == settings


def test_the_same_seed_gives_the_same_rows_and_another_seed_others() -> None:
    again = comparable(measured_table(run_flights(asdict(small("Q4")), SEED, {}), "Q4"))
    assert again.equals(table("Q4"))
    other = table("Q4", SEED + 1)
    assert value(other, "mae", 1) != value(table("Q4"), "mae", 1)


@pytest.mark.parametrize(("run", "other"), [("Q1", "Q4"), ("Q1", "Q2"), ("P1", "P2")])
def test_all_arms_of_a_seed_begin_with_one_flight_and_sit_the_same_tests(run: str, other: str) -> None:
    one, two = table(run), table(other)
    first = pl.col("k") == 1
    assert one.filter(first).equals(two.filter(first))
    assert value(one, "speed", 2, "") != value(two, "speed", 2, "")
    if run == "Q1":  # the nominal model learns nothing, so its error tells the tests apart
        for test in ("uniform", "boundary", "single", "fresh"):
            assert value(one, "mae", 2, test, line="nominal") == value(two, "mae", 2, test, line="nominal")


def test_full_regression_beside_other_members_is_that_of_the_same_flights() -> None:
    settings = {**asdict(small("Q1")), "members": ["exact", "dictionary_error"], "after": [2]}
    found = measured_table(flight_members.run(settings, SEED, {}), "Y5")
    for test in ("uniform", "boundary"):
        for part in ("mean", *PARTS["quadrotor"]):
            own = value(table("Q1"), "mae", 2, test, part)
            assert value(found, "mae", 2, test, part, "exact") == pytest.approx(own, rel=1e-6)
    assert value(found, "mae", 2, line="dictionary_error") != value(found, "mae", 2, line="exact")


def test_a_floor_changes_the_model_and_neither_flights_nor_tests() -> None:
    plain, floored = table("Q1"), table("Q6u")
    for measure, test, line in (("speed", "", ""), ("mae", "uniform", "linear"), ("mae", "fresh", "nominal")):
        assert value(plain, measure, 2, test, line=line) == value(floored, measure, 2, test, line=line)
    assert value(floored, "z2", 2) < value(plain, "z2", 2)
    for motor in PARTS["quadrotor"]:
        assert value(floored, "noise_sd", 1, "", motor) > value(plain, "noise_sd", 1, "", motor)


def test_other_limits_make_other_flights_and_tests() -> None:
    fast, slow, waves = (table(run) for run in ("Q1", "Q7u", "Q8u"))
    nominal = [value(found, "mae", 1, line="nominal") for found in (fast, slow, waves)]
    assert len(set(nominal)) == 3
    slowest = flights_of(small("Q7u").place)
    for parameters in (
        first_round(small("Q7d").learning, SEED).parameters[0],
        played("Q7d")[-1].parameters[-1],
    ):
        motion = slowest.family.trajectory(parameters).motion(np.linspace(0.0, 30.0, 3001), 2)
        assert np.linalg.norm(motion.orders[1], axis=1).max() <= 3.0


@pytest.mark.parametrize("run", ["Q1", "P1"])
def test_a_model_that_is_extended_is_the_one_that_a_campaign_trains(run: str) -> None:
    first, last, *_ = played(run)
    world = flights_of(small(run).place).world
    rng = np.random.default_rng(1)
    whole = world.learned(last.samples, small(run).learning.config.model, rng, first.model).model
    test = flown_tests(small(run), SEED).sets["uniform"].samples.log
    X, (mean, variance) = last.model.inputs.of_log(test), whole.posterior(test)
    np.testing.assert_allclose(means_at(last.model, X), mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(variances_at(last.model, X)[1], variance, rtol=1e-7)


def test_points_that_repeat_are_left_to_a_factor_made_at_once() -> None:
    """Without noise the corner is singular; the whole factor then adds what it needs, and says so."""
    X = np.linspace(0.0, 1.0, 5)[:, None]
    known = ExactGP(SquaredExponential((0,)), np.zeros(2), -40.0).condition(X[:1], np.zeros(1))
    with pytest.warns(UserWarning, match="added"):
        found = extended(known, np.repeat(X, 2, axis=0), np.zeros(10))
    assert found.jitter > 0.0
    assert np.isfinite(found.predict(X)[1]).all()


def test_figures_of_a_set_are_those_counted_by_hand() -> None:
    settings, last = small("Q1"), played("Q1")[-1]
    test = flown_tests(settings, SEED).sets["uniform"]
    X, command = last.model.inputs.of_log(test.samples.log), test.command
    mean, (latent, noisy) = means_at(last.model, X), variances_at(last.model, X)
    error, use = command - mean, test.judged
    found = dict(own_figures(last.model, test))
    flights = [test.samples.group == i for i in (0, 1)]
    np.testing.assert_allclose(found["mae"], np.mean([np.abs(error[own]).mean(0) for own in flights], axis=0))
    late = [np.abs(error[own & (test.samples.t >= 5.0)]).mean(0) for own in flights]
    np.testing.assert_allclose(found["mae_late"], np.mean(late, axis=0))
    np.testing.assert_allclose(found["variance"], latent[use].mean(0))
    np.testing.assert_allclose(found["deviation"], np.sqrt(latent[use]).mean(0))
    sd = np.sqrt(noisy[use])
    np.testing.assert_allclose(found["z2"], ((error[use] / sd) ** 2).mean(0))
    for name, quantile in (("coverage68", 1.0), ("coverage95", norm.ppf(0.975))):
        inside = [(abs(e) <= quantile * s).mean() for e, s in zip(error[use].T, sd.T, strict=True)]
        np.testing.assert_allclose(found[name], inside)
    np.testing.assert_allclose(found["nlpd"], -norm.logpdf(command[use], mean[use], sd).mean(0))
    ranks = [spearmanr(s, abs(e)).statistic for s, e in zip(sd.T, error[use].T, strict=True)]
    np.testing.assert_allclose(found["spearman"], ranks)


def test_variances_are_judged_at_times_that_are_as_far_apart_as_asked() -> None:
    settings = small("Q1")
    tests = flown_tests(settings, SEED)
    several, alone = tests.sets["uniform"], tests.sets["single"]
    for flight in (0, 1):
        t = several.samples.t[several.judged][several.samples.group[several.judged] == flight]
        np.testing.assert_allclose(np.diff(t), 2.0)
    assert len(alone.judged) == len(alone.samples) == 300
    assert len(tests.fresh) == settings.flights


def test_commands_of_different_units_are_averaged_over_their_deviations() -> None:
    unit, values = np.array([1.0, 2.0, 4.0, 8.0]), np.array([1.0, 4.0, 4.0, 16.0])
    given = [("mae", values), ("variance", values**2), ("z2", values), ("nlpd", values)]
    rows = {
        row.measure: row.value
        for row in by_command("pelican", unit, 1, "single", "", iter(given))
        if row.part == "mean"
    }
    assert rows["mae"] == pytest.approx((1 + 2 + 1 + 2) / 4)
    assert rows["variance"] == pytest.approx((1 + 4 + 1 + 4) / 4)
    assert rows["z2"] == pytest.approx(values.mean())
    # a density of y/s is s times that of y
    assert rows["nlpd"] == pytest.approx(np.mean(values - np.log(unit)))
    found = table("P1")
    assert value(found, "mae", 1, "single", "thrust") < 0.1 < value(found, "mae", 1, "single") < 2.0


def test_gaps_are_the_distances_to_the_nearest_sample() -> None:
    data, scale = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([2.0, 1.0])
    states = np.array([[0.0, 1.0], [4.0, 3.0], [2.0, 0.0]])
    found = dict(coverage_figures(data, states, scale))
    assert found["fill"] == 3.0
    assert found["gap95"] == pytest.approx(np.quantile([1.0, 3.0, 1.0], 0.95))


def test_more_flights_leave_smaller_gaps_and_a_flight_ahead_is_judged_before_it_is_learned() -> None:
    found = table("Q1")
    assert value(found, "fill", 2, "") <= value(found, "fill", 1, "")
    first, second = played("Q1")
    flight = FlightSet(second.samples.take(second.samples.group == 1), 0.5)
    predicted = means_at(first.model, first.model.inputs.of_log(flight.samples.log))
    assert value(found, "ahead_mae", 2, "") == pytest.approx(
        np.abs(flight.command - predicted).mean(), rel=1e-5
    )


def test_the_linear_line_is_ridge_regression_on_standardised_columns() -> None:
    found, last, test = table("Q1"), played("Q1")[1], flown_tests(small("Q1"), SEED).sets["single"]
    X, y = last.model.inputs.of_log(last.samples.log), last.samples.command
    Z, new = ((rows - X.mean(0)) / X.std(0) for rows in (X, last.model.inputs.of_log(test.samples.log)))
    # a ridge of 0.1 n on the Gram matrix is ten more samples of size sqrt(0.1 n) that say nothing
    more = np.concatenate([Z, np.sqrt(0.1 * len(Z)) * np.eye(10)])
    weights = np.linalg.lstsq(more, np.concatenate([y - y.mean(0), np.zeros((10, 4))]), rcond=None)[0]
    error = np.abs(test.command - y.mean(0) - new @ weights).mean()
    assert value(found, "mae", 2, "single", line="linear") == pytest.approx(error, rel=1e-5)


def test_inputs_of_the_two_vehicles_are_those_of_the_text() -> None:
    names = {
        place.preset: flights_of(place).world
        for place in (Place("quadrotor", "literal", None, 2), Place("pelican", "pelican", None, 2))
    }
    literal, pelican = (world.kind.inputs(world.spec, world.config) for world in names.values())
    assert literal == QuadrotorInputs(
        altitude=True, acceleration="kinematic", body_velocity=False, battery_voltage=False
    )
    assert pelican == QuadrotorInputs(
        altitude=True, acceleration="specific_force", body_velocity=False, battery_voltage=False
    )
    assert len(literal.columns) == 10
    spec = names["pelican"].spec
    assert (spec.radius, spec.margin, spec.upper[2], spec.speed, spec.rate) == (1.5, 0.0, 2.0, 1.5, 20.0)


@pytest.mark.parametrize(("preset", "flights", "samples"), [("literal", 10, 300), ("pelican", 6, 600)])
def test_presets_are_the_protocol_as_printed(preset: str, flights: int, samples: int) -> None:
    config = preset_config(KIND, preset)
    model = config.model
    assert (model.sharing, model.noise_floor, model.schedule, model.prior) == (
        "separate",
        0.0,
        "first",
        "none",
    )
    assert (model.fit_points, model.points) == (samples, flights * samples)
    assert (config.trajectory.start, config.trajectory.harmonics, config.trajectory.duration) == (
        "hover",
        2,
        30.0,
    )
    assert (config.data.averaged, config.design.criterion, config.design.points) == (
        False,
        "mean_variance",
        300,
    )


def test_the_angular_acceleration_of_the_pelican_is_that_of_its_gyroscope() -> None:
    (log,) = first_round(small("P1").learning, SEED).logs
    place, name = small("P1").place, "angular_acceleration"
    found = place.samples(log).log[name]
    told = replace(log, values={**log.values, name: np.zeros_like(log[name])})
    np.testing.assert_array_equal(found, place.samples(told).log[name])
    turned = np.cumsum(found, axis=0) / 20.0
    assert np.corrcoef(turned[:, 0], log["rates"][:, 0])[0, 1] > 0.8
    (log,) = first_round(small("Q1").learning, SEED).logs
    np.testing.assert_array_equal(small("Q1").place.samples(log).log[name], log[name])


def test_traces_are_those_of_the_arm() -> None:
    settings = small("P2")
    found = flight_traces(settings, SEED, flights=2)
    last, test = list(rounds(settings, SEED))[-1], flown_tests(settings, SEED).sets["single"]
    assert found["desired"].shape == found["flown"].shape == (300, 3)
    np.testing.assert_array_equal(found["flown"], last.logs[1]["position"][::2])
    assert _rms(found["desired"] - found["flown"]) < 0.5
    assert {len(found[name]) for name in ("t", "actual", "mean", "deviation", "deviation_noisy")} == {300}
    np.testing.assert_array_equal(found["actual"], test.command[::2, 3])
    assert (found["deviation_noisy"] > found["deviation"]).all()
    error = np.abs(found["mean"] - found["actual"]).mean()
    assert error == pytest.approx(value(table("P2"), "mae", 2, "single", "thrust"), rel=0.2)


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def test_extreme_flights_are_those_designed_for_other_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_tests, "EXTREME_SEEDS", (1_000_000,))
    monkeypatch.setattr(flight_tests, "EXTREME_FLIGHTS", 2)
    place = small("Q1").place
    pool, flights = flight_tests.extreme_flights(place), flights_of(place)
    assert [len(own) for own in pool.values()] == [1, 1]
    designed = [own[0] for own in pool.values()]
    assert not np.allclose(*designed)
    assert all(flights.feasible.contains(own) for own in designed)
    given = flown_tests(replace(small("Q1"), tests=(1, 0, 2)), SEED)
    assert set(given.sets) == {"uniform", "extreme", "single"}
    assert len(np.unique(given.sets["extreme"].samples.group)) == 2


def test_a_first_flight_from_the_ground_is_the_same_flight_between_take_off_and_landing() -> None:
    flights = flights_of(FLIGHT_RUNS["P6u"][1].place)
    parameters = SAMPLERS["uniform"](np.random.default_rng([SEED, FIRST]), flights.feasible)[0]
    alone = flights.family.trajectory(parameters)
    whole = between_ground(flights, alone)
    labels = [label for _, label, _ in whole.pieces()]
    assert labels == ["take-off", "approach", "segment", "return", "landing"]
    began = next(start for start, label, _ in whole.pieces() if label == "segment")
    t = np.linspace(0.0, alone.duration, 50)[1:-1]
    np.testing.assert_allclose(whole.motion(began + t).orders, alone.motion(t).orders, atol=1e-9)
    (log,) = flights.flown([whole], np.random.default_rng(0))
    height = log["position"][:, 2]
    contact = flights.robot.vehicle.parameters.contact_height
    assert max(height[0], height[-1]) < contact + 0.2 < alone.motion(t).orders[0, :, 2].min()


def test_settings_without_take_off_are_what_they_were() -> None:
    ground, other = FLIGHT_RUNS["P6d"][1], FLIGHT_RUNS["P2"][1]
    assert replace(ground, from_ground=False) == other
    assert ground.recorded == {**other.recorded, "from_ground": True}
    assert "from_ground" not in other.recorded


@pytest.mark.slow
def test_later_flights_stay_in_the_air() -> None:
    first, second = played("P6u")
    assert first.logs[0].t[-1] > second.logs[1].t[-1] + 10.0
    np.testing.assert_array_equal(second.logs[1]["position_des"], played("P1")[1].logs[1]["position_des"])
