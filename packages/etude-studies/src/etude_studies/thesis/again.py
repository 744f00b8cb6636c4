"""Comparison of figures that were computed here with the committed ones of the same seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from etude_studies.collected import Results
from etude_studies.measured import KEYS

if TYPE_CHECKING:
    import polars as pl

STEADY = ("error", "mae", "variance", "kernel_rms", "speed", "nearest", "seconds_until")
"""Figures that tables and claims rest on; the others are ranks, densities, or lengths in flat directions."""
SAME = 1e-6
"""Relative; figures are kept in single precision."""
LEAST = 1e-6
"""In a figure's own unit, or less is no difference: simulators converge so far."""


@dataclass(frozen=True)
class Again:
    """One run, computed here and committed.

    Attributes:
        run: its name. seeds: compared. commits: that made the committed ones.
        figures: compared. mean, largest: relative distance of one here from the committed one.
        missing: figures that only one of both has.
    """

    run: str
    seeds: tuple[int, ...]
    commits: str
    figures: int
    mean: float
    largest: float
    missing: int

    @property
    def sentence(self) -> str:
        """What came out, for people."""
        many = f"{len(self.seeds)} seeds" if len(self.seeds) > 1 else f"seed {self.seeds[0]}"
        lacks = f"; {self.missing} that only one of both has" if self.missing else ""
        if self.largest <= SAME:
            return f"{self.run}, {many}: {self.figures} figures, the same as those committed{lacks}"
        return (
            f"{self.run}, {many}: {self.figures} figures, {self.mean:.2%} from those committed "
            f"(by {self.commits}) in the mean, {self.largest:.2%} at most{lacks}"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"figures": self.figures, "mean": self.mean, "largest": self.largest, "missing": self.missing}


def again(run: str, seeds: Sequence[int], here: Results, committed: Results) -> Again | None:
    """The steady figures of some seeds of a run, here and committed; None where nothing is in both."""
    import polars as pl

    shared = sorted({*seeds} & {*here.seeds(run)} & {*committed.seeds(run)})
    if not shared:
        return None
    new, old = (_figures(results, run, shared) for results in (here, committed))
    both = new.join(old, on=["seed", *KEYS], suffix="_kept", how="inner")
    if not len(both):
        return None
    gap = (pl.col("value") - pl.col("value_kept")).abs()
    size = pl.max_horizontal(pl.col("value").abs(), pl.col("value_kept").abs())
    away = both.select(pl.when(gap <= LEAST).then(0.0).otherwise(gap / size)).to_series().to_numpy()
    return Again(
        run=run,
        seeds=tuple(shared),
        commits=committed.commits(run),
        figures=len(both),
        mean=float(away.mean()),
        largest=float(away.max()),
        missing=len(new) + len(old) - 2 * len(both),
    )


def _figures(results: Results, run: str, seeds: Sequence[int]) -> pl.DataFrame:
    import polars as pl

    table = results.tables[run]
    chosen = pl.col("seed").is_in(list(seeds)) & pl.col("measure").is_in(STEADY) & pl.col("value").is_finite()
    return table.filter(chosen).with_columns(pl.col("value").cast(pl.Float64))
