"""Bad input: every member answers with a typed error or a number that is right, never with NaN."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from etude import plugins
from etude.errors import DataError, EtudeError, NumericalError, UsageError
from etude.models import (
    BayesianLinear,
    ExactGP,
    InducingGP,
    JitterWarning,
    LearnedModel,
    ModelConfig,
    SquaredExponential,
    factorise,
    member_named,
    select_structures,
)
from etude.types import Array, Channel, Column, Log, Samples
from etude_sparse import SOGP, DictionaryConfig, DictionaryGP, DownsampledGP, SparseSpectrumGP

MEMBERS = {name: member_named(name) for name in plugins.BUILT_IN["etude.models"] if name != "all_lin"}
"""Those that learn commands one by one."""

SMALL = ModelConfig(
    rung="gp",
    kernel="ard_se",
    points=60,
    fit_points=40,
    fit_spacing_s=0.0,
    basis=15,
    steps=6,
    stretch_s=0.05,  # 15 s are enough to be believed here: members are asked, not how much motion they saw
)
BARE = replace(SMALL, prior="none", noise_floor=0.0, method="minimize")
"""Nothing holds the likelihood back: the thesis's settings."""
SETTINGS = {"weak prior": SMALL, "bare likelihood": BARE}
NOISE = 0.05
NAMES = pytest.mark.parametrize("name", MEMBERS)
BOTH = pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)


@dataclass(frozen=True)
class Motion:
    """Two joints along slow waves: times, trajectories, inputs (n, 6)."""

    t: np.ndarray
    group: np.ndarray
    X: np.ndarray

    def take(self, index: np.ndarray) -> Motion:
        return Motion(self.t[index], self.group[index], self.X[index])


def motion(n: int = 60, groups: int = 2) -> Motion:
    t, group = np.arange(n) * 0.25, np.arange(n) * groups // n
    angle = np.outer(t, [0.7, 1.1]) + np.outer(group, [1.0, 2.0])
    q, qd, qdd = np.sin(angle), np.cos(angle) * [0.7, 1.1], -np.sin(angle) * [0.49, 1.21]
    return Motion(t, group, np.column_stack([q, qd, qdd]))


@dataclass(frozen=True)
class Raw:
    """Inputs that are columns of a log, as they are."""

    width: int

    @property
    def columns(self) -> tuple[Column, ...]:
        return tuple(("x", f"x{i}", "1", "") for i in range(self.width))

    def of_log(self, log: Log) -> Array:
        return log["x"]

    def fitted(self, samples: Samples) -> Raw:
        return self

    def arrays(self) -> dict[str, Array]:
        return {}


def inputs(data: Motion) -> np.ndarray:
    return data.X


def function(data: Motion) -> np.ndarray:
    return np.asarray(3.0 * np.cos(data.X[:, 0]) + 0.5 * data.X[:, 3])


def noise(n: int) -> np.ndarray:
    return NOISE * np.random.default_rng(1).normal(size=n)


def log_of(t: np.ndarray, X: np.ndarray, y: np.ndarray) -> Log:
    parts = tuple(f"x{i}" for i in range(X.shape[1]))
    channels = {
        "x": Channel("x", parts, ("1",) * len(parts)),
        "command": Channel("command", ("a",), ("A",), "command"),
    }
    return Log(t, channels, {"x": X, "command": y[:, None]})


