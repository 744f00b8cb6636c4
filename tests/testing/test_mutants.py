"""Each suite turns red over every wrong twin that is listed here, and stays green over the original.

The score is the number of twins noticed over all: it is asserted to be all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from mutants import Twin, first_row_off, laws, log_off, noticed

from etude.design import Score
from etude.models import SquaredExponential
from etude.testing import (
    CriterionSuite,
    FamilySuite,
    InputsSuite,
    KernelSuite,
    LimitSuite,
    PhysicsSuite,
    RobotSuite,
    World,
    world,
)
from etude.types import Cone, Proof
from etude_arm import KIND

ARM = "arm4"


@cache
def arm() -> World:
    return world(KIND, ARM)


def assert_noticed(suite: object) -> None:
    assert noticed(suite), "the suite is green over a wrong twin"


# --- kernels ---

KERNEL = SquaredExponential((0, 3, 2))


def kernel_suite(wrong: Any) -> KernelSuite:
    class Suite(KernelSuite):
        kernel = wrong

    return Suite()


def _gram_off(k: Any, theta: Any, X: Any) -> Any:
    K, vjp = k.gram(theta, X)
    K = K.copy(order="F")
    K[0, 1] *= 1.01
    return K, vjp


KERNELS: dict[str, Any] = {
    "gram not symmetric": Twin(KERNEL, gram=_gram_off),
    "theta gradient halved": Twin(KERNEL, theta_gradient=lambda k, *a: 0.5 * k.theta_gradient(*a)),
    "theta gradient of one hyperparameter lost": Twin(
        KERNEL, theta_gradient=lambda k, *a: k.theta_gradient(*a) * np.array([1.0, 1.0, 0.0, 1.0])
    ),
    "input gradient without sign": Twin(KERNEL, input_gradient=lambda k, *a: -k.input_gradient(*a)),
    "diagonal too large": Twin(KERNEL, diagonal=lambda k, *a: 1.001 * k.diagonal(*a)),
    "diagonal gradient not zero": Twin(KERNEL, diagonal_gradient=lambda k, *a: k.diagonal_gradient(*a) + 0.1),
    "no covariance": Twin(
        KERNEL,
        value=lambda k, *a: -k.value(*a),
        gram=lambda k, *a: (-k.gram(*a)[0], k.gram(*a)[1]),
        diagonal=lambda k, *a: -k.diagonal(*a),
    ),
    "a name twice": Twin(KERNEL, names=lambda k: ("amplitude",) * k.size),
    "a role short": Twin(KERNEL, roles=lambda k: k.roles()[1:]),
    "starts from no number": Twin(KERNEL, initial=lambda k, *a: k.initial(*a) * np.nan),
    "theta unchecked": Twin(
        KERNEL,
        value=lambda k, theta, *a: k.value(np.nan_to_num(np.resize(theta, k.size)), *a),
    ),
}


def test_the_kernel_itself_is_green() -> None:
    assert not any(laws(kernel_suite(KERNEL)).values())


@pytest.mark.parametrize("wrong", KERNELS.values(), ids=KERNELS)
def test_wrong_kernels(wrong: Any) -> None:
    assert_noticed(kernel_suite(wrong))


# --- criteria ---


def criterion_suite(wrong: Callable[..., Score], averages: bool = True) -> CriterionSuite:
    class Suite(CriterionSuite):
        criterion = staticmethod(wrong)
        averaged = averages

    return Suite()


def right(output: Any, batch: Any, gain: Any) -> Score:
    from etude.design import mean_variance

    return mean_variance(output, batch, gain)


CRITERIA: dict[str, Callable[..., Score]] = {
    "gradient in the variances lost": lambda *a: replace(right(*a), variance=None),
    "gradient in the gains halved": lambda *a: replace(right(*a), gain=0.5 * right(*a).gain),
    "value is not a number": lambda *a: replace(right(*a), value=float("nan")),
    "value is an array": lambda *a: replace(right(*a), value=np.array([right(*a).value])),
    "value without its sign": lambda *a: replace(right(*a), value=-right(*a).value),
    "gains ignored": lambda output, batch, gain: right(output, batch, np.ones_like(gain)),
    "signed gains": lambda output, batch, gain: replace(
        right(output, batch, gain), value=right(output, batch, gain).value + float(gain.sum())
    ),
    "in squared units": lambda output, batch, gain: right(replace(output, scale=1.0), batch, gain),
}


def test_the_criterion_itself_is_green() -> None:
    assert not any(laws(criterion_suite(right)).values())


@pytest.mark.parametrize("wrong", CRITERIA.values(), ids=CRITERIA)
def test_wrong_criteria(wrong: Callable[..., Score]) -> None:
    assert_noticed(criterion_suite(wrong))


# --- families ---


def family_suite(change: Callable[[Any], Any]) -> FamilySuite:
    class Suite(FamilySuite):
        family = arm().family
        instants = 20_000

        def draw(self, seed: int) -> Any:
            family, p = arm().parameters(seed)
            return change(family), p

    return Suite()


def _trajectory_twin(family: Any, **changes: Any) -> Any:
    return Twin(family, trajectory=lambda f, p: Twin(f.trajectory(p), **changes))


def _faster(m: Any) -> Any:
    orders = m.orders.copy()
    orders[1] *= 1.001
    return replace(m, orders=orders)


FAMILIES: dict[str, Callable[[Any], Any]] = {
    "pull of the velocity lost": lambda f: Twin(
        f, vjp=lambda o, p, t, G: o.vjp(p, t, G * np.array([1.0, 0.0, 1.0])[:, None, None])
    ),
    "velocity a little off": lambda f: Twin(
        f,
        motion=lambda o, *a: _faster(o.motion(*a)),
        trajectory=lambda o, p: Twin(o.trajectory(p), motion=lambda y, *a: _faster(y.motion(*a))),
    ),
    "family and trajectory differ": lambda f: Twin(f, motion=lambda o, *a: _faster(o.motion(*a))),
    "kappa dropped from the bound": lambda f: _trajectory_twin(
        f, bound=lambda y, *a: (0.99 * y.bound(*a)[0], y.bound(*a)[1], 1.0)
    ),
    "kappa dropped from the rows": lambda f: Twin(f, rows=lambda o, *a: (*o.rows(*a)[:2], 1.0)),
    "a row of another order": lambda f: Twin(f, rows=lambda o, order, d: o.rows(max(order - 1, 0), d)),
    "parameters off": lambda f: Twin(f, parameters=lambda o, y: first_row_off(o.parameters(y))),
    "slowed without its path": lambda f: _trajectory_twin(
        f, slowed=lambda y, s: Twin(y.slowed(s), motion=lambda z, *a: _faster(z.motion(*a)))
    ),
    "not slowed": lambda f: _trajectory_twin(f, slowed=lambda y, _: y),
    "text rounded": lambda f: _trajectory_twin(
        f, to_json=lambda y: replace(y, coefficients=np.round(y.coefficients, 6)).to_json()
    ),
}


def test_the_family_itself_is_green() -> None:
    assert not any(laws(family_suite(lambda f: f)).values())


@pytest.mark.thinned(2)
@pytest.mark.parametrize("change", FAMILIES.values(), ids=FAMILIES)
def test_wrong_families(change: Callable[[Any], Any]) -> None:
    assert_noticed(family_suite(change))


# --- limits ---


def limit_suite(wrong: Any) -> LimitSuite:
    class Suite(LimitSuite):
        limit = wrong
        family = arm().family
        home = KIND.home(arm().spec)

    return Suite()


@cache
def velocity() -> Any:
    return next(limit for limit in arm().limits if limit.name == "velocity")


def _narrower(row: Proof, part: float) -> Proof:
    return replace(row, proved_lower=part * row.proved_lower, proved_upper=part * row.proved_upper)


def _wider(cone: Cone, by: float) -> Cone:
    return replace(cone, rows=cone.rows / by)


LIMITS: dict[str, Callable[[], Any]] = {
    "cones without their room": lambda: Twin(
        velocity(), cones=lambda o, f: [_wider(c, 1.01) for c in o.cones(f)]
    ),
    "cones far too narrow": lambda: Twin(velocity(), cones=lambda o, f: [_wider(c, 0.9) for c in o.cones(f)]),
    "the proof of samples only": lambda: Twin(
        velocity(), prove=lambda o, y: [_narrower(row, 0.99) for row in o.prove(y)]
    ),
    "a proof that is loose": lambda: Twin(
        velocity(), prove=lambda o, y: [_narrower(row, 1.1) for row in o.prove(y)]
    ),
    "a proof that never refuses": lambda: Twin(
        velocity(), prove=lambda o, y: [replace(row, upper=np.inf, lower=-np.inf) for row in o.prove(y)]
    ),
    "measures another order": lambda: Twin(
        velocity(), of_motion=lambda o, m: replace(o, order=2).of_motion(m)
    ),
    "measures without a sign": lambda: Twin(velocity(), of_motion=lambda o, m: np.abs(o.of_motion(m))),
    "measures one axis short": lambda: Twin(velocity(), of_motion=lambda o, m: o.of_motion(m)[:, 1:]),
    "a penalty without its gradient": lambda: Twin(
        velocity(), penalty=lambda _, m: (float(np.sum(m.orders[1] ** 2)), np.zeros_like(m.orders))
    ),
    "home is outside": lambda: replace(
        next(limit for limit in arm().limits if limit.name == "position"), lower=KIND.home(arm().spec) + 0.1
    ),
}


def test_the_limit_itself_is_green() -> None:
    assert not any(laws(limit_suite(velocity())).values())


@pytest.mark.parametrize("make", LIMITS.values(), ids=LIMITS)
def test_wrong_limits(make: Callable[[], Any]) -> None:
    assert_noticed(limit_suite(make()))


# --- inputs, physics and robots: one world each ---


def world_suite(base: type, **changes: Any) -> Any:
    here = replace(arm(), **changes) if changes else arm()

    class Suite(base):  # type: ignore[misc]
        kind, robot = KIND, ARM

        @property
        def world(self) -> World:
            return here

    return Suite()


def _stepped(o: Any, row: Any, memory: Any) -> Any:
    x, memory = o.step(row, memory)
    return x * (1.0 + 1e-6), memory


INPUTS: dict[str, Callable[[Any], Any]] = {
    "a log is seen otherwise than its plan": lambda i: Twin(i, states=lambda o, m: log_off(o.states(m), "q")),
    "X of the log off": lambda i: Twin(i, of_log=lambda o, log: o.of_log(log) * (1.0 + 1e-15) + 1e-15),
    "keep ignored": lambda i: Twin(i, plan=lambda o, m, _=None: o.plan(m)),
    "a step off": lambda i: Twin(i, step=_stepped),
    "pull of the friction lost": lambda i: Twin(
        i,
        plan=lambda o, m, k=None: replace(
            (p := o.plan(m, k)), vjp=lambda X, g: p.vjp(np.where(np.arange(X.shape[1]) < 12, X, 0.0), g)
        ),
    ),
    "pull of the memory lost": lambda i: Twin(
        i,
        plan=lambda o, m, k=None: replace(
            (p := o.plan(m, k)), vjp=lambda X, g: p.vjp(np.where(np.arange(X.shape[1]) < 24, X, 0.0), g)
        ),
    ),
    "pull of the gains lost": lambda i: Twin(
        replace(i, stick_velocity=np.full(4, 0.1)),
        plan=lambda o, m, k=None: replace((p := o.plan(m, k)), vjp=lambda X, g: p.vjp(X, np.zeros_like(g))),
    ),
    "a column short": lambda i: Twin(i, columns=property(lambda o: o.columns[1:])),
    "a column of no channel": lambda i: Twin(
        i, columns=property(lambda o: (("torque", "waist", "N m", ""), *o.columns[1:]))
    ),
    "a column without a unit": lambda i: Twin(
        i, columns=property(lambda o: ((*o.columns[0][:2], "", ""), *o.columns[1:]))
    ),
    "gains above one": lambda i: Twin(
        i, plan=lambda o, m, k=None: replace((p := o.plan(m, k)), gains=1.0 + np.abs(p.gains))
    ),
}


def test_the_inputs_themselves_are_green() -> None:
    assert not any(laws(world_suite(InputsSuite)).values())


@pytest.mark.thinned(2)
@pytest.mark.parametrize("change", INPUTS.values(), ids=INPUTS)
def test_wrong_inputs(change: Callable[[Any], Any]) -> None:
    assert_noticed(world_suite(InputsSuite, inputs=change(arm().inputs)))


MEANS: dict[str, Callable[[Any], Any]] = {
    "no gravity": lambda m: Twin(m, static=lambda o, log: 0.0 * o.static(log)),
    "gravity that moves": lambda m: Twin(m, static=lambda o, log: o.predict(log)),
    "rows know their company": lambda m: Twin(
        m, predict=lambda o, log: o.predict(log) + log["q"].mean(axis=0)
    ),
    "no number": lambda m: Twin(m, predict=lambda o, log: o.predict(log) * np.nan),
    "a command short": lambda m: Twin(m, predict=lambda o, log: o.predict(log)[:, 1:]),
    "stored rounded": lambda m: Twin(
        m,
        arrays=lambda o: {
            n: np.asarray(a, dtype=np.float32).astype(float) if np.asarray(a).dtype == float else a
            for n, a in o.arrays().items()
        },
    ),
}


@cache
def identified() -> Any:
    suite: Any = world_suite(PhysicsSuite)
    return {name: mean for name, mean in suite.means().items() if name == "identified"}


def physics_suite(change: Callable[[Any], Any]) -> Any:
    made = {name: change(mean) for name, mean in identified().items()}
    suite = world_suite(PhysicsSuite)
    type(suite).means = lambda _: made
    return suite


def test_the_physics_themselves_are_green() -> None:
    assert not any(laws(physics_suite(lambda m: m)).values())


@pytest.mark.parametrize("change", MEANS.values(), ids=MEANS)
def test_wrong_physics(change: Callable[[Any], Any]) -> None:
    assert_noticed(physics_suite(change))


def test_a_mean_that_has_seen_the_fold() -> None:
    def physics(*_: Any) -> dict[str, Any]:
        return {"identified": Twin(own, without=seen, __call__=lambda o, samples: o(samples))}

    def seen(o: Any, samples: Any, fold: Any) -> Any:
        return {number: o(samples).predict(samples.log) for number in set(fold.tolist())}

    own = KIND.physics(arm().spec, arm().config)["identified"]
    suite = physics_suite(lambda m: m)
    type(suite).kind = Twin(KIND, physics=physics)
    assert [name for name, found in laws(suite).items() if found] == [
        "test_what_a_fold_says_is_not_in_the_mean_without_it"
    ]


def _unseeded(o: Any, trajectory: Any, controller: Any, _: Any) -> Any:
    return o.run(trajectory, controller, np.random.default_rng())


ROBOTS: dict[str, Callable[[Any], Any]] = {
    "its own random numbers": lambda r: Twin(r, run=_unseeded),
    "a channel nobody promised": lambda r: Twin(
        r, run=lambda o, *a: (log := o.run(*a)).put(replace(log.channels["q"], name="mood"), log["q"])
    ),
    "no commands": lambda r: Twin(r, run=lambda o, *a: o.run(*a).without("command")),
    "another motion": lambda r: Twin(
        r, run=lambda o, y, *a: (log := o.run(y, *a)).put(log.channels["q"], -log["q"])
    ),
    "time stands still": lambda r: Twin(r, run=lambda o, *a: replace((log := o.run(*a)), t=0.0 * log.t)),
    "a signed error": lambda r: Twin(r, error=lambda o, log: (-o.error(log)[0], o.error(log)[1])),
    "one error for all": lambda r: Twin(r, error=lambda o, log: (o.error(log)[0].mean(), o.error(log)[1])),
}


def robot_suite(change: Callable[[Any], Any]) -> Any:
    own = KIND.robot(arm().spec, arm().config)
    kind = Twin(KIND, robot=lambda *_: change(own))
    suite = world_suite(RobotSuite, kind=kind)
    type(suite).kind = kind
    return suite


def test_the_robot_itself_is_green() -> None:
    assert not any(laws(robot_suite(lambda r: r)).values())


@pytest.mark.thinned(2)
@pytest.mark.parametrize("change", ROBOTS.values(), ids=ROBOTS)
def test_wrong_robots(change: Callable[[Any], Any]) -> None:
    assert_noticed(robot_suite(change))


def test_a_twin_is_its_original_otherwise() -> None:
    assert Twin(KERNEL).size == KERNEL.size
