"""One run of chapter 6: an arm of the comparison, of one seed, tested after every trajectory.

The thesis's protocol: training data under feedback alone, then one trajectory never trained on, with the
model's command of the desired motion as feedforward, not faded (4.2, 6).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import polars as pl

from etude.models import LearnedModel, trusted
from etude.protocols import Controller, Trajectory
from etude.threads import threads_for
from etude.types import Array, Log, Samples
from etude_arm import PerfectController
from etude_studies.measured import Measured
from etude_studies.thesis.arm_lines import Given, lines
from etude_studies.thesis.arm_measures import (
    Figure,
    density_loss,
    description,
    honesty,
    nearest_distance,
    rank_correlation,
    tracking,
)
from etude_studies.thesis.arm_motions import LEARN, NOISE, designed, recorded, tests_of, training_motions
from etude_studies.thesis.arm_parameters import parameter_figures, trained_again
from etude_studies.thesis.arm_settings import ArmSettings, world_of
from etude_studies.world import World

PRIMARY = "fourier"
"""The test that lines and the faded feedforward are measured on too."""
DESIGNED = ("designed", "condition")
"""Motions that depend on what was learned."""
AHEAD = ("ahead_variance", "ahead_mae")
TAUGHT = 500
"""Samples at which the density of the training data is judged."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What there is after a trajectory: its number, all logs so far, samples of them, the models."""

    number: int
    logs: tuple[Log, ...]
    samples: Samples
    model: LearnedModel
    before: LearnedModel | None
    spent: Mapping[str, float]


