"""How far runs have left their plans: what room the next ones have to leave."""

from __future__ import annotations

import numpy as np

from etude.campaign.state import State
from etude.contracts import Log, Margins
from etude.deploy.trajectory_files import PLANNED

FACT = "left_plan"
"""Of a `told` event: for each coordinate of the path the largest distance from the plan."""


def distance_from_plan(log: Log, path: str, duration: float) -> list[float] | None:
    """Largest |planned - measured| of each coordinate during the motion; None for a log without either."""
    during = (log.t >= 0.0) & (log.t <= duration)
    if path not in log or path + PLANNED not in log or not during.any():
        return None
    apart = np.abs(log[path] - log[path + PLANNED])[during]
    return [float(size) for size in apart.max(axis=0)]


def measured_margins(state: State, form: str, factor: float) -> Margins:
    """Room for motions of that form: the largest distance from a plan so far, times `factor`.

    The next distance is the largest yet with probability 1/(n + 1) at most, if runs are alike: the confidence
    that n logs give without the factor.
    """
    found = [r.told[FACT] for r in state.told if r.told and r.told.get(FACT)]
    if not found or not factor:
        return {}
    return {form: (factor * np.max(np.array(found), axis=0)[None], len(found) / (len(found) + 1.0))}
