"""Excitations of others for the arm: chirps, pseudo-random binary velocities, least condition number.

Settings, seeds and use were announced before a row was looked at (docs/decisions/0068-other-excitations.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from etude.abilities import SupportsRegressors
from etude.limits import SAMPLERS, FeasibleSet
from etude.protocols import Trajectory
from etude.trajectories import FourierFamily, FourierTrajectory
from etude.types import Array, Samples
from etude_studies.thesis.arm_settings import ArmSettings

Wave = Literal["chirp", "prbs"]
WAVES: tuple[Wave, ...] = get_args(Wave)
HARMONICS = 30
"""Of a minute: 0.5 Hz, the highest frequency of both."""
INSTANTS = 2048
"""Of a period, from which its coefficients are computed."""
DRAWN, TRIED, PLANNED = 24, 300, 50
"""Motions drawn first, as many as `design` draws; motions tried in all; planned instants of each."""
STEP, MOVED = 0.2, 0.2
"""A step's deviation as a part of each parameter's width, and the part of the parameters that it moves."""
ABSENT = 1e-9
"""Part of the largest below which a parameter does not act on a command, or two are the same to rounding."""


def wave(settings: ArmSettings, name: Wave, rng: np.random.Generator) -> FourierTrajectory:
    """A chirp or a binary motion of every joint, enlarged to the limits.

    Both are Fourier series of `HARMONICS`, so that limits are proved and enlarged as for all others.
    """
    world = settings.world
    config: Any = replace(
        world.config,
        trajectory=replace(world.config.trajectory, harmonics=HARMONICS),
    )
    family: Any = world.kind.family(world.spec, config)
    home = world.kind.home(world.spec)
    room = FeasibleSet.of(world.kind.limits(world.spec, config, None, {}), family, home)
    shape = chirp if name == "chirp" else binary
    velocities = np.stack([shape(rng) for _ in home], axis=1)
    still: Array = family.coefficients(room.centre)
    coefficients = still + series_of(velocities)
    p: Array = family.parameters(coefficients)
    trajectory: FourierTrajectory = family.trajectory(room.enlarge(p))
    return trajectory


def chirp(rng: np.random.Generator) -> Array:
    """(INSTANTS,) velocity whose frequency grows or falls evenly between the first and the last harmonic."""
    s = np.arange(INSTANTS) / INSTANTS
    angle = 2.0 * np.pi * (s + 0.5 * (HARMONICS - 1) * s**2)
    velocity = np.cos(angle + rng.uniform(0.0, 2.0 * np.pi))
    return np.asarray(velocity if rng.random() < 0.5 else velocity[::-1])


def binary(rng: np.random.Generator) -> Array:
    """(INSTANTS,) velocity of one size and random sign, drawn anew every half period of the last harmonic."""
    signs = rng.choice([-1.0, 1.0], 2 * HARMONICS)
    return np.asarray(signs[np.arange(INSTANTS) * 2 * HARMONICS // INSTANTS])


def series_of(velocities: Array) -> Array:
    """(2 HARMONICS + 1, k) coefficients of the series nearest to velocities (INSTANTS, k) of one period."""
    waves = np.fft.rfft(velocities, axis=0)[1 : HARMONICS + 1] * (2.0 / INSTANTS)
    return np.concatenate([np.zeros((1, velocities.shape[1])), waves.real, -waves.imag])


def least_condition(settings: ArmSettings, samples: Samples, rng: np.random.Generator) -> Trajectory:
    """The motion with the least condition number of the identified model's regressor (Swevers et al. 1997).

    The regressor is that of all samples and the planned ones. It has columns of rigid bodies and friction,
    each in command units at its prior deviation. Random motions first, then random steps from the best.
    """
    world, family = settings.world, settings.family
    assert isinstance(family, FourierFamily)
    room = FeasibleSet.of(
        world.kind.limits(world.spec, world.config, None, {}), family, world.kind.home(world.spec)
    )
    physics = world.kind.physics(world.spec, world.config)["identified"]
    assert isinstance(physics, SupportsRegressors)
    maps = physics.regressors()
    grams = [_gram(mapping, _states(samples)) for mapping in maps]
    t = np.linspace(0.0, family.duration, PLANNED)
    weight = len(samples) / PLANNED / max(1, len(np.unique(samples.group)))  # a motion counts as one logged

    def score(p: Array) -> float:
        X = np.concatenate(list(family.motion(p, t).orders), axis=1)
        return log_condition(
            [G + weight * _gram(regressor, X) for G, regressor in zip(grams, maps, strict=True)]
        )

    return family.trajectory(_searched(score, room, rng))


def _searched(score: Callable[[Array], float], room: FeasibleSet, rng: np.random.Generator) -> Array:
    points: list[Array] = list(SAMPLERS["scaled"](rng, room, DRAWN))
    values = [score(p) for p in points]
    place = int(np.argmin(values))
    best: Array = points[place]
    least, widths = values[place], room.widths()
    for _ in range(TRIED - DRAWN):
        p = room.shrink(best + STEP * widths * rng.normal(size=len(best)) * (rng.random(len(best)) < MOVED))
        value = score(p)
        if value < least:
            best, least = p, value
    return best


def log_condition(grams: Sequence[Array]) -> float:
    """Mean over commands of the log condition number of regressors with these Gram matrices (P, P).

    Columns have unit norm (van der Sluis 1969), so that units do not matter. Directions that no motion
    excites do not count.
    """
    conditions = []
    for G in grams:
        size = np.sqrt(G.diagonal())
        acts = size > ABSENT * size.max()
        values = np.linalg.eigvalsh((G / np.outer(size + ~acts, size + ~acts))[np.ix_(acts, acts)])
        values = values[values > ABSENT * values[-1]]
        conditions.append(0.5 * np.log(values[-1] / values[0]))
    return float(np.mean(conditions))


def _gram(regressor: Any, X: Array) -> Array:
    features = regressor.transform(X)[:, 1:]  # without the file's masses, a combination of the others
    return np.asarray(features.T @ features)


def _states(samples: Samples) -> Array:
    return np.concatenate([np.asarray(samples.log[name]) for name in ("q", "qd", "qdd")], axis=1)
