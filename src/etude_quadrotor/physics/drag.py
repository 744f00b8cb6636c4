"""Drag from flights: the lateral specific force, which has no part of thrust, as a function of velocity.

In the body frame thrust points along z, so an accelerometer reads only drag along x and y. A feedforward with
drag leans as far as the motion needs. Without it, the thesis's attitude is wrong by 27 degrees at 10 m/s and
0.5 1/s. The acceleration is not an input: its noise is also in the output, and would be learned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from etude.errors import DataError
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.models.gp.kernels import SquaredExponential
from etude.types import Array, Code, Index, Samples

LATERAL = 2
"""Outputs: x and y."""
POINTS, FIT_POINTS, STEPS = 600, 200, 40  # of a process with three inputs
KERNEL = SquaredExponential((0, 1, 2))
PROCESS = ("theta", "noise_variance", "X", "y")
"""What makes a process of the residual."""
FLOOR = 0.1
"""Least noise deviation, of the residual's own."""


@dataclass(frozen=True)
class DragModel:
    """Lateral drag force per mass, f = -d v + process(v), body frame.

    Attributes:
        linear: (2,) d >= 0 of body x and y, 1/s, by least squares.
        residual: a process per axis on what the line leaves, or None where flights held out show that the
            line alone predicts as well.
        noise: (2,) deviation of what neither explains, m/s^2.
    """

    linear: Array
    residual: tuple[ExactPosterior | None, ExactPosterior | None]
    noise: Array

    @property
    def coefficients(self) -> tuple[float, float, float]:
        """(dx, dy, 0) in 1/s, for flatness; along z drag and thrust cannot be told apart."""
        return float(self.linear[0]), float(self.linear[1]), 0.0

    def predict(self, velocity: Array) -> tuple[Array, Array]:
        """Force per mass (T, 2), m/s^2, and its variance with noise, at body velocities (T, 3)."""
        mean, variance = -velocity[:, :LATERAL] * self.linear, np.tile(self.noise**2, (len(velocity), 1))
        for j, posterior in enumerate(self.residual):
            if posterior is not None:
                more, latent = posterior.predict(velocity)
                mean[:, j] += more
                variance[:, j] = latent + posterior.noise_variance
        return mean, variance

    def c(self, name: str) -> Code:
        """C99 of `predict`'s mean: void name(const real *body_velocity, real *force)."""
        from etude_quadrotor.c99 import drag_code

        return drag_code(name, self)

    def arrays(self) -> Mapping[str, Array]:
        """Arrays from which `restored` makes the same model, bit for bit."""
        arrays = {"linear": self.linear, "noise": self.noise}
        for j, posterior in enumerate(self.residual):
            if posterior is not None:
                arrays |= {f"{j}.{name}": np.asarray(getattr(posterior, name)) for name in PROCESS}
        return arrays

    @classmethod
    def restored(cls, arrays: Mapping[str, Array]) -> DragModel:
        """The model whose `arrays()` these are."""
        x, y = (_again(arrays, f"{j}.") for j in range(LATERAL))
        return cls(arrays["linear"], (x, y), arrays["noise"])


def _again(arrays: Mapping[str, Array], prefix: str) -> ExactPosterior | None:
    """The process that was stored with that prefix, if there was one."""
    if f"{prefix}X" not in arrays:
        return None
    theta, noise, X, y = (arrays[prefix + name] for name in PROCESS)
    return posterior_given(KERNEL, theta, float(noise), X, y)


def train_drag(samples: Samples, *, process: bool = True) -> DragModel:
    """The drag that flights show; a process only where flights held out are predicted better with it.

    Args:
        process: False for the line alone, at a thousandth of the cost.

    Raises:
        DataError: the flights have no velocity.
    """
    velocity, force = _inputs(samples)
    line, flights = _fitted(velocity, force, (False, False)), np.unique(samples.group)
    if not process or len(flights) < 2:
        return line
    model = _fitted(velocity, force, (True, True))
    errors = np.zeros((2, LATERAL))
    for number in flights:
        held_out = samples.group == number
        for k, both in enumerate(((False, False), (True, True))):
            part = _fitted(velocity[~held_out], force[~held_out], both)
            errors[k] += np.abs(force[held_out] - part.predict(velocity[held_out])[0]).sum(axis=0)
    better = errors[1] < errors[0]
    residual = tuple(
        posterior if good else None for posterior, good in zip(model.residual, better, strict=True)
    )
    return DragModel(model.linear, (residual[0], residual[1]), np.where(better, model.noise, line.noise))


def _inputs(samples: Samples) -> tuple[Array, Array]:
    velocity = samples.log.get("body_velocity")
    if velocity is None:
        raise DataError(
            "the flights lack their velocity, so drag cannot be learned",
            next_step="Log position and attitude, or the velocity.",
        )
    return velocity, samples.log["specific_force"][:, :LATERAL]


def _fitted(velocity: Array, force: Array, processes: tuple[bool, bool]) -> DragModel:
    v = velocity[:, :LATERAL]
    size = np.maximum((v * v).sum(axis=0), np.finfo(float).tiny)
    linear = np.maximum(-(v * force).sum(axis=0) / size, 0.0)
    left = force + linear * v
    noise = left.std(axis=0)
    residual = [
        _process(velocity, left[:, j]) if use and noise[j] > 0.0 else None for j, use in enumerate(processes)
    ]
    return DragModel(linear, (residual[0], residual[1]), noise)


def _process(velocity: Array, left: Array) -> ExactPosterior:
    """A squared exponential in the velocity, trained on a part of the samples, evenly spread."""
    from etude.models.gp.hyperparameters import fit, initial_gp

    chosen, stored = _spread(len(left), FIT_POINTS), _spread(len(left), POINTS)
    start = initial_gp(KERNEL, velocity[chosen], left[chosen], noise_floor=FLOOR * float(left.std()))
    return fit(start, velocity[chosen], left[chosen], steps=STEPS).condition(velocity[stored], left[stored])


def _spread(count: int, most: int) -> Index:
    return np.arange(min(count, most)) * count // min(count, most)
