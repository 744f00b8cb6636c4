"""What a campaign folder holds, as the report reads it; a missing piece is None, never a crash."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from etude.campaign.record.journal import JOURNAL, Event, read_events, recorded
from etude.campaign.record.state import State, replay
from etude.errors import EtudeError, UsageError
from etude.storage import sha256_of

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign
    from etude.protocols import Limit, Model, Trajectory
    from etude.types import Channel, Log

T = TypeVar("T")
Facts = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Record:
    """A campaign as its files tell it.

    Attributes:
        folder: the campaign's folder.
        events: the journal, oldest first.
        state: what the events add up to.
        campaign: its robot and configuration, or None if robot.toml or campaign.toml cannot be read.
        notes: one sentence for each thing that could not be read.
    """

    folder: Path
    events: tuple[Event, ...]
    state: State
    campaign: Campaign | None
    notes: list[str]

    @property
    def robot(self) -> str:
        """Its name; the folder's if robot.toml cannot be read."""
        return self.campaign.spec.name if self.campaign else self.folder.resolve().name

    @cached_property
    def channels(self) -> dict[str, Channel]:
        """By name; empty without a robot."""
        if self.campaign is None:
            return {}
        return {channel.name: channel for channel in self.campaign.kind.channels(self.campaign.spec)}

    @property
    def path(self) -> Channel | None:
        """The channel that follows the trajectory."""
        return self.channels.get(self.campaign.kind.path) if self.campaign else None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates of the path: joints, or x, y, z; empty without a robot."""
        return self.path.parts if self.path else ()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the learned commands; empty without a robot."""
        return self.channels["command"].parts if self.channels else ()

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the learned commands; empty without a robot."""
        return self.channels["command"].units if self.channels else ()

    @property
    def unit(self) -> str:
        """Of the commands where all share one; else nothing."""
        return self.units[0] if len(set(self.units)) == 1 else ""

    @cached_property
    def limits(self) -> Sequence[Limit]:
        """Limits of a plan, as the file of the robot states them."""
        if self.campaign is None:
            return ()
        return tuple(self.campaign.kind.limits(self.campaign.spec, self.campaign.config, None, {}))

    def trajectory(self, number: int) -> Trajectory | None:
        return self.read(f"proposals/{number:04d}/trajectory.json", _trajectory)

    def certificate(self, number: int) -> Facts | None:
        return self.read(f"proposals/{number:04d}/certificate.json", _proof)

    def log(self, number: int) -> Log | None:
        return self.read(f"runs/{number:04d}.parquet", _log)

    def test_run(self, baseline: str | None, test: str | None = None) -> tuple[Event, Log] | None:
        """The last readable run of a test (None: the first); baseline None is the learned controller."""
        tests = [e for e in self.events if e.event == "evaluated"]
        if not tests:
            return None
        wanted = {"baseline": baseline, "test": test or tests[0].facts.get("test")}
        for event in reversed(tests):
            if all(event.facts.get(name) == value for name, value in wanted.items()):
                for name in event.files:
                    log = self.read(name, _log) if name.endswith(".parquet") else None
                    if log is not None:
                        return event, log
        return None

    def model(self, number: int) -> Model | None:
        """The model in use after round `number`."""
        from etude.campaign.record.stored_models import stored_model

        campaign = self.campaign
        if campaign is None:
            return None
        return self.read(f"models/{number:04d}", lambda _: stored_model(campaign, number))

    def read(self, name: str, reader: Callable[[Path], T]) -> T | None:
        """`reader(path)`; None if the file is absent, with a note if it is damaged, or not the one that was
        committed: the rest still counts.
        """
        path = self.folder / name
        if not path.exists():
            return None
        try:
            if path.is_file() and sha256_of(path) != recorded(self.events).get(name):
                raise ValueError("it was changed after it was committed")
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
    from etude.campaign.record.folder import open_campaign

    if not (folder / "campaign.toml").is_file() and not (folder / JOURNAL).is_file():
        raise UsageError(
            "no campaign here: neither campaign.toml nor journal.jsonl",
            where=str(folder),
            next_step="Start one with `etude init FOLDER --robot ROBOT`.",
        )
    notes: list[str] = []
    events = read_events(folder)
    campaign = None
    try:
        campaign = open_campaign(folder)
    except EtudeError as error:
        notes.append(f"the campaign could not be opened: {error}")
    return Record(folder, tuple(events), replay(events), campaign, notes)


def _trajectory(path: Path) -> Trajectory:
    from etude.trajectories.json_text import from_json

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
    for row in value.get("swept", ()):
        if not all(type(row[name]) in (int, float) for name in ("of_range", "of_clear")):
            raise ValueError("a row is not of what a motion sweeps")
    return value


def _log(path: Path) -> Log:
    from etude.logs.readers.log_file import read_log_file

    return read_log_file(path)
