"""Every member of the family by name: it learns, is calibrated, guides a design, and survives the disk."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from etude.control.feedforward import model_feedforward
from etude.models.calibration import score
from etude.models.guided import GuidedPosterior, guide_of
from etude.models.inverse_dynamics import train_model
from etude.models.model_file import load_model, save_model
from etude.models.output_process import train_output
from etude.models.processes import PROCESSES, SPECTRAL, exact
from etude.trajectories.samples import TrajectorySamples
from learning_examples import SMALL, pendulum, trajectories, trajectory

from etude.design.criteria import CRITERIA, Output, evaluate, value_of
from etude.errors import DataError, UsageError
from etude.models.contracts import HasKernel

ARD = replace(SMALL, kernel="ard_se", basis=30)
NAMES = pytest.mark.parametrize("name", PROCESSES)


def config(name: str, **changes):
    return replace(ARD, process=name, **changes)


@pytest.fixture(scope="module")
def models():
    data = trajectories(3)
    return {n: train_model(data, pendulum(), config(n), np.random.default_rng(0)) for n in PROCESSES}


@NAMES
def test_it_predicts_a_new_motion_with_variances_that_are_not_bold(name, models) -> None:
    new = trajectory(9)
    result = score(new.tau, *models[name].predict(new.q, new.qd, new.qdd), ~new.stuck)
    assert np.all(result.nmse < 0.25)
    assert np.all(result.z2 < 4.0)
    assert np.all(result.coverage > 0.7)
    assert np.all(models[name].scale >= 1.0)


def test_conditioning_without_each_trajectory_gives_the_scale_of_the_closed_form(monkeypatch) -> None:
    """The same processes, once able to leave groups out and once not."""

    class Bare:
        def __init__(self, posterior) -> None:
            self.predict, self.noise_variance = posterior.predict, posterior.noise_variance

    def bare(lesson):
        trained = PROCESSES["exact"](lesson)
        return replace(trained, condition=lambda X, y: Bare(trained.condition(X, y)))

    monkeypatch.setitem(PROCESSES, "bare", bare)
    for count in (3, 1):  # whole trajectories, stretches of one
        data = trajectories(count)
        scales = [
            train_output(
                data, data.q, data.tau[:, 0], 0, 40.0, config(name), np.random.default_rng(0), None
            ).scale
            for name in ("exact", "bare")
        ]
        assert scales[0] > 1.0
        assert scales[1] == pytest.approx(scales[0], rel=1e-7)


@pytest.mark.parametrize("name", ["dictionary_variance", "sogp"])
def test_without_calibration_the_scale_is_one(name) -> None:
    settings = config(name, calibrate=False, steps=2)
    model = train_model(trajectories(2), pendulum(), settings, np.random.default_rng(0))
    np.testing.assert_array_equal(model.scale, 1.0)


def test_bold_variances_are_widened_whether_left_out_in_closed_form_or_not() -> None:
    """Outputs that jump between trajectories: nothing learned from the others can foresee them."""
    data = trajectories(4)
    jump = replace(data, tau=data.tau + np.where(data.group % 2 == 0, 6.0, -6.0)[:, None])
    for name in ("exact", "dictionary_variance", "ssgp_fixed", "vfe", "sogp"):
        X = data.q
        settings = config(name, steps=0)
        args = (X, jump.tau[:, 0], 0, 40.0, settings)
        learned = train_output(jump, *args, np.random.default_rng(0), None)
        calm = train_output(data, X, data.tau[:, 0], 0, 40.0, settings, np.random.default_rng(0), None)
        assert learned.scale > 1.0, name
        assert learned.scale > calm.scale, name


@NAMES
def test_a_loaded_model_predicts_the_same_and_is_saved_the_same(name, models, tmp_path) -> None:
    model, new = models[name], trajectory(5)
    save_model(model, tmp_path / "a")
    loaded = load_model(tmp_path / "a")
    for first, second in zip(
        loaded.predict(new.q, new.qd, new.qdd), model.predict(new.q, new.qd, new.qdd), strict=True
    ):
        np.testing.assert_allclose(first, second, rtol=1e-12)
    for first, second in zip(loaded.posteriors, model.posteriors, strict=True):
        assert type(first) is type(second)
        assert type(guide_of(first)) is type(guide_of(second))
        assert first.noise_variance == second.noise_variance
        assert first.signal_variance == second.signal_variance
    save_model(loaded, tmp_path / "b")
    for part in ("model.json", "model.npz"):
        assert (tmp_path / "a" / part).read_bytes() == (tmp_path / "b" / part).read_bytes()


def test_files_from_before_the_family_are_read_and_unknown_forms_refused(models, tmp_path) -> None:
    model, new = models["exact"], trajectory(5)
    save_model(model, tmp_path)
    path = tmp_path / "model.json"
    words = json.loads(path.read_text())
    for output in words["outputs"]:
        assert output.pop("form") == "exact"
    path.write_text(json.dumps(words))
    expected = model.predict(new.q, new.qd, new.qdd)
    np.testing.assert_array_equal(load_model(tmp_path).predict(new.q, new.qd, new.qdd), expected)
    words["outputs"][0]["form"] = "magic"
    path.write_text(json.dumps(words))
    with pytest.raises(DataError, match="unknown form 'magic'"):
        load_model(tmp_path)


@NAMES
def test_a_design_can_climb_its_criterion(name, models, tmp_path) -> None:
    """On the model from the disk, as `etude ask` has it."""
    save_model(models[name], tmp_path)
    model = load_model(tmp_path)
    some = trajectory(6).take(np.arange(0, 40, 5))
    X = model.features.transform(some.q, some.qd, some.qdd)
    reference = model.features.transform(some.q + 0.3, some.qd, some.qdd)
    outputs = [Output.of(posterior, reference) for posterior in model.posteriors]
    gains = np.full((len(X), 2), 0.9)
    direction = np.random.default_rng(3).normal(size=X.shape)
    for criterion in (CRITERIA["log_ivr"], CRITERIA["mean_variance"]):
        value, gradient, _ = evaluate(criterion, outputs, X, gains)
        step = 1e-5 * direction
        ahead, behind = (value_of(criterion, outputs, X + s, gains) for s in (step, -step))
        assert np.isfinite(value)
        slope = float(np.sum(gradient * direction))
        assert (ahead - behind) / 2e-5 == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_a_member_without_covariances_predicts_itself_and_designs_with_its_guide(models) -> None:
    some = trajectory(6)
    for name in ("local_gp", "lwpr"):
        model = models[name]
        X = model.features.transform(some.q, some.qd, some.qdd)
        for posterior, other in zip(model.posteriors, models["exact"].posteriors, strict=True):
            assert isinstance(posterior, GuidedPosterior)
            assert not np.allclose(posterior.predict(X)[0], posterior.guide.predict(X)[0], rtol=1e-3)
            np.testing.assert_array_equal(posterior.predict(X)[0], posterior.own.predict(X)[0])
            # the same samples and hyperparameters as the exact member's
            np.testing.assert_array_equal(posterior.guide.predict(X)[1], other.predict(X)[1])
            assert Output.of(posterior, X[:3]).posterior is posterior.guide
            with pytest.raises(UsageError, match="no covariance"):
                posterior.covariance(X[:3], X[:3])
            with pytest.raises(UsageError, match="no covariance"):
                posterior.covariance_gradient(X[:3], X[:3], np.eye(3))
    assert guide_of(models["exact"].posteriors[0]) is models["exact"].posteriors[0]


@NAMES
def test_feedforward_commands_stay_inside_the_limits(name, models) -> None:
    some = trajectory(6)
    samples = TrajectorySamples(some.t, some.q, some.qd, some.qdd, np.zeros_like(some.q))
    commands = model_feedforward(models[name], pendulum())(samples)
    assert commands.shape == some.q.shape
    assert np.all(np.abs(commands) <= 40.0)
    # LWPR's bound counts the noise twice, so its commands fade out more than the others'
    least = 0.7 if name == "lwpr" else 0.8
    assert np.corrcoef(commands[:, 0], some.tau[:, 0])[0, 1] > least


@NAMES
def test_training_goes_on_from_a_model_of_any_member(name, models) -> None:
    settings, data = config(name, steps=0), trajectories(4)
    for start in ("exact", "ssgp_fixed", name):
        again = train_model(data, pendulum(), settings, np.random.default_rng(0), previous=models[start])
        for old, new in zip(models[start].posteriors, again.posteriors, strict=True):
            assert np.isfinite(new.noise_variance)
            if isinstance(old, HasKernel) and isinstance(new, HasKernel):
                np.testing.assert_array_equal(new.theta, old.theta)


@NAMES
def test_one_trajectory_is_enough(name) -> None:
    model = train_model(trajectories(1), pendulum(), config(name), np.random.default_rng(0))
    assert np.all(np.isfinite(model.scale))


def test_the_structured_kernel_goes_with_all_but_the_sparse_spectrum() -> None:
    for name in PROCESSES:
        if name in SPECTRAL:
            with pytest.raises(UsageError, match="squared exponential"):
                replace(SMALL, process=name)
            continue
        settings = replace(SMALL, process=name, basis=20, steps=4)
        model = train_model(trajectories(2), pendulum(), settings, np.random.default_rng(0))
        assert all(isinstance(p, HasKernel) for p in model.posteriors)


def test_each_name_trains_what_it_says(monkeypatch) -> None:
    lessons, data = [], trajectories(2)
    monkeypatch.setitem(PROCESSES, "seen", lambda lesson: (lessons.append(lesson), exact(lesson))[1])
    train_output(data, data.q, data.tau[:, 0], 0, 40.0, config("seen"), np.random.default_rng(0), None)
    (lesson,) = lessons
    lesson = replace(lesson, points=30, kept=lesson.moving)
    for name in ("fitc", "vfe"):
        assert PROCESSES[name](lesson).condition.__self__.form == name
    for name in SPECTRAL:
        gp = PROCESSES[name](lesson).condition.__self__
        assert gp.learned == (name == "ssgp_learned")
        assert len(gp.points) == 30
    assert PROCESSES["sogp"](lesson).condition.__self__.capacity == 30
    X, y = lesson.X[lesson.moving], lesson.y[lesson.moving]
    for rule in ("variance", "error"):  # only the error rule looks at the outputs
        trained = PROCESSES[f"dictionary_{rule}"](lesson)
        members = [trained.condition(X, outputs).X for outputs in (y, np.random.default_rng(1).permuted(y))]
        assert all(len(own) == 30 for own in members)
        assert np.array_equal(*members) == (rule == "variance")


def test_impossible_choices_are_refused() -> None:
    with pytest.raises(UsageError, match="process must be one of exact, dictionary_variance"):
        replace(SMALL, process="magic")
    with pytest.raises(UsageError, match="basis must be at least 1"):
        replace(SMALL, basis=0)


def test_the_exact_process_loads_no_other_member_and_a_stored_dictionary_no_compiler(
    models, tmp_path
) -> None:
    save_model(models["dictionary_error"], tmp_path)
    code = (
        "import sys\n"
        "from etude.models.inverse_dynamics import train_model\n"
        "from etude.models.model_file import load_model\n"
        "load_model(sys.argv[1])\n"
        "assert not {'numba', 'etude.models.gp.dictionary', 'etude.models.gp.sogp'} & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
