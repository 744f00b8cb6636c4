"""FlightModel: from the states of a vehicle to its four commands, by physics and processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.models.flight.config import PHYSICS_KINDS, FlightKind
from etude.models.flight.features import FlightFeatures
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.shared_exact import SharedPosterior
from etude.models.physics.flight_inverse import FlightPhysics
from etude.models.student_t import StudentT
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FlightModel:
    """An inverse model: mean function and processes of the four commands.

    Attributes:
        kind: "nominal", "identified": physics alone; "gp": processes on the centred commands; "nominal+gp",
            "identified+gp": on what the physics leave. The first two do not predict with their processes,
            but these still say where the vehicle has not been, for the design of the next flight.
        features: map from states to the processes' inputs.
        processes: one for all commands (shared kernel), or one for each. Their outputs are standardised:
            command = mean function + offset + deviation * output.
        offset, deviation: (4,) of the outputs, command units.
        scale: (4,) factor on the variances from held-out flights, >= 1.
        calibrated: whether enough flights were held out for the variances to be believed.
        physics: the analytic model, None where there is none; in use as mean function if `kind` says so.
        physics_variance: (4,) mean squared error of the physics on flights held out.
        student: distribution of held-out errors over predicted deviations, or None.
    """

    kind: FlightKind
    features: FlightFeatures
    processes: tuple[SharedPosterior, ...]
    offset: Array
    deviation: Array
    scale: Array
    calibrated: bool
    physics: FlightPhysics | None = None
    physics_variance: Array | None = None
    student: StudentT | None = None

    @property
    def posteriors(self) -> tuple[ExactPosterior, ...]:
        """One for each command, of the standardised outputs; with a shared kernel their covariances agree."""
        return tuple(posterior for process in self.processes for posterior in process.outputs)

    @property
    def shared(self) -> bool:
        """Whether one posterior's covariance is that of all."""
        return len(self.processes) == 1

    @property
    def prior_deviation(self) -> Array:
        """(4,) deviation of what the processes learn, before any data, command units."""
        prior = [p.signal_variance + p.noise_variance for p in self.posteriors]
        return np.asarray(self.deviation * np.sqrt(prior))

    def analytic(self, states: FlightStates) -> Array:
        """Commands (T, 4) of the physics alone; without any, the constant `offset`."""
        if self.physics is None:
            return np.tile(self.offset, (len(states), 1))
        return self.physics.predict(states)

    def mean_function(self, states: FlightStates) -> Array:
        """What the processes are added to, (T, 4)."""
        if self.kind == "gp":
            return np.tile(self.offset, (len(states), 1))
        return self.offset + self.analytic(states)

    def mean(self, states: FlightStates) -> Array:
        """Commands (T, 4) alone, without the price of their variances."""
        if self.kind in PHYSICS_KINDS:
            return self.analytic(states)
        X = self.features.transform(states)
        outputs = np.concatenate([process.mean(X) for process in self.processes], axis=1)
        return np.asarray(self.mean_function(states) + self.deviation * outputs)

    def predict(self, states: FlightStates) -> tuple[Array, Array]:
        """Mean and variance (T, 4) of the commands; the variance includes noise and calibration."""
        if self.kind in PHYSICS_KINDS:
            assert self.physics_variance is not None
            return self.analytic(states), np.tile(self.physics_variance, (len(states), 1))
        X = self.features.transform(states)
        means, variances = [], []
        for process in self.processes:
            mean, latent = process.predict(X)
            means.append(mean)
            variances.append(np.repeat((latent + process.noise_variance)[:, None], mean.shape[1], axis=1))
        spread = self.scale * self.deviation**2 * np.concatenate(variances, axis=1)
        return self.mean_function(states) + self.deviation * np.concatenate(means, axis=1), spread
