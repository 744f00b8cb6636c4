"""DesignConfig: what a design maximises and how long it searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from etude import plugins
from etude.errors import UsageError

GROUP = "etude.criteria"
"""Group of the entry points of criteria."""


@dataclass(frozen=True)
class DesignConfig:
    """Options of `solve.design`, the same for every kind of robot.

    Attributes:
        first: the first trajectory: "designed" from the limits alone, or "random".
        reference: motions that replace missing tasks from the second trajectory on: "mixed", half moves
            between random postures and half slow series, like the kind's tests but different motions; or
            "family", random members of the family.
        criterion: a name among `etude.criteria`, or "module:function".
        sampler: of the random candidates. "scaled": each block of the motion enlarged to its limits, every
            fourth candidate with a random amplitude; "uniform": half uniform on the feasible set, half on
            its edge.
        candidates: random candidates that are scored.
        refine: number of the best candidates that are refined by L-BFGS.
        steps: iterations of each refinement.
        points: planned samples along a trajectory; logs are autocorrelated, so about one a second.
        planned_noise: True: each planned sample represents several logged ones and has less noise; False:
            each counts as one sample.
        reference_points: reference states per process.
        random_share: fraction of the reference states from replacement motions although tasks are given.
        inducing: an exact process with more samples is reduced to this many of them; 0: never reduced.
        raw_units: add the commands' variances in their own squared units, as the thesis does.

    Raises:
        UsageError: values out of range, or an unknown criterion.
    """

    criterion: str = "log_ivr"
    sampler: Literal["scaled", "uniform"] = "scaled"
    candidates: int = 24
    refine: int = 2
    steps: int = 15
    points: int = 50
    planned_noise: bool = False
    reference_points: int = 100
    random_share: float = 0.5
    inducing: int = 0
    raw_units: bool = False
    first: Literal["designed", "random"] = "designed"
    reference: Literal["mixed", "family"] = "mixed"

    def __post_init__(self) -> None:
        plugins.require_known(GROUP, self.criterion, "design.criterion")
        for name, choices in WORDS.items():
            value = getattr(self, name)
            if value not in choices:
                raise UsageError(
                    f"{name} is '{choices[0]}' or '{choices[1]}', not {value!r}", where=f"design.{name}"
                )
        for name, least in LEAST_VALUES.items():
            if not getattr(self, name) >= least:
                raise UsageError(
                    f"{name} must be >= {least}, not {getattr(self, name)}", where=f"design.{name}"
                )
        if not 0.0 <= self.random_share <= 1.0:
            raise UsageError(
                f"random_share must be in [0, 1], not {self.random_share}", where="design.random_share"
            )


LEAST_VALUES = {"candidates": 1, "points": 1, "reference_points": 1, "refine": 0, "steps": 0, "inducing": 0}
WORDS = {"sampler": ("scaled", "uniform"), "first": ("designed", "random"), "reference": ("mixed", "family")}
