"""Prediction of one member of the ensemble for a log: mean, process, and the noise in its variance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.models.gp.kernels import resting
from etude.models.process_abilities import SupportsMeans, SupportsRestNoise
from etude.protocols import Candidate, Mean
from etude.types import Array, Log

PHYSICAL = ("nominal", "identified")
"""Means that go on where no data are, so that a command may fade to them."""


class Means:
    """Predictions of the mean functions for a log, each computed once."""

    def __init__(self, log: Log, *, static: bool = False) -> None:
        self.log, self._static = log, static
        self._predictions: dict[int, Array] = {}

    def of(self, candidate: Candidate) -> Array:
        """(n, m) mean function of a candidate, its process's offset included."""
        offset = np.tile(candidate.units[0], (len(self.log), 1))
        if candidate.mean is None:
            return offset
        return np.asarray(offset + self.alone(candidate.mean, candidate.commands))

    def alone(self, mean: Mean, commands: Sequence[int]) -> Array:
        """(n, m) of a mean function by itself, of those commands."""
        if id(mean) not in self._predictions:
            self._predictions[id(mean)] = mean.static(self.log) if self._static else mean.predict(self.log)
        return self._predictions[id(mean)][:, list(commands)]


def is_physical(candidate: Candidate) -> bool:
    """Whether its mean is physics."""
    return candidate.structure.removesuffix("+gp") in PHYSICAL


def fallback_physics(candidate: Candidate, candidates: Sequence[Candidate], believed: bool) -> Mean | None:
    """What a candidate's commands fade to: its own physics, or else those that the model has beside it.

    A process on the commands themselves may predict best where it was taught. Where it was not it knows
    nothing, gravity not either, while the robot's file or the same data tell it.

    Args:
        candidates: of the model, those of weight 0 too.
        believed: whether the data have enough motion. If not, the robot's file comes before what was
            identified from them: a narrow motion says little of gravity elsewhere.

    Returns:
        None where there are no physics: `level_of`.
    """
    if is_physical(candidate):
        return candidate.mean
    beside = {c.structure: c.mean for c in reversed(candidates) if c.structure in PHYSICAL}
    first, second = ("identified", "nominal") if believed else ("nominal", "identified")
    return beside.get(first, beside.get(second))


def level_of(candidate: Candidate) -> Array:
    """(m,) what is known of a candidate's commands without its process and without physics, command units.

    Their mean in training, less the more they moved about it: o³ / (o² + v) of a mean o and a variance v that
    the process explains. That is the estimate of least squares of a level of which o is one sample, where o²
    stands for the variance of levels. A load that is always there is kept; the mean of gravity over poses,
    which is a guess at the next, is not.
    """
    assert candidate.process is not None
    offset, factor = candidate.units
    moved = factor**2 * candidate.process.signal_variance
    whole = offset**2 + moved
    return np.asarray(offset * offset**2 / np.where(whole > 0.0, whole, 1.0))


def rests_of(candidate: Candidate) -> Sequence[Sequence[tuple[int, float]]]:
    """Of each command the noise at rest that its variance holds, as `kernels.rests`; few members know any."""
    process = candidate.process
    assert process is not None
    rests = process.rests if isinstance(process, SupportsRestNoise) else ()
    return rests or [()] * len(candidate.commands)


def noise_of(candidate: Candidate, X: Array) -> Array:
    """(n, m) noise in a candidate's variance, at rest too, command units²."""
    assert candidate.process is not None
    held = np.stack([resting(pairs, X) for pairs in rests_of(candidate)], axis=1)
    return np.asarray(
        candidate.calibration * candidate.units[1] ** 2 * (candidate.process.noise_variance + held)
    )


def outputs(candidate: Candidate, X: Array) -> Array:
    """(n, m) of a process in command units."""
    process = candidate.process
    assert process is not None
    values = process.mean(X) if isinstance(process, SupportsMeans) else process.predict(X)[0]
    return np.asarray(candidate.units[1] * values)
