"""Member that learns all commands of a robot together: one Lagrangian, additions for each command."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import DataError, UsageError
from etude.models.data.fit_data import LEAST_FIT, Folds, Rows, floor_of, seconds_of, spread_points
from etude.models.gp.kernels import own_friction
from etude.protocols import FitData, KernelFactory, Process
from etude.types import Array, Column, Index, Mask
from etude_lagrangian.joint_process import JointProcess
from etude_lagrangian.joints import joints_of
from etude_lagrangian.likelihood import JointHyperparameters, fit_joint, initial_hyperparameters
from etude_lagrangian.prior import JointPrior

INSTANTS = 300
"""Instants that it is conditioned on at most; the commands at all of them make one matrix."""
FIT_INSTANTS = 110
"""Instants for the hyperparameters at most."""


@dataclass(frozen=True)
class AllOutputs:
    """One energy for all commands of an arm, which must be in one unit, with the right signs.

    An entry of a command counts where it is usable and its joint moves; the state of a joint that stands is
    an input all the same.

    Attributes:
        additions: from columns and one command to the kernel of what the energy cannot say.
    """

    additions: KernelFactory = own_friction

    def __call__(self, fit: FitData) -> JointProcess:
        """The process of the group.

        Raises:
            UsageError: the commands are not those of all joints in order, or inputs lack a joint's part.
        """
        prior = self.prior(fit.columns, fit.commands)
        at = self.hyperparameters(prior, fit)
        rows = thinned(fit.kept, INSTANTS)
        return JointProcess(
            prior,
            at,
            fit.X[rows],
            fit.Y[rows],
            (fit.usable & fit.moving)[rows],
            tuple(fit.columns),
            fit.commands,
            fit,
            rows,
        )

    def restore(self, arrays: Mapping[str, Array]) -> JointProcess:
        """The process whose arrays these are; its predictions are the same bits."""
        metadata = json.loads(bytes(arrays["words"]))
        columns = tuple((str(c), str(p), str(u), str(o)) for c, p, u, o in metadata["columns"])
        commands = tuple(metadata["commands"])
        at = JointHyperparameters(arrays["theta"], arrays["log_noise"], arrays["floor"])
        counts = np.asarray(arrays["counts"], dtype=np.bool_)
        prior = self.prior(columns, commands)
        return JointProcess(prior, at, arrays["X"], arrays["Y"], counts, columns, commands)

    def prior(self, columns: Sequence[Column], commands: tuple[str, ...]) -> JointPrior:
        """Of these inputs and commands."""
        joints, names = joints_of(columns)
        if commands != names:
            raise UsageError(
                "one energy for all commands needs the commands of all joints, from base to tip",
                where=f"commands {', '.join(commands)}; joints {', '.join(names)}",
                next_step="Learn every command by itself: kernel = 'gip_lin'.",
            )
        return JointPrior(joints, tuple(self.additions(columns, (name,)) for name in names))

    def hyperparameters(self, prior: JointPrior, fit: FitData) -> JointHyperparameters:
        """Trained on the chosen samples, from the last round's if the schedule requires it."""
        config = fit.config
        earlier = None if config.schedule == "reinitialise" else fit.start
        previous = earlier.at if isinstance(earlier, JointProcess) and earlier.prior == prior else None
        if previous is not None and config.schedule in ("constant", "first"):
            return previous
        rows = thinned(fit.chosen, FIT_INSTANTS)
        X, counts = fit.X[rows], (fit.usable & fit.moving)[rows]
        used = np.flatnonzero(counts.T)
        y = np.ascontiguousarray(fit.Y[rows].T).ravel()[used]
        floor = np.broadcast_to(fit.floor, (len(fit.commands),)).astype(float)
        fresh, weak = initial_hyperparameters(prior, X, y, used, floor)
        start = fresh if previous is None else JointHyperparameters(previous.theta, previous.log_noise, floor)
        chosen = weak if config.prior == "weak" else None
        return fit_joint(prior, start, chosen, X, y, used, steps=config.steps, method=config.method)


def thinned(rows: Index, most: int) -> Index:
    """At most so many of the rows, evenly spread."""
    return rows if len(rows) <= most else rows[np.arange(most) * len(rows) // most]


all_lin = AllOutputs()
"""With friction: the joint prior that real arms are learned with."""


def data_together(
    folds: Folds, floor: float, start: Process | None, rng: np.random.Generator
) -> tuple[FitData, Array]:
    """What a joint member learns all commands from, and the units (2, J) of its outputs.

    Outputs are centred and in the commands' own unit, since they share one energy; uninformative entries are
    there; the member leaves them out one by one.

    Args:
        floor: least noise deviation, a part of each command's limit.

    Raises:
        DataError: a command is never informative.
    """
    samples, config = folds.samples, folds.config
    counts = samples.usable & samples.moving
    silent = [name for name, mask in zip(folds.commands, counts.T, strict=True) if np.count_nonzero(mask) < 2]
    if silent:
        raise DataError(
            "the axis hardly moves, so it cannot be learned",
            where=", ".join(silent),
            next_step="Excite it, or learn each command by itself.",
        )
    t, group = samples.t, samples.group
    use: Mask = np.asarray(counts.any(axis=1))
    kept = spread_points(t, group, use, min(config.points, INSTANTS), 0.0, rng)
    spacing = min(config.fit_spacing_s, seconds_of(samples) / LEAST_FIT)
    chosen = spread_points(t, group, use, min(config.fit_points, FIT_INSTANTS), spacing, rng)
    offset = np.array([samples.command[mask, j].mean() for j, mask in enumerate(counts.T)])
    units = np.stack([offset, np.ones_like(offset)])
    floors = [
        floor_of(folds, (j,), Rows(np.flatnonzero(mask), kept, chosen), units[:, [j]], floor)[0]
        for j, mask in enumerate(counts.T)
    ]
    return FitData(
        X=folds.X,
        Y=samples.command - offset,
        usable=samples.usable,
        moving=samples.moving,
        group=group,
        fold=folds.fold,
        chosen=chosen,
        kept=kept,
        columns=folds.inputs.columns,
        commands=folds.commands,
        kernels=(),
        floor=np.array(floors),
        start=start,
        config=config,
        rng=rng,
    ), units
