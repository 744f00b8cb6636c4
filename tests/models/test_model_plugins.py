"""Kernels and members of other packages: they work like Étude's own, and what is wrong with them is said."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from learning_examples import PHYSICS, SMALL, TOGETHER, Inputs, train, trajectories, trajectory

from etude import plugins
from etude.design import Output, criterion_named, evaluate, value_of
from etude.errors import DataError, UsageError
from etude.models import Posteriors, SquaredExponential, load_model, member_named, save_model

MEMBERS = {name: member_named(name) for name in plugins.BUILT_IN["etude.models"] if name != "all_lin"}
"""Those that learn commands one by one."""


def gravity(columns, commands):
    """Positions alone, and a squared exponential over everything: made of Étude's own kernels."""
    places = tuple(i for i, column in enumerate(columns) if column[0] == "q")
    assert commands[0] in ("a", "b")
    return SquaredExponential(places) + SquaredExponential(tuple(range(len(columns))))


@dataclass(frozen=True)
class Mine:
    """The squared exponential over all inputs, by a package that knows nothing of Étude's classes."""

    columns: tuple
    commands: tuple
    fault: str = ""

    @property
    def own(self):
        return SquaredExponential(tuple(range(len(self.columns))))

    def names(self):
        return self.own.names()

    def roles(self):
        return ("luck",) * len(self.names()) if self.fault == "roles" else self.own.roles()

    def initial(self, half_range, scale):
        return self.own.initial(half_range, scale)

    def gram(self, theta, X):
        K, vjp = self.own.gram(theta, X)
        if self.fault == "nan":
            K = K * np.nan
        if self.fault == "shape":
            K = K[:-1]
        if self.fault == "asymmetric":
            K = K + np.diag(np.ones(len(K)))
        return K if self.fault == "pair" else (K, vjp)

    def cross(self, theta, X, Z):
        if self.fault == "fails":
            raise ZeroDivisionError("no way")
        return self.own.cross(theta, X, Z)

    def diagonal(self, theta, X):
        return self.own.diagonal(theta, X)

    def diagonal_gradient(self, theta, X, g):
        return self.own.diagonal_gradient(theta, X, g)


class Unfinished:
    def __init__(self, columns, commands) -> None:
        self.names = self.roles = lambda: ()


def broken(fault):
    return lambda columns, commands: Mine(columns, commands, fault)


roles, nan, shape, pair, asymmetric, fails = map(
    broken, ("roles", "nan", "shape", "pair", "asymmetric", "fails")
)


def impossible(columns, commands):
    raise RuntimeError("no such robot")


KERNEL = f"{__name__}:Mine"


@pytest.mark.parametrize("config", [SMALL, TOGETHER], ids=["separate", "together"])
@pytest.mark.parametrize("process", ["exact", "vfe"])
def test_a_users_kernel_trains_designs_and_is_stored_by_its_name(config, process, tmp_path) -> None:
    own = replace(config, kernel=KERNEL, process=process, basis=20, steps=4)
    model, ours = train(trajectories(2), own), train(trajectories(2), replace(own, kernel="ard_se"))
    new = trajectory(5).log
    np.testing.assert_allclose(model.predict(new)[0], ours.predict(new)[0], rtol=1e-6, atol=1e-8)
    save_model(tmp_path / "model.npz", model)
    again = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    for one, other in zip(again.predict(new), model.predict(new), strict=True):
        np.testing.assert_array_equal(one, other)
    X = Inputs().of_log(trajectory(6).log)[::25]
    outputs = [Output.of(posterior, X + 0.2) for posterior, _ in again.latents()]
    gains, step = np.ones((len(X), 2)), 1e-5 * np.random.default_rng(0).normal(size=X.shape)
    criterion = criterion_named("log_ivr")
    _, gradient, _ = evaluate(criterion, outputs, X, gains)
    ahead, behind = (value_of(criterion, outputs, X + s, gains) for s in (step, -step))
    assert ahead - behind == pytest.approx(2.0 * float(np.sum(gradient * step)), rel=1e-4, abs=1e-12)
    goes_on = train(trajectories(3), replace(own, steps=0), again)
    for (old, _), (now, _) in zip(again.latents(), goes_on.latents(), strict=True):
        np.testing.assert_array_equal(now.theta, old.theta)


