"""What the journal's events add up to. Replaying them gives the state; there is no other state."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from etude.campaign.record.journal import Event

CHANGED = "changed robot"
"""The check whose red finding makes a log wait for an answer; see `campaign.changed`."""
UNMOVED = "unmoved"
"""Fact of a training: outputs whose joints stood still in all logs."""


@dataclass(frozen=True)
class Round:
    """One trajectory's life.

    Attributes:
        number: 1, 2, ...
        asked: facts of its proposal (seed, criterion value, ...), or None for a foreign log.
        told: facts of its log (sha256, robot seconds, ...), or None while it is awaited.
        trained: scores before the log was learned, which model was chosen; None until trained. Logs that were
            told together are learned together: the last of them has the facts.
        learned_with: number of the round whose training took this log in; None if that is its own, or none.
        abandoned: the log will never come, or must not be used.
        untold: its log was taken back.
        aside: its log is of the robot as it was, or as it was for a while; it is kept and not learned.
        held: its log waits for the answer to whether the robot has changed.
        runs: of a motion that confirms: facts of its logs, "without" and "with" the feedforward.
    """

    number: int
    asked: dict[str, Any] | None = None
    told: dict[str, Any] | None = None
    trained: dict[str, Any] | None = None
    learned_with: int | None = None
    abandoned: bool = False
    untold: bool = False
    aside: bool = False
    held: bool = False
    runs: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def confirms(self) -> bool:
        """It was asked for to be run without and with the feedforward, and is never learned from."""
        return bool(self.asked and self.asked.get("confirm"))

    @property
    def learned(self) -> bool:
        """Its log is in the model."""
        return self.trained is not None or self.learned_with is not None

    @property
    def open(self) -> bool:
        """Asked for, and its log is still awaited."""
        return self.asked is not None and self.told is None and not self.abandoned and not self.confirms


@dataclass(frozen=True)
class State:
    """All facts of a campaign.

    Attributes:
        seed: the campaign's seed.
        rounds: by number.
        evaluated: facts of `evaluated` events, oldest first (simulated campaigns only).
        promoted: facts of the promotions that were not rolled back, the one in use last.
        events: how many events were replayed.
    """

    seed: int = 0
    rounds: dict[int, Round] = field(default_factory=dict)
    evaluated: tuple[dict[str, Any], ...] = ()
    promoted: tuple[dict[str, Any], ...] = ()
    events: int = 0

    @property
    def told(self) -> list[Round]:
        """Rounds with a log that is used, by number."""
        return [
            r
            for _, r in sorted(self.rounds.items())
            if r.told is not None and not r.abandoned and not r.aside
        ]

    @property
    def trained(self) -> list[Round]:
        """Rounds that a training ended with, in the order of learning."""
        done = [r for r in self.rounds.values() if r.trained is not None]
        return sorted(done, key=lambda r: r.trained["order"] if r.trained else 0)

    @property
    def learned(self) -> list[Round]:
        """Rounds whose log is in the model, in the order of learning; those learned together, by number."""
        found = []
        for last in self.trained:
            others = [r for r in self.rounds.values() if r.learned_with == last.number]
            found += sorted([*others, last], key=lambda r: r.number)
        return found

    @property
    def held(self) -> list[Round]:
        """Rounds whose log waits for the answer to whether the robot has changed."""
        return [r for r in self.told if r.held]

    @property
    def pending(self) -> list[Round]:
        """Rounds with a log that no model has learned yet, and that waits for no answer."""
        return [r for r in self.told if not r.learned and not r.held]

    @property
    def proposals(self) -> list[Round]:
        """Open rounds, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.open]

    @property
    def confirmations(self) -> list[Round]:
        """Motions that confirm and were not given up, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.confirms and not r.abandoned]

    @property
    def next_number(self) -> int:
        return max(self.rounds, default=0) + 1

    def round_of_log(self, sha256: str) -> Round | None:
        """The round that this log answered already, by the hash of the original file."""
        known = (r for _, r in sorted(self.rounds.items()) if r.told and not r.abandoned)
        return next((r for r in known if r.told and r.told["sha256"] == sha256), None)


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
    if event.event == "promoted":
        return replace(state, promoted=(*state.promoted, {**facts, "number": event.number}))
    if event.event == "rolled_back":
        return replace(state, promoted=state.promoted[:-1])
    if event.number is None:
        return state
    if event.event in ("abandoned", "untold"):
        state = _without(state, [event.number])
    if event.event == "changed":
        state = _answered(state, [int(n) for n in event.facts.get("aside", ())])
    if event.event == "trained":
        state = _taken_in(state, event.number, event.facts.get("together", ()))
    old = state.rounds.get(event.number, Round(event.number))
    order = 1 + len(state.trained)
    fresh = {"told": facts, "trained": None, "learned_with": None, "held": _is_held(facts)}
    changes: dict[str, dict[str, Any]] = {
        "asked": {"asked": facts},
        "told": {**fresh, "abandoned": False, "untold": False, "aside": False},
        "untold": {"told": None, "untold": True, "aside": False, "held": False},
        "trained": {"trained": {**facts, "order": order}, "learned_with": None},
        "abandoned": {"abandoned": True},
        "exported": {},
        "changed": {},
        "confirmed": {"runs": {**old.runs, str(event.facts.get("run")): facts}},
    }
    return replace(state, rounds={**state.rounds, event.number: replace(old, **changes[event.event])})


def _is_held(told: dict[str, Any]) -> bool:
    """Whether the log was told with the finding that the robot has changed."""
    return any(f["check"] == CHANGED and f["light"] == "red" for f in told.get("findings", ()))


def _taken_in(state: State, number: int, together: Iterable[int]) -> State:
    """The logs that were learned together with the last of them."""
    rounds = dict(state.rounds)
    for other in set(together) - {number}:
        rounds[other] = replace(rounds[other], learned_with=number)
    return replace(state, rounds=rounds)


def _answered(state: State, aside: Sequence[int]) -> State:
    """Nothing waits for an answer any more, and what was put aside is learned no longer."""
    state = _without(state, aside)
    rounds = {n: replace(r, held=False, aside=r.aside or n in aside) for n, r in state.rounds.items()}
    return replace(state, rounds=rounds)


def _without(state: State, numbers: Sequence[int]) -> State:
    """Forgets the trainings that the logs of `numbers` went into; the other logs have to be learned again."""
    orders = {r.number: r.trained["order"] for r in state.trained if r.trained}
    own = [state.rounds[n] for n in numbers if n in state.rounds]
    gone = [orders[last] for r in own if (last := r.learned_with or r.number) in orders]
    if not gone:
        return state
    lost = {n for n, order in orders.items() if order >= min(gone)}
    kept = {
        n: replace(r, trained=None if n in lost else r.trained, learned_with=_unless(r.learned_with, lost))
        for n, r in state.rounds.items()
    }
    return replace(state, rounds=kept)


def _unless(number: int | None, lost: Container[int]) -> int | None:
    return None if number in lost else number
