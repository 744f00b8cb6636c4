"""Cost of one sample: a mean in a controller's cycle, and a dictionary that learns the sample."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from etude.models import ExactGP, PointMean, structured
from etude.types import Column
from etude_sparse import DictionaryConfig, DictionaryGP
from etude_studies.rows import Row
from etude_studies.streams import INPUTS, LENGTH, NOISE, motions, outputs, process
from etude_studies.world import World

OUTPUTS = 4
POINTS = 500
MEMBERS = 300
REPEATS = 2000
AIM_PREDICT_US, AIM_UPDATE_US = 40.0, 500.0


def latency_rows(rng: np.random.Generator) -> list[Row]:
    """`predict_one_point_us` of all outputs and `online_update_us` of one: medians, beside the aims.

    `predict_one_point_structured_us` is that of the default kernel with its friction features. A tick of
    100 Hz has 10,000 µs. The updates are of a full dictionary that samples of a smooth motion stream through
    one by one, swaps and refreshes included.
    """
    world = World.of("arm4")
    columns = world.inputs(world.alone).columns
    joints = [_structured(columns, joint) for joint in world.spec.names]
    return [
        _predict_row("predict_one_point_us", [process(NOISE)] * OUTPUTS, INPUTS, rng),
        _predict_row("predict_one_point_structured_us", joints, len(columns), rng),
        _update_row(rng),
    ]


def _structured(columns: Sequence[Column], joint: str) -> ExactGP:
    """The default process of one joint."""
    kernel = structured(columns, (joint,))
    theta = kernel.initial(np.full(len(columns), LENGTH), 1.0)
    return ExactGP(kernel, theta, 0.5 * float(np.log(NOISE)))


def _predict_row(metric: str, processes: Sequence[ExactGP], inputs: int, rng: np.random.Generator) -> Row:
    posteriors = [
        gp.condition(rng.normal(size=(POINTS, inputs)), rng.normal(size=POINTS)) for gp in processes
    ]
    mean, queries = PointMean(posteriors), rng.normal(size=(REPEATS, inputs))
    mean(queries[0])  # compiles
    value = _median_us(lambda i: mean(queries[i]))
    named = f"aim; {OUTPUTS} outputs of {inputs} inputs, n = {POINTS}"
    return Row(metric, value, "us", named, AIM_PREDICT_US)


def _update_row(rng: np.random.Generator) -> Row:
    X = motions(1, rng)
    y = outputs(X, rng)
    stream = DictionaryGP(process(NOISE), DictionaryConfig(size=MEMBERS)).stream(INPUTS)
    stream.offer(X[:MEMBERS], y[:MEMBERS])
    stream.offer(X[MEMBERS - 1 : MEMBERS], y[MEMBERS - 1 : MEMBERS])  # compiles the update
    value = _median_us(lambda i: stream.offer(X[MEMBERS + i, None], y[MEMBERS + i, None]))
    share = 100 * stream.replacements / REPEATS
    return Row("online_update_us", value, "us", f"aim; n = {MEMBERS}, {share:.0f} % swaps", AIM_UPDATE_US)


def _median_us(call: Callable[[int], object]) -> float:
    times = np.empty(REPEATS)
    for i in range(REPEATS):
        start = time.perf_counter()
        call(i)
        times[i] = time.perf_counter() - start
    return float(1e6 * np.median(times))
