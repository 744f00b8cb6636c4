"""Hyperparameters from log to log (thesis 6.1), for every member: update, constant, reinitialise."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from etude.models.inverse_dynamics import train_model
from etude.models.lesson import SCHEDULES, Lesson, on_schedule
from etude.models.model_config import ModelConfig
from etude.models.model_file import load_model, save_model
from etude.models.output_process import train_output
from etude.models.processes import PROCESSES, SPECTRAL
from learning_examples import SMALL, pendulum, trajectories

from etude.errors import UsageError
from etude.models.contracts import HasKernel
from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP
from etude.models.gp.exact import ExactGP
from etude.models.gp.training import fit, initial_gp

ML = replace(
    SMALL, kernel="ard_se", basis=20, points=60, fit_points=50, steps=5, prior="none", method="minimize"
)
NAMES = pytest.mark.parametrize("name", PROCESSES)
THESIS = ("thesis_dictionary_variance", "thesis_dictionary_error")


def model_of(count: int, config: ModelConfig, previous=None):
    return train_model(trajectories(count), pendulum(), config, np.random.default_rng(0), previous)


@pytest.fixture(scope="module")
def firsts():
    return {name: model_of(2, replace(ML, process=name)) for name in PROCESSES}


def lesson_of(config: ModelConfig, count: int, start=None) -> Lesson:
    """What the member is given for output 0."""
    lessons, data = [], trajectories(count)

    def seen(lesson):
        lessons.append(lesson)
        return PROCESSES["exact"](lesson)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PROCESSES, "seen", seen)
        own = replace(config, process="seen")
        train_output(data, data.q, data.tau[:, 0], 0, 40.0, own, np.random.default_rng(0), start)
    return lessons[0]


@NAMES
def test_constant_keeps_the_first_hyperparameters_bit_for_bit_whatever_comes(name, firsts, tmp_path) -> None:
    config, model = replace(ML, process=name, schedule="constant"), firsts[name]
    for count in (3, 4):
        save_model(model, tmp_path / str(count))
        previous, model = model, model_of(count, config, load_model(tmp_path / str(count)))
        for first, now in zip(firsts[name].posteriors, model.posteriors, strict=True):
            assert type(now) is type(first)
            if not isinstance(now, HasKernel):
                pytest.skip("without hyperparameters that could be kept")
            assert first.theta.tobytes() == now.theta.tobytes()
            if name != "lwpr":  # whose noise is what its fields leave, no hyperparameter
                assert now.noise_variance == pytest.approx(first.noise_variance, rel=1e-12)
        X = np.zeros((1, 12))
        for old, now in zip(previous.posteriors, model.posteriors, strict=True):
            assert old.predict(X)[0] != now.predict(X)[0]  # it has seen the new data


def test_constant_trains_the_first_time(firsts) -> None:
    for name in ("exact", "ssgp_fixed"):
        first = model_of(2, replace(ML, process=name, schedule="constant"))
        for own, trained in zip(first.posteriors, firsts[name].posteriors, strict=True):
            np.testing.assert_array_equal(own.theta, trained.theta)


@pytest.mark.parametrize("floor", ["auto", 0.05])
def test_constant_keeps_the_noise_whatever_the_floor_is_then(floor) -> None:
    first = model_of(2, replace(ML, noise_floor=0.0))
    then = model_of(3, replace(ML, noise_floor=floor, schedule="constant"), first)
    for old, now in zip(first.posteriors, then.posteriors, strict=True):
        assert now.noise_variance == pytest.approx(old.noise_variance, rel=1e-12)


@pytest.mark.parametrize("name", [name for name in PROCESSES if name not in THESIS])
def test_reinitialise_ignores_the_hyperparameters_before(name, firsts) -> None:
    config = replace(ML, process=name, schedule="reinitialise")
    alone, after = model_of(3, config), model_of(3, config, firsts[name])
    for own, other in zip(alone.posteriors, after.posteriors, strict=True):
        assert own.noise_variance == other.noise_variance
        if isinstance(own, HasKernel):
            np.testing.assert_array_equal(own.theta, other.theta)


@pytest.mark.parametrize("name", ["exact", "sogp", *SPECTRAL, "vfe", "fitc"])
def test_update_is_at_least_as_likely_as_what_it_starts_from(name) -> None:
    first = PROCESSES[name](lesson_of(ML, 2))
    lesson = lesson_of(ML, 2)
    earlier = first.condition(lesson.X[first.taught], lesson.y[first.taught])
    lesson = lesson_of(ML, 4, earlier)
    X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
    values = []
    for steps in (0, ML.steps):
        gp = PROCESSES[name](replace(lesson, steps=steps)).condition.__self__
        gp = gp if name != "sogp" else ExactGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor)
        values.append(gp.log_marginal_likelihood(X, y)[0])
    assert values[1] > values[0] + 1e-6
    at_start = PROCESSES[name](replace(lesson, steps=0)).condition.__self__
    np.testing.assert_array_equal(at_start.theta, earlier.theta)
    assert at_start.noise_variance == pytest.approx(earlier.noise_variance, rel=1e-12)


@pytest.mark.parametrize("name", SPECTRAL)
def test_update_carries_the_spectral_points_and_reinitialise_draws_them(name, firsts) -> None:
    for schedule, steps in (("update", 0), ("constant", 5)):
        config = replace(ML, process=name, steps=steps, schedule=schedule)
        for old, now in zip(
            firsts[name].posteriors, model_of(3, config, firsts[name]).posteriors, strict=True
        ):
            np.testing.assert_allclose(now.points, old.points, rtol=1e-13)
    fewer = model_of(3, replace(ML, process=name, steps=0, basis=12), firsts[name])
    for old, now in zip(firsts[name].posteriors, fewer.posteriors, strict=True):
        np.testing.assert_array_equal(now.theta, old.theta)
        assert now.points.shape == (12, old.points.shape[1])
    anew = model_of(3, replace(ML, process=name, steps=0, schedule="reinitialise"), firsts[name])
    assert np.abs(anew.posteriors[0].points - firsts[name].posteriors[0].points).max() > 0.1


@NAMES
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_a_stored_model_goes_on_as_the_one_in_memory(name, schedule, firsts, tmp_path) -> None:
    config = replace(ML, process=name, schedule=schedule, steps=2)
    save_model(firsts[name], tmp_path)
    kept, stored = (model_of(3, config, start) for start in (firsts[name], load_model(tmp_path)))
    data = trajectories(1)
    for first, second in zip(
        kept.predict(data.q, data.qd, data.qdd), stored.predict(data.q, data.qd, data.qdd), strict=True
    ):
        assert np.isfinite(first).all()
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("rule", ["variance", "error"])
def test_the_thesis_offers_a_log_with_the_old_hyperparameters_and_trains_on_the_members(
    rule,
) -> None:
    member = PROCESSES[f"thesis_dictionary_{rule}"]
    lesson = lesson_of(replace(ML, points=40), 1)
    first = member(lesson)
    moving = lesson.moving
    np.testing.assert_array_equal(first.taught, moving[np.arange(40) * len(moving) // 40])
    X, y = lesson.X[first.taught], lesson.y[first.taught]
    anew = partial(initial_gp, lesson.kernel, noise_floor=lesson.floor)
    by_hand = fit(anew(X, y), X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_array_equal(first.condition.__self__.parameters, by_hand.parameters)
    earlier = first.condition(X, y)

    lesson = lesson_of(replace(ML, points=40, noise_floor=0.0), 2, earlier)
    second = member(lesson)
    new = lesson.moving[lesson.group[lesson.moving] == 1]
    pool = np.concatenate([first.taught, new])
    old = ExactGP(lesson.kernel, earlier.theta, 0.5 * np.log(earlier.noise_variance))
    bare = DictionaryGP(old, DictionaryConfig(size=40, rule=rule, guard=None, gain=0.0))
    chosen = bare.select(lesson.X[pool], lesson.y[pool], start=np.arange(40))
    np.testing.assert_array_equal(second.taught, np.sort(pool[chosen.kept]))
    assert chosen.replacements > 0
    X, y = lesson.X[second.taught], lesson.y[second.taught]
    by_hand = fit(old, X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_allclose(second.condition.__self__.theta, by_hand.theta, rtol=1e-12)

    again = member(on_schedule(replace(lesson, before=None), "reinitialise"))  # the members stay
    np.testing.assert_array_equal(again.taught, second.taught)
    by_hand = fit(initial_gp(lesson.kernel, X, y), X, y, method="minimize", steps=5, prior=None)
    np.testing.assert_array_equal(again.condition.__self__.theta, by_hand.theta)
    held = member(on_schedule(lesson, "constant"))
    np.testing.assert_array_equal(held.taught, second.taught)
    np.testing.assert_array_equal(held.condition.__self__.theta, earlier.theta)


def test_a_dictionary_whose_members_left_the_data_is_filled_anew(firsts) -> None:
    """The data were preprocessed otherwise since."""
    name = "thesis_dictionary_variance"
    lesson = lesson_of(ML, 2, firsts[name].posteriors[0])  # positions alone: no sample of eight features
    trained = PROCESSES[name](lesson)
    assert len(trained.taught) == ML.points
    few = PROCESSES[name](replace(lesson_of(ML, 1), points=10))
    assert len(few.taught) == 10


def test_negative_steps_count_evaluations(monkeypatch) -> None:
    calls, original = [], ExactGP.log_marginal_likelihood
    monkeypatch.setattr(
        ExactGP, "log_marginal_likelihood", lambda gp, X, y: (calls.append(1), original(gp, X, y))[1]
    )
    PROCESSES["exact"](replace(lesson_of(replace(ML, steps=0), 2), steps=-17))
    assert len(calls) <= 17
    assert len(calls) > 10


def test_impossible_schedules_are_refused() -> None:
    with pytest.raises(UsageError, match="schedule must be one of update, constant, reinitialise"):
        replace(ML, schedule="sometimes")
    with pytest.raises(UsageError, match="negative steps count evaluations") as caught:
        replace(ML, method="lbfgs", steps=-100)
    assert caught.value.where == "model.steps = -100"
    assert replace(ML, steps=-100).steps == -100
