"""etude simulate"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, code_of, opened, table
from etude.errors import typed

if TYPE_CHECKING:
    from pathlib import Path

    from etude.campaign.record.events import Evaluated
    from etude.campaign.record.rounds import SimulatedRound
    from etude.campaign.record.state import State
    from etude.campaign.simulation import Adaptation

BY_AXIS = {"deg": "joints_deg", "m": "xyz_and_distance_m"}
"""What the errors along the axes are called, by their unit."""


@dataclass(frozen=True, kw_only=True)
class Simulate(Common):
    """Run the whole loop with a simulated robot, and test the model after every trajectory.

    Exit code 6: a log waits for an answer, because the robot has changed.
    """

    folder: Folder
    rounds: int = 4
    """Number of trajectories to plan, run and learn."""
    engine: Literal["compiled", "mujoco", ""] = ""
    """Arms: one of two independent implementations of the same physics. Default: compiled; mujoco is
    slower."""
    change: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A change of the robot in these rounds: payload=0.5 (kg), friction=1.5 (factor), sensor_elbow=20 (added
    to that joint's logged command); vehicles: payload, drag, sag, wind. The log that shows the change waits
    for an answer. Can be given several times."""

    control: Literal["feedback", "learned", ""] = ""
    """Control of training motions: feedback alone, or with the learned feedforward from the second motion on,
    as with ask --effort. Default: control in [tracking] of campaign.toml; vehicles always compensate the
    learned drag."""
    online: bool = False
    """Also test each model while it continues to learn, limited by its guard."""
    method: str = "variance"
    """Method for --online: variance, error, ssgp or sogp."""
    confirm: bool = False
    """Then run a motion that is never used for training, without and with the learned feedforward."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.simulation import simulate, simulate_confirmation
        from etude.errors import UsageError

        if self.rounds < 0:
            raise UsageError(f"the number of rounds must be 0 or more, not {self.rounds}")
        rounds: list[SimulatedRound] = []
        campaign = opened(self.folder)
        learning = _learning(self.method) if self.online else None
        change = _changes(self.change)
        feedforward = self.control == "learned" if self.control else None
        for done in simulate(
            campaign, self.rounds, self.engine, say, change, learning, feedforward=feedforward
        ):
            errors = ", ".join(f"{name} {e:.3f} {done.unit}" for name, e in done.mean_errors().items())
            say(f"After {done.robot_seconds:.0f} s of robot time: {errors}.")
            rounds.append(done)
        confirmed = None
        if self.confirm:
            confirmed = simulate_confirmation(campaign, self.engine, say, change)
        state = campaign.state()
        baselines, unit = _baselines(state.evaluated, len(campaign.axes))
        data = {
            "robot": campaign.name,
            "seed": state.seed,
            "rounds": [_figures(done) for done in rounds],
            "baselines": baselines,
            "waiting": [r.number for r in state.awaiting_answer],
            "confirmed": confirmed,
        }
        confirmation = [] if confirmed is None else [_confirmed(confirmed)]
        text = "\n".join([_table(baselines, rounds, unit), *confirmation, _next(self.folder, state)])
        return Outcome(text, data, code_of(changed=bool(state.awaiting_answer)))


def _next(folder: Path, state: State) -> str:
    """Sentence on the next step."""
    if state.awaiting_answer:
        return f"Next: etude tell {typed(folder)} --changed new (or forget, or same)."
    if not state.trained:
        return f"Next: etude simulate {typed(folder)} --rounds 1"
    return f"Next: etude status {typed(folder)}, etude report {typed(folder)}, etude promote {typed(folder)}"


def _confirmed(facts: Mapping[str, Any]) -> str:
    """Table of the errors of both runs of a confirmation motion."""
    from etude.campaign.record.confirmation import SHOWN, in_words

    none = [None] * len(facts["axes"])
    rows = [[name, *map(in_words, facts[key] or none)] for key, name in SHOWN.items()]
    unit = facts["units"][0]
    return table([f"trajectory {facts['number']}, feedforward, {unit}", *facts["axes"]], rows)


def _learning(method: str) -> Adaptation:
    """UsageError: there is no such method."""
    from etude import plugins

    made: Adaptation = plugins.load("etude.adaptations", "online")(method)
    return made


def _changes(entries: Sequence[str]) -> dict[str, float]:
    """Values by name, from name=value. UsageError: an entry is invalid."""
    from etude.errors import UsageError

    changes = {}
    for word in entries:
        name, _, value = word.partition("=")
        try:
            changes[name] = float(value)
        except ValueError:
            raise UsageError(
                f"{word!r} is not a change",
                where="--change",
                next_step="Write name=value, such as friction=1.5.",
            ) from None
    return changes


def _figures(done: SimulatedRound) -> dict[str, Any]:
    return {
        "number": done.number,
        "robot_seconds": done.robot_seconds,
        f"tracking_error_{done.unit}": done.mean_errors(),
        BY_AXIS.get(done.unit, f"axes_{done.unit}"): done.errors,
    }


def _table(baselines: dict[str, dict[str, float]], rounds: Sequence[SimulatedRound], unit: str) -> str:
    rows = [[name, "", *(f"{e:.3f}" for e in errors.values())] for name, errors in baselines.items()]
    rows += [
        [f"after {r.number}", f"{r.robot_seconds:.0f}", *(f"{e:.3f}" for e in r.mean_errors().values())]
        for r in rounds
    ]
    return table([f"tracking error, {unit}", "robot s", *next(iter(baselines.values()), {})], rows)


def _baselines(
    evaluated: Sequence[tuple[int, Evaluated]], axes: int
) -> tuple[dict[str, dict[str, float]], str]:
    """Newest error by baseline and test, and its unit."""
    from etude.campaign.record.events import summary

    errors: dict[str, dict[str, float]] = {}
    unit = ""
    for _, run in evaluated:
        if run.baseline:
            unit = run.unit
            errors.setdefault(run.baseline, {})[run.test] = summary(run.errors, axes)
    return errors, unit
