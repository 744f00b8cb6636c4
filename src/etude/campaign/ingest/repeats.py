"""Does a log repeat one that is there? The same motion again makes a model surer, and hardly better."""

from __future__ import annotations

import math

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored import stored_log
from etude.deploy.trajectory_files import PLANNED
from etude.errors import EtudeError
from etude.logs.cleaning.filters import median_rate
from etude.types import Array, Finding, Log

CHECK = "repeats"
NEAR = 0.05
"""Part of the range of a planned position, velocity or acceleration within which a state is there already:
the shortest length that a process of such inputs starts from is five times as long."""
SHARE = 0.8
"""Part of a log's states from which it repeats another."""
COMPARED_HZ = 25.0


def repeated(campaign: Campaign, state: State, number: int, log: Log) -> tuple[int, float] | None:
    """The earlier log that this one repeats most, and which part of it; None if it repeats none.

    Planned states are compared: how well a robot follows makes no other motion. A log without plan is taken
    for another motion.
    """
    own = planned_states(campaign, log)
    if own is None:
        return None
    found: list[tuple[float, int]] = []
    for other in state.told:
        known = None if other.number == number else _stored_states(campaign, other.number)
        if known is not None and known.shape[1] == own.shape[1]:
            found.append((share_within(own, known), other.number))
    share, earlier = max(found, key=lambda pair: (pair[0], -pair[1]), default=(0.0, 0))
    return (earlier, share) if share > SHARE else None


def _stored_states(campaign: Campaign, number: int) -> Array | None:
    """Of a log that was told; None if its file is damaged, which training will say."""
    try:
        return planned_states(campaign, stored_log(campaign, number))
    except EtudeError:
        return None


def share_within(own: Array, known: Array) -> float:
    """Part of the states (n, D) that lie within 1 of one of the known ones (m, D) in every coordinate."""
    from scipy.spatial import cKDTree

    if not len(own) or not len(known):
        return 0.0
    distance, _ = cKDTree(known).query(own, p=math.inf, distance_upper_bound=1.0)
    return float(np.mean(np.isfinite(distance)))


def planned_states(campaign: Campaign, log: Log) -> Array | None:
    """(n, D) planned path and rates while it moves, in parts of what counts as near; None without plan."""
    name = campaign.kind.path + PLANNED
    limits = campaign.kind.expected(campaign.spec).limits
    columns: list[Array] = []
    while name in log:
        values = log[name]
        lower, upper = limits.get(name.removesuffix(PLANNED), (values.min(axis=0), values.max(axis=0)))
        columns.append(values / np.maximum(NEAR * (upper - lower), np.finfo(float).tiny))
        name = next((c.name for c in log.channels.values() if c.derivative_of == name), "")
    if not columns:
        return None
    step = max(1, round(median_rate(log.t) / COMPARED_HZ))
    moving = np.any(np.abs(np.concatenate(columns[1:] or columns, axis=1)) > 0.0, axis=1)
    return np.concatenate(columns, axis=1)[moving][::step]


def warning(earlier: int, share: float) -> Finding:
    """What is said of it."""
    return Finding(
        CHECK,
        "yellow",
        f"it repeats log {earlier}: {100 * share:.0f} % of its planned states were there. "
        "It teaches little, and counts as no new evidence",
        "Run another motion: etude ask proposes one.",
    )