def run(settings: Mapping[str, Any], seed: int, needs: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """All figures of a run.

    Args:
        settings: of `ArmSettings`. seed: of the study. needs: the table of `arm_motions.draws`.
    """
    arm_settings, rows = ArmSettings(**settings), list[Measured]()
    with threads_for(0):
        for stage in stages(arm_settings, seed, training_motions(next(iter(needs.values()))), rows):
            rows += _evaluated(arm_settings, seed, stage)
    return [*rows, *foresight(rows)]


def foresight(rows: Sequence[Measured]) -> list[Measured]:
    """Rank correlation over trajectories of the variance expected and the error met before learning them."""
    series = {
        name: [row.value for row in rows if (row.measure, row.part) == (name, "mean")] for name in AHEAD
    }
    expected, met = (np.array(series[name]) for name in AHEAD)
    if len(met) < 3:
        return []
    last = max(row.k for row in rows)
    return [Measured(last, "", "", "mean", "ahead_rank", rank_correlation(expected, met))]


def stages(
    settings: ArmSettings, seed: int, drawn: Sequence[Trajectory], rows: list[Measured] | None = None
) -> Iterator[Stage]:
    """Learns trajectory after trajectory; what is known of each before it is learned goes to `rows`."""
    world, logs = settings.world, list[Log]()
    model: LearnedModel | None = None
    before: LearnedModel | None
    for number in range(1, settings.rounds + 1):
        began = time.process_time()
        motion = drawn[number - 1]
        if model is not None and settings.motions in DESIGNED:
            motion = designed(settings, model, world.samples(*logs), seed, number)
        spent = {"cpu_design": time.process_time() - began}
        logs.append(recorded(settings, motion, seed, number))
        if rows is not None and model is not None:
            rows += _ahead(settings, model, logs, number)
        began = time.process_time()
        samples = world.samples(*logs)
        rng = np.random.default_rng([seed, LEARN, number])
        before, model = model, world.learned(samples, settings.model_of(number), rng, model).model
        spent["cpu_train"] = time.process_time() - began
        yield Stage(number, tuple(logs), samples, model, before, spent)


def _ahead(
    settings: ArmSettings, model: LearnedModel, logs: Sequence[Log], number: int
) -> Iterator[Measured]:
    """What the model of the round before expects of a trajectory that it has not seen."""
    world = settings.world
    new, learned = world.samples(logs[-1]), world.samples(*logs[:-1])
    mean, variance = model.posterior(new.log)
    figures = zip(AHEAD, (variance.mean(axis=0), np.abs(new.command - mean).mean(axis=0)), strict=True)
    yield from joint_rows(number, "", "", world, figures)
    X, before = model.inputs.of_log(new.log), model.inputs.of_log(learned.log)
    half = 0.5 * np.maximum(np.ptp(before, axis=0), np.finfo(float).tiny)
    yield Measured(number, "", "", "mean", "nearest", nearest_distance(X, before, half))


def _evaluated(settings: ArmSettings, seed: int, stage: Stage) -> Iterator[Measured]:
    """Every test, the lines beside it, and what the model is by itself."""
    world, k, model = settings.world, stage.number, stage.model
    limit = world.kind.limit(world.spec)
    tests = tests_of(settings.robot, seed)
    began = time.process_time()
    plan = plan_of(world, model, tests[PRIMARY])
    mean, latent, noisy = _predicted(model, plan)
    spent = {**stage.spent, "cpu_predict": time.process_time() - began}
    for name, motion in tests.items():
        command = mean if name == PRIMARY else model.mean(plan_of(world, model, motion))
        log = tested(settings, motion, Given(command, world.spec.rate, limit), seed, name)
        yield from joint_rows(k, name, "", world, tracking(log, world.spec.rate))
        if name == PRIMARY and settings.described:
            yield from joint_rows(k, name, "", world, description(log, world.spec.rate))
        if name == PRIMARY:
            figures = honesty(log["command"][log.t >= 0.0], mean, latent, noisy)
            yield from joint_rows(k, name, "", world, figures)
    yield from joint_rows(k, "", "", world, [("nlpd_train", _density_of(model, stage.samples))])
    yield from parameter_figures(model, stage.before, k)
    if k == settings.again and stage.before is not None:
        yield from trained_again(model, stage.before, settings.model_of(k), k)
    faded = trusted(mean, noisy, model.prior_deviation, _without_process(model, plan))
    beside: dict[str, Controller] = {"faded": Given(faded, world.spec.rate, limit)}
    if settings.beside:
        beside |= lines(world, stage.logs)
    for name, controller in beside.items():
        log = tested(settings, tests[PRIMARY], controller, seed, PRIMARY)
        yield from joint_rows(k, PRIMARY, name, world, tracking(log, world.spec.rate))
    yield from (Measured(k, "", "", "mean", name, seconds) for name, seconds in spent.items())


def tested(
    settings: ArmSettings, motion: Trajectory, controller: Controller | None, seed: int, test: str
) -> Log:
    """The log of a test, to its end; every controller meets the same noise."""
    place = tuple(tests_of(settings.robot, seed)).index(test)
    return settings.simulated.run(motion, controller, np.random.default_rng([seed, NOISE, place]))


def plan_of(world: World, model: LearnedModel, motion: Trajectory) -> Log:
    """What a perfect run of a motion leaves, as the model looks at it, at the control ticks."""
    robot: Any = world.robot
    return model.inputs.states(robot.planned(motion))


def _without_process(model: LearnedModel, plan: Log) -> Array:
    """(T, J) commands of physics, or none at all without: what the protocol's feedforward fades to.

    Étude's own commands fade to a level without physics (`level_of`), as they did not when the runs began.
    """
    if any(model.behind(candidate) is not None for candidate in model.candidates):
        return model.safe(plan)
    return np.zeros((len(plan), len(model.commands)))


def _predicted(model: LearnedModel, plan: Log) -> tuple[Array, Array, Array]:
    """The model's mean, latent and noisy variance (T, J) at the states of a plan."""
    mean, noisy = model.posterior(plan)
    noise = np.zeros(len(model.commands))
    for candidate in model.candidates:
        assert candidate.process is not None
        factor = candidate.weights * candidate.calibration * candidate.units[1] ** 2
        noise[list(candidate.commands)] += factor * candidate.process.noise_variance
    return mean, np.maximum(noisy - noise, 0.0), noisy


def _density_of(model: LearnedModel, samples: Samples) -> Array:
    some = samples.take(slice(None, None, max(1, len(samples) // TAUGHT)))
    mean, variance = model.posterior(some.log)
    return density_loss(some.command - mean, variance)


def joint_rows(k: int, test: str, model: str, world: World, figures: Iterable[Figure]) -> Iterator[Measured]:
    """A row for each joint and one for their mean."""
    for name, values in figures:
        for joint, value in zip(world.spec.names, values, strict=True):
            yield Measured(k, test, model, joint, name, float(value))
        yield Measured(k, test, model, "mean", name, float(np.mean(values)))


def baseline(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """A controller that learns nothing: the same figures at every k, so that tables can draw them as lines.

    Args:
        settings: `robot`, `rounds`, and `controller`: "pd", "exact", "frictionless", the exact inverse of the
            same arm without friction, or "nominal", that of arm4.
    """
    arm_settings = ArmSettings(settings["robot"], rounds=settings["rounds"])
    robot: Any = arm_settings.world.robot
    rows: list[Measured] = []
    controllers: dict[str, Controller | None] = {
        "pd": None,
        "exact": PerfectController(robot),
        "nominal": PerfectController(cast("Any", world_of("arm4", "thesis").robot)),
        "frictionless": PerfectController(robot.changed(friction=1e-9)),
    }
    for name, motion in tests_of(arm_settings.robot, seed).items():
        log = tested(arm_settings, motion, controllers[settings["controller"]], seed, name)
        figures: list[Figure] = list(tracking(log, arm_settings.world.spec.rate))
        for k in range(arm_settings.rounds + 1):
            rows += joint_rows(k, name, "", arm_settings.world, figures)
    return rows
