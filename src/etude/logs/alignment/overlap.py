"""How far a recorded motion deviates from a proposal where both are, and how far it may."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.logs.alignment.starts import Plan
from etude.types import Array

# Root mean square deviation over the proposal's own spread. A weak controller against stiction reaches 0.8 on
# a small motion, other motions of the same kind begin at 0.9; up to 0.5 there is no doubt.
LARGEST_MISMATCH = 0.85
CLEAR_MATCH = 0.5
# Of so few coordinates other motions that repeat themselves fit better by chance, from 0.42 on; in positions
# and rates alike a third as often. Below a mismatch of 0.4 rates are not asked for: noise and a robot that
# leaves out what is quick spoil them first.
FEW, LARGEST_OF_FEW, CLEAR_OF_FEW = 3, 0.7, 0.4
LEAST_COVERAGE = 0.5  # part of the proposal that the log has to contain
STRIDE = 0.01  # of the proposal, over which rates are taken: noise is small beside so long a way


@dataclass(frozen=True)
class Overlap:
    """A motion and what was wanted of it, at the log's times within the proposal.

    Attributes:
        motion, wanted: (n, k).
        pooled: their root mean square deviation over the proposal's spread, in parts of the scale.
        each: (k,) the same of each coordinate.
        rates: the same of their rates, pooled; NaN of too few rows to tell.
    """

    motion: Array
    wanted: Array
    pooled: float
    each: Array
    rates: float

    @staticmethod
    def of(t: Array, measured: Array, plan: Plan) -> Overlap:
        """t: (T,) s of the proposal, at the plan's rate. measured: (T, k)."""
        inside = plan.inside(t)
        motion, wanted = measured[inside], plan.at(t[inside])
        if not inside.any():
            return Overlap(motion, wanted, np.inf, np.full(len(plan.scale), np.inf), np.nan)
        error = np.sqrt((((motion - wanted) / plan.scale) ** 2).mean(axis=0))
        spread = np.maximum((wanted / plan.scale).std(axis=0), 1e-12)
        pooled = float(np.linalg.norm(error) / np.linalg.norm(spread))
        return Overlap(motion, wanted, pooled, error / spread, _rates(motion, wanted, plan))

    @property
    def mismatch(self) -> float:
        """Pooled; of few coordinates, in doubt, the larger of positions' and rates': slow harmonics look
        alike in position.
        """
        doubtful = self.motion.shape[1] <= FEW and self.pooled > CLEAR_OF_FEW
        return float(np.fmax(self.pooled, self.rates)) if doubtful else self.pooled


def allowed(coverage: float, coordinates: int) -> float:
    """The largest mismatch of a log that holds that part of the proposal: a part alone fits by chance."""
    largest = LARGEST_OF_FEW if coordinates <= FEW else LARGEST_MISMATCH
    lacking = min(max((1.0 - coverage) / (1.0 - LEAST_COVERAGE), 0.0), 1.0)
    return largest - (largest - CLEAR_MATCH) * lacking


def _rates(motion: Array, wanted: Array, plan: Plan) -> float:
    """Deviation of the rates of change over a stride, in parts of those that were wanted."""
    rows = max(1, round(STRIDE * plan.duration * plan.rate))
    if len(motion) <= 2 * rows:
        return np.nan
    made, asked = ((values[rows:] - values[:-rows]) / plan.scale for values in (motion, wanted))
    return float(np.linalg.norm(made - asked) / max(float(np.linalg.norm(asked)), 1e-12))
