"""What several candidates of a rung say, averaged for each command by how well they predict other motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.models.data.cross_validation import Base, HeldOut
from etude.models.data.fit import Folds
from etude.models.selection.ensemble import everywhere
from etude.models.selection.structures import Learned
from etude.types import Array, Mask

EXPONENT = 4.0
"""Weights go as exp(4 · mean log density): a candidate that is better by half a unit weighs seven times as
much. It was chosen by its errors on the real logs of docs/real_logs.md, where it matters little."""
LEAST = 0.02
"""A candidate that weighs less for every command is left out."""


@dataclass(frozen=True, eq=False)
class Average:
    """A rung with all its candidates.

    Attributes:
        parts: the default's of each group first. shares: of each its (m,) weights within the rung.
        held: what the average says of the samples held out, calibration included.
    """

    parts: tuple[Learned, ...]
    shares: tuple[Array, ...]
    held: HeldOut


def averaged(
    folds: Folds, defaults: Sequence[Learned], others: Sequence[Learned], base: Base | None
) -> Average:
    """The candidates of a rung, weighed for each command by their density over what all of them predicted."""
    parts, J = [*defaults, *others], len(folds.commands)
    use = _compared(defaults, (len(folds.X), J))
    told = [everywhere(folds, part, base, use) for part in parts]
    errors, variances = (np.full((len(parts), len(folds.X), J), np.nan) for _ in range(2))
    for k, (part, (error, variance)) in enumerate(zip(parts, told, strict=True)):
        columns = list(part.candidate.commands)
        errors[k][:, columns], variances[k][:, columns] = error, variance
    weights = np.stack([weighed(errors[:, :, j], variances[:, :, j]) for j in range(J)], axis=1)
    needed = weights.max(axis=1) >= LEAST
    weights = np.where(needed[:, None], weights, 0.0)
    weights /= np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    for own, default in zip(weights, defaults, strict=False):  # where nothing was predicted it stays in use
        own[[j for j in default.candidate.commands if not weights[:, j].any()]] = 1.0
    held = HeldOut(*mixed(errors, variances, weights), folds.fold).at(use)
    kept = [k for k in range(len(parts)) if needed[k] or k < len(defaults)]
    shares = tuple(weights[k, list(parts[k].candidate.commands)] for k in kept)
    return Average(tuple(parts[k] for k in kept), shares, held)


def weighed(error: Array, variance: Array) -> Array:
    """(C,) weights of candidates by errors and variances (C, n), NaN where not predicted; 0 if nowhere.

    The first alone where no sample was predicted by all.
    """
    there = np.isfinite(error).any(axis=1)
    use = np.isfinite(error[there]).all(axis=0)
    weights = np.zeros(len(error))
    if not there.any() or not use.any():
        weights[np.flatnonzero(there)[:1]] = 1.0
        return weights
    e, v = error[there][:, use], variance[there][:, use]
    density = -0.5 * np.mean(np.log(v) + e**2 / v, axis=1)
    share = np.exp(EXPONENT * (density - density.max()))
    weights[there] = share / share.sum()
    return weights


def mixed(errors: Array, variances: Array, weights: Array) -> tuple[Array, Array]:
    """Error and variance (n, J) of the average of those (C, n, J): sum w (v + (m - average)^2).

    Where a candidate predicted nothing the others share its weight.
    """
    w = np.where(np.isfinite(errors), weights[:, None, :], 0.0)
    total = w.sum(axis=0)
    w = w / np.where(total > 0.0, total, 1.0)
    average = np.where(total > 0.0, np.nansum(w * np.nan_to_num(errors), axis=0), np.nan)
    spread = np.nan_to_num(variances) + (np.nan_to_num(errors) - np.nan_to_num(average)) ** 2
    return average, np.where(total > 0.0, np.sum(w * spread, axis=0), np.nan)


def _compared(defaults: Sequence[Learned], shape: tuple[int, int]) -> Mask:
    """(n, J) the samples on which rungs are compared: those that the defaults were conditioned on."""
    use = np.zeros(shape, dtype=np.bool_)
    for part in defaults:
        use[:, list(part.candidate.commands)] = np.isfinite(part.held.error)
    return use


def averages(
    folds: Folds,
    groups: Sequence[Mapping[str, Learned]],
    others: Sequence[Learned],
    bases: Mapping[str, Base],
) -> dict[str, Average]:
    """By rung that has other candidates, its average."""
    found = {}
    for rung in dict.fromkeys(other.candidate.rung for other in others):
        defaults = [group[rung] for group in groups if rung in group]
        beside = [other for other in others if other.candidate.rung == rung]
        found[rung] = averaged(folds, defaults, beside, bases.get(rung.removesuffix("+gp")))
    return found
