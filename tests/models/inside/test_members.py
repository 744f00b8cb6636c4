"""Every member of the family by name: it learns, is calibrated, guides a design, and survives storing."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
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
    train,
    trajectories,
    trajectory,
)

from etude import plugins
from etude.design import Output, criterion_named, evaluate, value_of
from etude.errors import UsageError
from etude.models import Posteriors, load_model, member_named, prediction_score, save_model
from etude.models.config import SPECTRAL
from etude.models.data.fit_data import complete_samples
from etude.models.gp.shared_exact import condition_shared
from etude.models.process_abilities import HasKernel

MEMBERS = {name: member_named(name) for name in plugins.BUILT_IN["etude.models"] if name != "all_lin"}
"""Those that learn commands one by one."""

ARD = replace(SMALL, kernel="ard_se", basis=30)
NAMES = pytest.mark.parametrize("name", MEMBERS)
SHARED = [name for name in MEMBERS if name != "thesis_dictionary_error"]
"""That one chooses members for one command's errors."""


def config(name: str, **changes: Any):
    return replace(ARD, process=name, **changes)


@pytest.fixture(scope="module")
def models():
    return {name: train(trajectories(3), config(name)) for name in MEMBERS}


@NAMES
def test_it_predicts_a_new_motion_with_variances_that_are_not_bold(name, models) -> None:
    new = trajectory(9)
    result = prediction_score(new, *models[name].predict(new.log))
    assert np.all(result.nmse < 0.25)
    assert np.all(result.z2 < 4.0)
    assert np.all(result.coverage > 0.7)
    assert all((c.calibration >= 1.0).all() for c in models[name].candidates)


@NAMES
def test_what_variances_are_at_most_they_are(name, models) -> None:
    new = trajectory(9)
    (mean, variance), (same, bound) = models[name].posterior(new.log), models[name].at_most(new.log)
    np.testing.assert_allclose(same, mean, rtol=1e-9, atol=1e-9 * np.abs(mean).max())
    assert np.all(bound >= variance * (1.0 - 1e-9))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", SHARED)
