"""etude tell"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from etude.cli.outcome import Common, Folder, Outcome, Say, code_of, opened
from etude.errors import typed

if TYPE_CHECKING:
    from etude.campaign.ingest.ingest_result import IngestResult
    from etude.campaign.ingest.tell import IngestedFile, IngestedMany


@dataclass(frozen=True, kw_only=True)
class Tell(Common):
    """Ingest logs and train the model once with all of them, in any order and at any time.

    A log that was ingested before changes nothing. A file that cannot be used does not stop the others: a
    table shows the result for each, and the exit code is 3. Exit code 6: a log waits for an answer, because
    the robot has changed.
    """

    folder: Folder
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[LOG ...]")] = ()
    """CSV, Parquet, a ROS 2 bag, a PX4 log, ... with the time and named measurements. Arms: positions and
    commands of every joint. Quadrotors: accelerometer, gyroscope and commands, and position and attitude if
    known."""
    number: int | None = None
    """Number of the trajectory that was run, for one log. Default: the newest open one that the motion
    fits."""
    foreign: bool = False
    """The log belongs to no proposal."""
    degrees: bool = False
    """All angles and rates of the log are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: use the log without a repair. Can be given several times."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name of a check: repair the log. Can be given several times."""
    topic: tuple[str, ...] = ()
    """Topics of a bag to read, joined by time. Default: all topics with joint states."""
    changed: Literal["new", "forget", "same", ""] = ""
    """Answer for a log that does not fit the robot that the model knows. new: learn from this log and later
    ones only; forget: exclude it; same: learn it with the others. Without a log: for all logs that wait."""

    confirm: Literal["without", "with", ""] = ""
    """The log is of a motion of etude ask --confirm, run without or with the feedforward. It is measured and
    never used for training."""

    control: Literal["feedback", "file", "learned", ""] = ""
    """Control during the motion: feedback alone, or feedback with the feedforward of the robot file's model
    or of the learned model. Default: as planned. Each control has its own tracking margins."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import IngestedFile, tell, tell_many
        from etude.errors import UsageError

        if not self.logs and not self.changed:
            raise UsageError("there is no log to tell", next_step="Name one or more files.")
        campaign = opened(self.folder)
        options: dict[str, Any] = {
            "foreign": self.foreign,
            "degrees": self.degrees,
            "accept": self.accept,
            "repair": self.repair,
            "topics": self.topic,
            "changed": self.changed,
            "confirm": self.confirm,
            "control": self.control,
            "say": say,
        }
        following = f"Next: etude status {typed(self.folder)}, etude ask {typed(self.folder)}"
        if len(self.logs) == 1:
            result = tell(campaign, self.logs[0], number=self.number, **options)
            return Outcome(
                "\n".join([*_lines(result, self.folder), following]),
                {**_data(result), "files": [_file(IngestedFile(self.logs[0], result))]},
                code_of(changed=result.awaits_answer),
            )
        if self.number is not None:
            raise UsageError("--number is for one log", next_step="Ingest that log alone.")
        many = tell_many(campaign, self.logs, **options)
        data = {
            "files": [_file(file) for file in many.files],
            "learned": many.learned,
            "warnings": [one.facts() for one in many.warnings],
        }
        held = any(file.ingested is not None and file.ingested.awaits_answer for file in many.files)
        code = code_of(changed=held, refused=bool(many.refused))
        after = [following] if any(file.ingested is not None for file in many.files) else []
        return Outcome("\n".join([*_table(many, self.folder), *after]), data, code)


def _lines(result: IngestResult, folder: Path) -> list[str]:
    if result.run:
        before = " was ingested before" if result.repeated else ""
        return [
            f"Run {result.run} the feedforward of trajectory {result.number}{before}: measured, not used "
            "for training."
        ]
    what = "a log without a proposal" if result.foreign else "the log of that proposal"
    first = f"Log {result.number} ({what}) was ingested before." if result.repeated else ""
    lines = [first or f"Log {result.number} stored, {what}."]
    lines += _kept_reading(result, folder)
    if result.repairs:
        lines += ["Repairs:", *(f"  - {sentence}" for sentence in result.repairs)]
    lines += [result.start] if result.start else []
    lines += _awaiting_answer(result)
    lines += [f"Log {result.number} is excluded from training."] if result.excluded else []
    return [*lines, *_learned(result.learned), *(f"Warning: {notice}" for notice in result.warnings)]


def _kept_reading(result: IngestResult, folder: Path) -> list[str]:
    """Of a repeated log: its repairs are those of the first reading, whatever campaign.toml says now."""
    if not result.repeated or result.run:
        return []
    return [
        "It was not read again. After a change of [log] in campaign.toml: "
        f"etude untell {typed(folder)} {result.number}, then etude tell."
    ]


def _awaiting_answer(result: IngestResult) -> list[str]:
    """Lines on the findings that the user must answer before the log is learned."""
    if not result.awaits_answer:
        return []
    parts = [f"{f.sentence[:1].upper()}{f.sentence[1:]}. {f.step}" for f in result.findings if f.flag]
    return [f"Log {result.number} is not used for training yet.", *parts]


def _learned(numbers: tuple[int, ...]) -> list[str]:
    return [f"Learned: {', '.join(map(str, numbers))}."] if numbers else []


def _table(many: IngestedMany, folder: Path) -> list[str]:
    width = max((len(file.path.name) for file in many.files), default=0)
    outcomes = ["refused" if file.ingested is None else file.sentence for file in many.files]
    rows = [f"{file.path.name.ljust(width)}  {one}" for file, one in zip(many.files, outcomes, strict=True)]
    warnings = [f"Warning: {notice}" for notice in many.warnings]
    return [*rows, *_shared_sentences(many, folder), *_learned(many.learned), *warnings]


def _shared_sentences(many: IngestedMany, folder: Path) -> list[str]:
    """Lines of further sentences; a sentence that several files share occurs once."""
    names: dict[str, list[str]] = {}
    for file in many.files:
        for sentence in _sentences(file, folder):
            names.setdefault(sentence, []).append(file.path.name)
    return [f"{_first_names(files)}: {sentence}" for sentence, files in names.items()]


def _sentences(file: IngestedFile, folder: Path) -> list[str]:
    if file.ingested is not None:
        return [
            *_kept_reading(file.ingested, folder),
            *file.ingested.repairs,
            *_awaiting_answer(file.ingested),
        ]
    error = file.refused
    return [] if error is None else [f"{error.fact.rstrip('.')}. {error.next_step}".rstrip()]


def _first_names(names: list[str], most: int = 4) -> str:
    """The first `most` names and the number of the others."""
    return ", ".join(names if len(names) <= most else [*names[:most], f"{len(names) - most} more"])


def _data(result: IngestResult) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "number": result.number,
        "repeated": result.repeated,
        "foreign": result.foreign,
        "repairs": result.repairs,
        "learned": result.learned,
        "warnings": [one.facts() for one in result.warnings],
        "held": result.awaits_answer,
        "aside": result.excluded,
        "run": result.run,
        "start": result.start,
        "findings": [asdict(finding) for finding in result.findings],
    }


def _file(file: IngestedFile) -> dict[str, Any]:
    refused = None
    if file.refused is not None:
        error = file.refused
        refused = {"fact": error.fact, "where": error.where, "next_step": error.next_step}
    facts = {} if file.ingested is None else _data(file.ingested)
    details = {name: value for name, value in facts.items() if name not in ("learned", "warnings")}
    return {"path": str(file.path), "outcome": file.sentence, "refused": refused, **details}


@dataclass(frozen=True, kw_only=True)
class NumberedCommand(Common):
    """A command on one trajectory of a campaign, or on its log."""

    folder: Folder
    number: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="NUMBER")]
    """Number of the trajectory and of its log, as etude status FOLDER lists it."""

    def outcome(self, what: str, done: str, changed: bool) -> Outcome:
        """What was done to it, or had been done before."""
        text = f"{what} {self.number} is {done}." if changed else f"It was {done} before."
        return Outcome(text, {"number": self.number, "changed": changed})


@dataclass(frozen=True, kw_only=True)
class Untell(NumberedCommand):
    """Remove a log that was ingested by mistake: the model is trained without it, and its proposal is open
    again."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import untell

        return self.outcome("Log", "taken back", untell(opened(self.folder), self.number, say=say))


@dataclass(frozen=True, kw_only=True)
class Abandon(NumberedCommand):
    """Close a trajectory whose log will never come or must not be used. Ingesting its log opens it again."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import abandon

        return self.outcome("Trajectory", "abandoned", abandon(opened(self.folder), self.number, say=say))
