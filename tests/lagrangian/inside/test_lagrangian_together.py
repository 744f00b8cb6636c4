"""The Lagrangian prior of all commands: reference values, laws of mechanics, and what the member promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lagrangian_examples import (
    AT_X,
    POTENTIAL,
    SLIDE,
    SLIDING,
    THETA,
    TURNING,
    V_00,
    VALUES,
    X,
    Z,
    alone,
    joints,
    motion,
    random_parameters,
)

from etude.errors import DataError, UsageError
from etude.models import Linear, ModelConfig, structured
from etude.protocols import FitData
from etude.testing import ProcessSuite, central
from etude_lagrangian import Joints, all_lin
from etude_lagrangian.likelihood import JointHyperparameters, initial_hyperparameters, joint_likelihood
from etude_lagrangian.member import AllOutputs
from etude_lagrangian.prior import JointPrior

NOTHING = -400.0
"""Log slope of an addition that adds nothing."""
BOTH = np.arange(2)
IN_THETA = [
    *(4.9213869979, 1.7357788297, 3.8881329873, 2.364867245, -0.098428697827, -7.4920663853),
    *(-6.0093755205, -0.71257212191, 0.55168121735, 7.9174599941, -16.054690513, -6.8999428636),
]
IN_X = [3.9243075598, -4.7924828307, 1.4815834105, 1.5440672788, 4.1078852247, -0.277173551]
PARTS = ("a", "b", "c")
COLUMNS = tuple(
    (channel, part, "rad", op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
    for part in PARTS
)


def pure(own: Joints, theta: np.ndarray) -> tuple[JointPrior, np.ndarray]:
    """The prior without additions."""
    return JointPrior(own, (Linear((0,)),) * own.count), np.append(theta, [NOTHING] * own.count)


def test_reference_values() -> None:
    prior, theta = pure(TURNING, THETA)
    np.testing.assert_allclose(prior.cross(theta, X, Z, BOTH), VALUES, rtol=1e-11)
    np.testing.assert_allclose(prior.gram(theta, X, BOTH), AT_X, rtol=1e-12)
    np.testing.assert_allclose(prior.diagonal(theta, X)[0], AT_X.diagonal(), rtol=1e-12)
    massless = THETA.copy()
    massless[V_00 : V_00 + 3] = NOTHING
    np.testing.assert_allclose(prior.cross(pure(TURNING, massless)[1], X, Z, BOTH), POTENTIAL, rtol=1e-12)


def test_reference_values_with_a_slide() -> None:
    prior, theta = pure(SLIDING, np.delete(THETA, [4, 11]))
    np.testing.assert_allclose(prior.cross(theta, X, Z, BOTH), SLIDE, rtol=1e-12)


def test_reference_gradients() -> None:
    from etude_lagrangian.all_outputs import EVERY, sweep_all

    prior, _ = pure(TURNING, THETA)
    p, F, fixed = prior.parameters.array(THETA), TURNING.packed(X), TURNING.packed(Z)
    dF, dp = np.zeros_like(F), np.zeros_like(p)
    sweep_all(p, F, fixed, EVERY, np.ones((2, 1, 2, 1)), True, dF, dp)
    np.testing.assert_allclose(prior.parameters.pulled(p, dp), IN_THETA, rtol=2e-10)
    np.testing.assert_allclose(TURNING.pulled(F, dF, 6)[0], IN_X, rtol=2e-10)


def test_reference_likelihood() -> None:
    prior, theta = pure(TURNING, THETA)
    inputs, outputs = motion()
    at = JointHyperparameters(theta, np.log([0.5, 0.5]), np.zeros(2))
    value, gradient = joint_likelihood(prior, at, inputs, outputs.T.ravel(), np.arange(12))
    assert -value == pytest.approx(37.5862732227, rel=1e-11)
    found = (-gradient[0], -gradient[V_00], -gradient[-2:].sum())
    np.testing.assert_allclose(found, (-2.67209163, -0.87878073, -10.42608198), rtol=2e-9)


@pytest.mark.parametrize("slides", [(), (1,)])
def test_each_commands_own_prior_is_its_diagonal_block(slides: tuple[int, ...]) -> None:
    own, rng = joints(3, slides), np.random.default_rng(0)
    theta, inputs, others = random_parameters(own), rng.normal(size=(40, 9)), rng.normal(size=(35, 9))
    prior, whole = pure(own, theta)
    K = prior.cross(whole, inputs, others, np.arange(3 * 35)).reshape(3, 40, 3, 35)
    for k in range(3):
        kernel, mine = alone(own, theta, k)
        np.testing.assert_allclose(K[k, :, k], kernel.value(mine, inputs, others), rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(
            prior.diagonal(whole, inputs)[:, k], kernel.diagonal(mine, inputs), rtol=1e-10
        )


def test_symmetric_and_positive_semidefinite() -> None:
    own = joints(3, (2,))
    prior, theta = pure(own, random_parameters(own))
    inputs = np.random.default_rng(1).normal(size=(37, 9))
    K = prior.gram(theta, inputs, np.arange(3 * 37))
    np.testing.assert_allclose(K, K.T, rtol=1e-10, atol=1e-11)
    assert np.linalg.eigvalsh(K).min() > -1e-10 * K.diagonal().mean()


def test_along_a_closed_motion_the_commands_do_no_work() -> None:
    """Any weights on torques give torques of one energy, so that Σ w·tau over a period is nothing."""
    own, rng = joints(3, (1,)), np.random.default_rng(2)
    prior, theta = pure(own, random_parameters(own))
    t = np.arange(400) / 400 * 2 * np.pi
    order = np.array([1.0, 2.0, 3.0])
    phase, amplitude = rng.uniform(0, 6, 3), rng.uniform(0.5, 1.0, 3)
    angle = np.outer(t, order) + phase
    q, w, u = (amplitude * x for x in (np.sin(angle), order * np.cos(angle), -(order**2) * np.sin(angle)))
    there = rng.normal(size=(20, 9))
    K = prior.cross(theta, np.hstack([q, w, u]), there, np.arange(60))
    tau = (K @ rng.normal(size=60)).reshape(3, -1).T
    assert abs(np.sum(w * tau)) < 1e-13 * np.sum(np.abs(w * tau))


def entries() -> tuple[JointPrior, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A prior with friction, some entries left out."""
    rng = np.random.default_rng(4)
    prior = all_lin.prior(COLUMNS, PARTS)
    inputs = rng.normal(size=(9, 12))
    used = np.flatnonzero(rng.uniform(size=27) < 0.7)
    return prior, inputs, rng.normal(size=27)[used], used, 0.3 * rng.normal(size=prior.size)


