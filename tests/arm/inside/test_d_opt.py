"""The determinant of the identified parameters' information, in its own words and through the design."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_home,
    arm_limits,
    arm_model,
    arm_point,
    arm_spec,
    assert_same,
    candidate,
)

from etude import plugins
from etude.design import (
    Design,
    DesignConfig,
    Latent,
    Output,
    criterion_named,
    design,
    evaluate,
    latents_of,
    needs_of,
    of_parameters,
    value_of,
)
from etude.errors import UsageError
from etude.limits import certify
from etude.testing import central
from etude_arm import ArmSpec
from etude_arm.physics.base_parameters import base_directions, parameter_scale, spread_states
from etude_arm.physics.base_regressor import BaseRegressor, base_regressors
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.rigid_body import RigidBodyModel, command_regressors
from etude_arm.physics.transmission import joint_drives

QUICK = DesignConfig(criterion="d_opt", candidates=6, refine=2, steps=15, points=25, reference_points=30)
d_opt, info_gain = criterion_named("d_opt"), criterion_named("info_gain")
V0 = np.array([0.05, 0.05])


@dataclass(frozen=True, eq=False)
class Physics:
    """As d_opt sees one."""

    spec: ArmSpec
    body: RigidBodyModel

    def regressors(self) -> tuple[BaseRegressor, ...]:
        return base_regressors(self.spec, self.body.tree, self.body.drives, self.body.friction_velocity)


def arm_body() -> RigidBodyModel:
    """Two links of 0.4 m in a vertical plane, 2 kg and 1 kg with their mass half-way."""
    link = np.zeros((3, 10))
    for body, mass in ((1, 2.0), (2, 1.0)):
        link[body] = [mass, 0.2 * mass, 0.0, 0.0, 0.001, 0.05 * mass, 0.05 * mass, 0.0, 0.0, 0.0]
    tree = KinematicTree(
        parent=np.array([0, 0, 1]),
        position=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]),
        rotation=np.tile(np.eye(3), (3, 1, 1)),
        joint_body=np.array([1, 2]),
        joint_axis=np.tile([0.0, 1.0, 0.0], (2, 1)),
        joint_anchor=np.zeros((2, 3)),
        joint_slides=np.zeros(2, dtype=bool),
        joint_zero=np.zeros(2),
        gravity=np.array([0.0, 0.0, -9.81]),
        nominal=link,
    )
    unknown, terms = np.zeros(2), np.zeros((2, 6))
    return RigidBodyModel(
        tree, joint_drives(2), V0, np.zeros((2, 20)), terms, unknown.astype(int), unknown, terms, unknown
    )


PHYSICS = {"identified": Physics(arm_spec(), arm_body())}


def known(points: int = 60, unit: float = 1.0) -> tuple[Latent, ...]:
    return of_parameters(latents_of(arm_model(points=points, unit=unit)), PHYSICS)


def outputs(points: int = 60) -> list[Output]:
    return [Output.of(latent.posterior, np.zeros((0, 8))) for latent in known(points)]


def planned(samples: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng, family = np.random.default_rng(4), arm_family()
    motion = family.motion(arm_point(rng, family), np.linspace(3.0, 27.0, samples), 3)
    return arm_model().inputs.plan(motion).X, rng.uniform(0.1, 1.0, (samples, 2))


def run(criterion: str = "d_opt", physics=PHYSICS) -> Design:
    model, config, rng = arm_model(), replace(QUICK, criterion=criterion), np.random.default_rng(0)
    return design(arm_family(), arm_limits(), arm_home(), model.inputs, model, config, rng, physics=physics)


def test_it_is_the_growth_of_the_parameters_log_determinant() -> None:
    """log det(Y^T W Y + Lambda0) - log det Lambda0, Lambda0 = prior and samples so far, the plain way.

    Base parameters and prior deviations are worked out here from the robot's limits; a determinant ratio
    does not depend on which basis of them is used.
    """
    body, spec = arm_body(), arm_spec()
    posteriors = [latent.posterior for latent in latents_of(arm_model())]
    X, gains = planned()
    spread = command_regressors(body.tree, body.drives, body.friction_velocity, *spread_states(spec, 136))
    nominal = body.tree.nominal[1:].ravel()
    for j, (output, posterior) in enumerate(zip(outputs(), posteriors, strict=True)):
        base = base_directions(spread[0][:, j], parameter_scale(body.tree))
        gain = spec.command[j] / np.sqrt(np.mean((spread[0][:, j] @ nominal) ** 2))
        terms = spec.command[j] / np.sqrt(np.mean(spread[1][:, j] ** 2, axis=0))
        terms[1] *= 0.1  # viscous friction of a force, at top speed, deviates by a tenth of the limit
        prior = np.concatenate([np.full(1 + base.shape[1], gain), terms])

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


@pytest.mark.thinned(2)
@pytest.mark.parametrize("criterion", [criterion_named(n) for n in plugins.BUILT_IN["etude.criteria"]])
def test_gradients_through_the_regressor(criterion) -> None:
    """Every criterion, not only d_opt, works on the identified model's posterior."""
    X, gains = planned(6)
    reference = planned(9)[0] + 0.05
    made = [Output.of(o.posterior, reference) for o in outputs()]
    _, in_X, in_gains = evaluate(criterion, made, X, gains)
    assert np.all(in_X[:, 6:] == 0.0)
    by_X = central(lambda Z: value_of(criterion, made, Z, gains), X)
    assert_same(in_X, by_X)
    assert_same(in_gains, central(lambda g: value_of(criterion, made, X, g), gains))


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
    found, other = run(), run("ivr")
    assert found.value > found.baseline
    assert certify(found.trajectory, arm_limits()).ok
    np.testing.assert_array_equal(found.deviation_before, other.deviation_before)
    assert np.all(found.deviation_after < found.deviation_before)
    assert needs_of(d_opt) == "identified"


def test_parameters_are_known_in_the_commands_unit_however_outputs_are_standardised() -> None:
    X = planned()[0]
    for one, ten in zip(known(), known(unit=10.0), strict=True):
        factor = ten.factors[0] ** 2
        np.testing.assert_allclose(
            factor * ten.posterior.predict(X)[1], one.posterior.predict(X)[1], rtol=1e-6
        )


def test_each_command_of_a_shared_process_has_parameters_of_its_own() -> None:
    posterior = latents_of(arm_model())[0].posterior
    shared = replace(arm_model(), candidates=(candidate(posterior, (0, 1), factor=[1.0, 3.0]),))
    found = of_parameters(latents_of(shared), PHYSICS)
    assert [latent.commands for latent in found] == [(0,), (1,)]
    assert found[1].posterior.noise_variance == pytest.approx(posterior.noise_variance)


@pytest.mark.parametrize("physics", [None, {}, {"nominal": lambda samples: None}])
def test_without_regressors_it_is_refused(physics) -> None:
    with pytest.raises(UsageError, match=r"d_opt needs the identified model, .*info_gain"):
        run(physics=physics)


def test_a_model_that_keeps_no_samples_is_refused() -> None:
    class Forgetful:
        noise_variance = 1.0

    with pytest.raises(UsageError, match=r"a Forgetful keeps none.*info_gain"):
        of_parameters([Latent(Forgetful(), (0,), np.ones(1))], PHYSICS)
