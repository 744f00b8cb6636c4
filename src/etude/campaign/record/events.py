"""Events of the journal: one frozen dataclass for each kind, read and written here alone.

A field's name is its key in the JSON. A field that equals its default is not written.
"""

from __future__ import annotations

import json
import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import PurePath
from typing import Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

from etude.codes import Notice
from etude.storage import GENERATION
from etude.types import Finding

FORMAT = 2
"""Version of the journal's lines. Lines of Étude 0.1 name none: they are of version 1."""

Figures = tuple[float | None, ...]
"""One number for each axis or command; None where it is unknown."""
Table = tuple[Figures, ...]
"""(O, k): for each derivative order one number for each axis."""
Margins = Mapping[str, tuple[Table, Table]]
"""By form of motion: tracking margins (O, k) and their confidences (O, k)."""
Given = tuple[str, str, tuple[float, ...]]
"""An answer to a question about a log: "accept" or "repair", the check, and what the repair needs."""


@dataclass(frozen=True, kw_only=True)
class Fact:
    """Base of all facts.

    Attributes:
        EVENT: name of the event in the journal.
    """

    EVENT: ClassVar[str] = ""


@dataclass(frozen=True, kw_only=True)
class Created(Fact):
    """The campaign was made.

    Attributes:
        seed: of all its random numbers.
        preset: of the configuration. kind: of the robot. robot: its name. axes: of its path.
    """

    EVENT: ClassVar[str] = "created"
    seed: int
    preset: str = ""
    kind: str = ""
    robot: str = ""
    axes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Edited(Fact):
    """`ask` or `tell` read an edit of robot.toml or campaign.toml."""

    EVENT: ClassVar[str] = "edited"


