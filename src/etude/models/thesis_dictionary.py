"""The dictionary as the thesis has it (2.5, 6.1.1, 6.2): carried from log to log, by the bare rule."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.lesson import Lesson, Member, Trained, initial_process, trained_process

Index = NDArray[np.int64]
Rule = Literal["variance", "error"]


def thesis_dictionary(rule: Rule) -> Member:
    """Exact regression on a dictionary of `points` samples that each new trajectory is offered to.

    The first trajectory fills it, evenly spread. The samples of a later one are offered with the
    hyperparameters of the last training, which then goes on (or starts anew, or is left out, as the schedule
    says) on the members themselves: thesis 6.1.1. The rule is bare: a swap needs no gain, and errors (2.8)
    count in full, so outliers are hoarded and the trained noise is too large. `chosen` and `kept` are not
    used. With several logs to begin with, the later ones are offered together.
    """

    def train(lesson: Lesson) -> Trained:
        members = _carried(lesson)
        first = not len(members)
        if first:
            members = _filled(lesson)
            learned = _on(lesson, members)
            begun = learned.condition(lesson.X[members], lesson.y[members])
            lesson = replace(lesson, start=begun, before=begun)
        new = lesson.moving[lesson.group[lesson.moving] > lesson.group[members].max()]
        if len(new):
            gp = initial_process(replace(lesson, start=lesson.before, chosen=members))
            members = _selected(gp, lesson, rule, members, new)
        elif first:
            return Trained(learned.condition, members)
        return Trained(_on(lesson, members).condition, members)

    return train


def _on(lesson: Lesson, members: Index) -> ExactGP:
    """The process trained on the members."""
    return trained_process(replace(lesson, chosen=members))


def _carried(lesson: Lesson) -> Index:
    """Positions of the earlier posterior's points, as far as they are still among the samples."""
    points = lesson.before.X if isinstance(lesson.before, ExactPosterior) else lesson.X[:0]
    place = {row.tobytes(): i for i, row in zip(lesson.moving, lesson.X[lesson.moving], strict=True)}
    found = np.unique([place[row.tobytes()] for row in points if row.tobytes() in place]).astype(np.int64)
    return _spread(found, lesson.points)


def _filled(lesson: Lesson) -> Index:
    """`points` samples of the first trajectory, evenly spread: each so-manieth, thesis 6.2."""
    group = lesson.group[lesson.moving]
    return _spread(lesson.moving[group == group.min()], lesson.points)


def _spread(positions: Index, count: int) -> Index:
    """At most `count` of the positions, evenly spread."""
    count = min(count, len(positions))
    return np.asarray(positions[np.arange(count) * len(positions) // max(count, 1)])


def _selected(gp: ExactGP, lesson: Lesson, rule: Rule, members: Index, new: Index) -> Index:
    """The members that are left when the new samples have been offered, thesis (2.7) or (2.8)."""
    from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP

    config = DictionaryConfig(size=lesson.points, rule=rule, guard=None, gain=0.0)
    pool = np.concatenate([members, new])  # of later trajectories, so the positions still increase
    chosen = DictionaryGP(gp, config).select(lesson.X[pool], lesson.y[pool], start=np.arange(len(members)))
    return np.sort(pool[chosen.kept])
