"""Campaign folder that is open: `Campaign`, with its paths and committed facts."""

from __future__ import annotations

import contextlib
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude._runtime.trusted_folders import folder_id
from etude.abilities import SupportsStatedLimits
from etude.campaign.record.config import CampaignConfig
from etude.campaign.record.config_file import CONFIG, load_config, trust_command
from etude.campaign.record.events import Created, Event, Fact, Ingested
from etude.campaign.record.journal import JOURNAL, commit, read_events
from etude.campaign.record.state import Round, State, replay
from etude.errors import UsageError
from etude.plugins import named_in
from etude.protocols import Kind, Limit, Model
from etude.storage import sha256_of, writer_lock
from etude.toml_tables import decoded, read_text
from etude.types import Channel, Log, Margins

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture
    from etude.models.learned_model import LearnedModel

ROBOT = "robot.toml"
WAIT_S = 10.0
"""How long a second writer waits; a `tell` that trains holds the place for longer."""
Say = Callable[[str], None]
"""Receives one sentence per step."""


@dataclass
class _Replayed:
    """A state, and the last event that is in it."""

    state: State = field(default_factory=State)
    last: Event | None = None


@dataclass(frozen=True, repr=False)
class Campaign:
    """A campaign folder with its configuration and robot, both as they were when it was opened.

    Attributes:
        path: the folder.
        config: campaign.toml.
        config_sha256: of campaign.toml's bytes. robot_sha256: of robot.toml's.
        kind: of the robot.
        spec: robot.toml, as the kind describes its robots.
    """

    path: Path
    config: CampaignConfig
    config_sha256: str
    kind: Kind
    spec: Any
    robot_sha256: str = ""

    def __repr__(self) -> str:
        state = self.state()
        return (
            f"Campaign {self.path.name!r} of {self.name} ({self.kind.name}): {len(state.ingested)} logs "
            f"ingested, {len(state.learned)} learned, {len(state.proposals)} proposals open"
        )

    def plot(self, path: str | Path | None = None) -> Picture:
        """The learning curve: a notebook shows it; `path` saves it as SVG."""
        from etude._runtime.pictures import picture_of

        return picture_of("campaign", self, path)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return str(self.spec.name)

    @cached_property
    def _replayed(self) -> _Replayed:
        return _Replayed()

    @cached_property
    def models(self) -> dict[str, LearnedModel]:
        """Stored models that were read, by the hash of their file."""
        return {}

    @cached_property
    def logs(self) -> dict[str, Log]:
        """Stored logs that were read, by the hash of their file."""
        return {}

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Channels that a log of this robot may have."""
        return tuple(self.kind.channels(self.spec))

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of the path."""
        return self.channel(self.kind.path).parts

    @property
    def command(self) -> Channel:
        """The learned channel."""
        return next(c for c in self.channels if c.role == "command")

    def channel(self, name: str) -> Channel:
        """The channel of that name."""
        return next(c for c in self.channels if c.name == name)

    def limits(self, margins: Margins | None = None, model: Model | None = None) -> Sequence[Limit]:
        """Limits of every trajectory, less the tracking margins; command limits by the model, if given."""
        return self.kind.limits(self.spec, self.config, model, margins or {})

    def described_limits(self, margins: Margins | None = None, model: Model | None = None) -> Sequence[Limit]:
        """Limits in the robot's description; an open proposal is checked against these."""
        trajectory = self.config.trajectory
        if isinstance(trajectory, SupportsStatedLimits):
            trajectory = trajectory.described
        return self.kind.limits(self.spec, replace(self.config, trajectory=trajectory), model, margins or {})

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
        """The state after all committed events; a repeated call replays new events alone."""
        events, replayed = self.events(), self._replayed
        count = replayed.state.events
        if not (
            0 < count <= len(events) and events[count - 1] is replayed.last
        ):  # the same line, so the same chain
            count, replayed.state = 0, State()
        replayed.state = replay(events[count:], replayed.state)
        replayed.last = events[-1] if events else None
        return replayed.state

    def commit(self, fact: Fact, number: int | None = None, files: Sequence[Path] = ()) -> None:
        """Appends a fact to the journal, with the hashes of robot.toml and campaign.toml.

        The files are already on the disk. The caller holds the lock.
        """
        config, robot = self.config_sha256, self.robot_sha256
        commit(self.path, fact, number, files, config_sha256=config, robot_sha256=robot)

    @contextlib.contextmanager
    def writing(self, wait_s: float | None = None) -> Iterator[None]:
        """Holds the writer's lock."""
        with writer_lock(self.path, WAIT_S if wait_s is None else wait_s):
            yield

    def round(self, number: int) -> Round:
        """The round of that number.

        Raises:
            UsageError: no proposal and no log has that number.
        """
        rounds = self.state().rounds
        if number not in rounds:
            numbers = ", ".join(map(str, sorted(rounds))) or "none yet"
            raise UsageError(
                f"there is no trajectory {number}", where=str(self.path), next_step=f"Known: {numbers}."
            )
        return rounds[number]


