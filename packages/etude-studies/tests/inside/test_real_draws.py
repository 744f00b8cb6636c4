"""Draws begin elsewhere in the same log, and are judged on the same samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude_studies import real_draws
from etude_studies.real_draws import draw_rows, drawn
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.world import World


def test_draws_share_no_instant() -> None:
    (real,) = (real for real in REAL_LOGS if real.name == "tx40")
    log, world = arm_log("tx40", real.find())
    parts = drawn(log, world, world.config.data)
    times = np.concatenate([part.t for part in parts])
    assert len(parts) == real_draws.DRAWS
    assert len(np.unique(times)) == len(times)
    assert all(set(part.group) == {0} for part in parts)


def test_rows_of_a_short_training(monkeypatch) -> None:
    learn = World.learned

    def brief(self, samples, model, *more, **how):
        model = replace(model, steps=2, fit_points=40, candidates=("default",))
        return learn(self, samples, model, *more, **how)

    monkeypatch.setattr(World, "learned", brief)
    monkeypatch.setattr(real_draws, "DRAWS", 2)
    monkeypatch.setattr(real_draws, "REAL_LOGS", [real for real in REAL_LOGS if real.name == "tx40"])
    rows = {row.metric: row.value for row in draw_rows(least_samples=(150,))}
    assert rows["tx40_150_mean"] < rows["tx40_150_largest"] < 1.0
    assert rows["tx40_150_largest"] - rows["tx40_150_mean"] < 2.0 * rows["tx40_150_deviation"]
