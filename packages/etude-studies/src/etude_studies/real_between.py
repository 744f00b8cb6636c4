"""Information left in the samples between those of a thinned log, by the blocks of `real_logs`.

Every draw of `real_draws` is trained as a campaign trains it. Its processes of one command are then
conditioned again with the same hyperparameters and weights; the one energy of all commands stays as it is.

    python -m etude_studies.real_between [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.models import (
    ExactGP,
    ExactPosterior,
    FixedInducing,
    LearnedModel,
    Posteriors,
    block_masks,
    figures,
)
from etude.protocols import Candidate
from etude.types import Array, Log, Samples, joined_samples
from etude_arm import filter_cutoff
from etude_studies.real_draws import DRAWS, drawn
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row, table
from etude_studies.world import World

LESS = 4.0
"""Times the noise where samples are to count for less than one: those for the hyperparameters, which were
taken as independent, are about so many times as far apart."""


def between_rows(logs: Path | None = None) -> list[Row]:
    """`<log>_<way>`: mean nMSE over the outputs, mean of the draws, beside that of the model as it is; and
    `<log>_<way>_largest`. Ways:

    `others_teach`: samples of all draws through the draw's own, each with so many times the noise as there
    are draws, so that nothing is counted twice. `each_less`: the draw's own with `LESS` times the noise.
    `others_less`: both. `averaged`: the draws' models averaged, one figure.
    """
    rows = []
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is None or real.name == "sarcos":  # which has no times
            continue
        errors_by_variant: dict[str, list[float]] = {}
        for variant, error in _errors(*arm_log(real.name, path)):
            errors_by_variant.setdefault(variant, []).append(error)
        one = errors_by_variant.pop("one")
        for variant, errors in errors_by_variant.items():
            name, beside = f"{real.name}_{variant}", "as it is"
            rows.append(Row(name, float(np.mean(errors)), "1", beside, float(np.mean(one))))
            rows.append(Row(f"{name}_largest", max(errors), "1", beside, max(one)))
    return rows


def _errors(log: Log, world: World) -> Iterator[tuple[str, float]]:
    """Way and mean nMSE, on the test samples of all draws; "one" is the model as it is."""
    parts = drawn(log, world, world.config.data)
    every = joined_samples(parts)
    draw_of = np.concatenate([np.full(len(part), draw) for draw, part in enumerate(parts)])
    train, test = block_masks(every.t, 1.0 / filter_cutoff(log, world.config.data))
    held = every.take(test)

    def nmse(mean: Array) -> float:
        return float(figures(held.command, mean, None, held.usable & held.moving).nmse.mean())

    plain = []
    for draw in range(DRAWS):
        taught, others = every.take(train & (draw_of == draw)), every.take(train & (draw_of != draw))
        rng = np.random.default_rng(draw)
        model = world.learned(taught, world.config.model, rng, body=False).model
        plain.append(model.mean(held.log))
        yield "one", nmse(plain[-1])
        nobody = others.take(slice(0, 0))
        ways = {
            "others_teach": (others, float(DRAWS)),
            "each_less": (nobody, LESS),
            "others_less": (others, LESS * DRAWS),
        }
        for variant, (more, factor) in ways.items():
            yield variant, nmse(again(model, more, factor).mean(held.log))
    yield "averaged", nmse(np.mean(plain, axis=0))


def again(model: LearnedModel, more: Samples, factor: float) -> LearnedModel:
    """The model with every exact process of one command on its own samples and on `more`, through its own,
    with `factor` times the noise.
    """
    return replace(model, candidates=tuple(_conditioned(model, c, more, factor) for c in model.candidates))


def _conditioned(model: LearnedModel, candidate: Candidate, more: Samples, factor: float) -> Candidate:
    process = candidate.process
    if candidate.mean is not None or not isinstance(process, Posteriors) or len(process.own) > 1:
        return candidate
    posterior, j = process.own[0], candidate.commands[0]
    if not isinstance(posterior, ExactPosterior):
        return candidate
    added = more.take((more.usable & more.moving)[:, j])
    X = np.vstack([posterior.X, model.inputs.of_log(added.log)])
    y = np.concatenate([posterior.y, (added.command[:, j] - candidate.units[0, 0]) / candidate.units[1, 0]])
    gp = ExactGP(posterior.kernel, posterior.theta, 0.5 * float(np.log(factor * posterior.noise_variance)))
    return replace(candidate, process=Posteriors((FixedInducing(gp, posterior.X, X).posterior(y),)))


if __name__ == "__main__":
    table(between_rows(Path(sys.argv[1]) if len(sys.argv) > 1 else None), "samples between")
