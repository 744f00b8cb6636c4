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
    """Take in logs and learn them in one training. Any order, any delay; the same log twice changes nothing.

    Of several files, one that cannot be used does not stop the others: the table says what became of each,
    and the exit code is then 3. Exit code 6: a log waits for an answer, since the robot has changed.
    """

    folder: Folder
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[LOG ...]")] = ()
    """CSV, Parquet, a ROS 2 bag, a PX4 log, ... with the time and, by name, what the robot measures: of an
    arm positions and commands of every joint; of a quadrotor accelerometer, gyroscope and commands, and if
    known position and attitude."""
    number: int | None = None
    """The trajectory that was run; else the newest open one that the motion fits. For one log."""
    foreign: bool = False
    """The log answers no proposal."""
    degrees: bool = False
    """All angles and rates of the log are in degrees."""
    accept: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose question is answered with: take the log as it is. Can be given several times."""
    repair: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A check whose question is answered with: put it right. Can be given several times."""
    topic: tuple[str, ...] = ()
    """Topics of a bag to read, joined by time; none: those with joint states."""
    changed: Literal["new", "forget", "same", ""] = ""
    """The answer for a log that is not of the robot that the model knows: new learns from it and those to
    come alone, forget sets it aside, same learns it with the others. Without a log: for those that wait."""

    confirm: Literal["without", "with", ""] = ""
    """The log is of a motion that confirms (etude ask --confirm), run without or with the feedforward: it is
    measured, and nothing learns from it."""

    control: Literal["feedback", "file", "learned", ""] = ""
    """What the motion was run under: feedback alone, or beside it the feedforward of the robot file's model,
    or of what was learned; if not given what it was asked for. Each has its own margins of tracking."""

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
                "\n".join([*_lines(result), following]),
                {**_data(result), "files": [_file(IngestedFile(self.logs[0], result))]},
                code_of(changed=result.awaits_answer),
            )
        if self.number is not None:
            raise UsageError("--number belongs to one log", next_step="Tell that log by itself.")
        many = tell_many(campaign, self.logs, **options)
        data = {
            "files": [_file(file) for file in many.files],
            "learned": many.learned,
            "warnings": [one.facts() for one in many.warnings],
        }
        held = any(file.ingested is not None and file.ingested.awaits_answer for file in many.files)
        code = code_of(changed=held, refused=bool(many.refused))
        after = [following] if any(file.ingested is not None for file in many.files) else []
        return Outcome("\n".join([*_table(many), *after]), data, code)


def _lines(result: IngestResult) -> list[str]:
    if result.run:
        before = " was told before" if result.repeated else ""
        return [
            f"Run {result.run} the feedforward of trajectory {result.number}{before}: measured, not learned."
        ]
    what = "a recording of its own" if result.foreign else "the answer to that proposal"
    first = f"Log {result.number} ({what}) was told before." if result.repeated else ""
    lines = [first or f"Log {result.number} stored, {what}."]
    if result.repairs:
        lines += ["Repairs:", *(f"  - {sentence}" for sentence in result.repairs)]
    lines += [result.start] if result.start else []
    lines += _awaiting_answer(result)
    lines += [f"Log {result.number} is set aside: nothing learns from it."] if result.excluded else []
    return [*lines, *_learned(result.learned), *(f"Warning: {notice}" for notice in result.warnings)]


def _awaiting_answer(result: IngestResult) -> list[str]:
    """Lines on the findings that the user must answer before the log is learned."""
    if not result.awaits_answer:
        return []
    parts = [f"{f.sentence[:1].upper()}{f.sentence[1:]}. {f.step}" for f in result.findings if f.flag]
    return [f"Log {result.number} is not learned yet.", *parts]


def _learned(numbers: tuple[int, ...]) -> list[str]:
    return [f"Learned: {', '.join(map(str, numbers))}."] if numbers else []


def _table(many: IngestedMany) -> list[str]:
    width = max((len(file.path.name) for file in many.files), default=0)
    outcomes = ["refused" if file.ingested is None else file.sentence for file in many.files]
    rows = [f"{file.path.name.ljust(width)}  {one}" for file, one in zip(many.files, outcomes, strict=True)]
    warnings = [f"Warning: {notice}" for notice in many.warnings]
    return [*rows, *_shared_sentences(many), *_learned(many.learned), *warnings]


def _shared_sentences(many: IngestedMany) -> list[str]:
    """Lines of further sentences; a sentence that several files share occurs once."""
    names: dict[str, list[str]] = {}
    for file in many.files:
        for sentence in _sentences(file):
            names.setdefault(sentence, []).append(file.path.name)
    return [f"{_first_names(files)}: {sentence}" for sentence, files in names.items()]


def _sentences(file: IngestedFile) -> list[str]:
    if file.ingested is not None:
        return [*file.ingested.repairs, *_awaiting_answer(file.ingested)]
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
    """Of the trajectory, which is that of its log: etude status FOLDER lists them."""

    def outcome(self, what: str, done: str, changed: bool) -> Outcome:
        """What was done to it, or had been done before."""
        text = f"{what} {self.number} is {done}." if changed else f"It was {done} before."
        return Outcome(text, {"number": self.number, "changed": changed})


@dataclass(frozen=True, kw_only=True)
class Untell(NumberedCommand):
    """Take back a log that was told by mistake: the model is trained without it, its proposal open again."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import untell

        return self.outcome("Log", "taken back", untell(opened(self.folder), self.number, say=say))


@dataclass(frozen=True, kw_only=True)
class Abandon(NumberedCommand):
    """Give a trajectory up: its log will never come, or must not be used. Telling it takes that back."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.ingest.tell import abandon

        return self.outcome("Trajectory", "abandoned", abandon(opened(self.folder), self.number, say=say))
