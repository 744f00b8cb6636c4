"""Hyperparameters from log to log (thesis 5, 6.1), for every member and schedule."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from learning_examples import (
    PHYSICS,
    SMALL,
    TOGETHER,
    Inputs,
    fit_of,
    posteriors,
    selection,
    train,
)
from learning_examples import trajectories as longer

from etude import plugins
from etude.models import (
    ExactGP,
    LearnedModel,
    ModelConfig,
    Posteriors,
    fit,
    initial_gp,
    load_model,
    member_named,
    save_model,
    trained_process,
)
from etude.models.config import SCHEDULES, SPECTRAL
from etude.models.data.fit_data import on_schedule
from etude.models.process_abilities import HasKernel
from etude.protocols import FitData
from etude_sparse import DictionaryConfig, DictionaryGP

MEMBERS = {name: member_named(name) for name in plugins.BUILT_IN["etude.models"] if name != "all_lin"}
"""Those that learn commands one by one."""

ML = replace(
    SMALL, kernel="ard_se", basis=20, points=60, fit_points=50, steps=5, prior="none", method="minimize"
)
trajectories = partial(longer, seconds=13.0)
NAMES = pytest.mark.parametrize("name", MEMBERS)
THESIS = ("thesis_dictionary_variance", "thesis_dictionary_error")


def model_of(count: int, config: ModelConfig, previous: LearnedModel | None = None) -> LearnedModel:
    return train(trajectories(count), config, previous)


def stored(model: LearnedModel, folder: Any) -> LearnedModel:
    save_model(folder / "model.npz", model)
    return load_model(folder / "model.npz", Inputs().restore, PHYSICS)


@pytest.fixture(scope="module")
def firsts():
    return {name: model_of(2, replace(ML, process=name)) for name in MEMBERS}


@pytest.mark.thinned(2)
@NAMES
def test_constant_keeps_the_first_hyperparameters_bit_for_bit_whatever_comes(name, firsts, tmp_path) -> None:
    config, model = replace(ML, process=name, schedule="constant"), firsts[name]
    for count in (3, 4):
        previous, model = model, model_of(count, config, stored(model, tmp_path))
        X = np.zeros((1, 8))
        for first, old, now in zip(
            posteriors(firsts[name]), posteriors(previous), posteriors(model), strict=True
        ):
            assert type(now) is type(first)
            assert old.predict(X)[0] != now.predict(X)[0]  # it has seen the new data
            if not isinstance(now, HasKernel):
                continue
            assert first.theta.tobytes() == now.theta.tobytes()
            assert now.noise_variance == pytest.approx(first.noise_variance, rel=1e-12)


def test_constant_trains_the_first_time(firsts) -> None:
    for name in ("exact", "ssgp_fixed"):
        first = model_of(2, replace(ML, process=name, schedule="constant"))
        for own, trained in zip(posteriors(first), posteriors(firsts[name]), strict=True):
            np.testing.assert_array_equal(own.theta, trained.theta)


@pytest.mark.parametrize("floor", ["auto", 0.05])
def test_constant_keeps_the_noise_whatever_the_floor_is_then(floor) -> None:
    first = model_of(2, replace(ML, noise_floor=0.0))
    then = model_of(3, replace(ML, noise_floor=floor, schedule="constant"), first)
    for old, now in zip(posteriors(first), posteriors(then), strict=True):
        assert now.noise_variance == pytest.approx(old.noise_variance, rel=1e-12)


@pytest.mark.parametrize("floor", ["auto", 0.2])
def test_first_learns_from_the_first_trajectory_alone_and_keeps_its_units(floor) -> None:
    config = replace(TOGETHER, schedule="first", noise_floor=floor)
    early = model_of(1, config)
    late, anew = model_of(2, config, early), model_of(2, config)
    refit = model_of(2, replace(config, schedule="update"), early)
    for one, two, other, moved in zip(*map(posteriors, (early, late, anew, refit)), strict=True):
        np.testing.assert_array_equal(two.theta, one.theta)
        assert two.noise_variance == pytest.approx(one.noise_variance, rel=1e-12)
        np.testing.assert_allclose(other.theta, one.theta, atol=1.0)
        assert not np.array_equal(moved.theta, one.theta)
        assert len(two.X) == config.points
    np.testing.assert_array_equal(late.candidates[0].units, early.candidates[0].units)
    first = trajectories(1).command[fit_of(config, trajectories(2), (0, 1)).chosen]
    np.testing.assert_allclose(anew.candidates[0].units[0], first.mean(axis=0))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [name for name in MEMBERS if name not in THESIS])
def test_reinitialise_ignores_the_hyperparameters_before(name, firsts) -> None:
    config = replace(ML, process=name, schedule="reinitialise")
    alone, after = model_of(3, config), model_of(3, config, firsts[name])
    for own, other in zip(posteriors(alone), posteriors(after), strict=True):
        assert own.noise_variance == other.noise_variance
        if isinstance(own, HasKernel):
            np.testing.assert_array_equal(own.theta, other.theta)


def process_of(posterior: Any) -> ExactGP:
    return ExactGP(posterior.kernel, posterior.theta, 0.5 * np.log(posterior.noise_variance))


def test_update_is_at_least_as_likely_as_what_it_starts_from() -> None:
    earlier = MEMBERS["exact"](fit_of(ML, trajectories(2)))
    data = fit_of(ML, trajectories(4), start=earlier)
    X, y = data.X[data.chosen], data.Y[data.chosen, 0]
    values = []
    for steps in (0, ML.steps):
        gp = trained_process(replace(data, config=replace(ML, steps=steps)))
        values.append(gp.log_marginal_likelihood(X, y)[0])
    assert values[1] > values[0] + 1e-6
    for name in ("exact", "sogp", "vfe", "fitc"):
        own = MEMBERS[name](replace(data, config=replace(ML, steps=0))).own[0]
        np.testing.assert_array_equal(own.theta, earlier.own[0].theta)
        assert own.noise_variance == pytest.approx(earlier.own[0].noise_variance, rel=1e-12)


def test_several_starts_go_on_from_the_earlier_one_too() -> None:
    """At its optimum a training from fresh starts alone would have to get there again."""
    config = replace(TOGETHER, steps=60)
    first, one_step = model_of(2, config), replace(config, starts=2, steps=1)
    likely = []
    for earlier in (None, first):
        own = posteriors(model_of(2, one_step, earlier))
        likely.append(sum(process_of(own[0]).log_marginal_likelihood(p.X, p.y)[0] for p in own))
    assert likely[1] > likely[0] + 10.0


@pytest.mark.parametrize("name", SPECTRAL)
def test_update_carries_the_spectral_points_and_reinitialise_draws_them(name, firsts) -> None:
    before = posteriors(firsts[name])
    for schedule, steps in (("update", 0), ("constant", 5)):
        config = replace(ML, process=name, steps=steps, schedule=schedule)
        for old, now in zip(before, posteriors(model_of(3, config, firsts[name])), strict=True):
            np.testing.assert_allclose(now.points, old.points, rtol=1e-13)
    fewer = model_of(3, replace(ML, process=name, steps=0, basis=12), firsts[name])
    for old, now in zip(before, posteriors(fewer), strict=True):
        np.testing.assert_array_equal(now.theta, old.theta)
        assert now.points.shape == (12, old.points.shape[1])
    config = replace(ML, process=name, steps=0, schedule="reinitialise")
    anew = selection(trajectories(3), config, firsts[name], seed=5).model
    assert np.abs(posteriors(anew)[0].points - before[0].points).max() > 0.1


@pytest.mark.thinned
@pytest.mark.parametrize("schedule", SCHEDULES)
@NAMES
def test_a_stored_model_goes_on_as_the_one_in_memory(name, schedule, firsts, tmp_path) -> None:
    config = replace(ML, process=name, schedule=schedule, steps=2)
    kept, again = (model_of(3, config, start) for start in (firsts[name], stored(firsts[name], tmp_path)))
    log = trajectories(1).log
    for first, second in zip(kept.predict(log), again.predict(log), strict=True):
        assert np.isfinite(first).all()
        np.testing.assert_array_equal(first, second)


def thesis_fit(config: ModelConfig, count: int, start: Posteriors | None = None) -> FitData:
    data = fit_of(replace(config, points=40), trajectories(count), start=start)
    return replace(data, floor=np.zeros(1))


@pytest.mark.parametrize("rule", ["variance", "error"])
def test_the_thesis_offers_a_log_with_the_old_hyperparameters_and_trains_on_the_members(rule) -> None:
    member = MEMBERS[f"thesis_dictionary_{rule}"]
    data = thesis_fit(ML, 1)
    first = member(data)
    moving = np.flatnonzero(data.moving[:, 0])
    taught = first.teaching.taught
    np.testing.assert_array_equal(taught, moving[np.arange(40) * len(moving) // 40])
    X, y = data.X[taught], data.Y[taught, 0]
    by_hand = fit(initial_gp(data.kernels[0], X, y), X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_array_equal(first.own[0].theta, by_hand.theta)

    data = thesis_fit(ML, 2, first)
    second = member(data)
    new = np.flatnonzero(data.moving[:, 0] & (data.group == 1))
    pool = np.concatenate([taught, new])
    old = process_of(first.own[0])
    bare = DictionaryGP(old, DictionaryConfig(size=40, rule=rule, guard=None, gain=0.0))
    chosen = bare.select(data.X[pool], data.Y[pool, 0], start=np.arange(40))
    members = second.teaching.taught
    np.testing.assert_array_equal(members, np.sort(pool[chosen.kept]))
    assert chosen.replacements > 0
    X, y = data.X[members], data.Y[members, 0]
    by_hand = fit(old, X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_allclose(second.own[0].theta, by_hand.theta, rtol=1e-12)

    again = member(replace(data, config=replace(data.config, schedule="reinitialise")))  # the members stay
    np.testing.assert_array_equal(again.teaching.taught, members)
    by_hand = fit(initial_gp(data.kernels[0], X, y), X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_array_equal(again.own[0].theta, by_hand.theta)
    held = member(on_schedule(replace(data, config=replace(data.config, schedule="constant"))))
    np.testing.assert_array_equal(held.teaching.taught, members)
    np.testing.assert_array_equal(held.own[0].theta, first.own[0].theta)


def test_a_dictionary_whose_members_left_the_data_is_filled_anew(firsts) -> None:
    """The data were preprocessed otherwise since."""
    name = "thesis_dictionary_variance"
    earlier = firsts[name].candidates[0].process
    data = thesis_fit(ML, 2, earlier)
    moved = replace(data, X=data.X + 0.25)
    assert len(MEMBERS[name](moved).teaching.taught) == 40
    assert len(MEMBERS[name](replace(data, config=replace(data.config, points=10))).teaching.taught) == 10


def test_negative_steps_count_evaluations(monkeypatch) -> None:
    calls, original = [], ExactGP.log_marginal_likelihood
    monkeypatch.setattr(
        ExactGP, "log_marginal_likelihood", lambda gp, X, y: (calls.append(1), original(gp, X, y))[1]
    )
    MEMBERS["exact"](fit_of(replace(ML, steps=-17), trajectories(2)))
    assert 10 < len(calls) <= 17
