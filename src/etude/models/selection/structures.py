"""Structures of one group of commands: a mean alone, and what all of them say of samples held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.models.data.cross_validation import Base, HeldOut
from etude.models.data.fit_data import Folds, Rows
from etude.models.learned_model import LearnedModel
from etude.models.process import Silent
from etude.models.process_abilities import EnsembleMember, name_of
from etude.protocols import Candidate


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
