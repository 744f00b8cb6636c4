"""Voltages and drag that a plan is flown with: analytic, learned and gated, or exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude.models.trust import familiar, trusted
from etude.protocols import Model
from etude.types import Array, Log
from etude_quadrotor.flatness import Drag
from etude_quadrotor.inputs import COMMANDS

LARGEST_CORRECTION = 0.5
"""V by which a learned voltage may differ from the analytic one: more has always been an extrapolation."""


class Voltages(Protocol):
    """What a feedforward asks of an inverse model."""

    def predict(self, log: Log) -> Array:
        """Commands (T, 4)."""
        ...


class LateralDrag(Protocol):
    """Drag as a function of the body's velocity."""

    @property
    def coefficients(self) -> Drag: ...

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """Force per mass along body x and y (T, 2), and its variance."""
        ...


@dataclass(frozen=True)
class LinearDrag:
    """Known coefficients (dx, dy, dz), 1/s: the exact drag of a simulated vehicle, or none."""

    coefficients: Drag = (0.0, 0.0, 0.0)

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """-d v (T, 2), without variance."""
        force = -velocity[:, :2] * np.array(self.coefficients[:2])
        return force, np.zeros_like(force)


@dataclass(frozen=True, eq=False)
class GatedVoltages:
    """A learned model's voltages where it knows better, the analytic one's elsewhere, never far from those.

    The model's own deviation says how much it is trusted. One that says that too few flights have calibrated
    it is trusted besides only within the ranges that it was trained on.

    Attributes:
        model: learned.
        analytic: what it is held against.
        limit: largest difference, V.
    """

    model: Model
    analytic: Voltages
    limit: float = LARGEST_CORRECTION

    def predict(self, log: Log) -> Array:
        """Voltages (T, 4)."""
        safe = self.analytic.predict(log)
        mean, variance = self.model.posterior(log)
        near = safe + np.clip(mean - safe, -self.limit, self.limit)
        found = trusted(near, variance, prior_deviation(self.model), safe)
        ranges = None if getattr(self.model, "calibrated", True) else getattr(self.model, "ranges", None)
        if ranges is not None:
            found = safe + familiar(self.model.inputs.of_log(log), ranges)[:, None] * (found - safe)
        return found


def prior_deviation(model: Model) -> Array:
    """(4,) deviation of what processes learn of each command before any data, in its unit.

    Of a command that is predicted by physics alone, that of a process beside them: it still says where the
    vehicle has been. Infinite, so that nothing fades, where there is no process.
    """
    found, best = np.full(COMMANDS, np.inf), np.full(COMMANDS, -1.0)
    chosen = {
        c: one.rung
        for one in model.candidates
        for c, w in zip(one.commands, one.weights, strict=True)
        if w > 0.0
    }
    for candidate in model.candidates:
        if candidate.process is None:
            continue
        prior = candidate.process.signal_variance + candidate.process.noise_variance
        for place, command in enumerate(candidate.commands):
            weight = float(candidate.weights[place])
            if weight == 0.0:  # of those that take no part, what stands on the same physics comes first
                weight = -0.5 * float(candidate.rung != f"{chosen.get(command, '')}+gp")
            if weight > best[command]:
                best[command] = weight
                found[command] = abs(candidate.units[1, place]) * np.sqrt(prior[place])
    return found
