"""Methods that the thesis does not have, on its data: what each learns from, and its errors on its tests.

Settings, seeds and use were announced before a row was looked at (docs/decisions/0067-other-regressors.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl

from etude.campaign import preset_config
from etude.models import ModelConfig
from etude.threads import threads_for
from etude.types import Array, Log, Samples
from etude_studies.measured import Measured
from etude_studies.real_lagrangian import learned_together
from etude_studies.thesis.arm import joint_rows, tested
from etude_studies.thesis.arm_lines import Given
from etude_studies.thesis.arm_measures import tracking
from etude_studies.thesis.arm_motions import LEARN, recorded, tests_of, training_motions
from etude_studies.thesis.arm_runs import DOWNSAMPLED, ROUNDS
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.flight_measures import PARTS, by_command
from etude_studies.thesis.flight_rounds import TRAIN, processes, random_flights
from etude_studies.thesis.flight_settings import FlightSettings, flights_of
from etude_studies.thesis.flight_tests import SETS, flown_tests
from etude_studies.thesis.lagrangian_network import lagrangian_network
from etude_studies.thesis.regressors import (
    NetworkSetting,
    TreeSetting,
    best_of,
    boosted,
    features,
    independent,
    network,
    orthogonal,
    standardised,
)
from etude_studies.world import World

Predictor = Callable[[Log], Array]
Method = Callable[[World, Samples, np.random.Generator], Predictor]
"""From the robot and its samples to what predicts commands (n, J) of states."""
SETTINGS = 8
"""Drawn for a network and for trees."""
POINTS, FIT_POINTS = 200, 500
"""Spectral points and inducing inputs, as in S1 and Y3; samples that give a process its hyperparameters."""
FLIGHTS = 10


def by_network(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:
    """A network on the thesis's inputs."""
    inputs, settings = world.inputs(world.config.model), [NetworkSetting.drawn(rng) for _ in range(SETTINGS)]
    X, Y = inputs.of_log(samples.log), samples.command
    predict = best_of(standardised(network), settings, X, Y, samples.group, rng)
    return lambda states: predict(inputs.of_log(states))


