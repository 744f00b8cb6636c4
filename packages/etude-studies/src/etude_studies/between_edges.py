"""Value of the samples between those of a thinned log for another motion, after `real_between`.

A stretch left out of a log is predicted from its edges. The samples of all draws reach nearer to it than
those of most draws alone, which is no merit of what lies between.

    python -m etude_studies.between_edges [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from etude.models import LearnedModel, block_masks, figures
from etude.types import Array, Index, Log, Mask, Samples, joined_samples
from etude_arm import filter_cutoff
from etude_studies.real_between import again
from etude_studies.real_draws import DRAWS, drawn
from etude_studies.real_logs import REAL_LOGS, arm_log, quarter_masks
from etude_studies.rows import Row, mean_rows, table
from etude_studies.world import World, one_period

SHORT = ("ur10", "tx40", "panda")
"""Logs that `least_samples` decides on."""
SIMULATED = ("arm4", "arm4_rough")
LEARNED_S, TEST_S, SEEDS = 24.0, 15.0, 10
Split = tuple[Mask, Mask]


def edge_rows(logs: Path | None = None) -> list[Row]:
    """Ratios of mean nMSE to that of a draw's own samples alone, means with 95 % intervals.

    `<log>_blocks_others`, `<log>_quarters_others`: the other draws' samples teach too, as `others_teach` in
    `real_between`. `_inside`: only those between two of the draw's own; its own at an edge count as before.
    `<robot>_others`: of a simulated arm that has one short log, on two other motions.
    """
    rows: list[Row] = []
    for name in SHORT:
        rows += log_rows(name, logs)
    for robot in SIMULATED:
        ratios = [new_motion(World.of(robot), seed) for seed in range(SEEDS)]
        rows += mean_rows(f"{robot}_others", ratios, "1", "", [])
    return rows


def log_rows(name: str, logs: Path | None) -> list[Row]:
    """The rows of one real log; none where it is not there."""
    path = next(real for real in REAL_LOGS if real.name == name).find(logs)
    if path is None:
        return []
    log, world = arm_log(name, path)
    gap = 1.0 / filter_cutoff(log, world.config.data)
    parts = drawn(log, world, world.config.data)
    every = joined_samples(parts)
    draw_of = np.concatenate([np.full(len(part), draw) for draw, part in enumerate(parts)])
    rows: list[Row] = []
    for kind, splits in (
        ("blocks", [block_masks(every.t, gap)]),
        ("quarters", list(quarter_masks(every.t, gap))),
    ):
        errors = np.array([_errors(world, every, draw_of == draw, splits, draw) for draw in range(DRAWS)])
        for place, variant in enumerate(("others", "inside"), start=1):
            ratios = (errors[:, place] / errors[:, 0]).tolist()
            rows += mean_rows(f"{name}_{kind}_{variant}", ratios, "1", "", [])
    return rows


def _errors(world: World, every: Samples, mine: Mask, splits: list[Split], draw: int) -> tuple[float, ...]:
    """Mean nMSE over all splits together of a draw's own samples alone, of `others` and of `inside`."""
    tests, means = [], []
    for train, test in splits:
        held, rng = every.take(test), np.random.default_rng(draw)
        model = world.learned(every.take(train & mine), world.config.model, rng, body=False).model
        tests.append(held)
        more = (np.flatnonzero(train & ~mine), inside(every.t, train, mine))
        ways = [again(model, every.take(rows), float(DRAWS)) for rows in more]
        means.append([one.mean(held.log) for one in (model, *ways)])
    whole = joined_samples(tests)
    use = whole.usable & whole.moving
    return tuple(
        float(figures(whole.command, np.concatenate(mean), None, use).nmse.mean())
        for mean in zip(*means, strict=True)
    )


def inside(t: Array, train: Mask, members: Mask) -> Index:
    """Positions of the other draws' samples that lie nearest to one of the draw's own `train` samples which
    is not at an edge; those at an edge come as often as there are other draws, so that with so many times
    the noise they are what they were.
    """
    mine = np.flatnonzero(members)[np.argsort(t[members], kind="stable")]
    training = train[mine]
    edge = training & ~(np.append(True, training[:-1]) & np.append(training[1:], True))
    middle = 0.5 * (t[mine][1:] + t[mine][:-1])
    nearest = np.searchsorted(middle, t)
    others = np.flatnonzero(~members & (training & ~edge)[nearest])
    return np.concatenate([others, np.repeat(mine[edge], DRAWS - 1)])


def new_motion(world: World, seed: int) -> float:
    """Error of the model that other draws taught too over that of one draw, on motions not learned from."""
    rng = np.random.default_rng(seed)

    def run(seconds: float) -> Log:
        log: Log = world.robot.run(world.motion(rng, **one_period(seconds)), None, rng)
        return log

    mine, *others = drawn(run(LEARNED_S), world, world.config.data)
    test = world.samples(run(TEST_S), run(TEST_S))
    model = world.learned(mine, world.config.model, rng, body=False).model
    return _nmse(again(model, joined_samples(others), float(DRAWS)), test) / _nmse(model, test)


def _nmse(model: LearnedModel, test: Samples) -> float:
    use = test.usable & test.moving
    return float(figures(test.command, model.mean(test.log), None, use).nmse.mean())


if __name__ == "__main__":
    table(edge_rows(Path(sys.argv[1]) if len(sys.argv) > 1 else None), "edges and other motions")
