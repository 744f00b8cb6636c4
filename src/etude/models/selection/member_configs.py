"""How the candidates of `candidates` learn: with what, from which samples, and when it is worth the time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from etude.models.config import ModelConfig
from etude.models.score import while_any_moves
from etude.types import Array

if TYPE_CHECKING:
    from etude.models.data.fit import Folds, Rows

FEW = 200
"""Samples for the default's hyperparameters below which a prior of mechanics has something to add: logs of a
minute or two. With four logs it was worse than the default alone."""
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
        fit_points, steps, points: at most, of the configuration's; 0: these.
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


def work_sign(folds: Folds) -> Array:
    """(J,) Σ command · speed / Σ |command · speed| where the joint moves; 0 where no speed is known."""
    samples, names = folds.samples, [channel for channel, *_ in folds.inputs.columns]
    speeds = [n for n in dict.fromkeys(names) if samples.log.channels[n].derivative_of == names[0]]
    if not speeds:
        return np.zeros(len(folds.commands))
    use = samples.usable & samples.moving
    power = np.where(use, samples.command * samples.log[speeds[0]], 0.0)
    return np.asarray(power.sum(axis=0) / np.maximum(np.abs(power).sum(axis=0), np.finfo(float).tiny))
