"""DesignConfig: what a design maximises and how long it searches."""

from __future__ import annotations

from dataclasses import dataclass

from etude.design.criteria import CRITERIA
from etude.errors import UsageError


@dataclass(frozen=True)
class DesignConfig:
    """Options of `solve.design`.

    Attributes:
        criterion: a name in `criteria.CRITERIA`.
        candidates: certified random candidates that are scored.
        refine: how many of the best are refined by L-BFGS.
        steps: iterations of each refinement.
        points: planned samples along a trajectory; logs are autocorrelated, so about one a second.
        reference_points: reference states per output.
        random_share: part of the reference states taken from random motions although tasks are given.
        raw_units: add the outputs' variances in their own squared units, as the thesis does.
    """

    criterion: str = "log_ivr"
    candidates: int = 24
    refine: int = 2
    steps: int = 15
    points: int = 50
    reference_points: int = 100
    random_share: float = 0.0
    raw_units: bool = False

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise UsageError(
                f"there is no criterion {self.criterion!r}; known: {', '.join(sorted(CRITERIA))}"
            )
        if min(self.candidates, self.points, self.reference_points) < 1 or min(self.refine, self.steps) < 0:
            raise UsageError("candidates, points and reference points must be >= 1, refine and steps >= 0")
        if not 0.0 <= self.random_share <= 1.0:
            raise UsageError(f"random_share must be in [0, 1], not {self.random_share}")
