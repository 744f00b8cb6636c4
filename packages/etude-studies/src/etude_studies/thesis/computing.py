"""Runs with their seeds, and their computation by the engine that the options ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude_studies.engines.choice import open_engine, shard
from etude_studies.engines.progress import progress
from etude_studies.engines.schedule import Report, run_all, shard_of
from etude_studies.spec import Spec
from etude_studies.thesis.catalogue import Run

Say = Callable[[str], None]


@dataclass(frozen=True)
class Chosen:
    """Specs of every run by its name, a seed each."""

    by_run: Mapping[str, Sequence[Spec]]

    @classmethod
    def of(cls, runs: Sequence[Run], first: int, seeds: int | None) -> Chosen:
        """Seeds from `first` on, as many as given or planned. UsageError: none."""
        if seeds is not None and seeds < 1:
            raise UsageError(f"{seeds} seeds are none", where="--seeds", next_step="Give 1 or more.")
        return cls({run.name: run.specs(range(first, first + (seeds or run.seeds))) for run in runs})

    @property
    def specs(self) -> list[Spec]:
        """Seed by seed, so that an end in between leaves whole seeds."""
        longest = max((len(specs_of_run) for specs_of_run in self.by_run.values()), default=0)
        return [
            specs_of_run[i]
            for i in range(longest)
            for specs_of_run in self.by_run.values()
            if i < len(specs_of_run)
        ]

    @property
    def names(self) -> dict[Spec, str]:
        """What people call each."""
        return {
            spec: f"{run} seed {spec.seed}"
            for run, specs_of_run in self.by_run.items()
            for spec in specs_of_run
        }

    def computed(self, store: Path, options: Mapping[str, Any], say: Say) -> Report:
        """As far as the store has no results of them.

        Args:
            options: `workers`, `cluster`, `shard`, `limit_s`.

        Raises:
            UsageError: options that make no sense, a cluster that does not answer.
            EtudeError: the store cannot be written to.
        """
        specs = self.specs
        if options["shard"]:
            specs = shard_of(specs, *shard(options["shard"]))
        opened = open_engine(options["workers"], options["cluster"], options["limit_s"], say)
        with opened as engine, progress() as tell:
            return run_all(specs, store, engine, tell, names=self.names)
