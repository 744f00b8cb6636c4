"""Models and ladder of flights: what is held out, what is chosen, calibration, scores, and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from etude.models.flight.config import PRESETS, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.ladder import choose, train_flight_ladder
from etude.models.flight.lesson import HeldOut, fitted_physics, lesson, physics_held_out
from etude.models.flight.model import FlightModel
from etude.models.flight.model_file import load_flight_model, save_flight_model
from etude.models.flight.score import score_flights
from etude.models.flight.training import train_flight_model, train_process
from etude.models.physics.flight_inverse import identify_vehicle
from etude.models.physics.flight_linear import LinearInverse
from inverse_flights import VEHICLE, flights

from etude.errors import DataError, UsageError
from etude.models.gp.exact import ExactGP
from etude.models.gp.shared_exact import condition_shared

SMALL = FlightModelConfig(kind="gp", points=240, fit_points=80, steps=8, starts=1)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def trained(data: FlightDataset, **changes) -> FlightModel:
    return train_flight_model(data, VEHICLE, replace(SMALL, **changes), rng())


@pytest.mark.parametrize("kernel", ["shared", "separate"])
def test_a_process_predicts_a_flight_that_it_has_not_seen(kernel: str) -> None:
    model = trained(flights(3), kernel=kernel, steps=20)
    fresh = flights(1, seed=5)
    score = score_flights(model, fresh)
    assert score.mae[0] < 0.35 * fresh.command.std()
    mean, variance = model.predict(fresh.states)
    assert mean.shape == variance.shape == (len(fresh), 4)
    # a BLAS may add up a product of one column and of four in another order
    np.testing.assert_allclose(model.mean(fresh.states), mean, rtol=1e-13)
    assert len(model.posteriors) == 4
    assert model.shared is (kernel == "shared")
    # far away the process knows nothing but its prior
    away = replace(fresh.states, rates=fresh.states.rates + 1e3)
    far = np.sqrt(model.scale) * model.prior_deviation
    np.testing.assert_allclose(np.sqrt(model.predict(away)[1]), np.tile(far, (len(fresh), 1)), rtol=1e-6)


def test_the_mean_is_the_processes_in_command_units() -> None:
    model = trained(flights(2), kind="identified+gp")
    fresh = flights(1, seed=5)
    X = model.features.transform(fresh.states)
    latent = np.column_stack([posterior.predict(X)[0] for posterior in model.posteriors])
    spread = np.column_stack([p.predict(X)[1] + p.noise_variance for p in model.posteriors])
    mean, variance = model.predict(fresh.states)
    expected = model.analytic(fresh.states) + model.offset + model.deviation * latent
    np.testing.assert_allclose(mean, expected, rtol=1e-10)
    np.testing.assert_allclose(variance, model.scale * model.deviation**2 * spread, rtol=1e-10)


def test_held_out_flights_are_unknown_to_physics_and_process() -> None:
    """Against a model made anew without the flight, at the same hyperparameters."""
    data = flights(3, hard=True)
    own = lesson(data, VEHICLE, SMALL, rng())
    physics, folds = fitted_physics(own, "identified")
    model, held = train_process(own, "identified+gp", SMALL, physics, folds)
    kept = data.take(own.kept)
    test, rest = kept.group == 1, kept.group != 1
    others = data.take(data.group != 1)
    weight = 0.2
    without = identify_vehicle(VEHICLE, others.states, others.command, weight)
    first = model.posteriors[0]
    gp = ExactGP(first.kernel, first.theta, 0.5 * np.log(first.noise_variance))
    X = model.features.transform(kept.states)
    Y = (kept.command - without.predict(kept.states) - model.offset) / model.deviation
    mean, latent = condition_shared(gp, X[rest], Y[rest]).predict(X[test])
    predicted = without.predict(kept.states.take(test)) + model.offset + model.deviation * mean
    np.testing.assert_allclose(held.error[test], kept.command[test] - predicted, atol=1e-8)
    spread = np.outer(latent + first.noise_variance, model.deviation**2)
    np.testing.assert_allclose(held.variance[test], spread, rtol=1e-6)
    bare = physics_held_out(own, folds)
    expected = (kept.command - without.predict(kept.states))[test]
    np.testing.assert_allclose(bare.error[test], expected, atol=1e-12)


def test_variances_are_multiplied_by_what_held_out_flights_show_and_never_shrunk() -> None:
    data = flights(4, hard=True)
    plain, calibrated = trained(data, calibrate=False), trained(data)
    np.testing.assert_array_equal(plain.scale, 1.0)
    own = lesson(data, VEHICLE, SMALL, rng())
    held = train_process(own, "gp", SMALL, *fitted_physics(own, "gp"))[1]
    z2 = np.mean(held.error**2 / held.variance, axis=0)
    np.testing.assert_allclose(calibrated.scale, np.maximum(1.0, z2), rtol=1e-9)
    assert not plain.calibrated
    assert calibrated.calibrated
    assert not trained(flights(3)).calibrated


def test_first_flight_hyperparameters_stay_and_a_refit_moves_them() -> None:
    data = flights(2)
    one = data.take(data.group == 0)
    for hyperparameters, stays in {"first_flight": True, "refit": False}.items():
        config = replace(SMALL, hyperparameters=hyperparameters)
        early = train_flight_model(one, VEHICLE, config, rng())
        late = train_flight_model(data, VEHICLE, config, rng(), early)
        anew = train_flight_model(data, VEHICLE, config, rng())
        same = np.array_equal(early.posteriors[0].theta, late.posteriors[0].theta)
        assert same is stays
        if stays:
            np.testing.assert_array_equal(late.offset, early.offset)
            np.testing.assert_allclose(late.posteriors[0].noise_variance, early.posteriors[0].noise_variance)
            np.testing.assert_allclose(anew.posteriors[0].theta, early.posteriors[0].theta, atol=1.0)
        assert len(late.posteriors[0].X) == SMALL.points


def test_the_noise_never_falls_below_its_floor() -> None:
    assert trained(flights(2, noise=0.0), noise_floor=0.2).processes[0].noise_variance > 0.04
    assert trained(flights(2, noise=0.0), noise_floor=0.0).processes[0].noise_variance < 0.04


def test_the_thesis_preset_has_its_ten_inputs() -> None:
    thesis = PRESETS["thesis"]
    assert thesis.features().width == 10
    model = train_flight_model(flights(2), VEHICLE, replace(thesis, steps=5, fit_points=60), rng())
    assert model.features.acceleration == "kinematic"
    assert not model.calibrated


def test_the_ladder_keeps_physics_where_a_process_has_nothing_to_learn() -> None:
    ladder = train_flight_ladder(flights(3), VEHICLE, replace(SMALL, kind="auto"), rng())
    assert set(ladder.models) == {"gp", "identified+gp", "identified", "nominal"}
    fresh = flights(2, seed=5)
    errors = {kind: score_flights(model, fresh).mae.mean() for kind, model in ladder.models.items()}
    assert errors[ladder.chosen] <= 1.05 * min(errors["identified"], errors["gp"])
    assert errors["identified"] < 0.5 * errors["gp"]
    assert errors["identified"] < 0.5 * errors["nominal"]
    assert ladder.error("identified") == pytest.approx(errors["identified"], rel=0.3)


def test_the_ladder_takes_the_process_where_physics_are_wrong() -> None:
    data = flights(4, hard=True)
    config = replace(SMALL, kind="auto", points=500, fit_points=200, steps=30)
    ladder = train_flight_ladder(data, VEHICLE, config, rng())
    assert ladder.chosen == "identified+gp"
    fresh = flights(2, seed=5, hard=True)
    mae = {kind: score_flights(model, fresh).mae.mean() for kind, model in ladder.models.items()}
    assert mae["identified+gp"] < mae["identified"] / 1.5


def held(errors: list[float]) -> HeldOut:
    e = np.repeat(errors, 2)[:, None] * np.ones(4)
    return HeldOut(e, np.ones_like(e), np.repeat(np.arange(len(errors)), 2))


def test_the_choice_is_never_a_worse_rung() -> None:
    draw = np.random.default_rng(3)
    for _ in range(50):
        scores = {k: held(list(draw.uniform(0.1, 1.0, 3))) for k in ("gp", "identified+gp", "identified")}
        chosen = choose(scores, 3)
        assert all(scores[chosen].mae().mean() <= other.mae().mean() for other in scores.values())
    # stretches of a single flight say little: there physics stay
    assert choose({"gp": held([0.1, 0.1]), "identified": held([0.2, 0.2])}, 1) == "identified"
    assert choose({"gp": held([0.1, 0.1])}, 1) == "gp"


def test_one_flight_trains_every_rung() -> None:
    ladder = train_flight_ladder(flights(1), VEHICLE, replace(SMALL, kind="auto"), rng())
    assert ladder.chosen in ("identified", "nominal")
    assert len(ladder.held_out["gp"].mae()) == 6
    assert not ladder.model.calibrated
    short = flights(1).take(np.arange(20))  # two seconds: a single stretch, nothing to hold out
    tiny = train_flight_ladder(short, VEHICLE, replace(SMALL, kind="auto"), rng())
    assert np.isfinite(tiny.model.predict(short.states)[0]).all()


def test_a_vehicle_that_nobody_described_has_a_linear_rung() -> None:
    data = replace(flights(3), command_unit="1")
    ladder = train_flight_ladder(data, VEHICLE, replace(SMALL, kind="auto"), rng())
    assert set(ladder.models) == {"gp", "identified+gp", "identified"}
    assert isinstance(ladder.models["identified"].physics, LinearInverse)
    with pytest.raises(UsageError, match="nominal"):
        train_flight_model(data, VEHICLE, replace(SMALL, kind="nominal"), rng())


def test_a_command_that_never_changes_stays() -> None:
    data = flights(2)
    command = data.command.copy()
    command[:, 2] = 0.25
    data = replace(data, command=command, command_unit="1")
    for kernel in ("shared", "separate"):
        model = trained(data, kernel=kernel)
        mean, variance = model.predict(data.states)
        np.testing.assert_allclose(mean[:, 2], 0.25, atol=1e-9)
        assert (variance > 0.0).all()


@pytest.mark.parametrize("kind", ["nominal", "identified", "gp", "nominal+gp", "identified+gp"])
@pytest.mark.parametrize("kernel", ["shared", "separate"])
def test_a_model_on_disk_predicts_the_same_bits(kind: str, kernel: str, tmp_path) -> None:
    model = trained(flights(2), kind=kind, kernel=kernel, steps=2)
    save_flight_model(model, tmp_path)
    loaded = load_flight_model(tmp_path)
    fresh = flights(1, seed=5)
    for mine, other in zip(model.predict(fresh.states), loaded.predict(fresh.states), strict=True):
        np.testing.assert_array_equal(mine, other)
    assert (loaded.kind, loaded.features, loaded.student) == (kind, model.features, model.student)
    np.testing.assert_array_equal(loaded.analytic(fresh.states), model.analytic(fresh.states))
    again = tmp_path / "again"
    save_flight_model(loaded, again)
    assert (again / "flight_model.json").read_bytes() == (tmp_path / "flight_model.json").read_bytes()


def test_a_linear_map_on_disk_and_damaged_files(tmp_path) -> None:
    model = trained(replace(flights(2), command_unit="1"), kind="identified", steps=2)
    save_flight_model(model, tmp_path)
    fresh = flights(1, seed=5)
    loaded = load_flight_model(tmp_path)
    np.testing.assert_array_equal(loaded.predict(fresh.states)[0], model.predict(fresh.states)[0])
    numbers = tmp_path / "flight_model.npz"
    numbers.write_bytes(numbers.read_bytes()[:200])
    with pytest.raises(DataError, match="no flight model"):
        load_flight_model(tmp_path)
    with pytest.raises(DataError, match="no flight model"):
        load_flight_model(tmp_path / "nowhere")


def test_scores_of_each_flight_are_those_of_their_definition() -> None:
    data = flights(4, hard=True)
    model = trained(data)
    fresh = flights(2, seed=5, hard=True)
    score = score_flights(model, fresh)
    own = fresh.take(fresh.group == 1)
    mean, variance = model.predict(own.states)
    error = own.command - mean
    assert score.mae[1] == pytest.approx(np.abs(error).mean())
    assert score.mae_after[1] == pytest.approx(np.abs(error[own.t >= 5.0]).mean())
    assert score.z2[1] == pytest.approx((error**2 / variance).mean())
    assert score.coverage[1] == pytest.approx((np.abs(error) < 1.96 * np.sqrt(variance)).mean(), abs=2e-3)
    from scipy.stats import norm, t

    assert score.nlpd[1] == pytest.approx(-norm.logpdf(error, scale=np.sqrt(variance)).mean())
    assert model.student is not None
    tails = t.logpdf(error, model.student.freedom, scale=model.student.scale * np.sqrt(variance))
    assert score.nlpd_t[1] == pytest.approx(-tails.mean())
    with pytest.raises(DataError):
        score_flights(model, fresh.take(np.zeros(len(fresh), dtype=bool)))


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "best"},
        {"kernel": "four"},
        {"hyperparameters": "never"},
        {"prior": "strong"},
        {"acceleration": "world"},
        {"points": 1},
        {"starts": 0},
        {"noise_floor": float("nan")},
        {"fit_spacing_s": -1.0},
    ],
)
def test_wrong_options_are_refused(wrong) -> None:
    with pytest.raises(UsageError):
        FlightModelConfig(**wrong)


def test_no_flight_a_missing_input_and_auto_for_one_model_are_refused() -> None:
    data = flights(1)
    nothing = data.take(np.zeros(len(data), dtype=bool))
    with pytest.raises(DataError, match="no flight"):
        train_flight_ladder(nothing, VEHICLE, SMALL, rng())
    with pytest.raises(DataError, match="velocity"):
        trained(replace(data, states=replace(data.states, velocity=None)))
    with pytest.raises(UsageError, match="one kind"):
        trained(data, kind="auto")
