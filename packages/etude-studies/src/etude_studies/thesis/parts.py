"""Statistics of a part of a claim, their power, and the region of equality around 0."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise

import msgspec

from etude.errors import UsageError
from etude_studies.thesis.ledger_items import Part

GROUPS = (
    ("waist", "shoulder", "elbow", "wrist"),
    ("motor1", "motor2", "motor3", "motor4"),
    ("pitch", "yaw", "roll", "thrust"),
)
"""Joints or commands that are compared with each other by "largest" and "smallest"."""
MARGIN, SHARE_MARGIN, RANK_MARGIN, VALUE_MARGIN = 1.15, 0.1, 0.5, 0.1
"""Where a part gives none: a factor; a share of steps; ranks; a part of the bound (of 1 where that is 0)."""
NOT_LOGS = ("rises", "rank")
NEEDS: Mapping[str, tuple[str, ...]] = {
    "ratio": ("a", "b", "at"),
    "ratio_each": ("a", "b", "at"),
    "rises": ("a", "at"),
    "slope": ("a", "at"),
    "value": ("a", "at"),
    "gap": ("a", "b", "at"),
    "shrinks": ("a", "b", "at"),
    "rank": ("a", "at", "among", "bound"),
    "reach": ("a", "b", "at"),
    "spread": ("at", "among"),
    "largest": ("a", "at", "part"),
    "smallest": ("a", "at", "part"),
}
"""By statistic, the fields that may not be empty."""


def check(part: Part) -> None:
    """Raises UsageError for a part that its statistic can do nothing with."""
    where = f"{part.statistic} of {part.a}"
    if part.statistic not in NEEDS:
        statistics = ", ".join(NEEDS)
        raise UsageError(
            f"{part.statistic!r} is no statistic", where=where, next_step=f"Known: {statistics}."
        )
    if part.claim not in ("less", "more", "equal"):
        fact = f"a part claims less, more or equal, not {part.claim!r}"
        raise UsageError(fact, where=where, next_step="Choose one of the three.")
    missing = [name for name in NEEDS[part.statistic] if not getattr(part, name)]
    if missing:
        raise UsageError(f"{' and '.join(missing)} missing", where=where, next_step="Give it in the part.")
    for fact in _wrong(part):
        raise UsageError(fact, where=where, next_step="Correct the part.")
    margin_of(part)


def in_logs(part: Part) -> bool:
    """Whether x is a logarithm, so that exp(x) is a factor."""
    return part.statistic not in NOT_LOGS and (part.statistic != "value" or part.log)


def margin_of(part: Part) -> float:
    """Largest |x| that still counts as equal, in the unit of x.

    A factor is given for logarithms; that of a slope, which is a rate, is spread over the steps of `at`.
    Where x is no logarithm, MARGIN counts as none given: it is what a claims file leaves in the field.

    Raises:
        UsageError: a factor of 1 or less, or a margin of 0 or less.
    """
    stated = part.margin if in_logs(part) or part.margin != MARGIN else None
    margin = stated if stated is not None else _default(part)
    least = 1.0 if in_logs(part) else 0.0
    if not least < margin < math.inf:
        fact = f"a margin of {margin} is not above {least:g}"
        raise UsageError(
            fact, where=f"{part.statistic} of {part.a}", next_step="Give a factor for logarithms."
        )
    if not in_logs(part):
        return margin
    return math.log(margin) / (part.at[-1] - part.at[0] if part.statistic == "slope" else 1)


def comparisons(part: Part) -> int:
    """Pairs of arms among which the statistic chooses the one that it tests."""
    return math.comb(len(part.among), 2) if part.statistic == "spread" else 1


def sources(part: Part) -> tuple[str, ...]:
    """Every source that the part names, each once."""
    named = (part.a, part.b, part.c, part.d, *(part.among or ()))
    return tuple(dict.fromkeys(name for name in named if name))


def run_of(source: str) -> str:
    """The run that a source is in."""
    return source.partition(":")[0]


def exchanged(source: str, replace: Mapping[str, str]) -> str:
    """The source that takes the place of `source`: by its whole name first, else by its run.

    Where another model of a run takes the place of the run's own, the models beside it stay.
    """
    if source in replace:
        return replace[source]
    run, colon, model = source.partition(":")
    other = replace.get(run, run)
    return source if colon and ":" in other else other + colon + model


def read_so(
    part: Part,
    replace: Mapping[str, str],
    tests: Mapping[str, str] | None = None,
    measures: Mapping[str, str] | None = None,
) -> Part:
    """The part with every source, the test and the measure exchanged; itself where that makes two sides one.

    Another model of a run has figures of tests alone, so that it takes no place in other figures.
    """
    replacements = {old: new for old, new in replace.items() if part.test or ":" not in new}
    sides = {name: exchanged(getattr(part, name), replacements) for name in "abcd" if getattr(part, name)}
    among = tuple(exchanged(source, replacements) for source in part.among)
    columns = {
        "test": (tests or {}).get(part.test, part.test),
        "measure": (measures or {}).get(part.measure, part.measure),
    }
    other = msgspec.structs.replace(part, among=among, **columns, **sides)
    return other if len(sources(other)) == len(sources(part)) else part


def _wrong(part: Part) -> Iterable[str]:
    """What else is wrong with a part, in words."""
    at, against = list(part.at), list(part.against or ())
    if at != sorted(set(at)) or against != sorted(set(against)):
        yield "the counts of trajectories do not rise"
    if part.statistic in ("slope", "shrinks", "reach") and len(at) < 2:
        yield "two counts of trajectories or more are needed"
    if part.statistic == "slope" and len(against) == 1:
        yield "two counts of trajectories to compare with are needed"
    if part.statistic == "rises" and not any(after == k + 1 for k, after in pairwise(at)):
        yield "no step from one count of trajectories to the next"
    if part.statistic == "reach" and at and at[0] < 1:
        yield "a reach begins after one trajectory"
    if part.statistic == "rank" and part.a not in (part.among or ()):
        yield "a is not among those it is ranked with"
    if part.statistic == "spread" and len(part.among or ()) < 2:
        yield "a spread needs two sources or more"
    if part.statistic == "gap" and (not part.c) != (not part.d):
        yield "c and d come together"
    needs_bound = part.statistic == "spread" or (part.statistic == "gap" and not part.c)
    if (needs_bound or (part.statistic == "value" and part.log)) and not (part.bound or 0.0) > 0.0:
        yield "a bound above 0 is needed, as its logarithm is taken"
    if part.statistic in ("largest", "smallest") and not any(part.part in group for group in GROUPS):
        yield f"{part.part!r} is neither a joint nor a command"


def parts_read(part: Part) -> tuple[str, ...]:
    """The joints or commands that the statistic reads."""
    if part.statistic not in ("largest", "smallest"):
        return (part.part,)
    return next(group for group in GROUPS if part.part in group)


def _default(part: Part) -> float:
    if part.statistic == "rises":
        return SHARE_MARGIN
    if part.statistic == "rank":
        return RANK_MARGIN
    return MARGIN if in_logs(part) else VALUE_MARGIN * (abs(part.bound or 0.0) or 1.0)
