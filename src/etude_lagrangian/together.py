"""What all commands are learned from together: instants at which some of them says something."""

from __future__ import annotations

import numpy as np

from etude.errors import DataError
from etude.models.data.fit import LEAST_FIT, Folds, Rows, floor_of, seconds_of, spread_points
from etude.protocols import FitData, Process
from etude.types import Array, Mask
from etude_lagrangian.member import FIT_INSTANTS, INSTANTS


def data_together(
    folds: Folds, floor: float, start: Process | None, rng: np.random.Generator
) -> tuple[FitData, Array]:
    """What a joint member learns all commands from, and the units (2, J) of its outputs.

    Outputs are centred and in the commands' own unit, since they share one energy; entries that say nothing
    are there, and left out by the member one by one.

    Args:
        floor: least noise deviation, a part of each command's limit.

    Raises:
        DataError: a command never says anything.
    """
    samples, config = folds.samples, folds.config
    counts = samples.usable & samples.moving
    silent = [name for name, own in zip(folds.commands, counts.T, strict=True) if np.count_nonzero(own) < 2]
    if silent:
        raise DataError(
            "the axis hardly moves, so nothing of it can be learned",
            where=", ".join(silent),
            next_step="Excite it, or learn each command by itself.",
        )
    t, group = samples.t, samples.group
    use: Mask = np.asarray(counts.any(axis=1))
    kept = spread_points(t, group, use, min(config.points, INSTANTS), 0.0, rng)
    spacing = min(config.fit_spacing_s, seconds_of(samples) / LEAST_FIT)
    chosen = spread_points(t, group, use, min(config.fit_points, FIT_INSTANTS), spacing, rng)
    offset = np.array([samples.command[own, j].mean() for j, own in enumerate(counts.T)])
    units = np.stack([offset, np.ones_like(offset)])
    floors = [
        floor_of(folds, (j,), Rows(np.flatnonzero(own), kept, chosen), units[:, [j]], floor)[0]
        for j, own in enumerate(counts.T)
    ]
    return FitData(
        X=folds.X,
        Y=samples.command - offset,
        usable=samples.usable,
        moving=samples.moving,
        group=group,
        fold=folds.fold,
        chosen=chosen,
        kept=kept,
        columns=folds.inputs.columns,
        commands=folds.commands,
        kernels=(),
        floor=np.array(floors),
        start=start,
        config=config,
        rng=rng,
    ), units