@dataclass(frozen=True, kw_only=True)
class Constrained(Fact):
    """Constraints of a motion: limits less tracking margins.

    Attributes:
        model: number of the round whose model bounds the commands; None before any log.
        controls: controls under which the motion may run; () if unknown.
        margins: tracking margins. unheld: sentences about margins that are not enforced.
    """

    model: int | None = None
    controls: tuple[str, ...] = ()
    margins: Margins = field(default_factory=dict)
    unheld: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Asked(Constrained):
    """A trajectory was proposed.

    Attributes:
        status: a sentence on how it was found.
        gain: expected reduction of the remaining variance, a fraction; None if unknown.
        seed: of its random numbers. learned: number of trainings before it.
        active_limits: pairs of axis and quantity.
        criterion, value, baseline_value, choice, deviation_before, deviation_after, evaluations, seconds:
            of the design; see `solve.Design`.
        confirm: a confirmation motion, run without and with the feedforward; no model learns from it.
        weighs: a motion to identify the load at the hand; no model learns from it.
        model_sha256: of the model that computes its feedforward. left_over, trained_speeds: see
            `record.confirmation`.
    """

    EVENT: ClassVar[str] = "asked"
    status: str
    gain: float | None = None
    seed: tuple[int, ...] = ()
    learned: int = 0
    active_limits: tuple[tuple[str, str], ...] = ()
    criterion: str = ""
    value: float | None = None
    baseline_value: float | None = None
    choice: float | None = None
    deviation_before: Figures = ()
    deviation_after: Figures = ()
    evaluations: int = 0
    seconds: float = 0.0
    confirm: bool = False
    weighs: bool = False
    model_sha256: str = ""
    left_over: Figures | None = None
    trained_speeds: tuple[float, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class Exported(Constrained):
    """Files of a proposal, or of a model, were written for a receiver.

    Attributes:
        format: of a proposal: name of the exporter. effort: with the learned command.
        speed: per cent. start: pose (k,) of the way to the motion, rad (m).
        target, place: of a model: name of the target, and the folder. model_sha256: of its file.
    """

    EVENT: ClassVar[str] = "exported"
    format: str = ""
    effort: bool = False
    speed: int = 0
    start: tuple[float, ...] = ()
    target: str = ""
    place: str = ""
    model_sha256: str = ""


@dataclass(frozen=True, kw_only=True)
class Ingested(Fact):
    """A log was ingested.

    Attributes:
        sha256: of the original file. source: its name.
        robot_seconds: recorded motion, s. rows: of the log. repairs: a sentence each.
        foreign: it belongs to no proposal. speed: speed of the run, per cent of the proposal's.
        answers: to questions about it. findings: those accepted, and those that await an answer.
        segments: start times of the segments, s. control: control of the run; "" if unknown.
        tracked: largest tracking errors (O, k) by form of motion.
        start: s until tracking settled, and the errors (O, k) before.
        repeats: number of the log that it repeats.
    """

    EVENT: ClassVar[str] = "told"
    sha256: str
    source: str = ""
    robot_seconds: float = 0.0
    rows: int = 0
    repairs: tuple[str, ...] = ()
    foreign: bool = False
    speed: int = 100
    answers: tuple[Given, ...] = ()
    segments: tuple[float, ...] = (0.0,)
    control: str = ""
    tracked: Mapping[str, Table] = field(default_factory=dict)
    start: tuple[float, Table] | None = None
    findings: tuple[Finding, ...] = ()
    repeats: int | None = None


@dataclass(frozen=True, kw_only=True)
class Untold(Fact):
    """A log was taken back."""

    EVENT: ClassVar[str] = "untold"
    sha256: str = ""


@dataclass(frozen=True, kw_only=True)
class Changed(Fact):
    """The user said whether the robot has changed.

    Attributes:
        choice: "new", "forget" or "same". logs: logs that the answer is about. aside: logs excluded from
            training.
    """

    EVENT: ClassVar[str] = "changed"
    choice: str = ""
    logs: tuple[int, ...] = ()
    aside: tuple[int, ...] = ()


@dataclass(frozen=True)
class PrequentialScore:
    """Scores of one structure on a log before it was learned, one number for each command.

    Attributes:
        nmse, z2, coverage, msll: where the joint moved; nmse_all, z2_all, coverage_all: where any did.
    """

    nmse: Figures = ()
    z2: Figures = ()
    coverage: Figures = ()
    msll: Figures = ()
    nmse_all: Figures = ()
    z2_all: Figures = ()
    coverage_all: Figures = ()


@dataclass(frozen=True)
class NewMotionScores:
    """Scores on new motions: leave-one-log-out cross-validation over all logs.

    Errors are normalised by the variance over all logs, so a log with little variation has little weight.
    They are errors of `Samples.target`, while any joint moves.

    Attributes:
        logs: number of logs, or of parts that are left out together. used: scores of the structure in use.
            linear: nMSE of linear regression.
    """

    logs: int
    used: PrequentialScore
    linear: Figures = ()


@dataclass(frozen=True)
class BlockScores:
    """Scores on held-out blocks of one log; they do not predict the error on another motion.

    Attributes:
        blocks: their numbers. of: number of all blocks. chosen: structure in use.
        nmse, nmse_all: by structure, for each command, as in `PrequentialScore`.
    """

    blocks: tuple[int, ...]
    of: int
    chosen: str
    nmse: Mapping[str, Figures]
    nmse_all: Mapping[str, Figures] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Trained(Fact):
    """Logs were learned.

    Attributes:
        logs: numbers of the training logs. together: numbers of those that are new, if several.
        models: prequential scores by structure. held_out_mae: mean absolute errors held out, by structure.
        predicted_by: structure in use before this training. chosen, rungs: structure in use after it, of all
            commands and of each.
        calibrated: enough trajectories were held out to calibrate the variances.
        unmoved: commands whose joints stood still in all logs.
        row_scatter: of each command, root mean square of recorded rows about the filtered samples.
        robot_seconds: recorded motion of all logs learned so far, s.
        recipe: sentences of the preprocessing. inputs: fitted parameters of the inputs.
        warnings: notices of the training.
        forecast_deviation, latent_deviation, noise_deviation, moved: see `training.with_forecast`.
        new_motion: scores of logs left out; None of a single one. held_out: scores on blocks of that.
        body: of the description, as `abilities.SupportsBody`; "" if the kind has none.
    """

    EVENT: ClassVar[str] = "trained"
    logs: tuple[int, ...] = ()
    models: Mapping[str, PrequentialScore] = field(default_factory=dict)
    held_out_mae: Mapping[str, float | None] = field(default_factory=dict)
    predicted_by: str | None = None
    chosen: str
    rungs: tuple[str, ...] = ()
    calibrated: bool = True
    unmoved: tuple[str, ...] = ()
    robot_seconds: float = 0.0
    recipe: tuple[str, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[Notice, ...] = ()
    forecast_deviation: tuple[float, ...] = ()
    latent_deviation: tuple[float, ...] = ()
    noise_deviation: tuple[float, ...] | None = None
    moved: float | None = None
    new_motion: NewMotionScores | None = None
    held_out: BlockScores | None = None
    row_scatter: tuple[float, ...] = ()
    together: tuple[int, ...] = ()
    body: str = ""

    @property
    def in_use(self) -> str:
        """The structure in use when the log was ingested; for the first log, the one selected then."""
        return self.predicted_by or self.chosen

    def score_of(self, structure: str) -> PrequentialScore:
        """Empty where it was not scored."""
        return self.models.get(structure, PrequentialScore())

    def score_in_use(self) -> PrequentialScore:
        """Of what was in use when the log came."""
        return self.score_of(self.in_use)


ERROR = "tracking_error_"
"""Begins the key of the errors of a test run in the JSON; their unit ends it."""


@dataclass(frozen=True, kw_only=True)
class Evaluated(Fact):
    """A simulated test run.

    Attributes:
        test: name of the motion. baseline: of the controller; "": the learned one.
        robot_seconds: recorded motion before it, s.
        errors: mean absolute tracking error of each axis, and the distance where axes are directions in
            space. unit: of the errors.
    """

    EVENT: ClassVar[str] = "evaluated"
    test: str
    baseline: str = ""
    robot_seconds: float = 0.0
    errors: tuple[float, ...] = ()
    unit: str = ""


def summary(values: Sequence[float], axes: int) -> float:
    """Summary figure of an evaluation: the mean over the axes, or the entry after those of the axes."""
    return float(values[-1] if len(values) > axes else sum(values) / len(values))


@dataclass(frozen=True, kw_only=True)
class Abandoned(Fact):
    """A trajectory was given up."""

    EVENT: ClassVar[str] = "abandoned"
    had_log: bool = False


@dataclass(frozen=True, kw_only=True)
class Promoted(Fact):
    """A model was promoted.

    Attributes:
        sha256: of its file. forced: against the data. reason: why. refused: reasons against it.
        compared: rows of `models.accuracy.ErrorRatio`.
        narrow, wide: parts of held-out commands inside the 50 % and 95 % intervals.
        logs: hashes of the logs in the model.
    """

    EVENT: ClassVar[str] = "promoted"
    sha256: str
    forced: bool = False
    compared: tuple[Mapping[str, Any], ...] = ()
    narrow: Figures = ()
    wide: Figures = ()
    refused: tuple[Notice, ...] = ()
    reason: str = ""
    logs: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RolledBack(Fact):
    """The model of hash `sha256` was replaced by the earlier one of hash `to`."""

    EVENT: ClassVar[str] = "rolled_back"
    sha256: str = ""
    to: str = ""
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Confirmed(Fact):
    """A run of a confirmation motion.

    Attributes:
        run: "without" or "with" the feedforward.
        error: mean absolute tracking error of each axis; moving: the same while it moves; late, noise: see
            `record.confirmation.Without`. units: of these, by axis.
        sha256: of the log. source: its name. repairs: a sentence each.
    """

    EVENT: ClassVar[str] = "confirmed"
    run: str
    error: Figures
    units: tuple[str, ...]
    moving: Figures | None = None
    late: Figures | None = None
    noise: Figures | None = None
    sha256: str = ""
    source: str = ""
    repairs: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunBegan(Fact):
    """`etude run` connected to a robot that it may move.

    Attributes:
        driver: as it was named. robot, identity: as the robot reports. real: not a simulation.
        agreed: how the person agreed: "typed", or "--yes" for a simulation.
        told: other values that the robot reported, by the name in `drivers.About`.
    """

    EVENT: ClassVar[str] = "run_began"
    driver: str
    robot: str = ""
    identity: str = ""
    real: bool = True
    agreed: str = ""
    told: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RobotMotion(Fact):
    """One motion of a robot that Étude moves.

    Attributes:
        part: "approach", "motion" or "return". speed: per cent. first: only its beginning.
        sha256: of the trajectory's JSON. control: see `record.controls`. identity: of the robot.
    """

    part: str
    speed: int = 100
    first: bool = False
    sha256: str = ""
    control: str = ""
    identity: str = ""


@dataclass(frozen=True, kw_only=True)
class MotionSent(RobotMotion):
    """Committed before the first set-point: without its `MotionEnded` the robot may have moved.

    Attributes:
        start: pose (k,) at which it starts, rad (m).
    """

    EVENT: ClassVar[str] = "motion_sent"
    start: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MotionEnded(RobotMotion):
    """Outcome of a motion.

    Attributes:
        ended: see `drivers.Ended`. reason: a sentence. reached: s of the motion. late: cycles missed.
        worst_error: (k,) largest |measured - asked| in time, rad (m), until it stopped.
        residual: (k,) largest |command - predicted|, means over 0.1 s; () where nothing was predicted.
        recording, recording_sha256: its file in the campaign.
    """

    EVENT: ClassVar[str] = "motion_ended"
    ended: str
    reason: str = ""
    reached: float = 0.0
    late: int = 0
    worst_error: Figures = ()
    residual: Figures = ()
    recording: str = ""
    recording_sha256: str = ""


@dataclass(frozen=True, kw_only=True)
class RunEnded(Fact):
    """`etude run` left the robot at rest. why: a sentence. exit_code: of the command."""

    EVENT: ClassVar[str] = "run_ended"
    why: str = ""
    exit_code: int = 0


FACTS: Mapping[str, type[Fact]] = {
    kind.EVENT: kind
    for kind in (
        *(Created, Edited, Asked, Exported, Ingested, Untold, Changed, Trained, Evaluated, Abandoned),
        *(Promoted, RolledBack, Confirmed, RunBegan, MotionSent, MotionEnded, RunEnded),
    )
}


@dataclass(frozen=True)
class Event:
    """One fact, and when and on what it was committed.

    Attributes:
        fact: one of `FACTS`.
        time: when it was committed, ISO 8601 with the zone.
        number: trajectory it is about; None for facts about the whole campaign.
        config_sha256: hash of campaign.toml at that moment. robot_sha256: of robot.toml; "" if unknown.
        files: path relative to the campaign folder -> SHA-256, for each file the fact rests on.
        generation: of what was written, see `storage.GENERATION`.
    """

    fact: Fact
    time: str = ""
    number: int | None = None
    config_sha256: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    robot_sha256: str = ""
    generation: int = 1

    @property
    def event(self) -> str:
        """Name of the event in the journal."""
        return self.fact.EVENT


class NewerFormatError(ValueError):
    """A line that a newer version wrote."""


def event_to_json(event: Event) -> str:
    """The JSON object of an event. ValueError: a number in it is not finite."""
    values = {"event": event.fact.EVENT, "version": FORMAT, "time": event.time, "number": event.number}
    values |= {"config_sha256": event.config_sha256, "files": dict(event.files), **_facts(event.fact)}
    values |= {"robot_sha256": event.robot_sha256} if event.robot_sha256 else {}
    return json.dumps({**values, "generation": event.generation}, allow_nan=False)


def event_from_json(text: str) -> Event:
    """The event of a JSON object, without unknown keys.

    Raises:
        NewerFormatError: its version is newer, or the version is known and the event is not.
        ValueError: it is no event, its time is none, or it names a file outside the campaign.
    """
    values = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("no object")
    if _decoded(int, values.get("version", 1)) > FORMAT:
        raise NewerFormatError(f"format {values['version']}")
    if _decoded(int, values.get("generation", 1)) > GENERATION:
        raise NewerFormatError(f"generation {values['generation']}")
    kind = FACTS.get(_decoded(str, values.get("event")))
    if kind is None:
        raise NewerFormatError(f"event {values['event']!r}")
    if kind is Evaluated:
        values = _with_errors(values)
    arguments: dict[str, Any] = {
        name: _decoded(hint, values[name]) for name, hint in _hints(Event).items() if name in values
    }
    missing = {"time", "number", "config_sha256", "files"} - arguments.keys()
    if missing:
        raise ValueError(f"without {missing}")
    if arguments["time"]:
        datetime.fromisoformat(arguments["time"])
    event = Event(_decoded(kind, values), **arguments)
    recording = event.fact.recording if isinstance(event.fact, MotionEnded) else ""
    for name in (*event.files, recording):
        if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
            raise ValueError(f"{name} is outside the campaign")
    return event


def plain(value: Any) -> Any:
    """A fact, or a value in it, as JSON values, without fields that equal their default."""
    if isinstance(value, Notice):
        return value.to_json()
    if is_dataclass(value) and not isinstance(value, type):
        values = {f.name: getattr(value, f.name) for f in fields(value)}
        return {f.name: plain(values[f.name]) for f in fields(value) if values[f.name] != _default(f)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _facts(fact: Fact) -> dict[str, Any]:
    values: dict[str, Any] = plain(fact)
    if isinstance(fact, Evaluated):
        values.pop("unit", None)
        values[ERROR + fact.unit] = values.pop("errors", [])
    return values


def _with_errors(values: dict[str, Any]) -> dict[str, Any]:
    """The same with the tracking errors and their unit apart."""
    key = next((key for key in values if key.startswith(ERROR)), ERROR)
    return {**values, "errors": values.get(key, []), "unit": key.removeprefix(ERROR)}


def _default(attribute: Field[Any]) -> Any:
    return attribute.default if attribute.default_factory is MISSING else attribute.default_factory()


@lru_cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of a dataclass's fields, by name."""
    hints = get_type_hints(kind)
    return {
        attribute.name: hints[attribute.name]
        for attribute in fields(kind)
        if hints[attribute.name] is not Fact
    }


def _decoded(hint: Any, value: Any) -> Any:
    """A JSON value as that type. ValueError: it is of another."""
    origin, of = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return None if value is None else _decoded(next(o for o in of if o is not type(None)), value)
    if hint is Notice:
        return Notice.from_json(value)
    if hint is Any or (origin is Literal and value in of):
        return value
    if origin is tuple and isinstance(value, list):
        kinds = [of[0]] * len(value) if of[-1] is Ellipsis else of
        return tuple(_decoded(kind, item) for kind, item in zip(kinds, value, strict=True))
    if isinstance(value, dict):
        if isinstance(hint, type) and is_dataclass(hint):
            arguments = {n: _decoded(kind, value[n]) for n, kind in _hints(hint).items() if n in value}
            return hint(**arguments)
        return {key: _decoded(of[1], item) for key, item in value.items()}
    if hint is float and type(value) in (int, float):
        return float(value)
    if hint in (int, str, bool) and type(value) is hint:
        return value
    raise ValueError(f"{value!r} is no {hint}")
