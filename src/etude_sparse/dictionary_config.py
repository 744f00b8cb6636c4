"""DictionaryConfig: how a dictionary chooses its members."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from etude.errors import UsageError


@dataclass(frozen=True)
class DictionaryConfig:
    """How a dictionary chooses.

    Attributes:
        size: members u at most. A candidate costs O(u²), a refresh O(u³).
        rule: "variance", thesis (2.7): a candidate replaces the member that the others determine best, if
            they determine the candidate less; log det (K + d I) then never falls. "error", thesis (2.8): the
            same with the error |y* - y| of the prediction from the others.
        guard: of the error rule, which by itself collects outliers and noise and forgets the rest. A point is
            then worth its latent variance, and up to 1 + guard² times that if its error is large: as far as
            data there could reduce the error, and less again beyond `guard` standard deviations, where it
            is rather an outlier. None is the bare rule of the thesis.
        threshold: a candidate enters only if its deviation (variance rule) or error (error rule) exceeds this
            part of the prior deviation; the thesis's delta_t, for which it gives no number.
        gain: part by which a swap has to raise the score. With 0, the thesis's, members are dragged along the
            trajectory by ever so small gains: more swaps, and a smaller determinant at the end.
        half_life: s (or points, if no times are given) in which a member's score halves, so that old members
            give way although they are informative (the idea of Nguyen-Tuong and Peters 2011; the exponential
            is ours); None keeps them. With it log det may fall.
        refresh_every: replacements after which the inverse is computed anew.
    """

    size: int = 500
    rule: Literal["variance", "error"] = "variance"
    guard: float | None = 3.0
    threshold: float = 0.0
    gain: float = 0.1
    half_life: float | None = None
    refresh_every: int = 500

    def __post_init__(self) -> None:
        if self.rule not in ("variance", "error"):
            raise UsageError("rule must be 'variance' or 'error'", where=f"dictionary.rule = {self.rule!r}")
        for name in ("size", "refresh_every"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be at least 1", where=f"dictionary.{name}")
        for name in ("guard", "half_life"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} must be a positive number or absent", where=f"dictionary.{name}")
        for name in ("threshold", "gain"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise UsageError(f"{name} must be a number >= 0", where=f"dictionary.{name}")
