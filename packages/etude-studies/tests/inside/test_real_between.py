"""Conditioned again on its own samples a model is what it was; twice at twice the noise too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.models import split_blocks
from etude_studies import real_between, real_draws
from etude_studies.real_between import again, between_rows
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.world import World

BRIEF = {"steps": 3, "fit_points": 40, "candidates": ("default", "gip_lin")}


@pytest.fixture(scope="module")
def learned():
    (real,) = (real for real in REAL_LOGS if real.name == "tx40")
    log, world = arm_log("tx40", real.find())
    train, test = split_blocks(world.samples(log), 0.03)
    model = replace(world.config.model, **BRIEF)
    return world.learned(train, model, np.random.default_rng(0), body=False).model, train, test


def test_with_nothing_more_it_is_the_model_itself(learned) -> None:
    model, train, test = learned
    same = again(model, train.take(slice(0, 0)), 1.0).mean(test.log)
    scale = model.mean(test.log).std(axis=0)
    np.testing.assert_allclose(same / scale, model.mean(test.log) / scale, atol=1e-3)


def test_told_twice_with_twice_the_noise_is_told_once(learned) -> None:
    """Where all that counts was kept, its own samples are those of the training part that move."""
    model, train, test = learned
    once = again(model, train.take(slice(0, 0)), 1.0).mean(test.log)
    scale = once.std(axis=0)
    twice = again(model, train, 2.0).mean(test.log)
    np.testing.assert_allclose(twice / scale, once / scale, atol=1e-6)
    bold = again(model, train, 1.0).mean(test.log)
    assert np.abs((bold - once) / scale).max() > 1e-3


def test_rows_of_a_short_training(monkeypatch) -> None:
    learn = World.learned

    def brief(self, samples, model, *more, **how):
        return learn(self, samples, replace(model, **BRIEF), *more, **how)

    monkeypatch.setattr(World, "learned", brief)
    for module in (real_between, real_draws):
        monkeypatch.setattr(module, "DRAWS", 2)
    monkeypatch.setattr(real_between, "REAL_LOGS", [real for real in REAL_LOGS if real.name == "tx40"])
    rows = {row.metric: row for row in between_rows()}
    assert set(rows) == {
        f"tx40_{way}{more}"
        for way in ("others_teach", "each_less", "others_less", "averaged")
        for more in ("", "_largest")
    }
    assert all(0.0 < row.value < 1.0 for row in rows.values())
    assert rows["tx40_others_teach"].value <= rows["tx40_others_teach_largest"].value
    assert rows["tx40_averaged"].value < rows["tx40_averaged"].reference_value
