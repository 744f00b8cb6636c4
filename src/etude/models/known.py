"""How well a model knows its commands where it was trained: from where on a row lies outside
(`trust.outside`).

It is found of the inputs that the processes are conditioned on, so that models on disk of any age tell it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.models.contracts import HasInputs
from etude.models.selection.parts import noise_of, outputs
from etude.models.trust import known_in_training
from etude.protocols import Candidate
from etude.types import Array

MOST = 64
"""Inputs at which it is asked, evenly spread over all: a mean over them is known to a tenth."""


def known_of(candidates: Sequence[Candidate], believed: Sequence[bool]) -> Array:
    """(J,) what may be unknown of each command before a row lies outside; infinite where no process has
    inputs, and 0 where the mean is not believed: it is known nowhere.
    """
    found = np.full(len(believed), np.inf)
    for j in range(len(believed)):
        own = [(c, c.commands.index(j)) for c in candidates if j in c.commands]
        own = [(c, place) for c, place in own if c.weights[place] > 0.0]
        X = _inputs(own)
        if X is not None:
            found[j] = _known(own, X) if believed[j] else 0.0
    return found


def _inputs(own: list[tuple[Candidate, int]]) -> Array | None:
    """(k, D) of the candidate that weighs most among those that have some."""
    for candidate, _ in sorted(own, key=lambda pair: -float(pair[0].weights[pair[1]])):
        process: object = candidate.process
        X = process.conditioned_on if isinstance(process, HasInputs) else None
        if X is not None and len(X):
            return np.asarray(X[:: -(-len(X) // MOST)])
    return None


def _known(own: list[tuple[Candidate, int]], X: Array) -> float:
    """Of one command. Its candidates stand on one mean function, so that their outputs tell them apart."""
    weights = np.array([float(c.weights[place]) for c, place in own])
    means, unknown, noise = [], [], 0.0
    for weight, (candidate, place) in zip(weights, own, strict=True):
        assert candidate.process is not None
        factor = float(candidate.calibration[place] * candidate.units[1, place] ** 2)
        white = float(candidate.process.noise_variance[place])
        latent = candidate.process.predict(X)[1][:, place]
        held = noise_of(candidate, X)[:, place] - factor * white
        unknown.append(factor * latent - held)
        means.append(candidate.units[0, place] + outputs(candidate, X)[:, place])
        noise += weight * factor * white
    average = weights @ np.stack(means)
    apart = weights @ (np.stack(means) - average) ** 2
    return float(known_in_training(np.mean(weights @ np.stack(unknown) + apart), np.asarray(noise)))
