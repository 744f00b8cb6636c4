"""Every method of learning on line: what it is told it knows, and what it cannot use changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import DataError, UsageError
from etude.models import ExactGP, ExactPosterior, SquaredExponential, structured
from etude_online import OnlineConfig
from etude_online.learner import OnlineOutput
from etude_online.methods import METHODS, begin

D = 8
COLUMNS = [(name, part, "", "") for name in ("q", "qd", "qdd") for part in "ab"]
COLUMNS += [("qd", part, "1", "tanh") for part in "ab"]
KERNELS = {"structured": structured(COLUMNS, ("a",)), "ard_se": SquaredExponential(tuple(range(D)))}
NOISE = 0.05


def function(X: np.ndarray) -> np.ndarray:
    return np.sin(2.0 * X[:, 0]) + 0.5 * X[:, 1] + 0.3 * X[:, 6]


def inputs(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, D))


def start(kernel: str = "structured") -> ExactPosterior:
    """Knows one half of the inputs' range."""
    X = inputs(40, 0)
    X[:, 0] = -np.abs(X[:, 0])
    own = KERNELS[kernel]
    theta = own.initial(np.ones(D), 1.0)
    return ExactGP(own, theta, np.log(NOISE)).condition(X, function(X))


@pytest.fixture(params=METHODS)
def method(request: pytest.FixtureRequest) -> str:
    return request.param


def learner(method: str, kernel: str = "structured", **options: object) -> OnlineOutput:
    config = OnlineConfig(method, **({"size": 60, "frequencies": 40} | options))
    return begin(start(kernel), config, np.random.default_rng(1))


def told(model: OnlineOutput, X: np.ndarray, y: np.ndarray, first: float = 0.0) -> OnlineOutput:
    for i, (x, target) in enumerate(zip(X, y, strict=True)):
        model.observe(x, target, first + 0.1 * i)
    return model


def predicted(model: OnlineOutput, X: np.ndarray) -> np.ndarray:
    return np.array([model.mean(x) for x in X])


@pytest.mark.parametrize("kernel", KERNELS)
def test_it_starts_from_what_was_known(method: str, kernel: str) -> None:
    posterior = start(kernel)
    X = posterior.X[::3]
    assert np.abs(predicted(learner(method, kernel), X) - posterior.predict(X)[0]).max() < 0.1


def test_what_it_was_told_it_predicts_and_does_not_forget_at_once(method: str) -> None:
    X = inputs(30, 3)
    X[:, 0] = 0.5 + 0.5 * np.abs(X[:, 0])  # where the start knew nothing
    y = function(X)
    before = predicted(learner(method), X) - y
    model = told(learner(method), X, y)
    assert model.samples == 30
    assert np.mean((predicted(model, X) - y) ** 2) < 0.25 * np.mean(before**2)
    x = X[-1]
    assert abs(model.mean(x) - y[-1]) < 0.3


@pytest.mark.parametrize(
    ("x", "y", "t"),
    [(np.nan, 0.0, 1.0), (np.inf, 0.0, 1.0), (0.1, np.nan, 1.0), (0.1, -np.inf, 1.0), (0.1, 0.0, np.nan)],
)
def test_values_that_are_not_finite_are_refused_and_poison_nothing(
    method: str, x: float, y: float, t: float
) -> None:
    model, at = told(learner(method), inputs(3, 4), np.zeros(3)), inputs(5, 5)
    before = predicted(model, at)
    with pytest.raises(DataError, match="NaN or infinite"):
        model.observe(np.full(D, x), y, t)
    assert model.samples == 3
    np.testing.assert_array_equal(predicted(model, at), before)
    model.observe(np.full(D, 0.1), 0.0, 1.0)
    assert np.isfinite(predicted(model, at)).all()


def test_a_wrong_width_is_refused_when_learning_and_when_asked(method: str) -> None:
    model = learner(method)
    for x in (np.zeros(D - 1), np.zeros((1, D)), np.zeros(0)):
        with pytest.raises(UsageError, match="one input of shape"):
            model.observe(x, 0.0, 0.0)
        with pytest.raises(UsageError, match="one input of shape"):
            model.mean(x)
    assert model.samples == 0


def test_a_clock_that_stands_still_or_runs_backwards_is_refused(method: str) -> None:
    model, at = told(learner(method), inputs(3, 4), np.zeros(3), first=5.0), inputs(5, 5)
    before = predicted(model, at)
    for t in (5.2, 5.1, -1.0):
        with pytest.raises(DataError, match="time stands still or runs backwards"):
            model.observe(np.zeros(D), 1.0, t)
    np.testing.assert_array_equal(predicted(model, at), before)
    model.observe(np.zeros(D), 1.0, 5.3)
    assert model.samples == 4


def test_there_is_no_mean_where_the_input_is_not_finite(method: str) -> None:
    assert np.isnan(learner(method).mean(np.full(D, np.nan)))


def test_repeated_and_constant_samples_stay_finite(method: str) -> None:
    x = inputs(1, 6)[0]
    model = told(learner(method), np.tile(x, (80, 1)), np.full(80, 0.4))
    assert model.mean(x) == pytest.approx(0.4, abs=0.2)
    assert np.isfinite(predicted(model, inputs(20, 7))).all()


def test_more_samples_than_it_keeps_leave_it_sound(method: str) -> None:
    X = np.sin(np.linspace(0.0, 30.0, 300)[:, None] * np.linspace(0.5, 1.5, D))
    model = told(learner(method, size=25), X, function(X))
    error = predicted(model, X[-100:]) - function(X[-100:])
    assert np.mean(error**2) < 0.2 * function(X).var()


def test_the_same_start_and_generator_learn_the_same(method: str) -> None:
    X, at = inputs(20, 8), inputs(5, 9)
    one, other = (predicted(told(learner(method), X, function(X)), at) for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("forgetting", ["variance", "ssgp"])
def test_with_a_half_life_a_function_that_changes_is_followed(forgetting: str) -> None:
    X = np.sin(np.linspace(0.0, 60.0, 600)[:, None] * np.linspace(0.5, 1.5, D))
    errors = []
    for half_life in (None, 5.0):
        model = told(learner(forgetting, size=40, half_life=half_life), X[:300], function(X[:300]))
        told(model, X[300:], -function(X[300:]), first=100.0)
        errors.append(np.mean((predicted(model, X[500:]) + function(X[500:])) ** 2))
    assert errors[1] < 0.5 * errors[0]


def test_an_unknown_method_is_refused_with_the_choices() -> None:
    with pytest.raises(UsageError, match=r"no online method 'magic'.*variance, error"):
        begin(start(), OnlineConfig("magic"), np.random.default_rng(0))


@pytest.mark.parametrize(
    "bad",
    [{"size": 0}, {"frequencies": 0}, {"rate_hz": 0.0}, {"window_s": np.nan}, {"memory_s": -1.0},
     {"half_life": 0.0}, {"hold_s": -1.0}, {"hold_s": np.inf}],
)  # fmt: skip
def test_impossible_configurations_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(UsageError, match=next(iter(bad))):
        OnlineConfig(**bad)
