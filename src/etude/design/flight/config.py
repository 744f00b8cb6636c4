"""FlightDesignConfig: what a design of a flight maximises and how long it searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from etude.design.criteria import CRITERIA, NEEDS_IDENTIFIED
from etude.errors import UsageError

FLIGHT_CRITERIA = tuple(name for name in CRITERIA if name not in NEEDS_IDENTIFIED)


@dataclass(frozen=True)
class FlightDesignConfig:
    """Options of `solve.design_flight`.

    Attributes:
        criterion: one of `FLIGHT_CRITERIA`.
        points: planned samples along the flight.
        reference_points: reference states.
        inducing: basis points that stand for the data.
        candidates: random flights scored, half uniform, half on the edge of the feasible set.
        starts: of the solver: half of them the best candidates, half other ones.
        steps: iterations of a whole search.
        method: "gradient", exact; or "finite_differences", as in the thesis, for comparison.
    """

    criterion: str = "log_ivr"
    points: int = 75
    reference_points: int = 300
    inducing: int = 300
    candidates: int = 100
    starts: int = 8
    steps: int = 60
    method: Literal["gradient", "finite_differences"] = "gradient"

    def __post_init__(self) -> None:
        if self.criterion not in FLIGHT_CRITERIA:
            raise UsageError(
                f"there is no criterion {self.criterion!r} for flights; known: {', '.join(FLIGHT_CRITERIA)}"
            )
        if self.method not in ("gradient", "finite_differences"):
            raise UsageError(f"the method is 'gradient' or 'finite_differences', not {self.method!r}")
        for name in ("points", "reference_points", "inducing", "candidates"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be >= 1, not {getattr(self, name)}")
        if not 0 <= self.starts <= self.candidates or self.steps < 0:
            raise UsageError(
                f"starts must be in 0..{self.candidates} and steps >= 0, not {self.starts} and {self.steps}"
            )