def test_derivatives_of_the_likelihood_with_entries_left_out() -> None:
    prior, inputs, y, used, theta = entries()
    at = JointHyperparameters(theta, np.log([0.5, 0.3, 0.4]), np.full(3, 0.1))
    _, gradient = joint_likelihood(prior, at, inputs, y, used)

    def value(vector: np.ndarray) -> float:
        return joint_likelihood(prior, at.with_vector(vector), inputs, y, used)[0]

    np.testing.assert_allclose(gradient, central(value, at.vector), rtol=1e-5, atol=1e-6)


def test_entries_left_out_are_those_rows_taken_away() -> None:
    prior, inputs, _, used, theta = entries()
    whole = prior.gram(theta, inputs, np.arange(27))
    np.testing.assert_array_equal(prior.gram(theta, inputs, used), whole[np.ix_(used, used)])


def test_training_starts_from_the_scales_of_the_data() -> None:
    prior, inputs, _, _, _ = entries()
    y = np.repeat([4.0, 2.0, 0.2], 9)
    start, weak = initial_hyperparameters(prior, inputs, y, np.arange(27), np.full(3, 0.1))
    named = dict(zip(prior.parameters.names(), np.exp(start.theta), strict=False))
    acceleration = 0.5 * np.ptp(inputs[:, 6:9], axis=0)
    assert named["potential"] == pytest.approx(2.0)  # half of the largest: one of four parts
    assert named["potential_sin[1]"] ** 2 == pytest.approx(0.25)
    assert named["potential_cos[2]"] ** 2 == pytest.approx(0.05)
    assert named["inertia[2,1]"] == pytest.approx(1.0 / (acceleration[1] * np.sqrt(2.0 * 3.0 * 3.0)))
    np.testing.assert_allclose(np.exp(start.log_noise), [2.0, 1.0, 0.1])
    np.testing.assert_allclose(weak.centre[-3:], np.log([0.4, 0.2, 0.02]))
    assert weak.width[0] == 1.0
    assert weak.width[1] == 1.5


