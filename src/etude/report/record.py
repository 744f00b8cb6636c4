"""Record of a campaign folder for the report, with its learning curves; missing values are None."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from etude.campaign.record.events import Evaluated, Event, Figures, Trained, summary
from etude.campaign.record.journal import JOURNAL, read_events, recorded
from etude.campaign.record.state import State, replay
from etude.errors import EtudeError, UsageError
from etude.limits.certificate import facts_of
from etude.report.markup import with_unit
from etude.storage import sha256_of
from etude.types import Array

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign
    from etude.protocols import Limit, Model, Trajectory
    from etude.types import Channel, Log

T = TypeVar("T")
Facts = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Record:
    """A campaign as read from its files.

    Attributes:
        folder: of the campaign.
        events: the journal, oldest first.
        state: after all events.
        campaign: its robot and configuration; None if robot.toml or campaign.toml cannot be read.
        notes: a sentence for each file that cannot be read.
    """

    folder: Path
    events: tuple[Event, ...]
    state: State
    campaign: Campaign | None
    notes: list[str]

    @property
    def robot(self) -> str:
        """Name of the robot; of the folder if robot.toml cannot be read."""
        return self.campaign.spec.name if self.campaign else self.folder.resolve().name

    @cached_property
    def channels(self) -> dict[str, Channel]:
        """Channels by name; empty without a robot."""
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
        """Unit of the commands if all share one; else ""."""
        return self.units[0] if len(set(self.units)) == 1 else ""

    @cached_property
    def limits(self) -> Sequence[Limit]:
        """Limits of a plan in the robot's file."""
        if self.campaign is None:
            return ()
        return tuple(self.campaign.kind.limits(self.campaign.spec, self.campaign.config, None, {}))

    def trajectory(self, number: int) -> Trajectory | None:
        return self.read(f"proposals/{number:04d}/trajectory.json", _trajectory)

    def certificate(self, number: int) -> Facts | None:
        return self.read(f"proposals/{number:04d}/certificate.json", _proof)

    def whole(
        self, number: int, approach: Trajectory | None = None
    ) -> tuple[Trajectory | None, Facts | None, str]:
        """A proposal's motion, certificate and folder; with approach and return if they were written as one
        file. With an `approach`, this one precedes the motion instead.
        """
        base = f"proposals/{number:04d}"
        if approach is not None:
            from etude.trajectories import Chain

            alone = self.read(f"{base}/trajectory.json", _trajectory)
            before = [("approach", part) for _, _, part in approach.pieces()]
            after = () if alone is None else [(label, part) for _, label, part in alone.pieces()]
            whole = Chain((*before, *after)) if after else None
            return whole, self.read(f"{base}/certificate.json", _proof), base
        ways = [
            name.rpartition("/")[0]
            for name in recorded(self.events)
            if name.startswith(f"{base}/from_") and name.endswith("/trajectory.json")
        ]
        folder = ways[-1] if ways else base
        trajectory = self.read(f"{folder}/trajectory.json", _trajectory)
        return trajectory, self.read(f"{folder}/certificate.json", _proof), folder

    def changed(self, name: str) -> str:
        """A sentence if robot.toml or campaign.toml changed after a file was committed; "" otherwise."""
        from etude.campaign.record.stored_files import changed_since

        files = () if self.campaign is None else changed_since(self.campaign, self.events, [name])
        return f"This certificate is older than the change of {' and '.join(files)}." if files else ""

    def log(self, number: int) -> Log | None:
        return self.read(f"runs/{number:04d}.parquet", _log)

    def test_run(self, baseline: str, test: str | None = None) -> tuple[Event, Log] | None:
        """The last readable run of a test (None: the first); baseline "" is the learned controller."""
        tests = [(e, e.fact) for e in self.events if isinstance(e.fact, Evaluated)]
        if not tests:
            return None
        key = baseline, test or tests[0][1].test
        for event, fact in reversed(tests):
            if (fact.baseline, fact.test) == key:
                for name in event.files:
                    log = self.read(name, _log) if name.endswith(".parquet") else None
                    if log is not None:
                        return event, log
        return None

    def model(self, number: int) -> Model | None:
        """The newest model after round `number`; None without one."""
        from etude.campaign.record.stored_models import stored_model

        campaign = self.campaign
        if campaign is None:
            return None
        return self.read(f"models/{number:04d}", lambda _: stored_model(campaign, number))

    def read(self, name: str, reader: Callable[[Path], T]) -> T | None:
        """`reader(path)`; None for a missing file, and for a damaged or changed one with a note.

        The other files still count.
        """
        path = self.folder / name
        if not path.exists():
            return None
        try:
            if path.is_file() and sha256_of(path) != recorded(self.events).get(name):
                raise ValueError("it was changed after Étude stored it")
            return reader(path)
        except (EtudeError, OSError, ValueError, LookupError, TypeError, RecursionError) as error:
            note = f"{name} could not be read: {error}"
            if note not in self.notes:
                self.notes.append(note)
            return None


