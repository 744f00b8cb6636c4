"""Which rung predicts each command: the one that erred least on motion held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from etude.contracts import Array
from etude.models.fit import Folds
from etude.models.held_out import HeldOut

TRAJECTORIES = 2
"""From so many on commands are chosen for one by one, and linear regression competes. Stretches of a single
trajectory are no evidence for either: they are all near each other, and a regression that fits them best may
err without bound on the next motion."""
ROUNDING = 1e-20
"""Part of the mean square of a command below which a squared error is rounding: both are right."""


def choices(folds: Folds, trained: Sequence[Sequence[str]], errors: Mapping[str, Array]) -> tuple[str, ...]:
    """The rung of each command.

    Args:
        trained: for each command its rungs; of equally good ones the first is taken.
        errors: by rung, (J,) held-out errors as `config.choose_by` says.
    """
    config, command = folds.config, folds.samples.command
    if config.rung != "auto":
        return tuple(config.rung for _ in trained)
    power = 1 if config.choose_by == "absolute" else 2
    size = np.sqrt(np.mean(command**2, axis=0))
    rounding = (np.sqrt(ROUNDING) * size) ** power
    if folds.trajectories >= TRAJECTORIES:
        return tuple(
            _least({rung: errors[rung][j] for rung in _competing(folds, rungs)}, float(rounding[j]))
            for j, rungs in enumerate(trained)
        )
    spread = np.maximum(command.std(axis=0), np.finfo(float).tiny) ** power
    relative = {rung: float(np.mean(errors[rung] / spread)) for rung in _competing(folds, trained[0])}
    return tuple(_least(relative, 0.0) for _ in trained)


def _competing(folds: Folds, rungs: Sequence[str]) -> list[str]:
    """Those of the rungs that may be chosen, as few trajectories say little."""
    if folds.trajectories >= TRAJECTORIES:
        found = list(rungs)
    else:
        found = [rung for rung in rungs if not rung.startswith("linear")]
    physics = [rung for rung in found if not rung.endswith("gp") and rung != "linear"]
    return physics if physics and folds.trajectories < folds.config.process_from else found


def _least(errors: Mapping[str, float], rounding: float) -> str:
    """The rung with the least error; the first of those that are as good, or if nothing was held out."""
    rungs = list(errors)
    best = rungs[0]
    for rung in rungs[1:]:
        if errors[rung] < errors[best] - rounding or np.isnan(errors[best]) > np.isnan(errors[rung]):
            best = rung
    return best


def warnings_of(
    folds: Folds, trained: Sequence[Sequence[str]], chosen: Sequence[str], held: Mapping[str, HeldOut]
) -> tuple[str, ...]:
    """A sentence for each command of which linear regression predicts more than a process by itself."""
    found = []
    squared = {rung: own.errors("squared") for rung, own in held.items()}
    for j, (rungs, rung) in enumerate(zip(trained, chosen, strict=True)):
        rival = "gp" if rung.startswith("linear") and "gp" in rungs else rung
        if not rival.endswith("gp") or rival == "linear+gp":
            continue
        error, linear = squared[rival][j], squared["linear"][j]
        if not error > linear + ROUNDING * float(np.mean(folds.samples.command[:, j] ** 2)):
            continue
        worse = float(np.sqrt(error / linear)) if linear > 0.0 else np.inf
        found.append(
            f"{folds.commands[j]}: on motion held out the process erred {worse:.3g} times as much as linear "
            f"regression{_outcome(folds, rung)}."
        )
    return tuple(found)


def _outcome(folds: Folds, rung: str) -> str:
    if rung == "linear":
        return ", so this command is predicted by linear regression alone"
    if rung == "linear+gp":
        return ", so the process now learns only what linear regression leaves"
    if folds.trajectories < TRAJECTORIES:
        return ", but one trajectory is too little to fall back to that; tell another one"
    return ""
