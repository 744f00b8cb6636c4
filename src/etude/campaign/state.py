"""What the journal's events add up to. Replaying them gives the state; there is no other state."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from etude.campaign.journal import Event


@dataclass(frozen=True)
class Round:
    """One trajectory's life.

    Attributes:
        number: 1, 2, ...
        asked: facts of its proposal (seed, criterion value, ...), or None for a foreign log.
        told: facts of its log (sha256, robot seconds, ...), or None while it is awaited.
        trained: scores before the log was learned, which model was chosen; None until trained.
        abandoned: the log will never come, or must not be used.
    """

    number: int
    asked: dict[str, Any] | None = None
    told: dict[str, Any] | None = None
    trained: dict[str, Any] | None = None
    abandoned: bool = False

    @property
    def open(self) -> bool:
        """Asked for, and its log is still awaited."""
        return self.asked is not None and self.told is None and not self.abandoned


@dataclass(frozen=True)
class State:
    """All facts of a campaign.

    Attributes:
        seed: the campaign's seed.
        rounds: by number.
        evaluated: facts of `evaluated` events, oldest first (simulated campaigns only).
        events: how many events were replayed.
    """

    seed: int = 0
    rounds: dict[int, Round] = field(default_factory=dict)
    evaluated: tuple[dict[str, Any], ...] = ()
    events: int = 0

    @property
    def told(self) -> list[Round]:
        """Rounds with a log that is used, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.told is not None and not r.abandoned]

    @property
    def trained(self) -> list[Round]:
        """Rounds whose log is in the model, in the order of learning."""
        done = [r for r in self.rounds.values() if r.trained is not None]
        return sorted(done, key=lambda r: r.trained["order"] if r.trained else 0)

    @property
    def pending(self) -> list[Round]:
        """Rounds with a log that no model has learned yet: work that was interrupted."""
        return [r for r in self.told if r.trained is None]

    @property
    def proposals(self) -> list[Round]:
        """Open rounds, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.open]

    @property
    def next_number(self) -> int:
        return max(self.rounds, default=0) + 1

    def round_of_log(self, sha256: str) -> Round | None:
        """The round that this log answered already, by the hash of the original file."""
        return next((r for r in self.told if r.told and r.told["sha256"] == sha256), None)


def replay(events: list[Event]) -> State:
    """Folds the events into a state; a pure function, so live and replayed state cannot differ."""
    state = State()
    for event in events:
        state = replace(_apply(state, event), events=state.events + 1)
    return state


def _apply(state: State, event: Event) -> State:
    facts = {**event.facts, "time": event.time}
    if event.event == "created":
        return replace(state, seed=int(event.facts["seed"]))
    if event.event == "evaluated":
        return replace(state, evaluated=(*state.evaluated, {**facts, "number": event.number}))
    if event.number is None:
        return state
    old = state.rounds.get(event.number, Round(event.number))
    if event.event == "abandoned" and old.trained is not None:
        state = _unlearn(state, old.trained["order"])
        old = state.rounds[event.number]
    order = 1 + len(state.trained)
    changes: dict[str, dict[str, Any]] = {
        "asked": {"asked": facts},
        "told": {"told": facts, "trained": None, "abandoned": False},
        "trained": {"trained": {**facts, "order": order}},
        "abandoned": {"abandoned": True},
        "exported": {},
    }
    return replace(state, rounds={**state.rounds, event.number: replace(old, **changes[event.event])})


def _unlearn(state: State, order: int) -> State:
    """Forgets the trainings that a given-up log went into; their logs have to be learned again."""
    kept = {
        n: r if r.trained is None or r.trained["order"] < order else replace(r, trained=None)
        for n, r in state.rounds.items()
    }
    return replace(state, rounds=kept)
