"""Training data of one group of commands: rows, units, noise floor, kernels, and hyperparameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from etude import plugins
from etude.errors import DataError
from etude.models.config import ModelConfig
from etude.models.process_abilities import HasKernel
from etude.protocols import FitData, Inputs, Process
from etude.types import Array, Column, Index, Mask, Samples

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.hyperparameters import Prior

MANY = 2
"""So many times the inducing inputs samples must be, for what all of them teach to be worth its time."""
LARGEST_FLOOR = 0.1
"""Limit of the noise floor as a part of the command's own deviation: a joint may use little of its range."""
OF_ARMS = ("structured", "standing", "gip_lin")
"""Kernels of an arm's command, with many hyperparameters."""
SCORED_SAMPLES = 600
"""Largest number of samples by which candidates are scored."""
LEAST_FIT = 80
"""Spacings that all trajectories together last at least: an arm's kernel has some 80 hyperparameters for six
joints. Where logs are too short for `fit_spacing_s`, samples for these are taken nearer to each other."""


@dataclass(frozen=True, eq=False)
class Folds:
    """What all structures of one round learn from.

    Attributes:
        samples: by trajectory and time, each once. inputs: of all processes. X: (n, D) of the samples.
        fold: (n,) number of what each sample is held out with. limit: (J,) of the commands.
        config: see `ModelConfig`. commands: names of the J commands.
        held: (J,) commands whose coordinates no log has moved: they answer what else moves. None: none.
        scored: (n,) samples that all candidates are scored by, with or without training samples; None: each
            by what the default is conditioned on.
    """

    samples: Samples
    inputs: Inputs
    X: Array
    fold: Index
    limit: Array
    config: ModelConfig
    commands: tuple[str, ...]
    held: Mask | None = None
    scored: Mask | None = None

    @property
    def score_target(self) -> Array:
        """(n, J) what errors are of."""
        return score_target(self.samples, self.config)

    @property
    def error_mask(self) -> Mask:
        """(n, J) where errors count: at the scored samples, or else at those that teach."""
        samples = self.samples
        if self.scored is None:
            return np.asarray(samples.usable & samples.moving)
        return np.asarray(self.scored[:, None] & np.isfinite(samples.target))

    @property
    def trajectories(self) -> int:
        """How many there are."""
        return len(np.unique(self.samples.group))

    @property
    def numbers(self) -> list[int]:
        """Numbers of the folds, increasing."""
        return [int(number) for number in np.unique(self.fold)]

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """Which commands are learned together."""
        every = tuple(range(len(self.commands)))
        return [every] if self.config.sharing == "shared" else [(j,) for j in every]


@dataclass(frozen=True, eq=False)
class Rows:
    """The samples of a group: those that count, those conditioned on, those for hyperparameters."""

    moving: Index
    kept: Index
    chosen: Index


HEARD = ("state", "command", "plan")
"""Roles of the channels that tell samples apart."""


def in_order(samples: Samples) -> Samples:
    """Sorted by trajectory and time, every sample once: order and repetition of telling change nothing.

    A sample is repeated if its time, states, plans, commands and masks are the same; that of the first
    trajectory stays.
    """
    log = samples.log
    heard = [log.values[n] for n, channel in log.channels.items() if channel.role in HEARD]
    rows = np.column_stack([log.t, *heard, samples.usable, samples.moving]).astype(float) + 0.0  # no -0
    place: dict[bytes, int] = {}
    for i in np.argsort(samples.group, kind="stable").tolist():
        place.setdefault(rows[i].tobytes(), i)
    unique = np.fromiter(place.values(), dtype=np.int64, count=len(place))
    return samples.take(unique[np.lexsort((samples.t[unique], samples.group[unique]))])


def spread_points(
    t: Array, group: Index, use: Mask, count: int, spacing: float, rng: np.random.Generator
) -> Index:
    """At most `count` positions (m,) of samples with `use`, increasing, evenly spread with a random offset.

    Within a trajectory two of them are at least `spacing` seconds apart. A fixed stride over smooth motion
    decorrelates the points; its random offset avoids resonance with the motion's period.
    """
    candidates = np.flatnonzero(use)
    if spacing > 0:
        candidates = candidates[spaced_positions(t[candidates], group[candidates], spacing)]
    if len(candidates) <= count:
        return candidates
    places = (np.arange(count) + rng.uniform()) * (len(candidates) / count)
    return np.asarray(candidates[places.astype(np.int64)])


def score_target(samples: Samples, config: ModelConfig) -> Array:
    """(n, J) commands that errors on samples left out are of: where candidates are stacked, one target."""
    return samples.target if config.stacks else samples.command