def test_it_shares_a_kernel_over_several_commands(name, tmp_path) -> None:
    model = train(trajectories(2), replace(TOGETHER, process=name, basis=30, steps=6))
    new = trajectory(9)
    assert np.all(prediction_score(new, *model.predict(new.log)).nmse < 0.5)
    (candidate,) = [c for c in model.candidates if c.weights.any()]
    assert candidate.commands == (0, 1)
    with_theta = [p for p in candidate.process.own if isinstance(p, HasKernel)]
    for posterior in with_theta[1:]:
        np.testing.assert_array_equal(posterior.theta, with_theta[0].theta)
    save_model(tmp_path / "model.npz", model)
    again = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    for one, other in zip(model.predict(new.log), again.predict(new.log), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_error_rule_of_the_thesis_is_of_one_command() -> None:
    with pytest.raises(UsageError, match="chooses members for one command"):
        train(trajectories(2), replace(TOGETHER, process="thesis_dictionary_error"))


@NAMES
def test_held_out_does_not_know_what_is_held_out(name) -> None:
    fit = fit_of(config(name, steps=3), trajectories(3))
    process = MEMBERS[name](fit)
    own = fit.kept[fit.fold[fit.kept] == 1]
    mean, variance = process.held_out(own)
    assert mean.shape == variance.shape == (len(own), 1)
    spoiled = fit.Y.copy()
    spoiled[fit.fold == 1] += 100.0
    np.testing.assert_allclose(process.held_out(own, spoiled)[0], mean, rtol=1e-6, atol=1e-8)
    assert np.all(variance >= process.noise_variance * 0.5)


@pytest.mark.parametrize("commands", [(0,), (0, 1)])
def test_held_out_in_closed_form_is_conditioning_without(commands) -> None:
    settings = ARD if len(commands) == 1 else TOGETHER
    fit = fit_of(settings, trajectories(3), commands)
    process = MEMBERS["exact"](fit)
    assert isinstance(process, Posteriors)
    assert process.teaching is not None
    own = fit.kept[fit.fold[fit.kept] == 2]
    other = fit.kept[fit.fold[fit.kept] != 2]
    for Y in (fit.Y, np.cos(fit.Y)):
        without = process.teaching.on(other, Y)
        mean, latent = without.predict(fit.X[own])
        found = process.held_out(own, Y)
        np.testing.assert_allclose(found[0], mean, atol=1e-8)
        np.testing.assert_allclose(found[1], latent + without.noise_variance, rtol=1e-6)
    np.testing.assert_allclose(process.held_out(own)[0], process.held_out(own, fit.Y)[0], atol=1e-10)


@NAMES
def test_a_restored_process_is_the_same_and_holds_nothing_out(name) -> None:
    fit = fit_of(config(name, steps=3), trajectories(2))
    process = MEMBERS[name](fit)
    again = MEMBERS[name].restore(process.arrays())
    for one, other in zip(process.predict(fit.X[:40]), again.predict(fit.X[:40]), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(process.noise_variance, again.noise_variance)
    np.testing.assert_array_equal(process.signal_variance, again.signal_variance)
    arrays = again.arrays()
    assert all(np.array_equal(arrays[key], value) for key, value in process.arrays().items())
    with pytest.raises(UsageError, match="cannot be held out"):
        again.held_out(fit.kept[:3])


@NAMES
def test_a_design_can_climb_its_criterion(name, models, tmp_path) -> None:
    """On the stored model, as `etude ask` has it."""
    save_model(tmp_path / "model.npz", models[name])
    model = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    some = trajectory(6).take(np.arange(0, 40, 5)).log
    X = model.inputs.of_log(some)
    reference = model.inputs.of_log(some.put(some.channels["q"], some["q"] + 0.3))
    outputs = [Output.of(posterior, reference) for posterior, _ in model.latents()]
    gains = np.full((len(X), 2), 0.9)
    direction = np.random.default_rng(3).normal(size=X.shape)
    for criterion in (criterion_named("log_ivr"), criterion_named("mean_variance")):
        value, gradient, _ = evaluate(criterion, outputs, X, gains)
        step = 1e-5 * direction
        ahead, behind = (value_of(criterion, outputs, X + s, gains) for s in (step, -step))
        assert np.isfinite(value)
        slope = float(np.sum(gradient * direction))
        assert (ahead - behind) / 2e-5 == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_a_member_without_covariances_predicts_itself_and_designs_with_its_guide(models) -> None:
    X = Inputs().of_log(trajectory(6).log)
    for name in ("local_gp", "lwpr"):
        pairs = zip(models[name].latents(), models["exact"].latents(), posteriors(models[name]), strict=True)
        for (guide, _), (other, _), own in pairs:
            # the same samples and hyperparameters as the exact member's
            np.testing.assert_array_equal(guide.predict(X)[1], other.predict(X)[1])
            assert not np.allclose(own.predict(X)[0], guide.predict(X)[0], rtol=1e-3)
            with pytest.raises(UsageError, match="no covariance"):
                own.covariance(X[:3], X[:3])


@NAMES
def test_training_goes_on_from_a_model_of_any_member(name, models) -> None:
    for start in {"exact", "ssgp_fixed", name}:
        again = train(trajectories(2, 13.0), config(name, steps=0), models[start])
        for (old, _), (new, _) in zip(models[start].latents(), again.latents(), strict=True):
            assert np.isfinite(new.noise_variance)
            np.testing.assert_array_equal(new.theta, old.theta)


@pytest.mark.thinned(2)
@NAMES
def test_one_trajectory_is_enough(name) -> None:
    model = train(trajectories(1), config(name))
    assert all(np.isfinite(c.calibration).all() for c in model.candidates)


def test_the_structured_kernel_goes_with_all_but_the_sparse_spectrum() -> None:
    for name in MEMBERS:
        if name in SPECTRAL:
            continue
        model = train(trajectories(2, 13.0), replace(SMALL, process=name, basis=20, steps=4))
        assert all(isinstance(p, HasKernel) for p, _ in model.latents())


def test_each_name_trains_what_it_says() -> None:
    fit = fit_of(config("exact", points=30), trajectories(2))
    teaching = {name: MEMBERS[name](fit).teaching for name in MEMBERS}
    assert len(teaching["exact"].taught) == 30
    for name in ("dictionary_variance", "dictionary_error", "vfe", "fitc", "lwpr", "local_gp", *SPECTRAL):
        np.testing.assert_array_equal(teaching[name].taught, complete_samples(fit))
    for name in SPECTRAL:
        assert len(MEMBERS[name](fit).own[0].points) == 30
    rows = complete_samples(fit)
    for rule in ("variance", "error"):  # only the error rule looks at the outputs
        other = np.random.default_rng(1).permuted(fit.Y, axis=0)
        members = [teaching[f"dictionary_{rule}"].on(rows, Y).own[0].X for Y in (fit.Y, other)]
        assert all(len(own) == 30 for own in members)
        assert np.array_equal(*members) == (rule == "variance")


def test_commands_that_share_a_factor_are_one_latent_function() -> None:
    process = MEMBERS["exact"](fit_of(TOGETHER, trajectories(2), (0, 1)))
    assert [own for _, own in process.latents()] == [(0, 1)]
    X = process.teaching.fit.X[:9]
    mean, variance = process.predict(X)
    for j, posterior in enumerate(process.own):
        np.testing.assert_allclose(posterior.predict(X)[0], mean[:, j], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(posterior.predict(X)[1], variance[:, j], rtol=1e-9)
    np.testing.assert_allclose(process.mean(X), mean, rtol=1e-12, atol=1e-12)
    first = process.own[0]
    assert condition_shared.__module__ == "etude.models.gp.shared_exact"
    assert all(posterior.L is first.L for posterior in process.own)


def test_a_member_is_loaded_alone() -> None:
    assert member_named("exact") is MEMBERS["exact"]
    with pytest.raises(UsageError, match="no member of the model family 'magic'"):
        member_named("magic")
    code = (
        "import sys\n"
        "from learning_examples import SMALL, train, trajectories\n"
        "train(trajectories(1), SMALL)\n"
        "gp = 'etude.models.gp.'\n"
        "bad = {'numba', 'polars', gp + 'dictionary', gp + 'sogp', gp + 'inducing'}\n"
        "assert not bad & set(sys.modules), bad & set(sys.modules)\n"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1])
    assert done.returncode == 0, done.stderr