def learned(
    name: str, settings: ModelConfig, data: Motion, X: np.ndarray, y: np.ndarray, moving: Any = True
) -> LearnedModel:
    every = np.ones((len(y), 1), dtype=bool)
    samples = Samples(log_of(data.t, X, y), data.group, every, every & np.atleast_1d(moving)[:, None])
    config, own = replace(settings, process=name), np.random.default_rng(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", JitterWarning)  # the announced fallback of a singular covariance
        return select_structures(samples, Raw(X.shape[1]), {}, np.array([40.0]), config, own).model  # type: ignore[arg-type]


def mean_of(model: LearnedModel, X: np.ndarray) -> np.ndarray:
    return model.predict(log_of(np.arange(len(X), dtype=float), X, np.zeros(len(X))))[0][:, 0]


def error_of(model: LearnedModel, X: np.ndarray, y: np.ndarray) -> float:
    """Root mean square error at X, after a look at all that must be a number, there and far away."""
    (candidate,) = (c for c in model.candidates if c.weights.any())
    assert candidate.process is not None
    for Z in (X, X + 5.0 * np.ptp(X, axis=0) + 1.0):
        mean, variance = candidate.process.predict(Z)
        assert np.isfinite(mean).all()
        if not np.isnan(variance).all():  # a member may say that it has no variance, but then nowhere
            assert np.isfinite(variance).all()
            assert np.all(variance >= 0.0)
    assert np.all(candidate.calibration >= 1.0)
    assert np.all(candidate.process.noise_variance >= 0.0)
    return float(np.sqrt(np.mean((mean_of(model, X) - y) ** 2)))


def bound(name: str, usual: float) -> float:
    """Part of the outputs' deviation that the error may reach.

    Receptive fields fit lines to their neighbourhoods: on 60 samples they know little more than the mean.
    """
    return 0.8 if name == "lwpr" else usual


def either(call, *kinds: type[EtudeError]) -> LearnedModel | None:
    """What `call` returns, or None where it refuses with one of these errors."""
    try:
        return call()
    except kinds:
        return None


@pytest.mark.thinned
@NAMES
@BOTH
@pytest.mark.parametrize("value", [0.0, 3.7])
def test_constant_outputs_are_predicted_or_refused(name, settings, value) -> None:
    data = motion()
    X, y = inputs(data), np.full(60, value)
    process = either(lambda: learned(name, settings, data, X, y), NumericalError, DataError)
    assert process is None or error_of(process, X, y) < 1e-6


@pytest.mark.thinned
@NAMES
@pytest.mark.parametrize("signal", [0.3, 0.02])
def test_a_small_signal_about_a_load_is_commanded_as_it_was_learned(name, signal) -> None:
    """A process is no less believed where it was trained because noise hides much of what it explains."""
    data = motion()
    X = inputs(data)
    y = 3.0 + signal * np.sin(X[:, 0]) + noise(60)
    model = learned(name, SMALL, data, X, y)
    log = log_of(data.t, X, y)
    assert np.abs(model.predict(log).mean - model.posterior(log)[0]).max() <= 0.01 * signal


@NAMES
def test_far_outside_a_load_is_held_and_nothing_beyond_what_was_commanded(name) -> None:
    if name.startswith("ssgp"):
        pytest.skip("the features of a sparse spectrum repeat, and its variances with them")
    data = motion()
    X = inputs(data)
    y = 3.0 + 0.3 * np.sin(X[:, 0]) + noise(60)
    model = learned(name, SMALL, data, X, y)
    far = mean_of(model, X + 30.0 * np.ptp(X, axis=0) + 1.0)
    assert np.all((far >= y.min()) & (far <= y.max()))


@pytest.mark.thinned
@NAMES
@BOTH
def test_repeated_samples_do_no_harm(name, settings) -> None:
    data = motion().take(np.repeat(np.arange(30), 2))
    X, y = inputs(data), function(data) + noise(60)
    assert error_of(learned(name, settings, data, X, y), X, y) < 0.2 * np.std(y)


@pytest.mark.thinned
@NAMES
@BOTH
def test_one_place_repeated_gives_the_mean_of_its_outputs(name, settings) -> None:
    data = motion().take(np.zeros(30, dtype=np.int64))
    X, y = inputs(data), 2.0 + noise(30)
    process = learned(name, settings, data, X, y)
    assert error_of(process, X, y) <= 1.05 * np.std(y)


@pytest.mark.thinned
@NAMES
@BOTH
def test_fewer_samples_than_inputs_are_no_worse_than_their_mean(name, settings) -> None:
    for count in (2, 4):
        data = motion().take(np.arange(count) * 13)
        X, y = inputs(data), function(data)
        assert error_of(learned(name, settings, data, X, y), X, y) <= 1.01 * np.std(y)


@NAMES
def test_no_or_one_sample_that_moves_is_refused(name) -> None:
    data = motion()
    for moving in (0, 1):
        with pytest.raises(DataError, match="hardly moves") as caught:
            learned(name, SMALL, data, inputs(data), function(data), np.arange(60) < moving)
        assert "a" in caught.value.where


@pytest.mark.thinned
@NAMES
@pytest.mark.parametrize("unit", [1e6, 1e-6])
def test_the_unit_of_the_inputs_does_not_matter(name, unit) -> None:
    """Training starts at the data's scales, so the same samples in another unit teach the same."""
    data = motion()
    X, y = inputs(data), function(data) + noise(60)
    plain, scaled = (learned(name, SMALL, data, Z, y) for Z in (X, X * unit))
    assert error_of(scaled, X * unit, y) < bound(name, 0.2) * np.std(y)
    np.testing.assert_allclose(mean_of(scaled, X * unit), mean_of(plain, X), atol=0.05 * np.std(y))


@NAMES
def test_inputs_far_from_zero_and_a_column_that_never_changes(name) -> None:
    data = motion()
    y = function(data) + noise(60)
    for X in (inputs(data) + 1e6, np.column_stack([inputs(data), np.full(60, 1e6)])):
        assert error_of(learned(name, SMALL, data, X, y), X, y) < bound(name, 0.2) * np.std(y)


@pytest.mark.thinned
@NAMES
@BOTH
def test_noise_free_data_are_learned_or_refused(name, settings) -> None:
    data = motion()
    X, y = inputs(data), function(data)
    process = either(lambda: learned(name, settings, data, X, y), NumericalError)
    assert process is None or error_of(process, X, y) < bound(name, 0.1) * np.std(y)
    assert process is not None or settings is BARE


@NAMES
def test_a_command_that_is_not_a_number_is_refused(name) -> None:
    data = motion()
    X, y = inputs(data), function(data)
    y[7] = np.nan
    with pytest.raises(DataError, match="NaN"):
        learned(name, replace(SMALL, fit_points=60), data, X, y)


KERNEL = SquaredExponential((0, 1, 2))
EXACT = ExactGP(KERNEL, np.zeros(4), -2.0, 0.1)


class Same:
    """The features of a linear regression on its inputs."""

    def transform(self, X: np.ndarray) -> np.ndarray:
        return X

    def pullback(self, X: np.ndarray, G: np.ndarray) -> np.ndarray:
        return G


REGRESSORS = {
    "exact": EXACT,
    "downsampled": DownsampledGP(EXACT, every=3),
    "dictionary": DictionaryGP(EXACT, DictionaryConfig(size=10)),
    "linear": BayesianLinear(Same(), 0.0, -2.0),
    "vfe": InducingGP(KERNEL, np.zeros(4), -2.0, np.eye(3), "vfe", 0.1),
    "fitc": InducingGP(KERNEL, np.zeros(4), -2.0, np.eye(3), "fitc", 0.1),
    "sogp": SOGP(KERNEL, np.zeros(4), -2.0, 0.1, capacity=10),
    "spectrum": SparseSpectrumGP(np.random.default_rng(2).normal(size=(8, 3)), np.zeros(4), -2.0, 0.1),
}
ALL = pytest.mark.parametrize("gp", REGRESSORS.values(), ids=REGRESSORS)


@ALL
def test_one_point_is_enough_to_condition_on(gp) -> None:
    X, y = np.array([[0.3, -0.2, 0.1]]), np.array([2.0])
    posterior = gp.condition(X, y)
    mean, variance = posterior.predict(np.concatenate([X, X + 50.0]))
    assert np.isfinite(mean).all()
    assert np.isfinite(variance).all()
    assert 0.0 <= variance[0] <= posterior.noise_variance + 1e-12 or isinstance(gp, InducingGP)
    assert 0.0 < mean[0] < 2.0


@ALL
def test_no_points_and_points_that_are_not_numbers_are_refused(gp) -> None:
    X, y = np.ones((4, 3)), np.arange(4.0)
    for bad_X, bad_y in (
        (X[:0], y[:0]),
        (X, y[:3]),
        (X[:, 0], y),
        (np.where(np.eye(4, 3) > 0, np.nan, X), y),
        (X, np.array([0.0, np.inf, 1.0, 2.0])),
    ):
        with pytest.raises(DataError):
            gp.condition(bad_X, bad_y)


@ALL
def test_inputs_of_another_width_are_refused(gp) -> None:
    posterior = gp.condition(np.random.default_rng(0).normal(size=(12, 3)), np.arange(12.0))
    for X in (np.zeros((2, 2)), np.zeros((2, 4)), np.zeros(3)):
        with pytest.raises(UsageError):
            posterior.predict(X)


@pytest.mark.parametrize("gp", [gp for gp in REGRESSORS.values() if hasattr(gp, "theta")])
@pytest.mark.parametrize("theta", [np.zeros(3), np.zeros(5), np.zeros((4, 1)), np.array([0, 0, np.nan, 0])])
def test_a_hyperparameter_vector_of_the_wrong_length_is_refused(gp, theta) -> None:
    with pytest.raises(UsageError):
        replace(gp, theta=theta)
    if hasattr(gp, "with_parameters"):
        with pytest.raises(UsageError):
            gp.with_parameters(np.append(gp.parameters, 0.0))
        with pytest.raises(UsageError):
            gp.with_parameters(gp.parameters[:-1])


@pytest.mark.parametrize("scale", [0.0, 1e-320])
def test_a_covariance_of_zero_is_refused_and_not_tried_for_ever(scale) -> None:
    with pytest.raises(NumericalError, match="is zero"):
        factorise(np.full((3, 3), scale, order="F"), 0.0)
