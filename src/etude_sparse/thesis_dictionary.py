"""Dictionary of the thesis (2.5, 6.1.1, 6.2): carried from log to log, by its rule without additions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from etude.errors import UsageError
from etude.models.data.fit_data import columns, complete_samples, initial_process, trained_process
from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.process import Posteriors
from etude.protocols import FitData
from etude.types import Index

Rule = Literal["variance", "error"]


def thesis_dictionary(rule: Rule, fit: FitData) -> tuple[ExactGP, Index]:
    """Exact regression on a dictionary of `points` samples that each new trajectory is offered to.

    The first trajectory fills it, evenly spread. The samples of a later one are offered with the
    hyperparameters of the last training. Training then continues on the members (or starts anew, or is left
    out, by the schedule): thesis 6.1.1. The rule is bare: a swap needs no gain, and errors (2.8) count in
    full, so outliers are hoarded and the trained noise is too large. `chosen` and `kept` are not used. With
    several logs to begin with, the later ones are offered together.

    Raises:
        UsageError: several commands: a member is chosen for the errors of one.
    """
    if fit.Y.shape[1] > 1 and rule == "error":
        raise UsageError(
            "the error rule chooses members for one command",
            where="model.process = 'thesis_dictionary_error'",
            next_step="Set model.sharing = 'separate', or use the variance rule.",
        )
    members = _carried(fit)
    first = not len(members)
    if first:
        members = _filled(fit)
        learned = _trained_on(fit, members)
        begun = learned.condition(fit.X[members], columns(fit.Y[members, :1]))
        fit = replace(fit, start=Posteriors((begun,)), config=replace(fit.config, schedule="update"))
    moving = complete_samples(fit)
    new = moving[fit.group[moving] > fit.group[members].max()]
    if len(new):
        # the last training's hyperparameters, whatever the schedule makes of them afterwards
        config = replace(fit.config, schedule="update")
        gp = initial_process(replace(fit, config=config, chosen=members))
        members = _selected(gp, fit, rule, members, new)
    elif first:
        return learned, members
    return _trained_on(fit, members), members


def _trained_on(fit: FitData, members: Index) -> ExactGP:
    """The process trained on the members."""
    return trained_process(replace(fit, chosen=members))


def _carried(fit: FitData) -> Index:
    """Positions of the earlier process's points, as far as they are still among the samples."""
    earlier = fit.start.own[0] if isinstance(fit.start, Posteriors) else None
    points = earlier.X if isinstance(earlier, ExactPosterior) else fit.X[:0]
    moving = complete_samples(fit)
    place = {row.tobytes(): i for i, row in zip(moving, fit.X[moving], strict=True)}
    positions = np.unique([place[row.tobytes()] for row in points if row.tobytes() in place]).astype(np.int64)
    return _spread(positions, fit.config.points)


def _filled(fit: FitData) -> Index:
    """`points` samples of the first trajectory, evenly spread: each so-manieth, thesis 6.2."""
    moving = complete_samples(fit)
    group = fit.group[moving]
    return _spread(moving[group == group.min()], fit.config.points)


def _spread(positions: Index, count: int) -> Index:
    """At most `count` of the positions, evenly spread."""
    count = min(count, len(positions))
    return np.asarray(positions[np.arange(count) * len(positions) // max(count, 1)])


def _selected(gp: ExactGP, fit: FitData, rule: Rule, members: Index, new: Index) -> Index:
    """The members that are left when the new samples have been offered, thesis (2.7) or (2.8)."""
    from etude_sparse.dictionary import DictionaryConfig, DictionaryGP

    config = DictionaryConfig(size=fit.config.points, rule=rule, guard=None, gain=0.0)
    pool = np.concatenate([members, new])  # of later trajectories, so the positions still increase
    y = columns(fit.Y[pool, :1])
    chosen = DictionaryGP(gp, config).select(fit.X[pool], y, start=np.arange(len(members)))
    return np.sort(pool[chosen.kept])
