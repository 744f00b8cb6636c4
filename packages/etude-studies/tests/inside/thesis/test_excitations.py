"""Chirps, binary velocities and motions of least condition number for the arm."""

from __future__ import annotations

import numpy as np
import pytest

from etude.limits import SAMPLERS, FeasibleSet
from etude_studies.thesis.arm_motions import draws, recorded, training_motions
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.excitations import (
    HARMONICS,
    INSTANTS,
    WAVES,
    Wave,
    binary,
    chirp,
    least_condition,
    log_condition,
    series_of,
)

RNG = np.random.default_rng


def test_a_chirp_sweeps_the_whole_band_and_a_binary_velocity_has_one_size() -> None:
    for seed in range(4):
        crossings = np.flatnonzero(np.diff(np.sign(chirp(RNG(seed)))))
        gaps = np.sort(np.diff(crossings))  # half periods: those of the last harmonic are 34 instants
        assert gaps[0] == pytest.approx(INSTANTS / (2 * HARMONICS), abs=2)
        assert gaps[-1] > 3 * gaps[0]
        assert len(crossings) == pytest.approx(HARMONICS + 1, abs=1)  # the mean frequency, twice a period
    signs = binary(RNG(0))
    assert set(np.abs(signs)) == {1.0}
    lengths = np.diff(np.flatnonzero(np.diff(signs)))
    assert lengths.min() >= INSTANTS // (2 * HARMONICS)


def test_the_nearest_series_of_a_series_is_itself() -> None:
    angle = 2.0 * np.pi * np.arange(INSTANTS) / INSTANTS
    velocity = 0.7 * np.cos(3 * angle) - 0.2 * np.sin(HARMONICS * angle)
    table = np.zeros((2 * HARMONICS + 1, 1))
    table[3], table[2 * HARMONICS] = 0.7, -0.2
    assert series_of(velocity[:, None]) == pytest.approx(table, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", WAVES)
def test_waves_use_a_limit_fully_and_leave_none(name: Wave) -> None:
    shared, own = (
        training_motions(draws({"preset": "default", "motions": motions}, 100, {}))[:2]
        for motions in ("scaled", name)
    )
    assert own[0] == shared[0]
    motion = own[1].motion(np.linspace(0.0, own[1].duration, 6001))
    world = ArmSettings(preset="default").world
    reach = world.inputs(world.config.model).channels
    sizes = [
        np.abs(motion.orders[i]).max(axis=0) / np.array(reach[c].reach) for i, c in enumerate(("q", "qd"))
    ]
    sizes.append(np.abs(motion.orders[2]).max(axis=0) / 0.5)  # rad/s^2 of every joint
    used = np.max(sizes, axis=0)
    assert np.all(used <= 1.0 + 1e-9)
    assert np.all(used > 0.6)


def test_units_of_parameters_do_not_change_a_condition_number() -> None:
    features = RNG(1).normal(size=(50, 4)) @ np.diag([1.0, 10.0, 0.01, 3.0])
    features = np.column_stack([features, np.zeros(50), features[:, 0] * 2.0])  # not excited; the same twice
    scaled = features * np.array([5.0, 0.2, 1e3, 1.0, 1.0, 7.0])
    plain, other = (log_condition([A.T @ A]) for A in (features, scaled))
    assert plain == pytest.approx(other, rel=1e-9)
    unit = features[:, :4] / np.linalg.norm(features[:, :4], axis=0)
    assert log_condition([unit.T @ unit]) == pytest.approx(np.log(np.linalg.cond(unit)), rel=1e-9)


@pytest.mark.slow
def test_least_condition_is_less_than_that_of_random_motions() -> None:
    settings = ArmSettings(preset="default", motions="condition")
    first = training_motions(draws({"preset": "default"}, 100, {}))[0]
    samples = settings.world.samples(recorded(settings, first, 100, 1))
    world, family = settings.world, settings.family
    maps = world.kind.physics(world.spec, world.config)["identified"].regressors()
    t = np.linspace(0.0, 60.0, 300)

    def condition(motion) -> float:
        X = np.concatenate(list(motion.motion(t).orders), axis=1)
        return log_condition([(A := own.transform(X)[:, 1:]).T @ A for own in maps])

    room = FeasibleSet.of(
        world.kind.limits(world.spec, world.config, None, {}), family, world.kind.home(world.spec)
    )
    best = least_condition(settings, samples, RNG(0))
    assert room.contains(family.parameters(best))
    random = [condition(family.trajectory(p)) for p in SAMPLERS["scaled"](RNG(1), room, 24)]
    assert condition(best) < np.median(random)
