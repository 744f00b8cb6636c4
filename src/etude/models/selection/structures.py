"""Structures of one group of commands: a mean, alone or with a process, and that one's noise floor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.errors import NumericalError
from etude.models.data.cross_validation import Base, HeldOut, process_held_out
from etude.models.data.fit_data import Folds, Rows, fit_data, floor_of, is_held, on_schedule, units_of
from etude.models.learned_model import LearnedModel
from etude.models.members import member_named
from etude.models.process import Silent
from etude.models.process_abilities import EnsembleMember, name_of
from etude.protocols import Candidate
from etude.types import Mask


@dataclass(frozen=True, eq=False)
class LearnedStructure:
    """A structure of one group of commands, and what it says of samples held out.

    Attributes:
        held: of those that it was conditioned on. beside: of further samples; None: of none.
        base: its mean function; None: of a process on the commands themselves.
    """

    candidate: EnsembleMember
    held: HeldOut
    rows: Rows
    base: Base | None
    beside: HeldOut | None = None


def base_of(structure: str) -> str:
    """Name of a structure's mean function; "" for a process on the commands themselves."""
    return "" if structure == "gp" else structure.removesuffix("+gp")


def rows_only(held: HeldOut, group: tuple[int, ...], rows: Rows) -> HeldOut:
    """The commands of a group at the samples kept, so that all structures are compared on the same."""
    outputs = list(group)
    use = np.zeros((len(held.error), len(outputs)), dtype=np.bool_)
    use[rows.kept] = True
    return HeldOut(held.error[:, outputs], held.variance[:, outputs], held.fold).at(use)


def earlier_of(
    previous: LearnedModel | None, structure: str, group: tuple[int, ...], folds: Folds, name: str = "default"
) -> Candidate | None:
    """Last round's candidate of the same structure, name and commands, if it had the same inputs.

    None too where there are too few trajectories to go on from fewer.
    """
    if previous is None or list(previous.inputs.columns) != list(folds.inputs.columns):
        return None
    if folds.trajectories < folds.config.warm_from:
        return None
    candidates = [c for c in previous.candidates if c.structure == structure and c.commands == group]
    return next((c for c in candidates if name_of(c) == name), None)


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


def alone(
    folds: Folds, group: tuple[int, ...], rows: Rows, structure: str, base: Base, twin: Candidate
) -> LearnedStructure:
    """A mean function by itself; the process of `twin` says where the robot has not been."""
    outputs, process, factor = list(group), twin.process, twin.units[1]
    assert process is not None
    held = base.held_out(folds)
    prior = process.signal_variance + process.noise_variance
    if structure == "linear":  # all that there is to explain
        command = folds.samples.command[rows.moving][:, outputs]
        prior = np.maximum(prior, command.var(axis=0) / factor**2)
    least = held.variance[0, outputs] / factor**2
    silent = Silent(process, twin.calibration, least, prior, grows=structure == "linear")
    nothing, ones = np.zeros(len(outputs)), np.ones(len(outputs))
    units = np.stack([nothing, factor])
    return LearnedStructure(
        EnsembleMember(structure, group, nothing, base.mean, silent, units, ones),
        rows_only(held, group, rows),
        rows,
        base,
    )
