"""What every criterion owes, built in or of a plug-in: each name in `etude.criteria` is tested here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude import plugins
from etude.design import Criterion, Output, PlainBatch, Score, criterion_named, evaluate, needs_of, value_of
from etude.design.config import GROUP
from etude.errors import UsageError
from etude.models import ExactGP, structured
from etude.protocols import Posterior
from etude.testing import CriterionSuite

D, T = 8, 7
COLUMNS = [
    (channel, joint, "1", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
    for joint in "ab"
]
NAMES = plugins.names(GROUP)
EVERY = pytest.mark.parametrize("criterion", [criterion_named(name) for name in NAMES], ids=NAMES)
KERNEL = structured(COLUMNS, ("a",))


def suite(name: str) -> type[CriterionSuite]:
    """The laws of `etude.testing` for the criterion of that name."""
    members = {"criterion": staticmethod(criterion_named(name)), "averaged": name == "mean_variance"}
    return type(f"Test_{name}", (CriterionSuite,), members)


globals().update({f"Test_{name}": suite(name) for name in NAMES})


def outputs() -> list[Output]:
    rng = np.random.default_rng(0)
    made = []
    for size in (1.0, 12.0):
        X = rng.uniform(-1.0, 1.0, (25, D))
        gp = ExactGP(KERNEL, KERNEL.initial(np.ones(D), size), np.log(0.1 * size))
        posterior = gp.condition(X, rng.standard_normal(25))
        made.append(Output.of(posterior, rng.uniform(-1.0, 1.0, (11, D))))
    return made


def batch(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (T, D)), rng.uniform(-0.9, 0.9, (T, 2))


@EVERY
def test_a_posterior_with_the_bare_contract_gives_the_same(criterion: Criterion) -> None:
    class Bare:
        def __init__(self, posterior: Posterior) -> None:
            self.predict = posterior.predict
            self.covariance = posterior.covariance
            self.covariance_gradient = posterior.covariance_gradient
            self.variance_gradient = posterior.variance_gradient
            self.noise_variance, self.signal_variance = posterior.noise_variance, posterior.signal_variance

    full, (X, gains) = outputs(), batch()
    bare = [Output.of(Bare(o.posterior), o.reference) for o in full]
    assert isinstance(bare[0].reference_batch, PlainBatch)
    for one, two in zip(
        evaluate(criterion, full, X, gains), evaluate(criterion, bare, X, gains), strict=True
    ):
        np.testing.assert_allclose(one, two, rtol=1e-8, atol=1e-10)


@EVERY
def test_nothing_depends_on_what_was_measured(criterion: Criterion) -> None:
    made, (X, gains) = outputs(), batch()
    other = [
        replace(
            o,
            posterior=ExactGP(
                o.posterior.kernel, o.posterior.theta, 0.5 * np.log(o.posterior.noise_variance)
            ).condition(o.posterior.X, o.posterior.y[::-1].copy()),
        )
        for o in made
    ]
    other = [Output.of(o.posterior, o.reference) for o in other]
    assert value_of(criterion, other, X, gains) == pytest.approx(
        value_of(criterion, made, X, gains), rel=1e-9
    )


@EVERY
def test_more_samples_never_say_less(criterion: Criterion) -> None:
    """Of a mean over samples that is not so: `mean_variance` is one."""
    made, (X, gains) = outputs(), batch()
    values = [value_of(criterion, made, X[:n], gains[:n]) for n in range(1, T + 1)]
    if criterion is criterion_named("mean_variance"):
        values = [n * value for n, value in enumerate(values, start=1)]
    assert np.all(np.diff(values) > -1e-12)


def loud(output: Output, batch: PlainBatch, gain: np.ndarray) -> Score:
    """Largest where samples are loud: a plug-in in order, but for what the tests below change."""
    variance = batch.variance()
    return Score(float(gain**2 @ variance), 2.0 * gain * variance, variance=gain**2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda s: replace(s, value=np.nan),
            r"returns the value nan, not a finite number",
        ),
        (lambda s: replace(s, value=np.ones(2)), r"criterion 'broken' returns the value \[1. 1.\]"),
        (lambda s: replace(s, gain=s.gain[:-1]), r"'broken' returns derivatives in 'gain' .* shape \(6,\)"),
        (lambda s: replace(s, variance=np.full(T, np.nan)), r"'broken' .* 'variance' that are not finite"),
        (lambda s: replace(s, own=np.ones((T, 2))), r"'broken' .* 'own' that are of shape"),
        (lambda s: replace(s, cross=np.ones((T, T))), r"'broken' .* 'cross' that are of shape"),
        (lambda s: s.value, r"'broken' returns a float, not a Score"),
        (lambda s: 1 / 0, r"'broken' fails: ZeroDivisionError"),
    ],
)
def test_a_broken_criterion_is_named(change, message: str) -> None:
    def broken(output: Output, batch: PlainBatch, gain: np.ndarray) -> Score:
        return change(loud(output, batch, gain))

    made, (X, gains) = outputs(), batch()
    with pytest.raises(UsageError, match=message):
        evaluate(broken, made, X, gains)
    with pytest.raises(UsageError, match=message):
        value_of(broken, made, X, gains)


def test_a_criterion_is_found_by_its_full_name() -> None:
    assert criterion_named("etude.design.criteria:ivr") is criterion_named("ivr")
    assert [needs_of(criterion_named(name)) for name in ("ivr", "d_opt", "info_gain")] == [
        "reference",
        "identified",
        "",
    ]
    with pytest.raises(UsageError, match="is not a criterion"):
        criterion_named("etude.design.criteria:LOG_FLOOR")
    with pytest.raises(UsageError, match="there is no criterion 'inform'"):
        criterion_named("inform")
