"""Methods compared over paired seeds by the rule of the thesis's study, for numbers of one's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from etude_studies.thesis.contrasts import Values
from etude_studies.thesis.ledger import Claim, Entry, Ledger, Part
from etude_studies.thesis.ledger_items import Direction
from etude_studies.thesis.part_verdicts import PartVerdict
from etude_studies.thesis.parts import MARGIN
from etude_studies.thesis.verdicts import judge

BySeed = Mapping[int, float]


def compare(
    pairs: Mapping[str, tuple[BySeed, BySeed]], *, claim: Direction = "less", margin: float = MARGIN
) -> dict[str, PartVerdict]:
    """A word with its numbers for each pair of methods; the pairs are corrected together.

    The word is "holds", "reversed", "tie" or "not decided" (docs/decisions/0021-verdicts.md). With it are the
    ratio with its interval, wins, p by the t test and by sign flips, power at the margin, and seeds needed.

    Args:
        pairs: by name a figure of two methods, the same seeds of both: errors above 0. A seed that only one
            of them has counts as failed.
        claim: what is asked of the ratio of the first to the second: "less", "more" or "equal".
        margin: the factor within which they count as equal.

    Raises:
        UsageError: a margin of 1 or less.
    """
    claims = tuple(_claim(place, a, b, claim, margin) for place, (a, b) in enumerate(pairs.values()))
    samples = {
        f"{place}{side}": one
        for place, both in enumerate(pairs.values())
        for side, one in zip("ab", both, strict=True)
    }
    verdicts = judge(Ledger(claims, (), ()), _Given(samples))
    return {name: verdicts[str(place)].parts[0] for place, name in enumerate(pairs)}


def compared_rows(entry: Entry, values: Values) -> dict[str, PartVerdict]:
    """Every other row of an entry over the row that it names, by source: "less" of its last count.

    A row counts the seeds that both have; they are corrected together. Empty where no row is named, and
    without rows that have not been run.
    """
    column = "mean" if "mean" in entry.columns else entry.columns[0]
    figures_by_run = {
        row.run: values.values(row.run, entry.measure, (row.at or entry.at)[-1], entry.test, column)
        for row in entry.rows
    }
    base = figures_by_run.pop(entry.against, {})
    both = {run: sorted({*figures} & {*base}) for run, figures in figures_by_run.items()}
    return compare(
        {
            run: ({seed: figures_by_run[run][seed] for seed in seeds}, {seed: base[seed] for seed in seeds})
            for run, seeds in both.items()
            if seeds
        }
    )


def _claim(place: int, a: BySeed, b: BySeed, claim: Direction, margin: float) -> Claim:
    part = Part("ratio", claim, "figure", a=f"{place}a", b=f"{place}b", at=(0,), margin=margin)
    return Claim(str(place), "", ("",), "own", rests_on=("these",), seeds=len({*a, *b}), parts=(part,))


@dataclass(frozen=True)
class _Given:
    """Numbers by source, whatever else is asked."""

    numbers: Mapping[str, BySeed]

    def values(self, source: str, measure: str, k: int, test: str, part: str) -> BySeed:  # noqa: ARG002
        return self.numbers[source]
