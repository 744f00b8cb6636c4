"""Base parameters of a fit: combinations that no motion separates, and their identifiability by the logs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array
from etude_arm.identified.parameter_fit import ParameterFit
from etude_arm.physics.base_parameters import RANK_TOLERANCE

MEASURED, PARTLY = 0.99, 0.75
"""Reduction of the prior variance from which a parameter counts as identified or partly identified: a tenth,
or half, of its deviation remains."""
LEAST_PART = 1e-6
"""Relative factor of a regrouped parameter: smaller ones are rounding errors."""


@dataclass(frozen=True)
class Combination:
    """A base parameter: (index in theta, factor) of its members, which no motion separates; the first factor
    is 1.
    """

    parts: tuple[tuple[int, float], ...]

    def row(self, size: int) -> Array:
        """(size,) row such that row @ theta is the value."""
        row = np.zeros(size)
        for place, factor in self.parts:
            row[place] = factor
        return row


def share_of(fit: ParameterFit, one: Combination) -> float:
    """Part of a base parameter's variance before the logs that they took away."""
    weights = one.row(len(fit.theta))
    after, before = (float(weights @ C @ weights) for C in (fit.after, fit.before))
    return 1.0 - after / before


def identifiability(share: float) -> str:
    """In a word, by the part of the variance that the logs took away."""
    return "measured" if share >= MEASURED else "partly" if share >= PARTLY else "from the file"


def combinations(fit: ParameterFit) -> tuple[list[Combination], list[int]]:
    """The base parameters (Gautier 1991: QR with pivots), and indices of parameters that affect no
    command.
    """
    from scipy.linalg import qr

    rows = fit.shown * fit.scale
    silent = np.linalg.norm(rows, axis=0) <= RANK_TOLERANCE * max(
        float(np.abs(rows).max(initial=0.0)), 1e-300
    )
    triangle, order = qr(rows, mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    rank = int(np.sum(size > RANK_TOLERANCE * size[0])) if len(size) else 0
    regrouped = np.linalg.solve(triangle[:rank, :rank], triangle[:rank, rank:])
    bases = []
    for k, first in enumerate(order[:rank].tolist()):
        others = zip(order[rank:].tolist(), regrouped[k].tolist(), strict=True)
        # in the units of theta: columns were scaled
        parts = [
            (place, factor * float(fit.scale[first] / fit.scale[place]))
            for place, factor in others
            if abs(factor) > LEAST_PART
        ]
        bases.append(Combination(((first, 1.0), *sorted(parts))))
    return sorted(bases, key=lambda one: one.parts[0][0]), np.flatnonzero(silent).tolist()
