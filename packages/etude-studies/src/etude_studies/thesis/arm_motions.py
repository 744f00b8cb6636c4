"""The motions of a seed: random ones to learn from, and tests, the same for all runs of the seed.

Streams of random numbers are named by the seed and what they are for, so no run's luck depends on another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import polars as pl

from etude.design import design
from etude.limits import SAMPLERS, FeasibleSet
from etude.models import LearnedModel
from etude.protocols import Family, Trajectory
from etude.trajectories import FourierTrajectory
from etude.types import Array, Log, Samples
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.excitations import WAVES, least_condition, wave
from etude_studies.thesis.own_omega0 import JointByJoint

TRAIN, TEST, RUN, NOISE, DESIGN, LEARN, ROUND = range(7)
"""Streams of a seed's random numbers."""
COMMON = 10_000
"""Seed of the test that all seeds share; no run may have it."""
MOST = 10
"""Random motions of a seed."""


def draws(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> pl.DataFrame:
    """The random motions of a seed, as coefficients of their series: a stage that runs share.

    Args:
        settings: `robot`, `preset`, `motions`, `draw`, `own_omega0` of `ArmSettings`.
        seed: of the study.
    """
    arm_settings, rows = ArmSettings(**settings), []
    for number in range(1, MOST + 1):
        for axis, series in enumerate(_drawn(arm_settings, seed, number)):
            named = {name: getattr(series, name) for name in ("omega0", "duration", "ramp")}
            named |= {f"{i}_{j}": float(value) for (i, j), value in np.ndenumerate(series.coefficients)}
            rows += [(number, axis, name, value) for name, value in named.items()]
    return pl.DataFrame(rows, schema=["number", "axis", "name", "value"], orient="row")


def _drawn(settings: ArmSettings, seed: int, number: int) -> tuple[FourierTrajectory, ...]:
    """One series; or one for each joint, if each has its own base frequency."""
    rng = np.random.default_rng([seed, TRAIN, settings.draw, number])
    if settings.motions in WAVES and number > 1:
        return (wave(settings, settings.motions, rng),)
    world, family = settings.world, settings.family.drawn(rng)
    limits = world.kind.limits(world.spec, world.config, None, {})
    room = FeasibleSet.of(limits, family, world.kind.home(world.spec))
    drawn: Any = family.trajectory(SAMPLERS[_sampler(settings, number)](rng, room, 1)[0])
    return drawn.series if isinstance(drawn, JointByJoint) else (drawn,)


def _sampler(settings: ArmSettings, number: int) -> str:
    """Runs of a seed share the first motion, whatever their others are."""
    return "amplitude" if settings.motions == "amplitude" and number > 1 else "scaled"


def training_motions(table: pl.DataFrame) -> list[Trajectory]:
    """The motions of a table of `draws`, to the bit."""
    coefficients: dict[int, dict[int, dict[str, float]]] = {}
    for number, axis, name, value in table.iter_rows():
        coefficients.setdefault(number, {}).setdefault(axis, {})[name] = value
    motions: list[Trajectory] = []
    for _, parts in sorted(coefficients.items()):
        series = [_series(terms) for _, terms in sorted(parts.items())]
        motions.append(series[0] if len(series) == 1 else JointByJoint(tuple(series)))
    return motions


def _series(values: Mapping[str, float]) -> FourierTrajectory:
    places = {tuple(map(int, name.split("_"))): v for name, v in values.items() if "_" in name}
    table: Array = np.zeros((1 + max(i for i, _ in places), 1 + max(j for _, j in places)))
    for place, value in places.items():
        table[place] = value
    return FourierTrajectory(table, values["omega0"], values["duration"], values["ramp"])


@lru_cache(maxsize=4)
def tests_of(robot: str, seed: int) -> Mapping[str, Trajectory]:
    """Motions never trained on: the seed's own series and moves, and a series that all seeds share."""
    world = ArmSettings(robot).world
    tests = world.kind.tests(world.spec, world.config, np.random.default_rng([seed, TEST]))
    shared = world.kind.tests(world.spec, world.config, np.random.default_rng([COMMON, TEST]))
    return {**tests, "common": shared["fourier"]}


def recorded(settings: ArmSettings, motion: Trajectory, seed: int, number: int) -> Log:
    """The log of a motion under feedback alone, rounded as the settings say."""
    log = settings.simulated.run(motion, None, np.random.default_rng([seed, RUN, number]))
    if not settings.rounding:
        return log
    return _rounded(log, np.random.default_rng([seed, ROUND, settings.rounding, number]))


def _rounded(log: Log, rng: np.random.Generator) -> Log:
    """The log with every number, 0 apart, at the next one above or below, by chance."""

    def beside(values: Array) -> Array:
        other = np.nextafter(values, np.where(rng.random(values.shape) < 0.5, -np.inf, np.inf))
        return np.where(values == 0.0, values, other)

    return replace(log, values={name: beside(values) for name, values in log.values.items()})


def designed(
    settings: ArmSettings, model: LearnedModel, samples: Samples, seed: int, number: int
) -> Trajectory:
    """The motion that teaches the model most by the criterion of the settings, or that of least condition."""
    rng = np.random.default_rng([seed, DESIGN, number])
    if settings.motions == "condition":
        return least_condition(settings, samples, rng)
    world, config = settings.world, settings.config
    family: Family = settings.family
    limits = world.kind.limits(world.spec, config, None, {})
    return design(
        family,
        limits,
        world.kind.home(world.spec),
        model.inputs,
        model,
        config.design,
        rng,
        rate=float(world.spec.rate),
        physics=world.kind.physics(world.spec, config),
    ).trajectory
