"""What is learned from too little motion is not believed: its variances say so, and so does a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.contracts import Array, Candidate, Mask
from etude.models.fit import Folds
from etude.models.rows import seconds_of

LEAST_STRETCHES, LEAST_MOVING = 2.0, 0.5
"""Motion that errors can be judged by, in stretches of `ModelConfig.stretch_s`, each held out of the other:
of the whole, and of a command's own joint."""
DOUBT = 0.1
"""Part of a command's limit that is the least deviation before that."""
ROUNDING = 1e-9
"""Part of a variance below which another is none."""


def short(folds: Folds) -> Mask:
    """(J,) commands of which there is too little motion to hold any out that differs from the rest."""
    samples, stretch = folds.samples, folds.config.stretch_s
    seconds = seconds_of(samples)
    own = seconds * np.mean(samples.usable & samples.moving, axis=0)
    return np.asarray((own < LEAST_MOVING * stretch) | (seconds < LEAST_STRETCHES * stretch))


def doubted(folds: Folds, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, of short motion with at least the variance that a constant would leave, or their prior.

    A controller then gives the model no trust, a design sees no difference, and no stop rule fires.
    """
    if not folds.config.calibrate:
        return list(candidates)
    samples = folds.samples
    seen = np.nanvar(np.where(samples.usable, samples.command, np.nan), axis=0)
    least = np.where(short(folds), np.maximum(seen, (DOUBT * folds.limit) ** 2), 0.0)
    return [_with_least(candidate, least[list(candidate.commands)]) for candidate in candidates]


def _with_least(candidate: Candidate, least: Array) -> Candidate:
    assert candidate.process is not None
    process, square = candidate.process, candidate.units[1] ** 2
    prior = process.noise_variance + process.signal_variance
    least = np.where(least > 0.0, np.maximum(least, square * prior), 0.0)
    known = candidate.calibration * square * np.maximum(process.noise_variance, ROUNDING * prior)
    factor = np.divide(least, known, out=np.ones_like(known), where=known > ROUNDING**2 * least)
    factor = np.maximum(1.0, factor)
    return replace(candidate, calibration=candidate.calibration * factor)


def notes(folds: Folds) -> tuple[str, ...]:
    """What the user should know of short motion."""
    few = short(folds)
    if not few.any() or not folds.config.calibrate:
        return ()
    names = "all commands" if few.all() else ", ".join(np.array(folds.commands)[few].tolist())
    return (
        f"{names}: of {seconds_of(folds.samples):.0f} s in all there is too little motion to be believed, so "
        "the model says that it is uncertain everywhere; tell another log that moves it.",
    )
