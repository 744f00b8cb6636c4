"""Sensitivity of the error on a real arm's log to the choice of training samples, by the blocks of
`real_logs`.

A log of 1,000 samples a second is thinned to some hundred; where the thinning begins is chance. Each draw
begins elsewhere, and all are judged on the test samples of all of them together.

    python -m etude_studies.real_draws [FOLDER]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.models import LinearPhysics, block_masks, figures
from etude.types import Array, Log, Samples, joined_samples
from etude_arm import filter_cutoff
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row, table
from etude_studies.world import World

DRAWS = 5


def draw_rows(logs: Path | None = None, *, least_samples: tuple[int, ...] = (150, 300)) -> list[Row]:
    """By log and `data.least_samples`: mean nMSE over the outputs, its mean, spread, least and largest value
    over the draws, beside linear regression's; the worst output's error over linear regression's; CPU of
    training.
    """
    rows = []
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is None or real.name == "sarcos":  # which has no times
            continue
        log, world = arm_log(real.name, path)
        for least in least_samples:
            outcomes = np.array(list(_outcomes(log, world, replace(world.config.data, least_samples=least))))
            rows += _rows(f"{real.name}_{least}", *outcomes.T)
    return rows


def _rows(name: str, mine: Array, linear: Array, worst: Array, seconds: Array) -> list[Row]:
    beside, line = "linear regression", float(linear.mean())
    return [
        Row(f"{name}_mean", float(mine.mean()), "1", beside, line),
        Row(f"{name}_deviation", float(mine.std(ddof=1)), "1"),
        Row(f"{name}_least", float(mine.min()), "1", beside, line),
        Row(f"{name}_largest", float(mine.max()), "1", beside, line),
        Row(f"{name}_worst_vs_linear", float(worst.mean()), "1", "the largest", float(worst.max())),
        Row(f"{name}_cpu", float(seconds.mean()), "s"),
    ]


def _outcomes(log: Log, world: World, data: Any) -> Iterator[tuple[float, float, float, float]]:
    """Of each draw: mean nMSE, linear regression's, the largest ratio of an output, seconds of CPU."""
    parts = drawn(log, world, data)
    t = np.concatenate([part.t for part in parts])
    draw_of = np.concatenate([np.full(len(part), draw) for draw, part in enumerate(parts)])
    train, test = block_masks(t, 1.0 / filter_cutoff(log, data))
    every = joined_samples(parts)
    held = every.take(test)
    for draw in range(DRAWS):
        taught, start = every.take(train & (draw_of == draw)), time.process_time()
        model = world.learned(taught, world.config.model, np.random.default_rng(draw), body=False).model
        seconds, use = time.process_time() - start, held.usable & held.moving
        line = LinearPhysics(model.inputs)(taught).predict(held.log)
        mine, theirs = (figures(held.command, m, None, use).nmse for m in (model.mean(held.log), line))
        yield float(mine.mean()), float(theirs.mean()), float(np.max(mine / theirs)), seconds


def drawn(log: Log, world: World, data: Any) -> list[Samples]:
    """The log thinned from several beginnings, each as one trajectory of the same number."""
    config = replace(world.config, data=data)
    parts = [
        world.kind.samples(world.spec, config, [log], [np.full(len(log), draw, dtype=np.int64)])
        for draw in range(DRAWS)
    ]
    return [replace(part, group=np.zeros_like(part.group)) for part in parts]


if __name__ == "__main__":
    table(draw_rows(Path(sys.argv[1]) if len(sys.argv) > 1 else None), "draws of training instants")
