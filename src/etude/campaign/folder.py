"""Campaign: an opened campaign folder. It knows where things lie and what was committed, nothing else."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude.campaign.config import CampaignConfig
from etude.campaign.config_file import CONFIG, load_config
from etude.campaign.journal import Event, commit, read_events
from etude.campaign.state import State, replay
from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.robots.toml_file import load_robot
from etude.storage import writer_lock

ROBOT = "robot.toml"
WAIT_S = 10.0
"""How long a second writer waits; a `tell` that trains holds the place for longer."""


@dataclass(frozen=True)
class Campaign:
    """A campaign folder with its configuration and robot, both as they were when it was opened.

    Attributes:
        path: the folder.
        config: campaign.toml.
        config_sha256: of campaign.toml's bytes.
        spec: robot.toml.
    """

    path: Path
    config: CampaignConfig
    config_sha256: str
    spec: RobotSpec

    def proposal(self, number: int) -> Path:
        return self.path / "proposals" / f"{number:04d}"

    def run_file(self, number: int) -> Path:
        return self.path / "runs" / f"{number:04d}.parquet"

    def source_file(self, number: int) -> Path:
        return self.path / "runs" / f"{number:04d}.source.toml"

    def model_folder(self, number: int) -> Path:
        return self.path / "models" / f"{number:04d}"

    def events(self) -> list[Event]:
        return read_events(self.path)

    def state(self) -> State:
        """The state that all committed events add up to."""
        return replay(self.events())

    def commit(self, event: str, number: int | None, files: list[Path], **facts: Any) -> None:
        """Appends a fact to the journal; its files are on the disk already. The caller holds the lock."""
        commit(self.path, event, number, self.config_sha256, files, **facts)

    @contextlib.contextmanager
    def writing(self, wait_s: float | None = None) -> Iterator[None]:
        """The one writer's place."""
        with writer_lock(self.path, WAIT_S if wait_s is None else wait_s):
            yield

    def round(self, number: int) -> Any:
        """The round of that number.

        Raises:
            UsageError: nothing of that number was asked for or told.
        """
        rounds = self.state().rounds
        if number not in rounds:
            known = ", ".join(map(str, sorted(rounds))) or "none yet"
            raise UsageError(
                f"there is no trajectory {number}", where=str(self.path), next_step=f"Known: {known}."
            )
        return rounds[number]


def open_campaign(path: Path) -> Campaign:
    """Opens the campaign in `path`.

    Raises:
        UsageError: there is none, its `init` was interrupted, or campaign.toml or robot.toml are impossible.
    """
    path = Path(path)
    config, digest = load_config(path)
    if not any(event.event == "created" for event in read_events(path)):
        raise UsageError(
            "this campaign was not finished being made",
            where=str(path / CONFIG),
            next_step="Run etude init again.",
        )
    spec = load_robot(path / ROBOT)
    if (spec.flight is None) != (config.flight is None):
        raise UsageError(
            "robot.toml and campaign.toml describe different kinds of robot",
            where=str(path / CONFIG),
            next_step='A flying vehicle has kind = "vehicle" in both files.',
        )
    return Campaign(path, config, digest, spec)
