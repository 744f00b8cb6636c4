"""The best candidate of each command alone: what an average costs too much time for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.models.model import LearnedModel
from etude.types import Array


def single(model: LearnedModel) -> LearnedModel:
    """The model with, for each command, the candidate of most weight: the best held-out density."""
    weights = np.zeros((len(model.candidates), len(model.commands)))
    for k, candidate in enumerate(model.candidates):
        weights[k, list(candidate.commands)] = candidate.weights
    best = weights.argmax(axis=0)
    own = [
        np.array([float(best[j] == k) for j in candidate.commands])
        for k, candidate in enumerate(model.candidates)
    ]
    return replace(
        model, candidates=tuple(replace(c, weights=w) for c, w in zip(model.candidates, own, strict=True))
    )


def errors(model: LearnedModel) -> str:
    """Held-out errors of the candidates in use, in words."""
    found: dict[str, Array] = {}
    for candidate in model.candidates:
        told = getattr(candidate, "error", None)
        for i, j in enumerate(candidate.commands):
            if candidate.weights[i] and told is not None:
                found[model.commands[j]] = told[i]
    if not found:
        return "its held-out error was not stored with this model; learn a log again"
    each = ", ".join(f"{name} {float(value):.3g}" for name, value in found.items())
    return f"mean absolute error on motion held out: {each}"
