"""The journal's numbers in the order a learning curve needs them. Nothing is computed but means."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.report.record import Facts, Record

Array = NDArray[np.float64]

BASELINES = {"pd": "PD alone", "rigid_body": "rigid body", "perfect": "perfect model"}
BASELINE_STYLES = {"pd": "c2", "rigid_body": "c5", "perfect": "c3"}
KINDS = {
    "gp": "GP",
    "identified": "identified rigid body",
    "identified+gp": "rigid body + GP",
    "nominal": "nominal model",
    "linear": "linear regression",
}
TESTS = {"fourier": "a smooth Fourier test motion", "moves": "point-to-point moves"}


def kind_name(kind: object) -> str:
    return KINDS.get(str(kind), str(kind))


@dataclass(frozen=True)
class Evaluation:
    """One test of one controller: after which round, at how much robot time, with which error.

    Attributes:
        number: the round whose model was tested; 0 for controllers that need no data.
        seconds: robot time spent so far, s.
        error: (dof,) mean tracking error, degrees.
    """

    number: int
    seconds: float
    error: Array

    @property
    def mean(self) -> float:
        return float(np.mean(self.error))


@dataclass(frozen=True)
class Test:
    """All evaluations on one test motion."""

    name: str
    learned: tuple[Evaluation, ...]
    baselines: dict[str, tuple[Evaluation, ...]]

    def baseline(self, name: str) -> Evaluation | None:
        """The newest evaluation of a baseline: the rigid body's is identified from all data so far."""
        found = self.baselines.get(name, ())
        return found[-1] if found else None


def tests(record: Record) -> tuple[Test, ...]:
    """Every test motion the journal has evaluations of, in the order of their first appearance."""
    events = [facts for facts in record.state.evaluated if "tracking_error_deg" in facts]
    names = dict.fromkeys(str(e.get("test", "test")) for e in events)
    return tuple(_test(name, [e for e in events if str(e.get("test", "test")) == name]) for name in names)


def _test(name: str, events: list[Facts]) -> Test:
    learned = _series(e for e in events if not e.get("baseline"))
    kinds = dict.fromkeys(str(e["baseline"]) for e in events if e.get("baseline"))
    return Test(
        name, learned, {kind: _series(e for e in events if e.get("baseline") == kind) for kind in kinds}
    )


def _series(events: Iterable[Facts]) -> tuple[Evaluation, ...]:
    latest = {int(e.get("number") or 0): e for e in events}
    return tuple(
        Evaluation(
            number,
            float(latest[number].get("robot_seconds", 0.0)),
            np.atleast_1d(np.asarray(latest[number]["tracking_error_deg"], dtype=float)),
        )
        for number in sorted(latest)
    )


def robot_seconds(record: Record) -> float:
    """Robot time spent in the whole campaign, s."""
    spent = [float(e.facts["robot_seconds"]) for e in record.events if e.event in ("trained", "evaluated")]
    return max(spent, default=0.0)


def chosen_kind(event: Facts | None) -> str | None:
    """The rung of the ladder that was in use after this `trained` event."""
    return str(event["chosen"]) if event and event.get("chosen") else None


def score(event: Facts | None, kind: str | None, quantity: str) -> Array | None:
    """(dof,) prequential score of one kind in one `trained` event; None if no joint has one."""
    models = (event or {}).get("models") or {}
    values = (models.get(kind) or {}).get(quantity)
    if values is None:
        return None
    table = _numbers(values)
    return table if np.isfinite(table).any() else None


def held_out(event: Facts | None) -> dict[str, Array]:
    """(dof,) nMSE on held-out blocks of one log for each model that was scored so; empty if none was."""
    blocks = ((event or {}).get("held_out") or {}).get("nmse") or {}
    scores = {str(kind): _numbers(values) for kind, values in blocks.items()}
    return {kind: values for kind, values in scores.items() if np.isfinite(values).any()}


def _numbers(values: object) -> Array:
    return np.array([np.nan if v is None else float(v) for v in np.atleast_1d(np.asarray(values, object))])


def scored_kinds(record: Record) -> tuple[str, ...]:
    """Every kind of model with scores anywhere in the journal."""
    return tuple(
        dict.fromkeys(kind for r in record.state.trained for kind in ((r.trained or {}).get("models") or {}))
    )
