"""Learning on line over the rows of a recorded flight: a controller for a robot that is no arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.models import LearnedModel
from etude.types import Log
from etude_online import OnlineConfig, OnlineModel
from etude_studies.world import World

FOLDER = Path(__file__).parents[4] / "examples" / "crazyflie"
WORLD = World.of(FOLDER / "crazyflie.toml")
CONFIG = OnlineConfig("variance", size=100, window_s=0.2, hold_s=0.2)


@pytest.fixture(scope="module")
def flights() -> tuple[dict[str, LearnedModel], Log]:
    """Models of one flight, by structure, and the rows of another, of other manoeuvres."""
    logs = [WORLD.read(FOLDER / f"{name}.csv") for name in ("log10_thrust", "log15_roll_pitch")]
    samples = WORLD.samples(*logs)
    known = samples.take(samples.group == 0)
    models = {}
    for rung in ("gp", "identified"):
        config = replace(WORLD.config.model, rung=rung, starts=1, noise_floor=0.4, points=200, steps=10)
        models[rung] = WORLD.learned(known, config, np.random.default_rng(0)).model
    return models, samples.take(samples.group == 1).log


def replayed(model: LearnedModel, log: Log, config: OnlineConfig = CONFIG) -> tuple[OnlineModel, np.ndarray]:
    """The commands (T, 4), each asked for before its row was observed."""
    channels, limits = WORLD.kind.channels(WORLD.spec), WORLD.command_limits
    online = OnlineModel(model, channels, None, limits, config, WORLD.spec.rate, np.random.default_rng(1))
    out = []
    for k, t in enumerate(log.t.tolist()):
        row = {name: values[k] for name, values in log.values.items()}
        out.append(online.command(t, row)[0])
        online.observe(t, row)
    return online, np.array(out)


@pytest.mark.parametrize("rung", ["gp", "identified"])
def test_on_later_rows_it_errs_no_more_than_the_frozen_model(flights, rung: str) -> None:
    models, log = flights
    online, commands = replayed(models[rung], log)
    assert online.counts.learned.min() > 300
    assert online.counts.refused.sum() == online.counts.ignored == 0
    later = slice(len(log) // 2, None)
    frozen = np.clip(models[rung].mean(log), *WORLD.command_limits)
    errors = [np.mean((found - log["command"])[later] ** 2, axis=0) for found in (commands, frozen)]
    assert (errors[0] <= errors[1]).all()
    assert errors[0].mean() < 0.8 * errors[1].mean()


def test_commands_are_within_their_limits_and_the_same_when_replayed(flights) -> None:
    models, log = flights
    few = log.take(slice(0, 250))
    (_, one), (_, same) = (replayed(models["gp"], few, replace(CONFIG, guarded=False)) for _ in range(2))
    np.testing.assert_array_equal(one, same)
    assert np.isfinite(one).all()
    lower, upper = WORLD.command_limits
    assert (one >= lower).all()
    assert (one <= upper).all()


def test_nothing_is_learned_from_rows_that_say_nothing(flights) -> None:
    models, log = flights
    rates = np.where(log.t[:, None] < 1.0, log["rates"], np.nan)
    lost = log.put(log.channels["rates"], rates).take(slice(0, 60))
    channels, limits = WORLD.kind.channels(WORLD.spec), WORLD.command_limits
    rng = np.random.default_rng(1)
    online = OnlineModel(models["gp"], channels, None, limits, CONFIG, WORLD.spec.rate, rng)
    for k, t in enumerate(lost.t.tolist()):
        online.observe(t, {name: values[k] for name, values in lost.values.items()})
    assert online.counts.ignored == np.count_nonzero(lost.t >= 1.0) > 0
    assert 0 < online.counts.learned.max() <= 13
