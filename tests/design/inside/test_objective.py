from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_inputs,
    arm_model,
    arm_point,
    assert_same,
    flight_family,
    flight_inputs,
    flight_model,
    flight_point,
)

from etude import plugins
from etude.design import Objective, Output, criterion_named, latents_of
from etude.design.config import GROUP
from etude.design.latents import planned
from etude.design.objective import gains_of, instants, vjp_gains
from etude.testing import central
from etude.types import Motion, Planned

NAMES = tuple(plugins.BUILT_IN[GROUP])
EVERY = pytest.mark.parametrize("criterion", NAMES)
FAMILY = pytest.mark.parametrize("family", ["nullspace", "ramp, omega0 drawn"])


def objective(criterion: str, model, family, reference: np.ndarray, *, share: float = 1.0) -> Objective:
    latents = planned(latents_of(model), share, 0)
    outputs = tuple(Output.of(latent.posterior, reference) for latent in latents)
    times, keep = instants(30.0, 12, model.inputs.rate)
    commands = tuple(latent.commands for latent in latents)
    return Objective(criterion_named(criterion), outputs, commands, model.inputs, family, times, keep)


def arm_aim(criterion: str, family_name: str, stick: float = 0.02) -> tuple[Objective, np.ndarray]:
    rng, model = np.random.default_rng(9), arm_model(stick=stick)
    family = arm_family(family_name).drawn(rng)
    t = np.linspace(3.0, 27.0, 9)
    reference = model.inputs.plan(family.motion(arm_point(rng, family), t, 3)).X
    return objective(criterion, model, family, reference), arm_point(rng, family)


@pytest.mark.thinned
@EVERY
@FAMILY
@pytest.mark.parametrize("stick", [0.0, 0.03])
def test_gradient_for_an_arm(criterion: str, family: str, stick: float) -> None:
    aim, at = arm_aim(criterion, family, stick)
    value, gradient = aim.value_and_gradient(at)
    assert value == pytest.approx(aim.value(at), rel=1e-10)
    assert_same(gradient, central(aim.value, at))


@pytest.mark.thinned
@EVERY
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("source", ["specific_force", "kinematic"])
def test_gradient_for_a_vehicle(criterion: str, shared: bool, rest: bool, source: str) -> None:
    model = flight_model(flight_inputs(acceleration=source), shared=shared)
    rng, family = np.random.default_rng(1), flight_family(rest=rest)
    t = np.linspace(3.0, 27.0, 9)
    reference = model.inputs.plan(family.motion(flight_point(rng, family), t, 5)).X
    aim, at = objective(criterion, model, family, reference, share=0.05), flight_point(rng, family)
    value, gradient = aim.value_and_gradient(at)
    assert value == pytest.approx(aim.value(at), rel=1e-10)
    assert_same(gradient, central(aim.value, at, 1e-4))


def test_drag_matters() -> None:
    rng, family = np.random.default_rng(1), flight_family()
    at, values = flight_point(rng, family), []
    for inputs in (flight_inputs(), flight_inputs(drag=(0.0, 0.0, 0.0))):
        model = replace(flight_model(), inputs=inputs)
        values.append(objective("info_gain", model, family, np.zeros((0, 13))).value(at))
    assert values[0] != pytest.approx(values[1], rel=1e-3)


def test_slow_motion_teaches_less_where_slow_samples_are_masked() -> None:
    aim, at = arm_aim("ivr", "nullspace", 0.0)
    assert replace(aim, inputs=arm_inputs(0.1)).value(at) < aim.value(at)


def test_commands_that_share_a_function_share_its_samples() -> None:
    gains = np.array([[1.0, 1.0, -0.5], [0.6, 0.0, 0.5], [0.0, 0.0, 0.0]])
    found = gains_of([(0, 1), (2,)], gains)
    np.testing.assert_allclose(found[:, 0] ** 2, 0.5 * (gains[:, 0] ** 2 + gains[:, 1] ** 2))
    np.testing.assert_array_equal(found[:, 1], gains[:, 2])
    weights = np.array([[1.0, 3.0], [2.0, -1.0], [0.0, 2.0]])
    back = vjp_gains([(0, 1), (2,)], gains, weights)
    by_differences = central(lambda g: float(np.sum(weights * gains_of([(0, 1), (2,)], g))), gains)
    np.testing.assert_allclose(back[:2], by_differences[:2], atol=1e-8)
    np.testing.assert_array_equal(back[2], [0.0, 0.0, 2.0])


class Remembering:
    """x = [q, sum of q so far]: inputs that must be sampled at 10 Hz."""

    orders, rate, columns = 1, 10.0, (("q", "a", "m", ""), ("sum", "a", "m", ""))

    def plan(self, motion: Motion, keep=None) -> Planned:
        assert np.allclose(np.diff(motion.t), 0.1)
        q = motion.orders[0]

        def vjp(in_X: np.ndarray, in_gains: np.ndarray) -> np.ndarray:
            out = np.zeros_like(q)
            out[keep] += in_X[:, :1]
            ends = np.zeros(len(q))
            ends[keep] = in_X[:, 1]
            return (out + ends[::-1].cumsum()[::-1][:, None])[None]

        return Planned(np.hstack([q, q.cumsum(axis=0)])[keep], np.ones((len(keep), 1)), vjp)


def test_inputs_that_remember_see_the_whole_motion() -> None:
    from design_examples import Model, candidate

    from etude.models import ExactGP, SquaredExponential
    from etude.trajectories import FourierConfig, FourierFamily

    rng, kernel = np.random.default_rng(0), SquaredExponential((0, 1))
    gp = ExactGP(kernel, kernel.initial(np.array([1.0, 30.0]), 1.0), np.log(0.1))
    posterior = gp.condition(rng.standard_normal((10, 2)) * [1.0, 30.0], np.zeros(10))
    model = Model(Remembering(), (candidate(posterior, (0,)),))
    family = FourierFamily.of(FourierConfig(2, 30.0), 1)
    aim, at = objective("info_gain", model, family, np.zeros((0, 2))), rng.standard_normal(family.size)
    assert len(aim.times) == 301
    assert len(aim.keep) == 12
    assert_same(aim.value_and_gradient(at)[1], central(aim.value, at))


def test_instants() -> None:
    times, keep = instants(10.0, 4, 0.0)
    np.testing.assert_allclose(times, [1.25, 3.75, 6.25, 8.75])
    assert keep is None
    times, keep = instants(10.0, 4, 2.0)
    np.testing.assert_allclose(times, np.arange(21) / 2.0)
    assert np.abs(times[keep] - [1.25, 3.75, 6.25, 8.75]).max() <= 0.25
    assert len(instants(1.0, 50, 10.0)[1]) == 11
