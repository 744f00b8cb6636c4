"""The journal's numbers in the order a learning curve needs them. Nothing is computed but means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.campaign.record.events import Evaluated, Figures, Trained
from etude.campaign.record.rounds import summary
from etude.report.markup import with_unit
from etude.report.record import Record
from etude.types import Array

RUNGS = {
    "gp": "GP",
    "identified": "identified physics",
    "identified+gp": "identified physics + GP",
    "nominal": "nominal model",
    "nominal+gp": "nominal model + GP",
    "linear": "linear regression",
    "linear+gp": "linear regression + GP",
}


def rung_name(rung: object) -> str:
    """A rung of the ladder in words; several, as "gp, identified", one for each command, likewise."""
    parts = [part.strip() for part in str(rung).split(",")]
    return ", ".join(RUNGS.get(part, part) for part in parts)


@dataclass(frozen=True)
class Evaluation:
    """One test of one controller: after which round, at how much robot time, with which error.

    Attributes:
        number: the round whose model was tested; 0 for controllers that need no data.
        seconds: robot time spent so far, s.
        error: mean tracking error of each coordinate, and of the whole, last, where it was measured too.
        unit: of the error.
        axes: how many coordinates there are; what comes after their errors is the distance in space.
    """

    number: int
    seconds: float
    error: Array
    unit: str = "deg"
    axes: int = 0

    @property
    def mean(self) -> float:
        """The figure that stands for it: the mean over coordinates, or the distance in space."""
        return summary(self.error.tolist(), self.axes or len(self.error))

    @property
    def parts(self) -> Array:
        """Of each coordinate."""
        return self.error[: self.axes] if self.axes else self.error

    @property
    def text(self) -> str:
        return with_unit(self.mean, self.unit)


@dataclass(frozen=True)
class Test:
    """All evaluations on one test motion."""

    name: str
    learned: tuple[Evaluation, ...]
    baselines: dict[str, tuple[Evaluation, ...]]

    def baseline(self, name: str) -> Evaluation | None:
        """The newest evaluation of a baseline: an identified one knows all data so far."""
        found = self.baselines.get(name, ())
        return found[-1] if found else None

    @property
    def unit(self) -> str:
        """Of all its errors."""
        found = [*self.learned, *(e for series in self.baselines.values() for e in series)]
        return found[0].unit if found else "deg"


def tests(record: Record) -> tuple[Test, ...]:
    """Every test motion the journal has evaluations of, in the order of their first appearance."""
    runs = [(number, run) for number, run in record.state.evaluated if run.errors]
    names = dict.fromkeys(run.test for _, run in runs)
    axes = len(record.names)
    return tuple(_test(name, [own for own in runs if own[1].test == name], axes) for name in names)


def _test(name: str, runs: Sequence[tuple[int, Evaluated]], axes: int) -> Test:
    found = {
        baseline: _series([own for own in runs if own[1].baseline == baseline], axes)
        for baseline in dict.fromkeys(run.baseline for _, run in runs)
    }
    return Test(name, found.pop("", ()), found)


def _series(runs: Sequence[tuple[int, Evaluated]], axes: int) -> tuple[Evaluation, ...]:
    latest = dict(runs)
    return tuple(
        Evaluation(number, run.robot_seconds, np.array(run.errors), run.unit, axes)
        for number, run in sorted(latest.items(), key=lambda own: own[0])
    )


def robot_seconds(record: Record) -> float:
    """Robot time spent in the whole campaign, s."""
    facts = (e.fact for e in record.events)
    spent = [fact.robot_seconds for fact in facts if isinstance(fact, Trained | Evaluated)]
    return max(spent, default=0.0)


def chosen_rung(trained: Trained | None) -> str | None:
    """The rung that was in use after this training; several, joined, where commands differ."""
    return trained.chosen if trained else None


Quantity = Literal["nmse", "z2", "coverage", "msll", "nmse_all", "z2_all", "coverage_all"]


def score(trained: Trained | None, rung: str | None, quantity: Quantity) -> Array | None:
    """(J,) prequential score of one rung in one training; None if no command has one."""
    values = getattr(trained.score_of(rung or ""), quantity) if trained else ()
    table = _numbers(values)
    return table if np.isfinite(table).any() else None


def held_out(trained: Trained | None) -> dict[str, Array]:
    """(J,) nMSE on held-out blocks of one log for each rung that was scored so; empty if none was."""
    blocks = trained.held_out.nmse if trained and trained.held_out else {}
    scores = {rung: _numbers(values) for rung, values in blocks.items()}
    return {rung: values for rung, values in scores.items() if np.isfinite(values).any()}


def _numbers(values: Figures) -> Array:
    return np.array([np.nan if v is None else v for v in values])


def scored_rungs(record: Record) -> tuple[str, ...]:
    """Every rung with scores anywhere in the journal."""
    return tuple(dict.fromkeys(rung for r in record.state.trained if r.trained for rung in r.trained.models))
