"""Samples between a draw's own count once in all, and leave its edges as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.models import split_blocks
from etude.types import joined_samples
from etude_studies import between_edges
from etude_studies.between_edges import inside, log_rows, new_motion
from etude_studies.real_between import again
from etude_studies.real_draws import DRAWS
from etude_studies.real_logs import REAL_LOGS, arm_log, quarter_masks
from etude_studies.world import World

BRIEF = {"steps": 3, "fit_points": 40, "candidates": ("default",)}
T = 0.01 * np.arange(50)
OWN = np.arange(50) % DRAWS == 2
TRAIN = (np.arange(50) < 20) | (np.arange(50) >= 30)


def test_inside_counts_as_much_as_a_draw_alone_and_reaches_no_further() -> None:
    rows = inside(T, TRAIN, OWN)
    edges, others = rows[OWN[rows]], rows[~OWN[rows]]
    assert sorted(set(edges)) == [17, 32]  # a log's own ends are none
    assert (len(rows) + np.count_nonzero(TRAIN & OWN)) / DRAWS == np.count_nonzero(TRAIN & OWN)
    assert sorted(others) == [i for i in [*range(15), *range(35, 50)] if not OWN[i]]


def test_quarters_hold_out_everything_once_and_keep_their_distance() -> None:
    splits = list(quarter_masks(T, 0.03))
    assert np.sum([test for _, test in splits], axis=0).tolist() == [1] * len(T)
    for train, test in splits:
        assert np.abs(T[train][:, None] - T[test]).min() >= 0.03 - 1e-9


def test_draws_that_repeat_one_teach_nothing() -> None:
    (real,) = (real for real in REAL_LOGS if real.name == "tx40")
    log, world = arm_log("tx40", real.find())
    train, test = split_blocks(world.samples(log), 0.03)
    config = replace(world.config.model, **BRIEF)
    model = world.learned(train, config, np.random.default_rng(0), body=False).model
    every = joined_samples([train] * DRAWS)
    own = np.arange(len(every)) < len(train)
    rows = inside(every.t, np.ones(len(every), dtype=bool), own)
    assert len(rows) == (DRAWS - 1) * len(train)
    same = again(model, every.take(rows), float(DRAWS)).mean(test.log)
    scale = model.mean(test.log).std(axis=0)
    np.testing.assert_allclose(same / scale, model.mean(test.log) / scale, atol=5e-3)


def test_rows_of_a_short_training(monkeypatch) -> None:
    learn = World.learned

    def brief(self, samples, model, *more, **how):
        return learn(self, samples, replace(model, **BRIEF), *more, **how)

    monkeypatch.setattr(World, "learned", brief)
    monkeypatch.setattr(between_edges, "DRAWS", 2)
    rows = {row.metric: row.value for row in log_rows("tx40", None)}
    ways = [f"tx40_{kind}_{way}" for kind in ("blocks", "quarters") for way in ("others", "inside")]
    assert set(rows) == {f"{way}{more}" for way in ways for more in ("", "_ci95")}
    assert all(0.3 < rows[way] < 3.0 for way in ways)
    assert log_rows("panda", None) == []
    monkeypatch.setattr(between_edges, "LEARNED_S", 12.0)
    assert 0.5 < new_motion(World.of("arm4"), 0) < 2.0