def read_record(folder: Path) -> Record:
    """Reads a campaign folder.

    Raises:
        UsageError: the folder holds no campaign, or its journal was edited.
    """
    from etude.campaign.record.folder import open_campaign

    if not (folder / "campaign.toml").is_file() and not (folder / JOURNAL).is_file():
        raise UsageError(
            "there is no campaign here: neither campaign.toml nor journal.jsonl",
            where=str(folder),
            next_step="Create one with `etude init FOLDER --robot ROBOT`.",
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
    value = facts_of(path.read_bytes())
    for row in value["rows"]:
        numbers = [row[name] for name in ("lower", "upper", "proved_lower", "proved_upper", "slack")]
        texts = [row[name] for name in ("axis", "quantity", "method")]
        if not all(type(n) in (int, float) for n in numbers) or not all(isinstance(w, str) for w in texts):
            raise ValueError("a row does not have the form of a certificate row")
    for row in value.get("swept", ()):
        if not all(type(row[name]) in (int, float) for name in ("of_range", "of_clear")):
            raise ValueError("a row does not have the form of a swept range")
    return value


def _log(path: Path) -> Log:
    from etude.logs.readers.log_file import read_log_file

    return read_log_file(path)


STRUCTURES = {
    "gp": "GP",
    "identified": "identified physics",
    "identified+gp": "identified physics + GP",
    "nominal": "nominal model",
    "nominal+gp": "nominal model + GP",
    "linear": "linear regression",
    "linear+gp": "linear regression + GP",
}


def structure_name(structure: object) -> str:
    """A structure in words; also several, as "gp, identified", one for each command."""
    parts = [part.strip() for part in str(structure).split(",")]
    return ", ".join(STRUCTURES.get(part, part) for part in parts)


@dataclass(frozen=True)
class Evaluation:
    """One test of one controller.

    Attributes:
        number: round of the tested model; 0 for controllers without a model.
        seconds: robot time so far, s.
        error: mean tracking error of each coordinate; then the distance in space, if measured.
        unit: of the error.
        axes: number of coordinates.
    """

    number: int
    seconds: float
    error: Array
    unit: str = "deg"
    axes: int = 0

    @property
    def mean(self) -> float:
        """Summary value: the mean over coordinates, or the distance in space."""
        return summary(self.error.tolist(), self.axes or len(self.error))

    @property
    def parts(self) -> Array:
        """Error of each coordinate."""
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
        """The newest evaluation of a baseline, because an identified one uses all data so far."""
        series = self.baselines.get(name, ())
        return series[-1] if series else None

    @property
    def unit(self) -> str:
        """Unit of all its errors."""
        evaluations = [*self.learned, *(e for series in self.baselines.values() for e in series)]
        return evaluations[0].unit if evaluations else "deg"


def tests(record: Record) -> tuple[Test, ...]:
    """Every test motion with an evaluation in the journal, in order of appearance."""
    runs = [(number, run) for number, run in record.state.evaluated if run.errors]
    names = dict.fromkeys(run.test for _, run in runs)
    axes = len(record.names)
    return tuple(_test(name, [pair for pair in runs if pair[1].test == name], axes) for name in names)


def _test(name: str, runs: Sequence[tuple[int, Evaluated]], axes: int) -> Test:
    baselines = {
        baseline: _series([pair for pair in runs if pair[1].baseline == baseline], axes)
        for baseline in dict.fromkeys(run.baseline for _, run in runs)
    }
    return Test(name, baselines.pop("", ()), baselines)


def _series(runs: Sequence[tuple[int, Evaluated]], axes: int) -> tuple[Evaluation, ...]:
    latest = dict(runs)
    return tuple(
        Evaluation(number, run.robot_seconds, np.array(run.errors), run.unit, axes)
        for number, run in sorted(latest.items(), key=lambda item: item[0])
    )


def robot_seconds(record: Record) -> float:
    """Robot time of the whole campaign, s."""
    facts = (e.fact for e in record.events)
    spent = [fact.robot_seconds for fact in facts if isinstance(fact, Trained | Evaluated)]
    return max(spent, default=0.0)


def chosen_structure(trained: Trained | None) -> str | None:
    """Structure in use after this training; joined names if commands differ."""
    return trained.chosen if trained else None


Quantity = Literal["nmse", "z2", "coverage", "msll", "nmse_all", "z2_all", "coverage_all"]


def score(trained: Trained | None, structure: str | None, quantity: Quantity) -> Array | None:
    """(J,) prequential score of one structure in one training; None if no command has one."""
    values = getattr(trained.score_of(structure or ""), quantity) if trained else ()
    table = _numbers(values)
    return table if np.isfinite(table).any() else None


def held_out(trained: Trained | None) -> dict[str, Array]:
    """nMSE (J,) on held-out blocks of one log, for each structure with these scores."""
    blocks = trained.held_out.nmse if trained and trained.held_out else {}
    scores = {structure: _numbers(values) for structure, values in blocks.items()}
    return {structure: values for structure, values in scores.items() if np.isfinite(values).any()}


def new_motion(trained: Trained | None) -> tuple[Array, Array] | None:
    """nMSE (J,) on logs left out, of the structure in use and of linear regression; None for a single log."""
    scores = trained.new_motion if trained else None
    return None if scores is None else (_numbers(scores.used.nmse), _numbers(scores.linear))


def _numbers(values: Figures) -> Array:
    return np.array([np.nan if v is None else v for v in values])


def scored_structures(record: Record) -> tuple[str, ...]:
    """Every structure with scores anywhere in the journal."""
    return tuple(
        dict.fromkeys(structure for r in record.state.trained if r.trained for structure in r.trained.models)
    )
