"""Candidates of a rung: other processes beside the default's, for the same commands and mean function.

Each is a row of `recipes.CANDIDATES`. What they say is averaged for each command (`averaging`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from etude.models.data.cross_validation import Base, process_held_out
from etude.models.data.fit import Folds, Rows, rows_of
from etude.models.data.rows import apart
from etude.models.gp.kernels import own_columns
from etude.models.model import LearnedModel
from etude.models.score import while_any_moves
from etude.models.selection.member_configs import CANDIDATES
from etude.models.selection.structures import Learned, earlier_of, with_process
from etude.progress import counted
from etude.types import Array, Index, Mask

REST_S = 2.0
"""Least time between two samples of a joint at rest that teach, s."""
RESTS = 0.5
"""How much a joint rests, in [0, 1], from which its sample teaches what friction holds."""
COSTS = {"default": 0.1, "all_lin": 10.0}
"""About how long one takes; others 1."""


def beside_default(
    folds: Folds,
    groups: Sequence[Mapping[str, Learned]],
    bases: Mapping[str, Base],
    rng: np.random.Generator,
    previous: LearnedModel | None,
) -> list[Learned]:
    """The candidates that `model.candidates` names and the data are good for, in every rung of theirs."""
    found: list[Learned] = []
    if not folds.config.averages or len(folds.numbers) < 2:
        return found
    for name in counted(folds.config.candidates, lambda name: COSTS.get(name, 1.0)):
        recipe = CANDIDATES.get(name)
        for rung in counted(() if recipe is None else recipe.rungs):
            own = [group[rung] for group in groups if rung in group]
            if recipe is None or not own or not recipe.offered(folds, [learned.rows for learned in own]):
                continue
            every = tuple(j for learned in own for j in learned.candidate.commands)
            for commands in counted([every] if recipe.together else [(j,) for j in every]):
                learned = _learned(
                    folds, commands, name, rung, bases.get(rung.removesuffix("+gp")), rng, previous
                )
                found.append(learned)
    return found


def _learned(
    folds: Folds,
    group: tuple[int, ...],
    name: str,
    rung: str,
    base: Base | None,
    rng: np.random.Generator,
    previous: LearnedModel | None,
) -> Learned:
    recipe = CANDIDATES[name]
    samples = folds.samples
    if recipe.standing:
        samples = replace(samples, moving=samples.moving | resting(folds))
    own = replace(folds, samples=samples, config=recipe.config(folds.config))
    rows = rows_of(own, group, rng, any_of=recipe.together)
    if recipe.standing:  # at rest little is told of the motion, so those samples come on top
        rows = _beside(rows_of(replace(own, samples=folds.samples), group, rng), rows, folds, group)
    start = earlier_of(previous, rung, group, folds, name)
    learned = with_process(own, group, rows, rung, base, start, rng)
    return replace(learned, candidate=replace(learned.candidate, name=name))


def resting(folds: Folds) -> Mask:
    """(n, J) samples at which a joint rests while another moves; those in between say neither.

    Around a stick-slip the filter smears the motion: a slow sample is no observation of friction at rest. And
    of one rest all samples are held by the same friction, so that they repeat each other: some are enough.
    """
    samples = folds.samples
    places = [own_columns(folds.inputs.columns, (name,), "rest")[0] for name in folds.commands]
    rests = (folds.X[:, places] >= RESTS) & while_any_moves(samples)
    for own in rests.T:
        rows = np.flatnonzero(own)
        own[np.setdiff1d(rows, rows[apart(samples.t[rows], samples.group[rows], REST_S)])] = False
    return np.asarray(rests)


def _beside(moving: Rows, every: Rows, folds: Folds, group: tuple[int, ...]) -> Rows:
    """The rows of moving joints, and of the others those at rest."""
    rests = np.asarray(~folds.samples.moving[:, list(group)].all(axis=1))

    def both(own: Index, other: Index) -> Index:
        return np.union1d(own, other[rests[other]])

    return Rows(every.moving, both(moving.kept, every.kept), both(moving.chosen, every.chosen))


def everywhere(folds: Folds, learned: Learned, base: Base | None, compared: Mask) -> tuple[Array, Array]:
    """Errors and calibrated variances (n, m) held out, of standing joints too; NaN where not predicted.

    Each candidate is conditioned on samples of its own, so that together they use more of them. What the
    default held out, `compared` (n, J), others say something of too, or there were little to compare. What
    learns all commands together, from few samples, is compared by what it held out itself.
    """
    candidate, held = learned.candidate, learned.held
    own, process = list(candidate.commands), candidate.process
    error, variance = held.error.copy(), held.variance.copy()
    standing = while_any_moves(folds.samples)[:, own] & ~folds.samples.moving[:, own]
    missing = np.flatnonzero(((standing | compared[:, own]) & ~np.isfinite(error)).any(axis=1))
    if len(missing) and len(own) == 1 and process is not None:
        rows = replace(learned.rows, kept=missing)
        more = process_held_out(folds, candidate.commands, rows, candidate.units, process, base)
        told = np.isnan(error) & np.isfinite(more.error)
        error, variance = np.where(told, more.error, error), np.where(told, more.variance, variance)
    return error, variance * candidate.calibration
