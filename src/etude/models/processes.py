"""The members of the model family by name: how each learns one output. A new member is a row in PROCESSES."""

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
    from etude.models.gp.inducing import Form
    from etude.models.gp.kernels import Kernel
    from etude.models.gp.sparse_spectrum import SparseSpectrumGP

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
        start: an earlier posterior of this output, for a warm start.
        points: most samples kept. basis: inducing inputs, spectral points or basis points, at most.
        steps, method, prior: of the training, as `training.fit`. rng: of what is drawn.
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


def initial_process(lesson: Lesson) -> ExactGP:
    """The process to train from: the earlier hyperparameters if they fit, else the data's scales."""
    from etude.models.gp.training import initial_gp

    gp = initial_gp(lesson.kernel, lesson.X[lesson.chosen], lesson.y[lesson.chosen], noise_floor=lesson.floor)
    start = None if lesson.start is None else guide_of(lesson.start)
    if start is None or not isinstance(start, HasKernel) or start.kernel != lesson.kernel:
        return gp
    learned = max(start.noise_variance - lesson.floor**2, 1e-4 * start.noise_variance)
    return gp.with_parameters(np.append(start.theta, 0.5 * np.log(learned)))


def trained_process(lesson: Lesson) -> ExactGP:
    """An exact process with the hyperparameters of the chosen samples, which many members borrow."""
    from etude.models.gp.training import fit

    X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
    return fit(initial_process(lesson), X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)


def exact(lesson: Lesson) -> Trained:
    """Exact regression on the samples kept: downsampling is in their choice."""
    return Trained(trained_process(lesson).condition, lesson.kept)


def dictionary(rule: Literal["variance", "error"]) -> Member:
    """Exact regression on `points` samples: evenly spread ones, improved by offering every other.

    Hyperparameters come from the chosen samples, not from the members: those of the error rule were picked
    for their errors, and would teach too large a noise.
    """

    def train(lesson: Lesson) -> Trained:
        from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP

        gp = DictionaryGP(trained_process(lesson), DictionaryConfig(size=lesson.points, rule=rule))

        def condition(X: Array, y: Array) -> Posterior:
            count = min(lesson.points, len(y))
            return gp.select(X, y, start=np.arange(count) * len(y) // count).posterior

        return Trained(condition, lesson.moving)

    return train


def ssgp_fixed(lesson: Lesson) -> Trained:
    """A sparse spectrum with the likeliest of 100 draws of its points; starts anew every time."""
    return Trained(_spectrum(lesson).condition, lesson.moving)


def ssgp_learned(lesson: Lesson) -> Trained:
    """A sparse spectrum whose points are learned, until the newest trajectory is predicted no better."""
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum

    X, y, group = (part[lesson.chosen] for part in (lesson.X, lesson.y, lesson.group))
    newest = group == group.max()
    held_out = None if newest.all() else (X[newest], y[newest])
    known = np.ones_like(newest) if held_out is None else ~newest
    gp = fit_sparse_spectrum(
        replace(_spectrum(lesson), learned=True),
        X[known],
        y[known],
        method=lesson.method,
        steps=lesson.steps,
        prior=lesson.prior,
        held_out=held_out,
    )
    return Trained(gp.condition, lesson.moving)


def _spectrum(lesson: Lesson) -> SparseSpectrumGP:
    """Drawn points, and the hyperparameters found with them."""
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum, initial_sparse_spectrum

    X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
    gp = initial_sparse_spectrum(X, y, lesson.basis, lesson.rng, noise_floor=lesson.floor)
    return fit_sparse_spectrum(gp, X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)


def inducing(form: Form) -> Member:
    """`basis` inducing inputs, moved together with the hyperparameters to explain the chosen samples."""

    def train(lesson: Lesson) -> Trained:
        from etude.models.gp.inducing import InducingGP
        from etude.models.gp.inducing_training import fit_inducing, greedy_points

        X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
        gp = initial_process(lesson)
        Z = X[greedy_points(gp.kernel, gp.theta, X, lesson.basis)]
        start = InducingGP(gp.kernel, gp.theta, gp.log_noise, Z, form, lesson.floor)
        trained = fit_inducing(start, X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)
        return Trained(trained.condition, lesson.moving)

    return train


def sogp(lesson: Lesson) -> Trained:
    """The sparse online process, sample by sample through those kept, with an exact process's parameters."""
    from etude.models.gp.sogp import SOGP

    gp = trained_process(lesson)
    online = SOGP(gp.kernel, gp.theta, gp.log_noise, lesson.floor, capacity=lesson.basis)
    return Trained(online.condition, lesson.kept)


def local_gp(lesson: Lesson) -> Trained:
    """Local processes of `points` samples each, with an exact process's parameters; that process guides."""
    from etude.models.gp.local import LocalGP

    gp = trained_process(lesson)
    return Trained(LocalGP(gp, capacity=lesson.points).condition, lesson.moving, _guide(gp, lesson))


def lwpr(lesson: Lesson) -> Trained:
    """Receptive fields on every moving sample; an exact process is trained beside them, to guide."""
    from etude.models.lwpr.regression import LWPR

    member = LWPR(noise_floor=lesson.floor)
    return Trained(member.condition, lesson.moving, _guide(trained_process(lesson), lesson))


def _guide(gp: ExactGP, lesson: Lesson) -> Posterior:
    return gp.condition(lesson.X[lesson.kept], lesson.y[lesson.kept])


PROCESSES: dict[str, Member] = {
    "exact": exact,
    "dictionary_variance": dictionary("variance"),
    "dictionary_error": dictionary("error"),
    "ssgp_fixed": ssgp_fixed,
    "ssgp_learned": ssgp_learned,
    "fitc": inducing("fitc"),
    "vfe": inducing("vfe"),
    "sogp": sogp,
    "local_gp": local_gp,
    "lwpr": lwpr,
}
"""The members by the name that `model.process` gives."""
SPECTRAL = ("ssgp_fixed", "ssgp_learned")
"""Members that stand for the squared exponential kernel alone."""
