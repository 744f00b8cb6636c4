"""Errors of all candidates on samples left out of training, and errors of their averages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array

if TYPE_CHECKING:
    from etude.models.selection.structures import LearnedStructure


@dataclass(frozen=True, eq=False)
class CandidateErrors:
    """A candidate with its predictions of n samples that it was not trained on.

    Attributes:
        part: the candidate, with the structure that it is of.
        error: (n, m) error of each of its m commands, in command units; NaN where not predicted.
        variance: (n, m) predicted variance of the same.
    """

    part: LearnedStructure
    error: Array
    variance: Array

    @staticmethod
    def of(part: LearnedStructure) -> CandidateErrors:
        """On the samples that it was conditioned on."""
        return CandidateErrors(part, part.held.error, part.candidate.calibration * part.held.variance)

    @property
    def key(self) -> tuple[str, str]:
        """(structure, candidate name)."""
        return self.part.candidate.structure, self.part.candidate.name


def of_command(every: Sequence[CandidateErrors], j: int) -> tuple[list[int], Array, Array]:
    """Places of the candidates of command j, and their errors and variances (C, n)."""
    members = [(k, one, one.part.candidate.commands) for k, one in enumerate(every)]
    members = [(k, one, commands) for k, one, commands in members if j in commands]
    errors = np.array([one.error[:, commands.index(j)] for _, one, commands in members])
    return [k for k, *_ in members], errors, np.array([one.variance[:, c.index(j)] for _, one, c in members])


def mixed(errors: Array, variances: Array, weights: Array) -> tuple[Array, Array]:
    """Error and variance (n,) of the average of those (C, n), weights (C,): sum w (v + (m - average)^2).

    Where a candidate predicted nothing the others share its weight.
    """
    w = np.where(np.isfinite(errors), weights[:, None], 0.0)
    total = w.sum(axis=0)
    w = w / np.where(total > 0.0, total, 1.0)
    average = np.where(total > 0.0, np.nansum(w * np.nan_to_num(errors), axis=0), np.nan)
    spread = np.nan_to_num(variances) + (np.nan_to_num(errors) - np.nan_to_num(average)) ** 2
    return average, np.where(total > 0.0, np.sum(w * spread, axis=0), np.nan)
