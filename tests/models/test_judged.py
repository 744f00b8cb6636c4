"""One log against a model: what is asked of the model, and that what it lacks makes nothing up."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from etude.models import LearnedModel, change_test
from etude.types import Channel, Log, Samples

UNITS = ("rad", "rad")
AXES = ("a", "b")


class Known:
    """A model that predicts nothing, with a deviation of 0.5, and gravity as sin q."""

    freedom = 20.0
    different = 1.0
    unknown = 0.0

    def posterior(self, log: Log) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(log["command"]), np.full_like(log["command"], 0.25)

    def parted(self, log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mean, variance = self.posterior(log)
        return mean, variance, variance - self.unknown

    def mean(self, log: Log) -> np.ndarray:
        return np.zeros_like(log["command"])

    def worth(self) -> np.ndarray:
        return np.array([0.1, 3.0])

    def static(self, log: Log, *, fade: bool = True) -> np.ndarray:
        return np.sin(log["q"])


def samples(error: np.ndarray, rates: bool = True) -> Samples:
    t = np.arange(len(error)) * 0.1
    q = np.sin(np.outer(t, [0.7, 1.1]))
    v, a = (np.gradient(part, 0.1, axis=0) for part in (q, np.gradient(q, 0.1, axis=0)))
    channels = {
        "q": Channel("q", AXES, UNITS),
        "qd": Channel("qd", AXES, UNITS, derivative_of="q" if rates else ""),
        "qdd": Channel("qdd", AXES, UNITS, derivative_of="qd"),
        "command": Channel("command", AXES, UNITS, "command", acts_on="q"),
    }
    log = Log(t, channels, {"q": q, "qd": v, "qdd": a, "command": error})
    use = np.ones(error.shape, dtype=bool)
    return Samples(log, np.zeros(len(t), dtype=np.int64), use, use)


MODEL = cast("LearnedModel", Known())
NOISE = 0.5 * np.random.default_rng(2).standard_normal((400, 2))


def test_errors_as_large_as_predicted_are_no_change() -> None:
    found = change_test(MODEL, samples(NOISE))
    assert (found.alarm, found.cause, found.output) == (None, "unknown", None)
    assert found.z2 == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("rates", "cause"), [(True, "friction"), (False, "unknown")])
def test_a_change_is_noticed_and_named_where_rates_are_known(rates: bool, cause: str) -> None:
    log = samples(NOISE, rates)
    more = np.sign(log.log["qd"]) * np.array([[0.0, 3.0]])
    changed = samples(NOISE + more, rates)
    found: Any = change_test(MODEL, changed)
    assert 0 < found.alarm < 20
    assert (found.cause, found.output) == (cause, 1)


def test_a_sample_is_never_worth_more_than_itself() -> None:
    class Whole(Known):
        def worth(self) -> np.ndarray:
            return np.array([0.1, 1.0])

    few = samples(np.array([[0.0, 5.0], [0.0, 5.0]]))
    whole = change_test(cast("LearnedModel", Whole()), few).evidence
    np.testing.assert_array_equal(change_test(MODEL, few).evidence, whole)
    assert whole[0] > 0.0


def test_what_does_not_move_is_not_asked() -> None:
    log = samples(NOISE + 100.0)
    still = Samples(log.log, log.group, log.usable, np.zeros_like(log.moving))
    found = change_test(MODEL, still)
    assert (found.alarm, found.z2, found.evidence.max()) == (None, 0.0, 0.0)


def test_errors_where_the_model_knows_little_are_no_change() -> None:
    """Twice the deviation that it has there is none; where all is noise it is one, and far more is always."""

    class Unsure(Known):
        unknown = 0.2

    unsure = cast("LearnedModel", Unsure())
    assert change_test(MODEL, samples(1.8 * NOISE)).alarm is not None
    assert change_test(unsure, samples(1.8 * NOISE)).alarm is None
    assert change_test(unsure, samples(1.8 * NOISE)).z2 == change_test(MODEL, samples(1.8 * NOISE)).z2
    assert change_test(unsure, samples(4.0 * NOISE)).alarm is not None
