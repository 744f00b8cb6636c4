"""The Lagrangian prior of one command: reference values, and that it is what the joint prior says alone."""

from __future__ import annotations

import numpy as np
import pytest
from lagrangian_examples import (
    ALONE,
    AT_X,
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

from etude.errors import UsageError
from etude.models import ExactGP, PointMean, kernel_metadata, kernel_of, structured
from etude.testing import KernelSuite
from etude_lagrangian import Joints, Lagrangian, gip_lin
from etude_lagrangian.joints import joints_of
from etude_lagrangian.kernel_parameters import Parameters
from etude_sparse import DictionaryConfig, DictionaryGP

PARTS = ("base", "lift", "wrist")
COLUMNS = tuple(
    (channel, part, {"q": "m" if part == "lift" else "rad"}.get(channel, ""), op)
    for channel, op in (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
    for part in PARTS
)
IN_X = (
    [2.3464165201, -5.6002884594, 2.8305075829, 0.52118541789, 3.6492186424, -0.29307924191],
    [0.23186729868, 0.15997600878, -0.24660546015, -0.51394844622, 0.27994817724, -0.24878351394],
)
IN_THETA = [
    *(0.59787990457, 0.74379630366, -0.85662674532, -0.14591639909, 0.32282394144, -7.4920663853),
    *(-4.5890588226, -0.76165500409, 0.50323996199, 7.0239013695, -14.499188472, -5.4861709513),
]
# negative log likelihood and its derivatives in log u0 and log sn
LIKELIHOODS = (
    (17.3428248698, -4.80012062, -2.331334534),
    (19.3559665046, 0.702346673, -6.584458161),
)


class TestSuiteWithASlide(KernelSuite):
    kernel = gip_lin(COLUMNS, ("lift",))
    width = len(COLUMNS)


class TestSuiteOfTheLastJoint(KernelSuite):
    kernel = Lagrangian(joints(3, slides=(1,)), 2)
    width = 9


@pytest.mark.parametrize("k", [0, 1])
def test_reference_values_and_gradients_in_the_inputs(k: int) -> None:
    kernel = Lagrangian(TURNING, k)
    value, vjp = kernel.cross(ALONE[k], X, Z)
    assert value[0, 0] == pytest.approx(VALUES[k, k], rel=1e-11)
    assert kernel.diagonal(ALONE[k], X)[0] == pytest.approx(AT_X[k, k], rel=1e-12)
    np.testing.assert_allclose(vjp(np.ones((1, 1)))[0], IN_X[k], rtol=2e-10)


def test_reference_gradient_in_the_hyperparameters() -> None:
    vjp = Lagrangian(TURNING, 0).gram(THETA, np.vstack([X, Z]))[1]
    np.testing.assert_allclose(vjp(np.array([[0.0, 0.0], [1.0, 0.0]])), IN_THETA, rtol=2e-10)


def test_reference_values_with_a_slide() -> None:
    own = Parameters(SLIDING.slides)
    theta = np.delete(THETA, [4, 11])
    assert len(own.names()) == len(theta)
    for k in (0, 1):
        kernel, mine = alone(SLIDING, theta, k)
        assert kernel.value(mine, X, Z)[0, 0] == pytest.approx(SLIDE[k, k], rel=1e-12)


@pytest.mark.parametrize("k", [0, 1])
def test_reference_likelihoods(k: int) -> None:
    inputs, outputs = motion()
    gp = ExactGP(Lagrangian(TURNING, k), ALONE[k], np.log(0.5))
    value, gradient = gp.log_marginal_likelihood(inputs, outputs[:, k])
    found = (-value, -gradient[0], -gradient[-1])
    np.testing.assert_allclose(found, LIKELIHOODS[k], rtol=2e-9)
    if k == 0:
        assert -gradient[V_00] == pytest.approx(-0.359840509, rel=2e-9)


def test_strips_and_their_ends_hold_the_same_numbers() -> None:
    """One input at a time and more than a strip of them; a half Gram matrix and a whole one."""
    own, rng = joints(3, slides=(2,)), np.random.default_rng(1)
    kernel, theta = alone(own, random_parameters(own), 1)
    inputs, G = rng.normal(size=(67, 9)), rng.normal(size=(67, 67))
    whole, vjp = kernel.cross(theta, inputs, inputs)
    one = np.array([[kernel.value(theta, x[None], z[None])[0, 0] for z in inputs[60:]] for x in inputs[:5]])
    np.testing.assert_allclose(whole[:5, 60:], one, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(kernel.gram(theta, inputs)[0], whole, rtol=1e-11, atol=1e-13)
    apart = sum(kernel.input_gradient(theta, inputs, inputs[i : i + 1], G[:, i : i + 1]) for i in range(67))
    np.testing.assert_allclose(vjp(G), apart, rtol=1e-10, atol=1e-11)


def test_factors_that_vanish_do_no_harm() -> None:
    """With a, b > 1 a factor passes through zero; this form never divides by it."""
    kernel = Lagrangian(TURNING, 0)
    theta = np.where(np.arange(12) >= 8, np.log(3.0), THETA)
    angle = 0.5 * np.arccos(-1.0 / 9.0)  # c = (9 cos(q - q') + 1) / 2 = 0
    here, there = X.copy(), X.copy()
    here[0, 0], there[0, 0] = angle, -angle
    near = there.copy()
    near[0, 0] += 1e-7
    values = kernel.value(theta, here, np.vstack([there, near]))[0]
    assert np.isfinite(values).all()
    assert values[0] == pytest.approx(values[1], abs=1e-4)


def test_the_layout_has_the_terms_that_it_says() -> None:
    kernel = gip_lin(COLUMNS, ("wrist",))
    energy, *friction = kernel.parts
    assert energy == Lagrangian(Joints((0, 1, 2), (3, 4, 5), (6, 7, 8), (False, True, False)), 2)
    assert tuple(friction) == structured(COLUMNS, ("wrist",)).parts[1:4]
    # the last joint moves one link: u0, three a and two b of the potential, three v, three a and two b
    assert energy.size == 1 + 3 + 2 + 3 + 3 + 2
    assert gip_lin(COLUMNS, ("base",)).parts[0].size == 1 + 3 + 2 + 6 + 3 + 2


def test_training_starts_from_the_scales_of_the_data() -> None:
    kernel = Lagrangian(joints(3, slides=(1,)), 1)
    half = np.array([1.0, 0.2, 3.0, *[1.0] * 3, 2.0, 4.0, 8.0])
    start = dict(zip(kernel.names(), kernel.initial(half, 3.0), strict=True))
    assert np.exp(start["potential"]) == pytest.approx(3.0)
    assert np.exp(2.0 * start["inertia_sin[1]"]) == pytest.approx(1.0 / 0.2**2)
    assert np.exp(2.0 * start["potential_sin[1]"]) == pytest.approx(1.0 / 0.2**2)
    assert start["inertia_sin[0]"] == start["potential_cos[2]"] == 0.0
    assert np.exp(start["inertia[1,0]"]) == pytest.approx(3.0 / (2.0 * np.sqrt(2.0 * 2.0 * 2.0)))
    assert np.exp(start["inertia[2,2]"]) == pytest.approx(3.0 / (8.0 * np.sqrt(2.0 * 3.0 * 2.0)))
    assert "inertia[0,0]" not in start
    assert kernel.roles() == ("amplitude", *["slope"] * (kernel.size - 1))


@pytest.mark.parametrize(
    ("columns", "commands", "message"),
    [
        (COLUMNS[:6], ("base",), "needs position, velocity and acceleration"),
        (COLUMNS[:8], ("base",), "of the same joints"),
        (COLUMNS, ("base", "lift"), "of one joint"),
        (COLUMNS, ("tool",), "of one joint"),
        (COLUMNS[:9], ("base",), "its friction among the inputs"),
    ],
)
def test_inputs_that_are_not_there_are_refused(columns, commands, message) -> None:
    with pytest.raises(UsageError, match=message):
        gip_lin(columns, commands)


def test_impossible_joints_are_refused() -> None:
    with pytest.raises(UsageError, match="one column"):
        Joints((0,), (1,), (1,), (False,))
    with pytest.raises(UsageError, match="none of the 2 joints"):
        Lagrangian(TURNING, 2)
    assert joints_of(COLUMNS)[1] == PARTS


def test_it_is_stored_by_its_words() -> None:
    kernel = gip_lin(COLUMNS, ("lift",))
    assert kernel_of(kernel_metadata(kernel)) == kernel


def test_single_points_and_dictionaries_say_the_same() -> None:
    """Alone, with friction, and beside a posterior of another kernel."""
    rng = np.random.default_rng(3)
    inputs, outputs = rng.normal(size=(70, len(COLUMNS))), rng.normal(size=70)
    kernels = (
        gip_lin(COLUMNS, ("base",)),
        structured(COLUMNS, ("lift",)),
        gip_lin(COLUMNS, ("wrist",)).parts[0],
    )
    processes = [ExactGP(k, k.initial(np.ones(len(COLUMNS)), 1.0), -1.0) for k in kernels]
    posteriors = [gp.condition(inputs[: 70 - 9 * i], outputs[: 70 - 9 * i]) for i, gp in enumerate(processes)]
    mean, new = PointMean(posteriors), rng.normal(size=(5, len(COLUMNS)))
    wanted = np.stack([p.mean(new) for p in posteriors], axis=1)
    np.testing.assert_allclose([mean(x) for x in new], wanted, rtol=1e-9, atol=1e-11)
    assert np.isnan(mean(np.full(len(COLUMNS), np.nan))).any()
    kept = DictionaryGP(processes[0], DictionaryConfig(size=20)).condition(inputs, outputs)
    assert PointMean([kept])(new[0])[0] == pytest.approx(kept.mean(new[:1])[0], abs=1e-10)
