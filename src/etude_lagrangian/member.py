"""The member that learns all commands of a robot together: one Lagrangian, and additions for each command."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernels import own_friction
from etude.protocols import FitData, KernelFactory
from etude.types import Array, Column, Index
from etude_lagrangian.compilation import first_use
from etude_lagrangian.joints import joints_of
from etude_lagrangian.likelihood import JointHyperparameters, fit_joint, initial_hyperparameters
from etude_lagrangian.prior import JointPrior
from etude_lagrangian.process import JointProcess

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

    def first_use(self) -> str:
        """As `SupportsFirstUse.first_use`."""
        return first_use()

    def restore(self, arrays: Mapping[str, Array]) -> JointProcess:
        """The process whose arrays these are; its predictions are the same bits."""
        words = json.loads(bytes(arrays["words"]))
        columns = tuple((str(c), str(p), str(u), str(o)) for c, p, u, o in words["columns"])
        commands = tuple(words["commands"])
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
        """Trained on the chosen samples, from the last round's if the schedule says so."""
        config = fit.config
        earlier = None if config.schedule == "reinitialise" else fit.start
        known = earlier.at if isinstance(earlier, JointProcess) and earlier.prior == prior else None
        if known is not None and config.schedule in ("constant", "first"):
            return known
        rows = thinned(fit.chosen, FIT_INSTANTS)
        X, counts = fit.X[rows], (fit.usable & fit.moving)[rows]
        used = np.flatnonzero(counts.T)
        y = np.ascontiguousarray(fit.Y[rows].T).ravel()[used]
        floor = np.broadcast_to(fit.floor, (len(fit.commands),)).astype(float)
        fresh, weak = initial_hyperparameters(prior, X, y, used, floor)
        start = fresh if known is None else JointHyperparameters(known.theta, known.log_noise, floor)
        chosen = weak if config.prior == "weak" else None
        return fit_joint(prior, start, chosen, X, y, used, steps=config.steps, method=config.method)


def thinned(rows: Index, most: int) -> Index:
    """At most so many of the rows, evenly spread."""
    return rows if len(rows) <= most else rows[np.arange(most) * len(rows) // most]


all_lin = AllOutputs()
"""With friction: the joint prior that real arms are learned with."""