REFUSED = ("Cc", "Cs", "Zl", "Zp")
"""Categories of Unicode: control characters, halves of pairs, ends of lines and of paragraphs."""
TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""What turns the direction of writing, so that a name is shown as another."""


def require_plain(names: Iterable[str], where: str) -> None:
    """Raises UsageError if a name is empty, begins or ends with a blank, or has characters that cannot be
    printed.
    """
    for name in names:
        bad = [c for c in name if unicodedata.category(c) in REFUSED or c in TURNING]
        if bad:
            fault = f"holds {unicodedata.name(bad[0], f'U+{ord(bad[0]):04X}')}, which is not printable"
        elif name != name.strip() or not name:
            fault = "is empty, or begins or ends with a space"
        else:
            continue
        raise UsageError(
            f"the name {name!r} {fault}",
            where=where,
            next_step="Rename it in the robot's file, because names are headers of tables.",
        )


def names_of(table: Any) -> list[str]:
    """Every `name` in the tables of a robot.toml."""
    if isinstance(table, Mapping):
        names = [value for key, value in table.items() if key == "name" and isinstance(value, str)]
        return [*names, *(name for value in table.values() for name in names_of(value))]
    if isinstance(table, Sequence) and not isinstance(table, str | bytes):
        return [name for value in table for name in names_of(value)]
    return []


def open_campaign(path: Path) -> Campaign:
    """Opens the campaign in `path`.

    Raises:
        UsageError: the folder holds no campaign, its `init` was interrupted, or robot.toml or campaign.toml
            is invalid, or robot.toml has its axes in another order than the logs.
    """
    path = Path(path)
    loaded, facts = load_config(path), [event.fact for event in read_events(path)]
    created = next((fact for fact in facts if isinstance(fact, Created)), None)
    if created is None:
        require_no_remains(path)
        raise UsageError(
            "the creation of this campaign was not completed",
            where=str(path / CONFIG),
            next_step="Run etude init again.",
        )
    if created.kind not in ("", loaded.kind.name):
        raise UsageError(
            f"this campaign has the kind {created.kind!r}, but campaign.toml states {loaded.kind.name!r}",
            where=f"{path / CONFIG} kind",
            next_step=f'Write kind = "{created.kind}" again; another kind needs a separate folder.',
        )
    spec = _spec(path, loaded.kind)
    parts = [part for channel in loaded.kind.channels(spec) for part in channel.parts]
    require_plain((part for part in parts if part), str(path / ROBOT))
    campaign = Campaign(path, loaded.config, loaded.sha256, loaded.kind, spec, sha256_of(path / ROBOT))
    if created.axes and any(isinstance(fact, Ingested) for fact in facts):
        require_same_names(created.axes, campaign.axes, path)
    return campaign


def require_same_names(log_names: Sequence[str], now: Sequence[str], folder: Path) -> None:
    """UsageError: robot.toml has other names than the logs, or another order, which logs and models keep."""
    if tuple(log_names) != tuple(now):
        raise UsageError(
            f"robot.toml has {', '.join(now)}, in this order, but the logs of this campaign have "
            f"{', '.join(log_names)}",
            where=str(folder / ROBOT),
            next_step="Restore that order. Another robot needs a separate campaign.",
        )


REMAINS = ("runs", "models", "proposals", "promoted", "simulated")
"""Folders that only a campaign in use has."""


def require_no_remains(path: Path) -> None:
    """Raises UsageError if the folder holds logs or models of a campaign and its journal is empty."""
    remains = [name for name in REMAINS if any((path / name).glob("*"))]
    if remains:
        raise UsageError(
            f"the journal of this campaign is lost: it is empty, but there is {' and '.join(remains)}",
            where=str(path / JOURNAL),
            next_step="Restore journal.jsonl from a copy or your backup. Without a copy, create a new "
            "campaign in another folder, and ingest the logs in runs.",
        )


def _spec(path: Path, kind: Kind) -> Any:
    try:
        with named_in(path / ROBOT, path, folder_id(path / JOURNAL), trust_command(path)):
            return kind.spec(path / ROBOT)
    except UsageError:
        if (path / ROBOT).is_file() and not kind.recognises(path / ROBOT):
            decoded(read_text(path / ROBOT), str(path / ROBOT))  # what is no TOML is told so, with the line
            raise UsageError(
                f"robot.toml does not describe a robot of the kind {kind.name!r}, which campaign.toml names",
                where=str(path / ROBOT),
                next_step="Both files must state the same kind; restore the one that was changed.",
            ) from None
        raise
