"""The committed results: all seeds of a run in one file, and how a claim looks a figure up."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import DataError
from etude.logs import parquet_frame
from etude.storage import write_atomic
from etude_studies.made import Made
from etude_studies.measured import KEYS
from etude_studies.run_file import FORMAT, parquet_bytes, read_made, read_metadata, read_result, result_path

if TYPE_CHECKING:
    import polars as pl

    from etude_studies.spec import Spec

ORDER = (*KEYS[1:], "k", "seed")
SHORT = 9
"""Digits of a commit that people read."""


def collect(store: Path, runs: Mapping[str, Sequence[Spec]], target: Path) -> dict[str, tuple[Spec, ...]]:
    """Writes `<run>.parquet` into the target for every run: what the store has of its seeds.

    Returns:
        the specs of each run of which the store has no sound result; a run of which it has none at all
        leaves the target as it was.

    Raises:
        UsageError: one seed stands twice in a run.
        EtudeError: the disk is full or refuses.
    """
    missing = {}
    for run, specs in runs.items():
        tables = {}
        for spec in sorted(specs, key=lambda one: one.seed):
            try:
                tables[spec] = read_result(result_path(store, spec), spec)
            except DataError:
                continue
        missing[run] = tuple(spec for spec in specs if spec not in tables)
        if tables:
            made = {spec: read_made(result_path(store, spec)) for spec in tables}
            write_atomic(Path(target) / f"{run}.parquet", _collected(run, tables, made))
    return missing


def _collected(run: str, by_spec: Mapping[Spec, pl.DataFrame], made: Mapping[Spec, Made]) -> bytes:
    import polars as pl

    seeds = [spec.seed for spec in by_spec]
    if len(set(seeds)) < len(seeds):
        raise DataError(f"a seed of {run} stands there twice", next_step="Give every seed one spec.")
    tables = [
        table.select(pl.lit(spec.seed, pl.Int32).alias("seed"), *KEYS, "value")
        for spec, table in by_spec.items()
    ]
    summary = _summary(list(by_spec), [made[spec] for spec in by_spec])
    metadata = {"format": FORMAT, "run": run, "made": json.dumps(summary, sort_keys=True)}
    return parquet_bytes(pl.concat(tables).sort(ORDER), metadata)


def _summary(specs: Sequence[Spec], made: Sequence[Made]) -> dict[str, Any]:
    """What all seeds have in common once, what differs by seed."""
    batches: dict[str, dict[str, Any]] = {}
    for spec, origin in zip(specs, made, strict=True):
        common = {"commit": origin.commit, "versions": origin.versions, "machine": origin.machine}
        batch = batches.setdefault(json.dumps(common, sort_keys=True), {**common, "seeds": []})
        batch["seeds"].append(spec.seed)
    first = specs[0]
    return {
        "function": first.function,
        "settings": first.settings,
        "hashes": {str(spec.seed): spec.hash for spec in specs},
        "commit": _joined(origin.commit for origin in made),
        "versions": {name: _joined(origin.versions[name] for origin in made) for name in made[0].versions},
        "machine": {name: _joined(origin.machine[name] for origin in made) for name in made[0].machine},
        "cpu_s": round(sum(origin.cpu_s for origin in made), 1),
        "wall_s": round(sum(origin.wall_s for origin in made), 1),
        "date": max(origin.date for origin in made),
        "batches": list(batches.values()),
    }


def _joined(values: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(values))


@dataclass(frozen=True)
class Results:
    """All collections of a folder.

    Attributes:
        tables: by run, columns seed, k, test, model, part, measure, value.
        descriptions: by run; see `made`.
    """

    tables: Mapping[str, pl.DataFrame]
    descriptions: Mapping[str, Mapping[str, Any]]
    _parts: dict[str, dict[Any, pl.DataFrame]] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def load(cls, folder: Path) -> Results:
        """Reads every `<run>.parquet`. DataError: one is damaged or of another format."""
        paths = sorted(Path(folder).glob("*.parquet"))
        tables = {path.stem: parquet_frame(path) for path in paths}
        return cls(tables, {path.stem: json.loads(read_metadata(path)["made"]) for path in paths})

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs, sorted."""
        return tuple(self.tables)

    def seeds(self, run: str) -> tuple[int, ...]:
        """Seeds of a run, sorted; none of a run that is not there."""
        if run not in self.tables:
            return ()
        return tuple(self.tables[run]["seed"].unique().sort().to_list())

    def values(
        self, source: str, measure: str, k: int, test: str = "", part: str = "mean"
    ) -> dict[int, float]:
        """One figure of every seed that has it, by seed.

        Args:
            source: "A1", a run's own model, or "A1:linear", another line of that run.
            measure, k, test, part: as in `Measured`.
        """
        import polars as pl

        run, _, model = source.partition(":")
        figures = self._partition(run).get((model, measure, test, part))
        if figures is None:
            return {}
        selected = figures.filter(pl.col("k") == k)
        return dict(zip(selected["seed"].to_list(), selected["value"].to_list(), strict=True))

    def _partition(self, run: str) -> dict[Any, pl.DataFrame]:
        if run not in self._parts and run in self.tables:
            keys = ["model", "measure", "test", "part"]
            self._parts[run] = self.tables[run].partition_by(keys, as_dict=True)
        return self._parts.get(run, {})

    def replaced_by(self, other: Results) -> Results:
        """These, and in the place of a run that `other` has too, that one's."""
        tables = {**self.tables, **other.tables}
        descriptions = {**self.descriptions, **other.descriptions}
        return Results(dict(sorted(tables.items())), dict(sorted(descriptions.items())))

    def made(self, run: str) -> Mapping[str, Any]:
        """Where a run's results come from.

        `commit` and the values of `versions` and `machine` (texts, joined by commas where the seeds differ),
        `cpu_s` and `wall_s` of all seeds together, `date` of the latest, `function`, `settings`, `hashes` by
        seed, `batches` (seeds of the same commit, versions and machine). KeyError: there is no such run.
        """
        return self.descriptions[run]

    def commits(self, run: str) -> str:
        """The commits that made a run's results, by as many digits as people read."""
        return ", ".join(commit[:SHORT] for commit in self.made(run)["commit"].split(", "))
