"""What a campaign folder holds, as the report reads it; a missing piece is None, never a crash."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from etude.campaign.journal import JOURNAL, Event, read_events
from etude.campaign.state import State, replay
from etude.errors import EtudeError, UsageError
from etude.report.words import FLIGHT_WORDS, JOINT_WORDS, Words

if TYPE_CHECKING:
    from etude.logs.log import RobotLog
    from etude.models.inverse_dynamics import InverseDynamicsModel
    from etude.robots.spec import RobotSpec
    from etude.trajectories.samples import Trajectory

T = TypeVar("T")
Facts = dict[str, Any]


@dataclass(frozen=True)
class Record:
    """A campaign as its files tell it.

    Attributes:
        folder: the campaign's folder.
        events: the journal, oldest first.
        state: what the events add up to.
        spec: the robot, or None if robot.toml cannot be read.
        notes: one sentence for each thing that could not be read.
    """

    folder: Path
    events: tuple[Event, ...]
    state: State
    spec: RobotSpec | None
    notes: list[str]

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names; empty without a robot."""
        return self.spec.names if self.spec else ()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the learned outputs, the joints' or a vehicle's commands; empty without a robot."""
        return self.spec.outputs if self.spec else ()

    @property
    def flying(self) -> bool:
        """Whether it is a vehicle's; the journal tells where robot.toml cannot be read."""
        if self.spec is not None:
            return self.spec.flight is not None
        return any("tracking_error_m" in facts for facts in self.state.evaluated)

    @property
    def words(self) -> Words:
        return FLIGHT_WORDS if self.flying else JOINT_WORDS

    def trajectory(self, number: int) -> Trajectory | None:
        return self.read(f"proposals/{number:04d}/trajectory.json", _trajectory)

    def certificate(self, number: int) -> Facts | None:
        return self.read(f"proposals/{number:04d}/certificate.json", _proof)

    def log(self, number: int) -> RobotLog | None:
        return self.read(f"runs/{number:04d}.parquet", _log)

    def test_log(self, baseline: str | None) -> tuple[Event, RobotLog] | None:
        """The last recorded run of the first test: a baseline's, or the learned controller's (None)."""
        return self.test_run(baseline, _log)

    def test_run(
        self, baseline: str | None, reader: Callable[[Path], T], test: str | None = None
    ) -> tuple[Event, T] | None:
        """The last readable run of a test (None: the first); baseline None is the learned controller."""
        tests = [e for e in self.events if e.event == "evaluated"]
        if not tests:
            return None
        wanted = {"baseline": baseline, "test": test or tests[0].facts.get("test")}
        for event in reversed(tests):
            if all(event.facts.get(name) == value for name, value in wanted.items()):
                for name in event.files:
                    log = self.read(name, reader) if name.endswith(".parquet") else None
                    if log is not None:
                        return event, log
        return None

    def model(self, number: int) -> InverseDynamicsModel | None:
        return self.read(f"models/{number:04d}", _model)

    def read(self, name: str, reader: Callable[[Path], T]) -> T | None:
        """`reader(path)`; None if the file is absent, with a note if it is damaged: the rest still counts."""
        path = self.folder / name
        if not path.exists():
            return None
        try:
            return reader(path)
        except (EtudeError, OSError, ValueError, LookupError, TypeError, RecursionError) as error:
            note = f"{name} could not be read: {error}"
            if note not in self.notes:
                self.notes.append(note)
            return None


def read_record(folder: Path) -> Record:
    """Read a campaign folder.

    Raises:
        UsageError: the folder is not a campaign's, or its journal was edited.
    """
    from etude.robots.toml_file import load_robot

    if not (folder / "campaign.toml").is_file() and not (folder / JOURNAL).is_file():
        raise UsageError(
            "no campaign here: neither campaign.toml nor journal.jsonl",
            where=str(folder),
            next_step="Start one with `etude init FOLDER --robot ROBOT`.",
        )
    notes: list[str] = []
    events = read_events(folder)
    try:
        spec = load_robot(folder / "robot.toml")
    except EtudeError as error:
        spec = None
        notes.append(f"robot.toml could not be read: {error}")
    return Record(folder, tuple(events), replay(events), spec, notes)


def _trajectory(path: Path) -> Trajectory:
    from etude.trajectories.trajectory_file import from_json

    return from_json(path.read_bytes())


def _proof(path: Path) -> Facts:
    value = json.loads(path.read_bytes())
    if not isinstance(value, dict):
        raise ValueError("not a JSON object")
    for row in value.get("rows", ()):
        numbers = [row[name] for name in ("lower", "upper", "proved_lower", "proved_upper", "margin")]
        words = [row[name] for name in ("axis", "quantity", "method")]
        if not all(type(n) in (int, float) for n in numbers) or not all(isinstance(w, str) for w in words):
            raise ValueError("a row is not one of a certificate")
    return value


def _log(path: Path) -> RobotLog:
    from etude.logs.parquet import read_parquet

    return read_parquet(path)


def _model(path: Path) -> InverseDynamicsModel:
    from etude.models.model_file import load_model

    return load_model(path)