def scored_samples(samples: Samples) -> Mask:
    """(n,) at most `SCORED_SAMPLES` samples, evenly spread: more cost time and give no better scores."""
    candidates = np.flatnonzero(np.isfinite(samples.target).any(axis=1))
    mask = np.zeros(len(samples), dtype=np.bool_)
    count = min(len(candidates), SCORED_SAMPLES)
    mask[candidates[np.arange(count) * len(candidates) // max(count, 1)]] = True
    return mask


def seconds_of(samples: Samples) -> float:
    """How long all trajectories last together, pauses included."""
    return float(sum(np.ptp(samples.t[samples.group == number]) for number in np.unique(samples.group)))


def spaced_positions(t: Array, group: Index, spacing: float) -> Index:
    """Positions that keep each trajectory's samples `spacing` apart, greedily from its first one."""
    positions, last_t, last_group = [], -np.inf, None
    for i, (time, number) in enumerate(zip(t.tolist(), group.tolist(), strict=True)):
        # rows of a grid are `spacing` apart only up to rounding
        if number != last_group or time - last_t >= spacing * (1 - 1e-9):
            positions.append(i)
            last_t, last_group = time, number
    return np.array(positions, dtype=np.int64)


def rows_of(folds: Folds, group: tuple[int, ...], rng: np.random.Generator, *, any_of: bool = False) -> Rows:
    """The rows of a group of commands: samples at which each of them, or with `any_of` one, says something.

    Raises:
        DataError: there are fewer than two.
    """
    samples, config, outputs = folds.samples, folds.config, list(group)
    telling = (samples.usable & samples.moving)[:, outputs]
    use: Mask = np.any(telling, axis=1) if any_of else np.all(telling, axis=1)
    if np.count_nonzero(use) < 2:
        raise DataError(
            "the axis hardly moves, so it cannot be learned",
            where=", ".join(folds.commands[j] for j in group),
            next_step="Move it more, or remove it from the robot."
            if len(outputs) == 1
            else "Move all of them, or set model.sharing = 'separate'.",
        )
    many = config.inducing and np.count_nonzero(use) >= MANY * config.inducing
    most = config.inducing if many and config.process == "exact" else config.points
    kept = spread_points(samples.t, samples.group, use, most, 0.0, rng)
    spacing = config.fit_spacing_s
    if config.kernel in OF_ARMS or config.process == "all_lin":
        spacing = min(spacing, seconds_of(samples) / LEAST_FIT)
    usable: Mask = use
    if config.schedule == "first":
        usable = np.asarray(use & (samples.group == samples.group.min()))
    chosen = spread_points(samples.t, samples.group, usable, config.fit_points, spacing, rng)
    return Rows(np.flatnonzero(use), kept, chosen)


def units_of(target: Array, rows: Rows, config: ModelConfig) -> Array:
    """(2, m) offset and factor from a process's outputs to the target (n, m).

    An output that never changes is as uncertain as the others.
    """
    values = target[rows.chosen if config.schedule == "first" else rows.kept]
    offset = values.mean(axis=0)
    if not config.standardised:
        return np.stack([offset, np.ones_like(offset)])
    deviation = values.std(axis=0)
    # the deviation of a constant is rounding: some 1e-16 of its size
    constant = deviation <= 1e-12 * (1.0 + np.abs(values).max(axis=0))
    fallback = float(deviation[~constant].max()) if not constant.all() else 1.0
    return np.stack([offset, np.where(constant, fallback, deviation)])


def floor_of(folds: Folds, group: tuple[int, ...], rows: Rows, units: Array, part: float) -> Array:
    """(m,) least noise deviation in the units of the process, for a floor given as a part."""
    if folds.config.floor_of == "deviation":
        return np.full(len(group), part)
    outputs = list(group)
    largest = LARGEST_FLOOR * folds.samples.command[rows.moving][:, outputs].std(axis=0)
    return np.asarray(np.minimum(part * folds.limit[outputs], largest) / units[1])


def fit_data(
    folds: Folds,
    group: tuple[int, ...],
    rows: Rows,
    Y: Array,
    floor: Array,
    start: Process | None,
    config: ModelConfig,
    rng: np.random.Generator,
) -> FitData:
    """What a member learns the group from; Y (n, m) in the units of the process."""
    outputs, samples = list(group), folds.samples
    names = tuple(folds.commands[j] for j in group)
    return FitData(
        X=folds.X,
        Y=Y,
        usable=samples.usable[:, outputs],
        moving=samples.moving[:, outputs],
        group=samples.group,
        fold=folds.fold,
        chosen=rows.chosen,
        kept=rows.kept,
        columns=folds.inputs.columns,
        commands=names,
        kernels=(kernel_for(config.kernel, folds.inputs.columns, names, folds.X[rows.chosen[:8]]),),
        floor=floor,
        start=start,
        config=config,
        rng=rng,
    )


def kernel_for(name: str, columns: Sequence[Column], commands: tuple[str, ...], X: Array) -> Any:
    """The kernel of that name, for these inputs and commands; a plug-in's is tried at inputs X (n, D).

    Raises:
        UsageError: no such kernel, or one that these inputs have no columns for.
    """
    factory = plugins.load("etude.kernels", name)
    if name in plugins.BUILT_IN["etude.kernels"]:
        return factory(columns, commands)
    from etude.models.gp.plugin_kernel import PluginKernel

    return PluginKernel.of(name, factory, columns, commands).tried(X)


LENGTH_FACTORS = (1.0, 3.0, 1.0 / 3.0, 10.0, 0.1)
"""Starts of a training: half ranges of the inputs as lengths, times these."""


def complete_samples(fit: FitData) -> Index:
    """Positions of the samples at which every command of the group says something."""
    return np.flatnonzero((fit.usable & fit.moving).all(axis=1))


def columns(Y: Array) -> Array:
    """Outputs as trainings take them: (n,) of a single command, else (n, m)."""
    return Y[:, 0].copy() if Y.shape[1] == 1 else Y


def previous_process(fit: FitData) -> Process | None:
    """The last round's process, if training is to go on from it."""
    return None if fit.config.schedule == "reinitialise" else fit.start


def hyperparameters(fit: FitData) -> tuple[Array, float] | None:
    """theta and noise variance to train on from, if the last round's kernel was the same."""
    start = previous_process(fit)
    if start is None:
        return None
    latent = start.latents()[0][0]
    noise = latent.noise_variance
    if not isinstance(latent, HasKernel) or latent.kernel != fit.kernels[0]:
        return None
    return latent.theta, noise


def is_held(fit: FitData) -> bool:
    """Whether the hyperparameters stay as they are: a schedule that keeps them, and there are some."""
    return fit.config.schedule in ("constant", "first") and hyperparameters(fit) is not None


def on_schedule(fit: FitData) -> FitData:
    """The data with what the schedule leaves to do: held hyperparameters come with no steps, no floor; fewer
    steps go on from earlier ones.
    """
    if not is_held(fit):
        warm = fit.config.warm_steps
        if not warm or hyperparameters(fit) is None:
            return fit
        return replace(fit, config=replace(fit.config, steps=warm))
    return replace(fit, config=replace(fit.config, steps=0), floor=np.zeros_like(fit.floor))


def initial_process(fit: FitData) -> ExactGP:
    """The process to train from: the earlier hyperparameters if they fit, else the data's scales."""
    earlier = _earlier_process(fit)
    return _fresh(fit) if earlier is None else earlier


def trained_process(fit: FitData) -> ExactGP:
    """An exact process with the hyperparameters of the chosen samples."""
    config, start = fit.config, initial_process(fit)
    X, y = fit.X[fit.chosen], columns(fit.Y[fit.chosen])
    if y.ndim == 1 and config.starts == 1:
        from etude.models.gp.hyperparameters import fit as fit_one

        return fit_one(start, X, y, method=config.method, steps=config.steps, prior=weak(fit, X, y))
    return start if config.steps == 0 else _shared(fit)


def weak(fit: FitData, X: Array, y: Array) -> Prior | None:
    """The weak prior of these data, if the configuration has one."""
    from etude.models.gp.hyperparameters import weak_prior

    return weak_prior(fit.kernels[0], X, y) if fit.config.prior == "weak" else None


def _fresh(fit: FitData) -> ExactGP:
    from etude.models.gp.hyperparameters import initial_gp

    floor = float(fit.floor.max())
    return initial_gp(fit.kernels[0], fit.X[fit.chosen], telling(fit), noise_floor=floor)


def _earlier_process(fit: FitData) -> ExactGP | None:
    earlier = hyperparameters(fit)
    if earlier is None:
        return None
    from etude.models.gp.exact import ExactGP

    (theta, noise), floor = earlier, float(fit.floor.max())
    learned = max(noise - floor**2, 1e-4 * noise)  # what was found above the floor stays learned noise
    return ExactGP(fit.kernels[0], theta, 0.5 * float(np.log(learned)), floor)


def telling(fit: FitData) -> Array:
    """The chosen outputs that vary, or the first: a constant one says nothing about lengths."""
    Y = fit.Y[fit.chosen]
    if Y.shape[1] == 1:
        return columns(Y)
    varying = np.flatnonzero(Y.std(axis=0) > 0.0)
    return Y[:, varying] if len(varying) else Y[:, :1]


def _shared(fit: FitData) -> ExactGP:
    """Trained from several starts, or for several commands."""
    from etude.models.gp.shared_exact import fit_shared

    config, earlier = fit.config, _earlier_process(fit)
    X, Y = fit.X[fit.chosen], telling(fit)
    Y = Y[:, None] if Y.ndim == 1 else Y
    start, others = earlier, []
    if earlier is None or config.starts > 1:
        start = _fresh(fit)
        lengths = np.array([role == "length" for role in fit.kernels[0].roles()] + [False])
        others = [start.parameters + np.log(f) * lengths for f in LENGTH_FACTORS[1 : config.starts]]
        others += [] if earlier is None else [earlier.parameters]
    assert start is not None
    prior = weak(fit, X, Y)
    return fit_shared(start, X, Y, steps=config.steps, method=config.method, prior=prior, others=others)
