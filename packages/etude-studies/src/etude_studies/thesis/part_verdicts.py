"""The verdict on one part of a claim: its numbers over seeds, and one word by a rule that was fixed before.

A decision needs two tests, the paired t and sign flips; where they disagree, the weaker counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from etude_studies.thesis import statistics
from etude_studies.thesis.contrasts import Contrast
from etude_studies.thesis.ledger_items import Part
from etude_studies.thesis.parts import comparisons, in_logs, margin_of
from etude_studies.thesis.settling import (
    HALF,
    difference_power,
    equivalence_power,
    seeds_for_difference,
    seeds_for_equivalence,
)

HOLDS, REVERSED, TIE = "holds", "reversed", "tie"
UNDECIDED, UNTESTED = "not decided", "cannot be tested here"
DEPENDS = "depends on the reading"
"""Of a claim whose word is another one under a reading that is as good."""
NOT_RUN = "not run yet"
"""How the reason begins of what cannot be tested only because runs are missing."""
WORDS = (UNTESTED, REVERSED, UNDECIDED, TIE, HOLDS)
"""From the worst."""
FAILED = 0.1
"""Share of seeds without a number above which there is no verdict."""
EQUALLY = 0.05
"""Level of two one-sided tests, and of a mean beyond the margin: the 90 % and the 95 % interval."""
SECOND = 2
"""Looks at a claim whose block of extra seeds has been run."""
DIGITS = 6
"""That a verdict keeps, so that another machine's rounding leaves it as it is."""


class PartVerdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Word and numbers of one part, or of one count of trajectories of it.

    Attributes:
        part: its number in the claim, from 0. k: the count of trajectories where each is judged by itself.
        word: one of WORDS. reason: of a part that cannot be tested.
        log: whether estimate, intervals and margin are factors, exp of those of x; else in own units.
        estimate, low, high: mean and plain 95 % interval. narrow_low, narrow_high: 90 %.
        bca_low, bca_high: 95 % by the bootstrap. single_low, single_high: 95 % of a single run.
        sd: over seeds, of x (in logs where `log`).
        wins: seeds on the claimed side, with the 95 % interval of their share. seeds: with a number.
        failed: without. planned: both.
        p, p_permutation: two-sided t and sign flips; adjusted in the family. Of "equal" those
            of the two one-sided tests, which are not adjusted.
        agree: whether both tests say the same.
        level: what p has to be below for its part to be found next, the other parts as they are.
        power: chance that the test finds a true mean of one margin; of "equal", that it finds equality
            where the mean is 0.
        needed: seeds that would settle a part not decided, None if no number would, or a block has been run.
        margin: what still counts as equal, [1/margin, margin] or +-margin.
        printed: the thesis's own number. ordinary: whether it is inside the interval of a single run.
    """

    part: int
    word: str
    k: int | None = None
    reason: str = ""
    log: bool = True
    estimate: float | None = None
    low: float | None = None
    high: float | None = None
    narrow_low: float | None = None
    narrow_high: float | None = None
    bca_low: float | None = None
    bca_high: float | None = None
    single_low: float | None = None
    single_high: float | None = None
    sd: float | None = None
    wins: int = 0
    wins_low: float | None = None
    wins_high: float | None = None
    seeds: int = 0
    failed: int = 0
    planned: int = 0
    p: float | None = None
    p_adjusted: float | None = None
    p_permutation: float | None = None
    p_permutation_adjusted: float | None = None
    agree: bool = True
    level: float | None = None
    power: float | None = None
    needed: int | None = None
    margin: float | None = None
    printed: float | None = None
    ordinary: bool | None = None


@dataclass(frozen=True)
class Weighed:
    """One part with its own p values, and after `corrected` with those of its family.

    Attributes:
        index: number of the part in the claim. contrast: its x. reason: why there is no test, else "".
        looks: 1, or 2 of a block of extra seeds. p, p_permutation: of the whole part, looks and chosen pairs
            taken into account, unadjusted; 1 where there is no test.
        level: of the family. to_meet: what p has to be below to be found next in the family.
    """

    index: int
    part: Part
    contrast: Contrast
    printed: float | None
    reason: str
    looks: int = 1
    p: float = 1.0
    p_permutation: float = 1.0
    p_adjusted: float = 1.0
    p_permutation_adjusted: float = 1.0
    level: float = EQUALLY
    to_meet: float = EQUALLY

    @property
    def x(self) -> NDArray[np.float64]:
        """(n,) in the order of seeds."""
        return np.array([self.contrast.x[seed] for seed in sorted(self.contrast.x)], dtype=np.float64)

    @property
    def directed(self) -> bool:
        """Whether its word rests on the p of its family: "equal" rests on an interval."""
        return self.part.claim != "equal"

    @property
    def times(self) -> int:
        """By how much p is multiplied: looks, and pairs of arms that were chosen among."""
        return self.looks * comparisons(self.part)

    @property
    def power(self) -> float:
        """Of its test, at one margin."""
        n, _, sd = statistics.moments(self.x)
        margin = margin_of(self.part)
        if self.directed:
            return difference_power(n, margin, sd, self.to_meet / self.times)
        return equivalence_power(n, 0.0, sd, margin, EQUALLY / self.times)


def weigh(index: int, part: Part, contrast: Contrast, printed: float | None, looks: int = 1) -> Weighed:
    """The p values of one part, or the reason why there are none."""
    weighed = Weighed(index, part, contrast, printed, untested(contrast), looks)
    if weighed.reason:
        return weighed
    x, margin = weighed.x, margin_of(part)
    if weighed.directed:
        p, flips = statistics.paired_t(x), statistics.sign_flip(x)
    else:
        p, flips = statistics.equivalence(x, margin), statistics.equivalence_flip(x, margin)
    p, flips = min(1.0, weighed.times * p), min(1.0, weighed.times * flips)
    if weighed.directed:
        return replace(weighed, p=p, p_permutation=flips)
    return replace(weighed, p=p, p_permutation=flips, p_adjusted=p, p_permutation_adjusted=flips)


def untested(contrast: Contrast) -> str:
    """Why seeds give no verdict: runs not there, too many seeds failed, a single one; "" if they do."""
    fewest = (1.0 - FAILED) * contrast.planned
    short = {name: n for name, n in contrast.stored.items() if n == 0 or n < fewest - 1e-9}
    if short:
        lacking = (f"{name} ({n} of {contrast.planned} seeds)" if n else name for name, n in short.items())
        return f"{NOT_RUN}: runs {', '.join(lacking)}"
    if len(contrast.x) < fewest - 1e-9:
        return f"{contrast.failed} of {contrast.planned} seeds have no number"
    if len(contrast.x) < 2:
        return "fewer than two seeds have a number"
    return ""


def part_verdict(weighed: Weighed) -> PartVerdict:
    """Word and numbers of a part whose p values have been adjusted."""
    base = PartVerdict(
        part=weighed.index,
        word=UNTESTED,
        k=weighed.contrast.k,
        reason=weighed.reason,
        log=in_logs(weighed.part),
        seeds=len(weighed.contrast.x),
        failed=weighed.contrast.failed,
        planned=weighed.contrast.planned,
        printed=weighed.printed,
    )
    if weighed.reason:
        return base
    word, agree = _directed(weighed) if weighed.directed else _equal(weighed)
    return msgspec.structs.replace(
        base,
        word=word,
        agree=agree,
        needed=_needed(weighed) if word == UNDECIDED and weighed.looks == 1 else None,
        **_numbers(weighed),
        **_wins(weighed),
        **_single(weighed),
    )


def _directed(weighed: Weighed) -> tuple[str, bool]:
    significant = weighed.p_adjusted < weighed.level, weighed.p_permutation_adjusted < weighed.level
    if all(significant):
        claimed = (weighed.x.mean() < 0.0) == (weighed.part.claim == "less")
        return HOLDS if claimed else REVERSED, True
    alike, agree = _alike(weighed)
    # a tie by a test that could hardly find a difference is none
    return (TIE if alike and weighed.power >= HALF else UNDECIDED), not any(significant) and agree


def _equal(weighed: Weighed) -> tuple[str, bool]:
    alike, agree = _alike(weighed)
    if alike:
        return HOLDS, True
    x, margin = weighed.x, margin_of(weighed.part)
    level = EQUALLY / weighed.times
    beyond = statistics.outside(x, margin) < level, statistics.outside_flip(x, margin) < level
    return (REVERSED if all(beyond) else UNDECIDED), agree and beyond[0] == beyond[1]


def _alike(weighed: Weighed) -> tuple[bool, bool]:
    """Whether the mean is within the margin by both tests; whether both say the same."""
    x, margin = weighed.x, margin_of(weighed.part)
    level = EQUALLY / weighed.looks
    within = statistics.equivalence(x, margin) < level, statistics.equivalence_flip(x, margin) < level
    return all(within), within[0] == within[1]


def _needed(weighed: Weighed) -> int | None:
    n, mean, sd = statistics.moments(weighed.x)
    margin, pairs = margin_of(weighed.part), comparisons(weighed.part)
    level = (weighed.to_meet if weighed.directed else EQUALLY) / (SECOND * pairs)
    alike = seeds_for_equivalence(mean, sd, margin, EQUALLY / SECOND)
    if weighed.directed:
        least = seeds_for_difference(margin, sd, level, HALF)
        alike = None if alike is None or least is None else max(alike, least)
        other = seeds_for_difference(mean, sd, level)
    else:
        other = seeds_for_difference(abs(mean) - margin, sd, level) if abs(mean) > margin else None
    counts = [seeds for seeds in (alike, other) if seeds is not None]
    return max(min(counts), n + 1) if counts else None


def _numbers(weighed: Weighed) -> dict[str, float]:
    x, unit = weighed.x, _unit(weighed.part)
    low, high = statistics.interval(x)
    narrow_low, narrow_high = statistics.interval(x, 0.9)
    bca_low, bca_high = statistics.bca(x)
    single_low, single_high = statistics.prediction_interval(x)
    numbers = {
        "estimate": unit(float(x.mean())), "low": unit(low), "high": unit(high),
        "narrow_low": unit(narrow_low), "narrow_high": unit(narrow_high),
        "bca_low": unit(bca_low), "bca_high": unit(bca_high),
        "single_low": unit(single_low), "single_high": unit(single_high),
        "sd": statistics.moments(x)[2], "margin": unit(margin_of(weighed.part)),
        "p": weighed.p, "p_adjusted": weighed.p_adjusted, "level": weighed.to_meet, "power": weighed.power,
        "p_permutation": weighed.p_permutation, "p_permutation_adjusted": weighed.p_permutation_adjusted,
    }  # fmt: skip
    return {name: rounded(value) for name, value in numbers.items()}


def _wins(weighed: Weighed) -> dict[str, float | int]:
    x, margin = weighed.x, margin_of(weighed.part)
    won = {"less": x < 0.0, "more": x > 0.0, "equal": np.abs(x) <= margin}[weighed.part.claim]
    wins = int(np.count_nonzero(won))
    low, high = statistics.wilson(wins, len(x))
    return {"wins": wins, "wins_low": rounded(low), "wins_high": rounded(high)}


def _single(weighed: Weighed) -> dict[str, bool]:
    if weighed.printed is None:
        return {}
    unit, (low, high) = _unit(weighed.part), statistics.prediction_interval(weighed.x)
    return {"ordinary": unit(low) <= weighed.printed <= unit(high)}


def _unit(part: Part) -> Callable[[float], float]:
    return math.exp if in_logs(part) else float


def rounded(value: float) -> float:
    """To DIGITS significant digits."""
    return float(f"{value:.{DIGITS}g}")