# what a member owes


def fit_data(n: int = 60, **changes) -> FitData:
    """Three joints: gravity, inertia and friction; entries at rest, and two that say nothing."""
    rng = np.random.default_rng(7)
    q, w, u = (rng.uniform(-1.0, 1.0, (n, 3)) for _ in range(3))
    inputs = np.hstack([q, w, u, np.tanh(w / 0.1)])
    outputs = 2.0 * np.sin(q) + u + 0.3 * np.tanh(w / 0.1) + 0.05 * rng.normal(size=(n, 3))
    usable = np.ones((n, 3), dtype=np.bool_)
    usable[3, 1] = usable[40, 2] = False
    group = np.repeat(np.arange(3), n // 3)
    data = FitData(
        X=inputs,
        Y=outputs - outputs.mean(axis=0),
        usable=usable,
        moving=np.abs(w) > 0.05,
        group=group,
        fold=group,
        chosen=np.arange(0, n, 3),
        kept=np.arange(0, n, 2),
        columns=COLUMNS,
        commands=PARTS,
        kernels=(),
        floor=np.full(3, 0.02),
        start=None,
        config=ModelConfig(steps=6),
        rng=rng,
    )
    return replace(data, **changes)


@pytest.fixture(scope="module")
def learned():
    return all_lin(fit_data())


class TestTogether(ProcessSuite):
    """On the data of an arm, since the suite's have no joints."""

    member = AllOutputs()
    commands = 3
    covariances = False  # of its latents, exact processes, that is asked elsewhere

    def data(self, n: int = 60, seed: int = 0) -> FitData:
        return fit_data(n)

    def elsewhere(self, n: int = 12):
        return np.random.default_rng(9).uniform(-0.9, 0.9, (n, 12))

    def test_it_learned_something(self) -> None:
        data = fit_data()
        error = all_lin(data).predict(data.X[1::2])[0] - data.Y[1::2]
        assert np.mean(error**2) < 0.1 * np.mean(data.Y**2)


def test_what_is_held_out_is_what_others_would_predict(learned) -> None:
    """Entries that count, others, and instants that were thinned out: as if never told of the fold."""
    data = fit_data()
    own = data.kept[data.fold[data.kept] == 1]
    mean, variance = learned.held_out(own)
    others = data.kept[data.fold[data.kept] != 1]
    steps = replace(data.config, steps=0, schedule="constant")
    without = all_lin(replace(data, kept=others, start=learned, config=steps))
    wanted, latent = without.predict(data.X[own])
    np.testing.assert_allclose(mean, wanted, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(variance, latent + without.noise_variance, rtol=1e-7)
    assert not (data.usable & data.moving)[own].all()
    spare = np.flatnonzero(data.fold == 1)[1::2]  # never conditioned on
    np.testing.assert_allclose(
        learned.held_out(spare)[0], without.predict(data.X[spare])[0], rtol=1e-7, atol=1e-9
    )
    changed = data.Y + np.where(data.fold[:, None] == 1, 5.0, 0.5)
    again = all_lin(replace(data, kept=others, start=learned, config=steps, Y=changed))
    np.testing.assert_allclose(
        learned.held_out(own, changed)[0], again.predict(data.X[own])[0], rtol=1e-7, atol=1e-9
    )


def test_entries_that_do_not_count_teach_nothing(learned) -> None:
    data = fit_data()
    spoiled = np.where(data.usable & data.moving, data.Y, 100.0)
    again = all_lin(replace(data, Y=spoiled))
    np.testing.assert_array_equal(again.mean(data.X[:5]), learned.mean(data.X[:5]))


def test_the_mean_is_that_of_the_covariances_and_of_single_points(learned) -> None:
    new = np.random.default_rng(5).normal(size=(70, 12))
    K = learned.prior.cross(learned.at.theta, new, learned.X, learned.used)
    wanted = (K @ learned.alpha.ravel()[learned.used]).reshape(3, -1).T
    np.testing.assert_allclose(learned.mean(new), wanted, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(learned.predict(new)[0], wanted, rtol=1e-9, atol=1e-10)
    point = learned.point()
    np.testing.assert_allclose([point(x) for x in new[:4]], wanted[:4], rtol=1e-9, atol=1e-10)
    with pytest.raises(UsageError, match="one input of shape"):
        point(new)


def test_variances_of_few_instants_are_at_least_those_of_all(learned) -> None:
    new = learned.X[::3] + 0.1
    (mean, variance), (same, bound) = learned.predict(new), learned.at_most(new)
    np.testing.assert_array_equal(same, mean)
    assert (bound >= variance * (1.0 - 1e-9)).all()
    assert (bound > 1.01 * variance).any()
    few, used, _ = learned._variance_subset
    assert len(few) <= -(-len(learned.X) // 4)
    assert len(used) <= -(-len(learned.X) // 4) * len(PARTS)


def test_designs_see_each_command_alone_with_the_shared_hyperparameters(learned) -> None:
    latents = learned.latents()
    assert [own for _, own in latents] == [(0,), (1,), (2,)]
    p, _ = learned.prior.split(learned.at.theta)
    for j, (posterior, _) in enumerate(latents):
        energy = posterior.kernel.parts[0]
        shared = energy.parameters.array(posterior.theta[: energy.size])
        np.testing.assert_allclose(shared[:4], p[:4], rtol=1e-12)
        counts = learned.counts[:, j]
        np.testing.assert_array_equal(posterior.X, learned.X[counts])
        assert posterior.noise_variance == learned.noise_variance[j]
        own = np.arange(3 * 60).reshape(3, 60)[j]
        block = learned.prior.cross(learned.at.theta, posterior.X[:4], fit_data().X, own)
        single = posterior.kernel.value(posterior.theta, posterior.X[:4], fit_data().X)
        np.testing.assert_allclose(block.reshape(3, 4, 60)[j], single, rtol=1e-9, atol=1e-10)


def test_it_trains_on_from_the_last_round(learned) -> None:
    data = fit_data()
    kept = all_lin(replace(data, start=learned, config=replace(data.config, schedule="constant")))
    np.testing.assert_array_equal(kept.at.vector, learned.at.vector)
    on = all_lin(replace(data, start=learned))
    again = all_lin(replace(data, start=learned, config=replace(data.config, schedule="reinitialise")))
    np.testing.assert_array_equal(again.at.vector, learned.at.vector)
    assert not np.array_equal(on.at.vector, learned.at.vector)


def test_more_instants_than_it_takes_are_thinned() -> None:
    data = fit_data(n=360, config=ModelConfig(steps=0), chosen=np.arange(360), kept=np.arange(360))
    process = all_lin(data)
    assert len(process.X) == 300
    mean, variance = process.held_out(np.flatnonzero(data.fold == 2))
    assert np.isfinite(mean).all()
    assert (variance > 0.0).all()


def test_other_additions() -> None:
    data = fit_data(n=45, config=ModelConfig(steps=0))
    process = AllOutputs(structured)(data)
    assert len(process.prior.additions[0].parts) == 5
    assert np.isfinite(process.predict(data.X)[1]).all()


@pytest.mark.parametrize("commands", [("a", "b"), ("b", "a", "c"), ("a", "b", "tool")])
def test_commands_that_are_not_the_joints_are_refused(commands) -> None:
    with pytest.raises(UsageError, match="commands of all joints, from base to tip"):
        all_lin(fit_data(commands=commands))


def test_without_an_entry_that_counts_it_says_so() -> None:
    data = fit_data(config=ModelConfig(steps=0))
    process = all_lin(data)
    with pytest.raises(DataError, match="no entry of any command can be used"):
        replace(process, counts=np.zeros_like(process.counts))
