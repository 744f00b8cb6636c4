from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from design_examples import Model, arm_inputs, arm_model, candidate, flight_model

from etude.design import Output, latents_of, value_of
from etude.design.criteria import info_gain
from etude.design.latents import PlannedPosterior, fast_posterior, planned
from etude.errors import UsageError


def posterior(number: int = 0):
    return latents_of(flight_model())[number].posterior


def test_every_command_is_seen_once_in_the_order_of_commands() -> None:
    first, second = (latent.posterior for latent in latents_of(arm_model()))
    model = Model(arm_inputs(), (candidate(second, (1,)), candidate(first, (0,), factor=3.0)))
    found = latents_of(model)
    assert [latent.commands for latent in found] == [(0,), (1,)]
    assert found[0].posterior is first
    assert found[0].raw_scale == pytest.approx(1.0 / 9.0)


def test_a_shared_process_is_one_function_of_all_its_commands() -> None:
    (only,) = latents_of(flight_model(shared=True))
    assert only.commands == (0, 1, 2, 3)
    np.testing.assert_array_equal(only.factors, [0.5, 1.0, 2.0, 4.0])
    assert only.raw_scale == pytest.approx(1.0 / np.sum(only.factors**2))


def test_the_rung_in_use_is_what_is_seen() -> None:
    a, b = posterior(0), posterior(1)
    both = (candidate(a, (0,), structure="gp", weight=0.0), candidate(b, (0,), structure="linear+gp"))
    assert latents_of(Model(arm_inputs(), both))[0].posterior is b


@pytest.mark.parametrize(
    ("in_use", "expected"), [("nominal", "nominal+gp"), ("linear", "identified+gp"), ("identified", None)]
)
def test_a_rung_without_a_process_is_seen_through_another(in_use: str, expected: str | None) -> None:
    others = ("gp", "identified+gp", "nominal+gp")
    processes = {structure: posterior(number) for number, structure in enumerate(others)}
    rows = [candidate(p, (0,), structure=structure, weight=0.0) for structure, p in processes.items()]
    model = Model(arm_inputs(), (candidate(None, (0,), structure=in_use), *rows))
    assert latents_of(model)[0].posterior is processes[expected or "identified+gp"]


def test_of_a_group_each_command_has_its_own_rung() -> None:
    shared, alone = posterior(0), posterior(1)
    group = replace(candidate(shared, (0, 1, 2)), weights=np.array([1.0, 0.0, 1.0]))
    model = Model(arm_inputs(), (group, candidate(alone, (1,), structure="linear+gp")))
    found = latents_of(model)
    assert [(latent.commands, latent.posterior) for latent in found] == [((0, 2), shared), ((1,), alone)]


def test_a_command_without_any_process_is_refused() -> None:
    model = Model(arm_inputs(), (candidate(posterior(), (0,)), candidate(None, (1,), structure="linear")))
    with pytest.raises(UsageError, match="command 1 has no process"):
        latents_of(model)


def test_a_member_without_covariances_is_seen_through_its_guide() -> None:
    @dataclass
    class Guided:
        guide: object

    guide = posterior()
    found = latents_of(Model(arm_inputs(), (candidate(Guided(guide), (0,)),)))
    assert found[0].posterior is guide


def test_planned_samples_stand_for_all_that_are_logged() -> None:
    """15 planned samples for 300 logged: each with a twentieth of the noise, the same posterior otherwise."""
    own = latents_of(flight_model())
    assert [p.posterior for p in planned(own, 1.0, 0)] == [p.posterior for p in own]
    X = posterior().X[:15] + 0.1
    for latent, before in zip(planned(own, 15 / 300, 0), own, strict=True):
        noise = before.posterior.noise_variance / 20.0
        assert latent.posterior.noise_variance == pytest.approx(noise)
        S = before.posterior.covariance(X, X) / noise + np.eye(15)
        expected = 0.5 * np.linalg.slogdet(S)[1]
        outputs = [Output.of(latent.posterior, X[:0])]
        assert value_of(info_gain, outputs, X, np.ones((15, 1))) == pytest.approx(expected, rel=1e-9)


def test_a_posterior_seen_through_its_most_telling_samples() -> None:
    exact = latents_of(flight_model(points=200, shared=True, length=0.3))[0].posterior
    assert fast_posterior(exact, 200) is exact
    assert fast_posterior(exact, 0) is exact
    X = exact.X[::3] + 0.05
    before = exact.predict(X)[1]
    errors = []
    for count in (20, 60, 199):
        fast = fast_posterior(exact, count)
        assert fast.noise_variance == pytest.approx(exact.noise_variance)
        errors.append(np.abs(fast.predict(X)[1] - before).max() / exact.signal_variance)
    assert errors[2] < 1e-4
    assert errors[0] > errors[1] > errors[2]
    assert fast_posterior(fast, 5) is fast


def test_a_posterior_that_keeps_the_bare_contract() -> None:
    """Without shared factors the criteria use covariances alone."""

    class Bare:
        def __init__(self, inner) -> None:
            self.noise_variance, self.signal_variance = inner.noise_variance, inner.signal_variance
            names = ("predict", "covariance", "covariance_gradient", "variance_gradient", "mean_gradient")
            for name in names:
                setattr(self, name, getattr(inner, name))

    inner = posterior()
    X = inner.X[:5] + 0.1
    gains, kept = np.ones((5, 1)), [PlannedPosterior(p, 0.01) for p in (inner, Bare(inner))]
    values = [value_of(info_gain, [Output.of(p, X[:0])], X, gains) for p in kept]
    assert values[0] == pytest.approx(values[1])
    np.testing.assert_allclose(PlannedPosterior(inner, 0.1).mean_gradient(X), inner.mean_gradient(X))
