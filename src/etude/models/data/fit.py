"""What one group of commands is learned from: rows, units, floors and kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude import plugins
from etude.errors import DataError
from etude.models.config import ModelConfig
from etude.protocols import FitData, Inputs, Process
from etude.types import Array, Column, Index, Mask, Samples

MANY = 2
"""So many times the inducing inputs samples must be, for what all of them teach to be worth its time."""
LARGEST_FLOOR = 0.1
"""Limit of the noise floor as a part of the command's own deviation: a joint may use little of its range."""
OF_ARMS = ("structured", "standing", "gip_lin")
"""Kernels of an arm's command, with many hyperparameters."""
LEAST_FIT = 80
"""Spacings that all trajectories together last at least: an arm's kernel has some 80 hyperparameters for six
joints. Where logs are too short for `fit_spacing_s`, samples for these are taken nearer to each other."""


@dataclass(frozen=True, eq=False)
class Folds:
    """What all rungs of one round learn from.

    Attributes:
        samples: by trajectory and time, each once. inputs: of all processes. X: (n, D) of the samples.
        fold: (n,) number of what each sample is held out with. limit: (J,) of the commands.
        config: see `ModelConfig`. commands: names of the J commands.
    """

    samples: Samples
    inputs: Inputs
    X: Array
    fold: Index
    limit: Array
    config: ModelConfig
    commands: tuple[str, ...]

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

    A sample is told twice if its time, states, plans, commands and masks are the same; that of the first
    trajectory stays.
    """
    log = samples.log
    heard = [log.values[n] for n, channel in log.channels.items() if channel.role in HEARD]
    rows = np.column_stack([log.t, *heard, samples.usable, samples.moving]).astype(float) + 0.0  # no -0
    place: dict[bytes, int] = {}
    for i in np.argsort(samples.group, kind="stable").tolist():
        place.setdefault(rows[i].tobytes(), i)
    kept = np.fromiter(place.values(), dtype=np.int64, count=len(place))
    return samples.take(kept[np.lexsort((samples.t[kept], samples.group[kept]))])


def spread_points(
    t: Array, group: Index, use: Mask, count: int, spacing: float, rng: np.random.Generator
) -> Index:
    """At most `count` positions (m,) of samples with `use`, increasing, evenly spread with a random offset.

    Within a trajectory two of them are at least `spacing` seconds apart. A fixed stride over smooth motion
    decorrelates the points; its random offset avoids resonance with the motion's period.
    """
    candidates = np.flatnonzero(use)
    if spacing > 0:
        candidates = candidates[apart(t[candidates], group[candidates], spacing)]
    if len(candidates) <= count:
        return candidates
    places = (np.arange(count) + rng.uniform()) * (len(candidates) / count)
    return np.asarray(candidates[places.astype(np.int64)])


def seconds_of(samples: Samples) -> float:
    """How long all trajectories last together, pauses included."""
    return float(sum(np.ptp(samples.t[samples.group == number]) for number in np.unique(samples.group)))


def apart(t: Array, group: Index, spacing: float) -> Index:
    """Positions that keep each trajectory's samples `spacing` apart, greedily from its first one."""
    kept, last_t, last_group = [], -np.inf, None
    for i, (time, number) in enumerate(zip(t.tolist(), group.tolist(), strict=True)):
        if number != last_group or time - last_t >= spacing * (1 - 1e-9):
            kept.append(i)
            last_t, last_group = time, number
    return np.array(kept, dtype=np.int64)


def rows_of(folds: Folds, group: tuple[int, ...], rng: np.random.Generator, *, any_of: bool = False) -> Rows:
    """The rows of a group of commands: samples at which each of them, or with `any_of` one, says something.

    Raises:
        DataError: there are fewer than two.
    """
    samples, config, own = folds.samples, folds.config, list(group)
    telling = (samples.usable & samples.moving)[:, own]
    use: Mask = np.any(telling, axis=1) if any_of else np.all(telling, axis=1)
    if np.count_nonzero(use) < 2:
        raise DataError(
            "the axis hardly moves, so nothing of it can be learned",
            where=", ".join(folds.commands[j] for j in group),
            next_step="Excite it, or leave it out of the robot."
            if len(own) == 1
            else "Excite all together, or set model.sharing = 'separate'.",
        )
    many = config.inducing and np.count_nonzero(use) >= MANY * config.inducing
    most = config.inducing if many and config.process == "exact" else config.points
    kept = spread_points(samples.t, samples.group, use, most, 0.0, rng)
    spacing = config.fit_spacing_s
    if config.kernel in OF_ARMS or config.process == "all_lin":
        spacing = min(spacing, seconds_of(samples) / LEAST_FIT)
    told: Mask = use
    if config.schedule == "first":
        told = np.asarray(use & (samples.group == samples.group.min()))
    chosen = spread_points(samples.t, samples.group, told, config.fit_points, spacing, rng)
    return Rows(np.flatnonzero(use), kept, chosen)


def units_of(target: Array, rows: Rows, config: ModelConfig) -> Array:
    """(2, m) offset and factor from a process's outputs to the target (n, m).

    An output that never changes is as uncertain as the others.
    """
    seen = target[rows.chosen if config.schedule == "first" else rows.kept]
    offset = seen.mean(axis=0)
    if not config.standardised:
        return np.stack([offset, np.ones_like(offset)])
    deviation = seen.std(axis=0)
    constant = deviation <= 1e-12 * (1.0 + np.abs(seen).max(axis=0))
    fallback = float(deviation[~constant].max()) if not constant.all() else 1.0
    return np.stack([offset, np.where(constant, fallback, deviation)])


def floor_of(folds: Folds, group: tuple[int, ...], rows: Rows, units: Array, part: float) -> Array:
    """(m,) least noise deviation in the units of the process, for a floor given as a part."""
    if folds.config.floor_of == "deviation":
        return np.full(len(group), part)
    own = list(group)
    largest = LARGEST_FLOOR * folds.samples.command[rows.moving][:, own].std(axis=0)
    return np.asarray(np.minimum(part * folds.limit[own], largest) / units[1])


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
    own, samples = list(group), folds.samples
    names = tuple(folds.commands[j] for j in group)
    return FitData(
        X=folds.X,
        Y=Y,
        usable=samples.usable[:, own],
        moving=samples.moving[:, own],
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
