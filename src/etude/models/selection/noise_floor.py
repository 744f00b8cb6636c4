"""Noise floor of a process: of those that the configuration lists, the one that predicts best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.errors import NumericalError
from etude.models.data.cross_validation import Base, process_held_out
from etude.models.data.fit_data import Folds, Rows, fit_data, floor_of, is_held, on_schedule, units_of
from etude.models.members import member_named
from etude.models.process_abilities import EnsembleMember
from etude.models.selection.structures import LearnedStructure
from etude.protocols import Candidate
from etude.types import Mask


def with_process(
    folds: Folds,
    group: tuple[int, ...],
    rows: Rows,
    structure: str,
    base: Base | None,
    earlier: Candidate | None,
    rng: np.random.Generator,
    compared: Mask | None = None,
) -> LearnedStructure:
    """A process on what the mean function leaves, with the noise floor that predicts best.

    From log to log a length may creep to where covariances are no longer computed exactly. Where training
    from the earlier candidate fails, it begins anew from the data.

    compared: (n,) further samples that it predicts without their folds, while it still holds its data.
    """
    try:
        return _with_process(folds, group, rows, structure, base, earlier, rng, compared)
    except NumericalError:
        if earlier is None:
            raise
        return _with_process(folds, group, rows, structure, base, None, rng, compared)


def _with_process(
    folds: Folds,
    group: tuple[int, ...],
    rows: Rows,
    structure: str,
    base: Base | None,
    earlier: Candidate | None,
    rng: np.random.Generator,
    compared: Mask | None,
) -> LearnedStructure:
    config, outputs, member = folds.config, list(group), member_named(folds.config.process)
    command = folds.samples.command[:, outputs]
    target = command if base is None else command - base.whole[:, outputs]
    start = None if earlier is None else earlier.process
    units, scale, best = units_of(target, rows, config), np.ones(len(group)), -np.inf
    learned: LearnedStructure | None = None
    for place, part in enumerate(config.floors):
        down = place > 0 and config.floor_of == "deviation"  # from the optimum of a higher floor
        floor = floor_of(folds, group, rows, units, part)
        settings = replace(config, starts=1, schedule="update") if down else config
        fit = fit_data(folds, group, rows, (target - units[0]) / units[1], floor, start, settings, rng)
        held_fast = is_held(fit)
        if held_fast and config.schedule == "first" and earlier is not None:
            units = earlier.units
            fit = replace(fit, Y=(target - units[0]) / units[1])
        process = member(on_schedule(fit))
        held = process_held_out(folds, group, rows, units, process, base)
        if config.calibrate:
            scale = held.scale()
        density = held.density(scale)
        if learned is None or density > best:
            mean = None if base is None else base.mean
            error = held.errors("absolute")
            candidate = EnsembleMember(
                structure, group, np.zeros(len(group)), mean, process, units, scale, error=error
            )
            learned, best = LearnedStructure(candidate, held, rows, base), density
        if held_fast:  # the noise is held too
            break
        if config.floor_of == "deviation":
            start = process
    assert learned is not None
    return learned if compared is None else _with_further_samples(learned, folds, compared)


def _with_further_samples(learned: LearnedStructure, folds: Folds, compared: Mask) -> LearnedStructure:
    """The structure with held-out errors at the compared samples that have none yet."""
    candidate = learned.candidate
    assert candidate.process is not None
    more = replace(learned.rows, kept=np.flatnonzero(compared & ~np.isfinite(learned.held.error).all(axis=1)))
    return replace(
        learned,
        beside=process_held_out(
            folds, candidate.commands, more, candidate.units, candidate.process, learned.base
        ),
    )