def by_trees(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:
    """Boosted trees on what identified physics, itself least squares with friction, leaves."""
    inputs, settings = world.inputs(world.config.model), [TreeSetting.drawn(rng) for _ in range(SETTINGS)]
    physics = world.kind.physics(world.spec, world.config)["identified"](samples)
    X, left = inputs.of_log(samples.log), samples.command - physics.predict(samples.log)
    predict = best_of(standardised(boosted), settings, X, left, samples.group, rng)
    return lambda states: np.asarray(physics.predict(states) + predict(inputs.of_log(states)))


def by_features(
    frequencies: Callable[[int, int, np.random.Generator], Array],
    world: World,
    samples: Samples,
    rng: np.random.Generator,
) -> Predictor:
    """Random features of the kernel that an exact process learned from `FIT_POINTS` samples."""
    config = replace(world.config.model, process="exact", points=FIT_POINTS, fit_points=FIT_POINTS)
    model = world.learned(samples, config, rng).model
    X, parts = model.inputs.of_log(samples.log), list[tuple[Array, Callable[[Array], Array]]]()
    for candidate, posterior in zip(model.candidates, processes(model), strict=True):
        (command,), (offset, factor) = candidate.commands, candidate.units[:, 0]
        W = frequencies(POINTS, X.shape[1], rng)
        ridge = float(posterior.noise_variance / posterior.signal_variance)
        y = (samples.command[:, command] - offset) / factor
        parts.append((candidate.units[:, 0], features(W, np.exp(posterior.theta[1:]), X, y, ridge)))

    def predict(states: Log) -> Array:
        new = model.inputs.of_log(states)
        return np.stack([offset + factor * mean(new) for (offset, factor), mean in parts], axis=1)

    return predict


def by_inducing(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:
    """The variational process at the optimum of its bound, which a stochastic one (SVGP) approaches.

    Titsias (2009): with Gaussian noise the best distribution of the inducing values is known.
    """
    keys = {"process": "vfe", "basis": POINTS, "points": len(samples), "fit_points": FIT_POINTS}
    model = world.learned(samples, replace(world.config.model, **keys), rng).model  # type: ignore[arg-type]
    return model.mean


def by_process(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:
    """Full regression on all samples, with hyperparameters of `FIT_POINTS` of them: what the thesis has, for
    comparison.
    """
    keys = {"process": "exact", "points": len(samples), "fit_points": FIT_POINTS}
    model = world.learned(samples, replace(world.config.model, **keys), rng).model  # type: ignore[arg-type]
    return model.mean


def by_lagrangian(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:  # noqa: ARG001
    """The Lagrangian inspired polynomial kernel, all commands together, with friction inputs of the plan."""
    return learned_together(with_friction(world), samples)


def by_lagrangian_network(world: World, samples: Samples, rng: np.random.Generator) -> Predictor:
    """A deep Lagrangian network of states and friction inputs of the plan."""
    rough = with_friction(world)
    inputs, settings = rough.inputs(rough.config.model), [NetworkSetting.drawn(rng) for _ in range(SETTINGS)]
    X = inputs.of_log(samples.log)
    predict = best_of(lagrangian_network, settings, X, samples.command, samples.group, rng)
    return lambda states: predict(inputs.of_log(states))


def with_friction(world: World) -> World:
    """Whose inputs have columns of friction too, as the default protocol's."""
    fraction = preset_config(world.kind, "default").data.friction_fraction
    data = replace(world.config.data, friction_fraction=fraction)
    return replace(world, config=replace(world.config, data=data))


ANYWHERE: Mapping[str, Method] = {
    "network": by_network,
    "trees": by_trees,
    "orthogonal": partial(by_features, orthogonal),
    "independent": partial(by_features, independent),
    "variational": by_inducing,
    "process": by_process,
}
OF_M1: Mapping[str, Method] = {**ANYWHERE, "lagrangian": by_lagrangian}
ON_ARMS: Mapping[str, Method] = {**OF_M1, "lagrangian_network": by_lagrangian_network}


def on_the_arm(settings: Mapping[str, Any], seed: int, needs: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """M1 and M3: tracking error of each method's feedforward after six trajectories, on A6's samples.

    Args:
        settings: `methods`, names of `ON_ARMS`, and `rounds`; those of M1 and six if not given. Others are
            those of `ArmSettings`. seed: of the study. needs: the table of `arm_motions.draws`.
    """
    keys = {"rounds": ROUNDS, "data": DOWNSAMPLED, **settings}
    names = keys.pop("methods", tuple(OF_M1))
    arm_settings = ArmSettings(**keys)
    drawn = training_motions(next(iter(needs.values())))[: arm_settings.rounds]
    with threads_for(0):
        logs = [recorded(arm_settings, motion, seed, number) for number, motion in enumerate(drawn, start=1)]
        samples = arm_settings.world.samples(*logs)
        return [row for name in names for row in _tracked(arm_settings, seed, samples, name)]


def _tracked(settings: ArmSettings, seed: int, samples: Samples, name: str) -> Iterator[Measured]:
    world, k = settings.world, settings.rounds
    place, limit = list(ON_ARMS).index(name), world.kind.limit(world.spec)
    began = time.process_time()
    predict = ON_ARMS[name](world, samples, np.random.default_rng([seed, LEARN, k, place]))
    yield Measured(k, "", name, "mean", "cpu_train", time.process_time() - began)
    inputs = world.inputs(world.config.model)
    robot: Any = world.robot
    for test, motion in tests_of(settings.robot, seed).items():
        command = predict(inputs.states(robot.planned(motion)))
        log = tested(settings, motion, Given(command, world.spec.rate, limit), seed, test)
        yield from joint_rows(k, test, name, world, tracking(log, world.spec.rate))


def on_flights(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """M2: mean absolute error of each method on the tests of Q1's seed, after Y5's ten flights.

    Args:
        settings: `methods`, names of `ANYWHERE`; all if not given. Others are those of `FlightSettings`.
        seed: of the study.
    """
    keys = {"flights": FLIGHTS, **settings}
    names = keys.pop("methods", tuple(ANYWHERE))
    flight_settings = FlightSettings(**keys)
    with threads_for(0):
        samples = flight_settings.place.samples(*random_flights(flight_settings, seed))
        return [row for name in names for row in _flown(flight_settings, seed, samples, name)]


def _flown(settings: FlightSettings, seed: int, samples: Samples, name: str) -> Iterator[Measured]:
    k, place = settings.flights, list(ANYWHERE).index(name)
    world = replace(flights_of(settings.place).world, config=settings.learning.config)
    world = replace(world, config=replace(world.config, model=_anew(world.config.model)))
    began = time.process_time()
    predict = ANYWHERE[name](world, samples, np.random.default_rng([seed, TRAIN, k, place]))
    yield Measured(k, "", name, "mean", "cpu_train", time.process_time() - began)
    tests, unit = flown_tests(settings, seed).sets, np.ones(len(PARTS[settings.vehicle]))
    for test in (test_name for test_name in SETS if test_name in tests):
        error = np.abs(tests[test].command - predict(tests[test].samples.log))
        figures = iter([("mae", tests[test].flight_mean(error))])
        yield from by_command(settings.vehicle, unit, k, test, name, figures)


def _anew(model: ModelConfig) -> ModelConfig:
    """Hyperparameters of all flights; the thesis's are those of the first."""
    return replace(model, schedule="reinitialise")
