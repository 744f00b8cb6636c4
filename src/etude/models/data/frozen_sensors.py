"""Sensors that are stuck: a command, or a position that should move, of which every sample is the same."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Mask, Samples

STUCK_S = 3.0
"""s of motion without any change."""
SAME = 1e-9
"""Of the largest value, within which two samples are the same."""
GOES_ON = 0.05
"""Of its own range, that a plan moves while its position does not."""


def stuck(samples: Samples) -> tuple[int, int] | None:
    """The output and the sample at which it was certain; None if nothing is, or positions are not known.

    A command that stays the same while its joint moves; a position that stays the same while its plan moves.
    """
    path = samples.log.channels["command"].acts_on
    if not path or path not in samples.log:
        return None
    found = _first(samples.t, samples.command, samples.moving)
    plan = samples.log.get(f"{path}_des")
    if plan is None or plan.shape != samples.command.shape:
        return found
    held = _first(samples.t, samples.log[path], np.ones_like(samples.moving), plan)
    return min((own for own in (found, held) if own is not None), key=lambda own: own[1], default=None)


def _first(t: Array, values: Array, use: Mask, plan: Array | None = None) -> tuple[int, int] | None:
    """Output and sample of the first stretch that is long enough."""
    earliest: tuple[int, int] | None = None
    for j, column in enumerate(values.T):
        same = np.abs(np.diff(column)) <= SAME * max(float(np.abs(column).max(initial=0.0)), SAME)
        same &= use[1:, j] & use[:-1, j]
        begin = None
        for i, held in enumerate(same.tolist(), start=1):
            begin = (i - 1 if begin is None else begin) if held else None
            if begin is None or t[i] - t[begin] < STUCK_S:
                continue
            if plan is None or np.ptp(plan[begin : i + 1, j]) > GOES_ON * np.ptp(plan[:, j]):
                earliest = (j, i) if earliest is None or i < earliest[1] else earliest
                break
    return earliest
