"""Candidates of a rung: other processes beside the default's, for the same commands and mean function.

Each is a row of `CANDIDATES`: what it learns with, from which samples, and when it is worth its time. What
they say is averaged for each command (`averaging`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.contracts import Array, Index, Mask
from etude.models.config import ModelConfig
from etude.models.fit import Folds, Rows, rows_of
from etude.models.gp.kernels import own_columns
from etude.models.held_out import Base, process_held_out
from etude.models.model import LearnedModel
from etude.models.rows import apart
from etude.models.rungs import Learned, earlier_of, with_process
from etude.models.score import while_any_moves
from etude.progress import counted

FEW = 200
"""Samples for the default's hyperparameters below which a prior of mechanics has something to add: logs of a
minute or two. With four logs it was worse than the default alone."""
REST_S = 2.0
"""Least time between two samples of a joint at rest that teach, s."""
RESTS = 0.5
"""How much a joint rests, in [0, 1], from which its sample teaches what friction holds."""
INVERTED = -0.3
"""Work of a command over its size below which its sign is wrong: friction's is positive, and conservative
power cancels over a closed motion. Torques measured behind the gear hold no friction and come out near 0."""


@dataclass(frozen=True)
class Recipe:
    """How a candidate learns.

    Attributes:
        kernel: name in the group etude.kernels. process: name of the member.
        rungs: in which it takes part.
        together: all commands in one process; else each by itself.
        standing: samples of standing joints teach too, while another moves.
        fit_points, steps, points: at most, of the configuration's; 0: these. warm: steps from a warm start.
        offered: whether it is worth its time on these data, given the default's samples of each command.
    """

    kernel: str
    process: str = "exact"
    rungs: tuple[str, ...] = ("gp",)
    together: bool = False
    standing: bool = False
    fit_points: int = 0
    steps: int = 0
    points: int = 0
    offered: Callable[[Folds, Sequence[Rows]], bool] = lambda folds, rows: True  # noqa: ARG005

    def config(self, config: ModelConfig) -> ModelConfig:
        """The configuration of this candidate."""
        return replace(
            config,
            kernel=self.kernel,
            process=self.process,
            fit_points=min(self.fit_points or config.fit_points, config.fit_points),
            inducing=config.inducing if self.standing else 0,  # a Lagrangian is for few samples
            points=min(self.points or config.points, config.points),
            steps=self.steps or config.steps,
        )


def _rests(folds: Folds, rows: Sequence[Rows]) -> bool:  # noqa: ARG001
    """Joints stand while others move, and inputs remember how they came there."""
    stands = while_any_moves(folds.samples) & ~folds.samples.moving
    return bool(stands.any()) and any(op == "memory" for *_, op in folds.inputs.columns)


def _few(folds: Folds, rows: Sequence[Rows]) -> bool:  # noqa: ARG001
    return all(len(own.chosen) < FEW for own in rows)


def _conserves(folds: Folds, rows: Sequence[Rows]) -> bool:
    """Few samples, and commands that can be of one energy: in one unit, none with the wrong sign."""
    units = folds.samples.log.channels["command"].units
    return _few(folds, rows) and len(set(units)) == 1 and bool(np.all(work_sign(folds) > INVERTED))


CANDIDATES: dict[str, Recipe] = {
    "standing": Recipe("standing", rungs=("gp", "identified+gp"), standing=True, offered=_rests),
    "gip_lin": Recipe("gip_lin", fit_points=110, offered=_few),
    "all_lin": Recipe(
        "ard_se", "all_lin", together=True, fit_points=110, steps=60, points=300, offered=_conserves
    ),
}
"""Beside "default", by the name that `model.candidates` gives."""
COSTS = {"default": 0.1, "all_lin": 10.0}
"""About how long one takes; others 1."""


def work_sign(folds: Folds) -> Array:
    """(J,) Σ command · speed / Σ |command · speed| where the joint moves; 0 where no speed is known."""
    samples, names = folds.samples, [channel for channel, *_ in folds.inputs.columns]
    speeds = [n for n in dict.fromkeys(names) if samples.log.channels[n].derivative_of == names[0]]
    if not speeds:
        return np.zeros(len(folds.commands))
    use = samples.usable & samples.moving
    power = np.where(use, samples.command * samples.log[speeds[0]], 0.0)
    return np.asarray(power.sum(axis=0) / np.maximum(np.abs(power).sum(axis=0), np.finfo(float).tiny))


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


def everywhere(folds: Folds, learned: Learned, base: Base | None) -> tuple[Array, Array]:
    """Errors and calibrated variances (n, m) held out, of standing joints too; NaN where not predicted."""
    candidate, held = learned.candidate, learned.held
    own, process = list(candidate.commands), candidate.process
    error, variance = held.error.copy(), held.variance.copy()
    missing = while_any_moves(folds.samples)[:, own] & ~folds.samples.moving[:, own] & ~np.isfinite(error)
    rest = np.flatnonzero(missing.any(axis=1))
    if len(rest) and len(own) == 1 and process is not None:  # what learns together has held out all entries
        rows = replace(learned.rows, kept=rest)
        more = process_held_out(folds, candidate.commands, rows, candidate.units, process, base)
        told = np.isnan(error) & np.isfinite(more.error)
        error, variance = np.where(told, more.error, error), np.where(told, more.variance, variance)
    return error, variance * candidate.calibration