def test_a_kernel_made_of_our_parts_works_too() -> None:
    model = train(trajectories(2), replace(SMALL, kernel=f"{__name__}:gravity", steps=4))
    assert np.isfinite(model.predict(trajectory(5).log)[0]).all()


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("nan", "not numbers"),
        ("shape", r"shape \(7, 8\), not \(8, 8\)"),
        ("pair", "matrix and its pull-back"),
        ("roles", "one of the roles"),
        ("asymmetric", "differ at the same inputs"),
        ("fails", "does not work"),
        ("impossible", "cannot be made"),
        ("Unfinished", "has no initial, gram"),
        ("nothing", "cannot be loaded"),
    ],
)
def test_a_broken_kernel_is_named_with_its_fault(name: str, fault: str) -> None:
    with pytest.raises(UsageError, match=fault) as caught:
        train(trajectories(1), replace(SMALL, kernel=f"{__name__}:{name}"))
    assert name in str(caught.value)


class Member:
    """An exact process, restored as Étude's own; `fault` spoils it."""

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def __call__(self, fit):
        if self.fault == "fails":
            raise ZeroDivisionError("no way")
        own = MEMBERS["exact"](fit)
        return own if not self.fault else Spoiled(own, self.fault)

    def restore(self, arrays):
        return MEMBERS["exact"].restore(arrays)


class Spoiled:
    def __init__(self, own: Posteriors, fault: str) -> None:
        self.own, self.fault = own, fault
        if fault != "method":
            self.latents = own.latents
        self.arrays, self.c = own.arrays, own.c
        self.signal_variance = own.signal_variance
        self.noise_variance = own.noise_variance[0] if fault == "noise" else own.noise_variance

    def predict(self, X):
        mean, variance = self.own.predict(X)
        if self.fault == "nan":
            mean = mean * np.nan
        if self.fault == "negative":
            variance = variance - 1e6
        return (mean[:-1], variance) if self.fault == "shape" else (mean, variance)

    def held_out(self, own, Y=None):
        mean, variance = self.own.held_out(own, Y)
        return (mean[:, 0], variance) if self.fault == "held" else (mean, variance)


good = Member()
bad_method, bad_noise, bad_nan, bad_negative, bad_shape, bad_held, bad_fails = map(
    Member, ("method", "noise", "nan", "negative", "shape", "held", "fails")
)


def forgetful(fit):
    return MEMBERS["exact"](fit)


@pytest.mark.parametrize("config", [SMALL, TOGETHER], ids=["separate", "together"])
def test_a_users_member_learns_and_is_restored_by_its_name(config, tmp_path) -> None:
    own = replace(config, process=f"{__name__}:good", rung="auto", steps=4)
    model = train(trajectories(2), own)
    expected = train(trajectories(2), replace(own, process="exact"))
    new = trajectory(5).log
    save_model(tmp_path / "model.npz", model)
    again = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    for found in (model, again):
        np.testing.assert_array_equal(found.predict(new)[0], expected.predict(new)[0])


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("bad_method", "without latents"),
        ("bad_noise", "noise_variance of shape"),
        ("bad_nan", "not a number"),
        ("bad_negative", "below zero"),
        ("bad_shape", "mean of shape"),
        ("bad_held", "holds out in shapes"),
        ("bad_fails", "fails .ZeroDivisionError: no way"),
        ("forgetful", "it has no restore"),
        ("nothing", "cannot be loaded"),
    ],
)
def test_a_broken_member_is_named_with_its_fault(name: str, fault: str) -> None:
    with pytest.raises(UsageError, match=fault) as caught:
        train(trajectories(1), replace(SMALL, process=f"{__name__}:{name}"))
    assert name in str(caught.value)


class Wrong:
    """Physics that answer in another shape."""

    def __call__(self, samples):
        return self

    restore = None

    def predict(self, log):
        return np.zeros((len(log), 3))


def test_broken_physics_are_named() -> None:
    from learning_examples import selection

    with pytest.raises(UsageError, match="identified physics returned no numbers, or shape"):
        selection(trajectories(2), replace(SMALL, rung="identified"), physics={"identified": Wrong()})


def test_a_plugin_that_is_gone_is_said_when_a_model_is_read(tmp_path, monkeypatch) -> None:
    model = train(trajectories(1), replace(SMALL, kernel=KERNEL, steps=2))
    save_model(tmp_path / "model.npz", model)
    monkeypatch.delattr(f"{__name__}.Mine")
    with pytest.raises((UsageError, DataError), match="Mine"):
        load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
