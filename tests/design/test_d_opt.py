"""The determinant of the identified parameters' information, in its own words and through the design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import FAMILIES, arm, assert_same, differences, model, robot
from etude.design.identified import identified_posteriors
from etude.models.features import FeatureMap
from etude.models.physics.base_parameters import base_directions, parameter_scale, spread_states
from etude.models.physics.rigid_body import command_regressors
from etude.trajectories.random import random_trajectory

from etude.design.config import DesignConfig
from etude.design.criteria import CRITERIA, NEEDS_IDENTIFIED, Output, evaluate, value_of
from etude.design.information import d_opt, info_gain
from etude.design.solve import design
from etude.errors import UsageError

QUICK = DesignConfig(criterion="d_opt", candidates=6, refine=2, steps=15, points=25, reference_points=30)


def outputs(points: int = 60) -> list[Output]:
    none = np.zeros((0, 8))
    return [Output.of(p, none) for p in identified_posteriors(model(points=points), robot())]


def planned(samples: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng, family = np.random.default_rng(4), FAMILIES["nullspace"]
    motion = random_trajectory(rng, robot(), family).sample(np.linspace(3.0, 27.0, samples))
    X = model().features.transform(motion.q, motion.qd, motion.qdd)
    return X, rng.uniform(0.1, 1.0, (samples, 2))


def test_it_is_the_growth_of_the_parameters_log_determinant() -> None:
    """log det(Y^T W Y + Lambda0) - log det Lambda0, Lambda0 = prior and samples so far, the plain way.

    Base parameters and prior deviations are worked out here from the robot's limits; a determinant ratio
    does not depend on which basis of them is used.
    """
    known, body, spec = model(), arm(), robot()
    X, gains = planned()
    spread = command_regressors(body.tree, body.drives, body.friction_velocity, *spread_states(spec, 136))
    nominal = body.tree.nominal[1:].ravel()
    for j, (output, posterior) in enumerate(zip(outputs(), known.posteriors, strict=True)):
        base = base_directions(spread[0][:, j], parameter_scale(body.tree))
        gain = spec.command[j] / np.sqrt(np.mean((spread[0][:, j] @ nominal) ** 2))
        prior = np.concatenate(
            [
                np.full(1 + base.shape[1], gain),
                spec.command[j] / np.sqrt(np.mean(spread[1][:, j] ** 2, axis=0)),
            ]
        )

        def regressor(Z: np.ndarray, j: int = j, base: np.ndarray = base) -> np.ndarray:
            motion = (Z[:, :2], Z[:, 2:4], Z[:, 4:6])
            rigid, extra = command_regressors(body.tree, body.drives, body.friction_velocity, *motion)
            return np.column_stack([rigid[:, j] @ nominal, rigid[:, j] @ base, extra[:, j]])

        old, new = regressor(posterior.X), regressor(X)
        before = np.diag(prior**-2.0) + old.T @ old / posterior.noise_variance
        after = before + new.T @ (new * (gains[:, j] ** 2)[:, None]) / posterior.noise_variance
        scale = prior[:, None] * prior
        expected = np.linalg.slogdet(after * scale)[1] - np.linalg.slogdet(before * scale)[1]
        found = value_of(d_opt, [output], X, gains[:, j : j + 1])
        assert found == pytest.approx(expected, rel=1e-8)
        assert found == pytest.approx(2.0 * value_of(info_gain, [output], X, gains[:, j : j + 1]), rel=1e-12)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_gradients_through_the_regressor(criterion: str) -> None:
    """Every criterion, not only d_opt, works on the identified model's posterior."""
    X, gains = planned(6)
    reference = planned(9)[0] + 0.05
    made = [Output.of(o.posterior, reference) for o in outputs()]
    _, in_X, in_gains = evaluate(CRITERIA[criterion], made, X, gains)
    assert np.all(in_X[:, 6:] == 0.0)
    by_X = differences(lambda Z: value_of(CRITERIA[criterion], made, Z, gains), X)
    assert_same(in_X, by_X)
    assert_same(in_gains, differences(lambda g: value_of(CRITERIA[criterion], made, X, g), gains))


def test_what_is_known_already_counts() -> None:
    """A motion is worth less after more samples, and motions planned one after the other add up."""
    X, gains = planned()
    gains = np.ones_like(gains)
    assert value_of(d_opt, outputs(120), X, gains) < value_of(d_opt, outputs(60), X, gains)
    for output in outputs():
        posterior = output.posterior
        both = np.concatenate([posterior.X, X[:10]])
        then = Output.of(posterior.prior.condition(both, np.zeros(len(both))), output.reference)
        one = gains[:10, :1]
        parts = value_of(d_opt, [output], X[:10], one) + value_of(d_opt, [then], X[10:], one)
        assert value_of(d_opt, [output], X, gains[:, :1]) == pytest.approx(parts, rel=1e-8)


def test_a_design_for_the_parameters_is_forecast_by_the_model_itself() -> None:
    """The criterion is the identified model's; the deviations are those of the model's processes."""
    family = FAMILIES["nullspace"]
    found = design(model(), robot(), family, QUICK, np.random.default_rng(0))
    other = design(model(), robot(), family, replace(QUICK, criterion="ivr"), np.random.default_rng(0))
    assert found.value > found.baseline
    assert found.certificate.ok
    np.testing.assert_array_equal(found.deviation_before, other.deviation_before)
    assert np.all(found.deviation_after < found.deviation_before)
    assert frozenset({"d_opt"}) == NEEDS_IDENTIFIED


def test_without_a_model_file_it_is_refused() -> None:
    known = replace(model(), fallback=None)
    with pytest.raises(UsageError, match=r"'pair' has no model_file.*info_gain"):
        design(known, robot(), FAMILIES["nullspace"], QUICK, np.random.default_rng(0))


def test_a_model_file_is_enough() -> None:
    """No identified model yet: geometry from the file, friction velocity from the features or the limits."""
    import etude.design.identified as identified
    from etude.models.physics.geometry import Geometry

    expected = [p.predict(planned()[0])[1] for p in identified_posteriors(model(), robot())]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identified, "read_geometry", lambda spec: Geometry(arm().tree, arm().drives))
        known = replace(model(), fallback=None)
        found = [p.predict(planned()[0])[1] for p in identified_posteriors(known, robot())]
        np.testing.assert_allclose(found, expected)
        plain = replace(known, features=FeatureMap(2))
        assert np.isfinite(identified_posteriors(plain, robot())[0].predict(planned()[0])[1]).all()


def test_a_model_that_keeps_no_samples_is_refused() -> None:
    class Forgetful:
        noise_variance = 1.0

    known = replace(model(), posteriors=(Forgetful(), Forgetful()))
    with pytest.raises(UsageError, match=r"a Forgetful keeps none.*info_gain"):
        identified_posteriors(known, robot())
