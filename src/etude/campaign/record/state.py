"""State of a campaign: the replay of the journal's events; no other state exists."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from etude.campaign.record.events import (
    Abandoned,
    Asked,
    Changed,
    Confirmed,
    Created,
    Evaluated,
    Event,
    Ingested,
    MotionSent,
    Promoted,
    RobotMotion,
    RolledBack,
    RunBegan,
    Trained,
    Untold,
)

CHANGED = "changed robot"
"""The check whose red finding makes a log wait for an answer; see `ingest.robot_changed`."""


@dataclass(frozen=True)
class Round:
    """The history of one trajectory.

    Attributes:
        number: 1, 2, ...
        asked: its proposal; None for an unsolicited log.
        ingested: its log; None until it is ingested. ingested_at: time, ISO 8601.
        trained: the training that ended with its log; None until trained. Logs that are ingested together are
            learned together, and the last one has the training. order: of that training, from 1; 0: none.
        learned_with: number of the round whose training included this log; None for its own training, or
            none.
        abandoned: the log will not come, or must not be used.
        untold: the log was taken back.
        excluded: the log shows the robot before or during a change; it is stored and not learned.
        awaits_answer: the log awaits the answer whether the robot has changed.
        runs: logs of a confirmation motion, "without" and "with" the feedforward.
    """

    number: int
    asked: Asked | None = None
    ingested: Ingested | None = None
    ingested_at: str = ""
    trained: Trained | None = None
    order: int = 0
    learned_with: int | None = None
    abandoned: bool = False
    untold: bool = False
    excluded: bool = False
    awaits_answer: bool = False
    runs: Mapping[str, Confirmed] = field(default_factory=dict)

    @property
    def confirms(self) -> bool:
        """Whether it is a confirmation motion, run without and with the feedforward and never learned."""
        return self.asked is not None and self.asked.confirm

    @property
    def weighs(self) -> bool:
        """Whether it is a motion to identify the load at the hand, never learned."""
        return self.asked is not None and self.asked.weighs

    @property
    def teaches(self) -> bool:
        """Whether it was proposed for learning."""
        return self.asked is not None and not self.confirms and not self.weighs

    @property
    def learned(self) -> bool:
        """Whether its log is in the model."""
        return self.trained is not None or self.learned_with is not None

    @property
    def open(self) -> bool:
        """Whether it was proposed and awaits its log."""
        return self.teaches and self.ingested is None and not self.abandoned


@dataclass(frozen=True)
class State:
    """All facts of a campaign.

    Attributes:
        seed: of the campaign.
        rounds: by number.
        evaluated: simulated test runs with the number of the tested model's round, oldest first.
        promoted: promotions in force with the number of the model's round; the deployed one last.
        sent: the motion of the robot that was sent last, if nothing says how it ended.
        driver: of the last `etude run`, as it was named; "" before any.
        events: number of replayed events.
    """

    seed: int = 0
    rounds: dict[int, Round] = field(default_factory=dict)
    evaluated: tuple[tuple[int, Evaluated], ...] = ()
    promoted: tuple[tuple[int, Promoted], ...] = ()
    sent: Event | None = None
    driver: str = ""
    events: int = 0

    @property
    def ingested(self) -> list[Round]:
        """Rounds with a used log, by number."""
        return [
            r
            for _, r in sorted(self.rounds.items())
            if r.ingested is not None and not r.abandoned and not r.excluded
        ]

    @property
    def trained(self) -> list[Round]:
        """Rounds with a training, in the order of learning."""
        done = [r for r in self.rounds.values() if r.trained is not None]
        return sorted(done, key=lambda r: r.order)

    @property
    def newest(self) -> Trained | None:
        """The last training."""
        trained = self.trained
        return trained[-1].trained if trained else None

    @property
    def robot_seconds(self) -> float:
        """Recorded motion of all used logs, s."""
        return float(sum(r.ingested.robot_seconds for r in self.ingested if r.ingested))

    @property
    def learned(self) -> list[Round]:
        """Rounds whose log is in the model, in the order of learning; those learned together, by number."""
        rounds = []
        for last in self.trained:
            others = [r for r in self.rounds.values() if r.learned_with == last.number]
            rounds += sorted([*others, last], key=lambda r: r.number)
        return rounds

    @property
    def awaiting_answer(self) -> list[Round]:
        """Rounds whose log awaits the answer whether the robot has changed."""
        return [r for r in self.ingested if r.awaits_answer]

    @property
    def pending(self) -> list[Round]:
        """Rounds with a log that is not learned yet and awaits no answer."""
        return [r for r in self.ingested if not r.learned and not r.awaits_answer]

    @property
    def proposals(self) -> list[Round]:
        """Open rounds, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.open]

    @property
    def confirmations(self) -> list[Round]:
        """Confirmation motions that were not abandoned, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.confirms and not r.abandoned]

    @property
    def weighings(self) -> list[Round]:
        """Motions to identify the load that were not abandoned, by number."""
        return [r for _, r in sorted(self.rounds.items()) if r.weighs and not r.abandoned]

    @property
    def next_number(self) -> int:
        return max(self.rounds, default=0) + 1

    def round_of_log(self, sha256: str) -> Round | None:
        """The round of a log, by the hash of the original file; None for a new log."""
        rounds = (r for _, r in sorted(self.rounds.items()) if r.ingested and not r.abandoned)
        return next((r for r in rounds if r.ingested and r.ingested.sha256 == sha256), None)


def replay(events: Iterable[Event], state: State | None = None) -> State:
    """The state after the events, from an empty state or a given one.

    A pure function, so live and replayed state cannot differ.
    """
    state = State() if state is None else state
    for event in events:
        state = replace(_apply(state, event), events=state.events + 1)
    return state


def _apply(state: State, event: Event) -> State:
    number = event.number or 0
    match event.fact:
        case Created() as fact:
            return replace(state, seed=fact.seed)
        case Evaluated() as fact:
            return replace(state, evaluated=(*state.evaluated, (number, fact)))
        case Promoted() as fact:
            return replace(state, promoted=(*state.promoted, (number, fact)))
        case RolledBack():
            return replace(state, promoted=state.promoted[:-1])
        case RunBegan() as fact:
            return replace(state, driver=fact.driver)
        case RobotMotion() as fact:  # changes nothing that is known; its log does
            return replace(state, sent=event if isinstance(fact, MotionSent) else None)
    return state if event.number is None else _apply_to_round(state, event, event.number)


def _apply_to_round(state: State, event: Event, number: int) -> State:
    """The state after an event about one trajectory."""
    match event.fact:
        case Abandoned() | Untold():
            state = _drop_trainings(state, [number])
        case Changed() as fact:
            state = _with_answer(state, fact.aside)
        case Trained() as fact:
            state = _with_training(state, number, fact.together)
    old = state.rounds.get(number, Round(number))
    order = 1 + len(state.trained) if isinstance(event.fact, Trained) else 0
    return replace(state, rounds={**state.rounds, number: _next_round(old, event, order)})


def _next_round(old: Round, event: Event, order: int) -> Round:
    """The round after one of its events; order: number of a training, if the event is one."""
    match event.fact:
        case Asked() as fact:
            return replace(old, asked=fact)
        case Ingested() as fact:
            runs, waits = old.runs, _awaits_answer(fact)
            return Round(old.number, old.asked, fact, ingested_at=event.time, awaits_answer=waits, runs=runs)
        case Untold():
            return replace(old, ingested=None, untold=True, excluded=False, awaits_answer=False)
        case Trained() as fact:
            return replace(old, trained=fact, order=order, learned_with=None)
        case Abandoned():
            return replace(old, abandoned=True)
        case Confirmed() as fact:
            return replace(old, runs={**old.runs, fact.run: fact})
    return old


def _awaits_answer(ingested: Ingested) -> bool:
    """Whether the log has the finding that the robot has changed."""
    return any(f.check == CHANGED and f.light == "red" for f in ingested.findings)


def _with_training(state: State, number: int, together: Iterable[int]) -> State:
    """The state after a training, with the logs that were learned together."""
    rounds = dict(state.rounds)
    for other in set(together) - {number}:
        rounds[other] = replace(rounds[other], learned_with=number)
    return replace(state, rounds=rounds)


def _with_answer(state: State, excluded: Sequence[int]) -> State:
    """The state after the answer: no log awaits one, and `excluded` logs are not learned."""
    state = _drop_trainings(state, excluded)
    rounds = {
        n: replace(r, awaits_answer=False, excluded=r.excluded or n in excluded)
        for n, r in state.rounds.items()
    }
    return replace(state, rounds=rounds)


def _drop_trainings(state: State, numbers: Sequence[int]) -> State:
    """The state without the trainings that used the logs of `numbers`; other logs must be learned again."""
    orders = {r.number: r.order for r in state.trained}
    dropped = [state.rounds[n] for n in numbers if n in state.rounds]
    gone = [orders[last] for r in dropped if (last := r.learned_with or r.number) in orders]
    if not gone:
        return state
    lost = {n for n, order in orders.items() if order >= min(gone)}
    rounds = {
        n: replace(
            r,
            trained=None if n in lost else r.trained,
            order=0 if n in lost else r.order,
            learned_with=_none_if_lost(r.learned_with, lost),
        )
        for n, r in state.rounds.items()
    }
    return replace(state, rounds=rounds)


def _none_if_lost(number: int | None, lost: Container[int]) -> int | None:
    return None if number in lost else number
