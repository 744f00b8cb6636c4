"""The journal's numbers in the order a learning curve needs them. Nothing is computed but means."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from etude.campaign.record.rounds import summary
from etude.report.markup import with_unit
from etude.report.record import Facts, Record
from etude.types import Array

ERROR = "tracking_error_"
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
    events = [facts for facts in record.state.evaluated if _unit(facts)]
    names = dict.fromkeys(str(e.get("test", "test")) for e in events)
    axes = len(record.names)
    return tuple(
        _test(name, [e for e in events if str(e.get("test", "test")) == name], axes) for name in names
    )


def _test(name: str, events: list[Facts], axes: int) -> Test:
    learned = _series((e for e in events if not e.get("baseline")), axes)
    others = dict.fromkeys(str(e["baseline"]) for e in events if e.get("baseline"))
    return Test(
        name,
        learned,
        {other: _series((e for e in events if e.get("baseline") == other), axes) for other in others},
    )


def _series(events: Iterable[Facts], axes: int) -> tuple[Evaluation, ...]:
    latest = {int(e.get("number") or 0): e for e in events}
    return tuple(
        Evaluation(
            number,
            float(latest[number].get("robot_seconds", 0.0)),
            np.atleast_1d(np.asarray(latest[number][ERROR + _unit(latest[number])], dtype=float)),
            _unit(latest[number]),
            axes,
        )
        for number in sorted(latest)
    )


def _unit(facts: Facts) -> str:
    """Of an evaluation's tracking error; empty if it has none."""
    return next((key.removeprefix(ERROR) for key in facts if key.startswith(ERROR)), "")


def robot_seconds(record: Record) -> float:
    """Robot time spent in the whole campaign, s."""
    spent = [float(e.facts["robot_seconds"]) for e in record.events if e.event in ("trained", "evaluated")]
    return max(spent, default=0.0)


def chosen_rung(event: Facts | None) -> str | None:
    """The rung that was in use after this `trained` event; several, joined, where commands differ."""
    return str(event["chosen"]) if event and event.get("chosen") else None


def score(event: Facts | None, rung: str | None, quantity: str) -> Array | None:
    """(J,) prequential score of one rung in one `trained` event; None if no command has one."""
    models = (event or {}).get("models") or {}
    values = (models.get(rung) or {}).get(quantity)
    if values is None:
        return None
    table = _numbers(values)
    return table if np.isfinite(table).any() else None


def held_out(event: Facts | None) -> dict[str, Array]:
    """(J,) nMSE on held-out blocks of one log for each rung that was scored so; empty if none was."""
    blocks = ((event or {}).get("held_out") or {}).get("nmse") or {}
    scores = {str(rung): _numbers(values) for rung, values in blocks.items()}
    return {rung: values for rung, values in scores.items() if np.isfinite(values).any()}


def _numbers(values: object) -> Array:
    return np.array([np.nan if v is None else float(v) for v in np.atleast_1d(np.asarray(values, object))])


def scored_rungs(record: Record) -> tuple[str, ...]:
    """Every rung with scores anywhere in the journal."""
    return tuple(
        dict.fromkeys(rung for r in record.state.trained for rung in ((r.trained or {}).get("models") or {}))
    )
