"""What a member of the family learns from, and what it takes over from the last training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from etude.models.contracts import HasKernel, Posterior
from etude.models.guided import guide_of

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.kernels import Kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Schedule = Literal["update", "constant", "reinitialise"]
SCHEDULES: tuple[Schedule, ...] = ("update", "constant", "reinitialise")
"""What becomes of the hyperparameters when there are more data, thesis 6.1: trained on from their values,
kept as first trained, or trained anew from the data's scales."""


@dataclass(frozen=True)
class Lesson:
    """What a member learns one output from, and how long it may train.

    Attributes:
        X, y: (n, D) features and (n,) centred targets of all samples, by trajectory and time.
        group: (n,) number of each sample's trajectory.
        moving: positions of the samples that count; those of a stuck joint are not among them.
        kept: at most `points` of these, evenly spread: what an exact process is conditioned on.
        chosen: fewer of these, far enough apart for the likelihood: what hyperparameters are fitted to.
        kernel: covariance function.
        floor: least noise deviation, units of y.
        start: the earlier posterior of this output to train on from; None to train from the data's scales.
        points: most samples kept. basis: inducing inputs, spectral points or basis points, at most.
        steps, method, prior: of the training, as `training.fit`. rng: of what is drawn.
        before: the earlier posterior, whatever becomes of its hyperparameters.
    """

    X: Array
    y: Array
    group: Index
    moving: Index
    kept: Index
    chosen: Index
    kernel: Kernel
    floor: float
    start: Posterior | None
    points: int
    basis: int
    steps: int
    method: Literal["lbfgs", "minimize"]
    prior: Literal["weak"] | None
    rng: np.random.Generator
    before: Posterior | None = None


@dataclass(frozen=True)
class Trained:
    """A member with its hyperparameters.

    Attributes:
        condition: inputs (n, D) and centred outputs (n,) -> posterior. Called again without each trajectory
            to calibrate the variance, unless the posterior can leave its samples out in closed form.
        taught: positions in the lesson of the samples to condition on.
        guide: for a member without covariances, the process that designs the next motion in its place.
    """

    condition: Callable[[Array, Array], Posterior]
    taught: Index
    guide: Posterior | None = None


Member = Callable[[Lesson], Trained]


def on_schedule(lesson: Lesson, schedule: Schedule) -> Lesson:
    """The lesson with what `schedule` leaves of the earlier posterior; the first one is as it was.

    A member needs to know of no schedule: held hyperparameters come with no steps and no floor.
    """
    lesson = replace(lesson, before=lesson.start)
    if schedule == "reinitialise":
        return replace(lesson, start=None)
    return replace(lesson, steps=0, floor=0.0) if is_held(lesson, schedule) else lesson


def is_held(lesson: Lesson, schedule: Schedule) -> bool:
    """Whether the hyperparameters stay as they are: "constant", and there are earlier ones that fit."""
    return schedule == "constant" and _fitting(lesson) is not None


def _fitting(lesson: Lesson) -> HasKernel | None:
    """The earlier posterior, if it has hyperparameters of the same kernel."""
    start: object = None if lesson.start is None else guide_of(lesson.start)
    if not isinstance(start, HasKernel) or start.kernel != lesson.kernel:
        return None
    return start


def initial_process(lesson: Lesson) -> ExactGP:
    """The process to train from: the earlier hyperparameters if they fit, else the data's scales."""
    from etude.models.gp.training import initial_gp

    gp = initial_gp(lesson.kernel, lesson.X[lesson.chosen], lesson.y[lesson.chosen], noise_floor=lesson.floor)
    earlier, start = _fitting(lesson), lesson.start
    if earlier is None or start is None:
        return gp
    noise = guide_of(start).noise_variance
    learned = max(noise - lesson.floor**2, 1e-4 * noise)
    return gp.with_parameters(np.append(earlier.theta, 0.5 * np.log(learned)))


def trained_process(lesson: Lesson) -> ExactGP:
    """An exact process with the hyperparameters of the chosen samples, which many members borrow."""
    from etude.models.gp.training import fit

    X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
    return fit(initial_process(lesson), X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)
