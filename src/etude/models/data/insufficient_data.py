"""What is learned from too little motion is not believed: its variances say so, and so does a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.models.data.fit import Folds
from etude.models.data.rows import seconds_of
from etude.protocols import Candidate
from etude.types import Array, Mask

LEAST_STRETCHES, LEAST_MOVING = 2.0, 0.5
"""Motion that errors can be judged by, in stretches of `ModelConfig.stretch_s`, each held out of the other:
of the whole, and of a command's own joint."""
UNCERTAIN = "the model says that it is uncertain everywhere"
DOUBT = 0.1
"""Part of a command's limit that is the least deviation before that."""


def short(folds: Folds) -> Mask:
    """(J,) commands of which there is too little motion to hold any out that differs from the rest."""
    samples, stretch = folds.samples, folds.config.stretch_s
    seconds = seconds_of(samples)
    own = seconds * np.mean(samples.usable & samples.moving, axis=0)
    return np.asarray((own < LEAST_MOVING * stretch) | (seconds < LEAST_STRETCHES * stretch))


def least_variance(folds: Folds, candidates: Sequence[Candidate]) -> Array | None:
    """(J,) variance of short motion anywhere: what a constant would leave, or what the prior has; None if all
    of it is long enough.

    A controller then gives the model no trust, and no stop rule fires. Designs go on looking at the process.
    """
    few = short(folds)
    if not (few.any() and folds.config.calibrate):
        return None
    samples = folds.samples
    seen = np.nanvar(np.where(samples.usable, samples.command, np.nan), axis=0)
    least = np.maximum(seen, (DOUBT * folds.limit) ** 2)
    for candidate in candidates:
        assert candidate.process is not None
        prior = candidate.process.noise_variance + candidate.process.signal_variance
        own = list(candidate.commands)
        least[own] = np.where(
            candidate.weights > 0.0, np.maximum(least[own], candidate.units[1] ** 2 * prior), least[own]
        )
    return np.where(few, least, 0.0)


def notes(folds: Folds) -> tuple[str, ...]:
    """What the user should know of short motion."""
    few = short(folds)
    if not few.any() or not folds.config.calibrate:
        return ()
    names = "all commands" if few.all() else ", ".join(np.array(folds.commands)[few].tolist())
    return (
        f"{names}: of {seconds_of(folds.samples):.0f} s in all there is too little motion to be believed, so "
        f"{UNCERTAIN}; tell another log that moves it.",
    )
