"""inspect: checks of a log without a campaign, with or without a robot description."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign.create import find_robot, reading
from etude.campaign.ingest.command_decisions import ingested_logs
from etude.campaign.ingest.ingest_result import answered_proposal
from etude.campaign.ingest.questions import (
    Answers,
    LogQuestions,
    checks_of,
    clock_by_file_of,
    judged_commands,
)
from etude.campaign.ingest.recordings import is_recording
from etude.campaign.record.config_file import CONFIG
from etude.campaign.record.folder import Campaign, open_campaign
from etude.campaign.record.stored_files import FULL
from etude.errors import DataError, EtudeError
from etude.logs.checks.exact import judge_numbers
from etude.logs.checks.filtered_motion import Seen, seen
from etude.logs.checks.plausibility import judge_motion, mended
from etude.logs.checks.recording_quality import clock_findings, column_findings, motion_findings
from etude.logs.cleaning import read as logs
from etude.logs.cleaning.read import clean_log, matched_log
from etude.logs.cleaning.repairs import drop_spikes, drop_unreadable, order_rows
from etude.logs.columns.headers import plain, words_of
from etude.logs.columns.mapping import mapped, mapping_text
from etude.logs.columns.matching import match_columns
from etude.logs.columns.units import Limits, Stated, check_lengths, from_degrees, read_time
from etude.logs.columns.vocabulary import COMMANDS, PREFIXES, is_time, normal, split_suffix, split_unit
from etude.logs.config import LogConfig
from etude.logs.readers.log_file import sha256_of_log
from etude.logs.readers.registry import cut_sentences, end_findings, read_raw, with_rest_reported
from etude.protocols import Kind
from etude.threads import threads_for
from etude.types import Array, Channel, Finding, Log

USUAL_RATE = 200.0
"""Hz, assumed rate of a robot without a description, to determine the unit of its times."""
UNEXPECTED = (ValueError, ArithmeticError, LookupError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Inspected:
    """Result of the checks of a log.

    Attributes:
        log: as it was read, for drawing; rows in order. None where it could not be read.
        findings: in the order of the checks.
    """

    log: Log | None
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether `tell` would refuse the log, or ask a question."""
        return any(f.light == "red" or f.flag for f in self.findings)


@dataclass(frozen=True)
class _KnownRobot:
    """Known facts of the robot, described by its kind or guessed from the headers.

    why: reason why there are no channels. earlier: its logs so far, by number.
    campaign: None without one. log: the file.
    """

    channels: Sequence[Channel]
    limits: Limits
    rate: float
    path: str
    kind: Kind | None = None
    spec: Any = None
    config: LogConfig = field(default_factory=LogConfig)
    why: str = ""
    earlier: Mapping[int, Log] = field(default_factory=dict)
    campaign: Campaign | None = None
    log: Path = Path()


@threads_for(0)
def inspect(
    path: str | Path, robot: str | Path | None = None, *, degrees: bool = False, topics: Sequence[str] = ()
) -> Inspected:
    """Run every check on the log in a file, without storing anything.

    Args:
        path: as for `read_log`.
        robot: a built-in name, the path of a description, or the folder of a campaign, whose table [log] then
            applies, too; None: joints are guessed from the headers, and checks that need limits or a model
            file are left out.
        degrees: the file's angles are degrees.
        topics: topics of a file with several.

    Raises:
        UsageError: there is no such robot.
    """
    path = Path(path)
    description = None if robot is None else _describe_robot(str(robot))
    try:
        with np.errstate(all="ignore"):
            description = replace(description or _guess_robot(path, topics), log=path)
            log, stated = _read(path, description, topics)
            if degrees:
                log = from_degrees(log, stated)
            return _inspect_log(log, description, stated)
    except EtudeError as error:
        return Inspected(None, (_refused("columns", error),))


def mapping_of(path: Path, robot: str, topics: Sequence[str] = ()) -> str:
    """The table [log.columns] that assigns the file's columns to channels. Errors as of `mapping_text`."""
    channels = _describe_robot(robot).channels
    return mapping_text(list(read_raw(path, topics).values), channels, path.name)


def _describe_robot(robot: str) -> _KnownRobot:
    config, earlier, campaign = LogConfig(), {}, None
    if (Path(robot) / CONFIG).is_file():
        campaign = open_campaign(Path(robot))
        kind, spec, config = campaign.kind, campaign.spec, campaign.config.log
        earlier = ingested_logs(campaign, campaign.state())
    else:
        kind, place = find_robot(robot)
        with reading(place):
            spec = kind.spec(place)
    expected = kind.expected(spec)
    return _KnownRobot(
        tuple(kind.channels(spec)),
        expected.limits,
        expected.rate,
        kind.path,
        kind,
        spec,
        config,
        earlier=earlier,
        campaign=campaign,
    )


ROLES = (Channel("q", ("",), ("rad",)), Channel("qd", ("",), ("rad/s",)))
FEWEST = 1  # log that a folder has to hold
UNIT = 1e-3  # a quaternion's length is 1, to the digits that logs have


def guessed_of(raw: Log) -> tuple[tuple[Channel, ...], str]:
    """The channels guessed from raw columns, and the reason if there are none."""
    channels = guessed_channels(list(raw.values))
    if not channels:
        return (), "No header names the position and the command of a joint"
    try:
        columns = match_columns(list(raw.values), channels, raw.source).channels["q"]
    except DataError as error:
        return (), f"The headers do not identify the joints ({error.fact})"
    if _is_quaternion(np.hstack([raw[column.name] for column in columns])):
        names = ", ".join(column.name for column in columns)
        return (), f"{names} are not joints but an orientation, since their length is always 1"
    return channels, ""


def _is_quaternion(values: Array) -> bool:
    """Whether values (T, k) are unit quaternions in every row with numbers, and vary."""
    if values.shape[1] != 4:
        return False
    rows = values[np.isfinite(values).all(axis=1)]
    size = np.linalg.norm(rows, axis=1)
    return bool(len(rows) and np.ptp(rows) > 0.0 and (np.abs(size - 1.0) < UNIT).all())


def guessed_channels(headers: Sequence[str]) -> tuple[Channel, ...]:
    """Positions, velocities and commands of the joints with a position and a command among the headers; ()
    without such joints.
    """
    positions, speeds = (_joint_name_candidates(headers, words_of(channel)) for channel in ROLES)
    unit, commands = _commanded(headers)
    commanded, fast = ({name for names in parts for name in names} for parts in (commands, speeds))
    names = tuple(dict.fromkeys(next((n for n in some if n in commanded), "") for some in positions))
    names = tuple(name for name in names if name)
    if len(names) < FEWEST:
        return ()
    size = len(names)
    channels = [Channel("q", names, ("rad",) * size, required=True)]
    if all(name in fast for name in names):
        channels.append(Channel("qd", names, ("rad/s",) * size, derivative_of="q"))
    command = Channel("command", names, (unit,) * size, "command", required=True, acts_on="q")
    return (*channels, command)


def _commanded(headers: Sequence[str]) -> tuple[str, list[list[str]]]:
    """The unit whose words name most commands, and their joints."""
    vocabularies = {unit: (*synonyms, "command", "tau", "u", "cmd") for unit, synonyms in COMMANDS.items()}
    joints = {unit: _joint_name_candidates(headers, synonyms) for unit, synonyms in vocabularies.items()}
    unit = max(joints, key=lambda name: len(joints[name]))
    return unit, joints[unit]


def _joint_name_candidates(headers: Sequence[str], words: Sequence[str]) -> list[list[str]]:
    """For each header that begins or ends with one of the words: its possible remainders, longest first."""
    remainders = []
    for header in [header for header in headers if not is_time(header)]:
        text = normal(split_suffix(split_unit(header)[0])[0])
        text = plain(text) or text
        parts = {part for word in words if (part := _part_in_header(text, word))}
        remainders += [sorted(parts, key=lambda part: (-len(part), part))] if parts else []
    return remainders


NUMBERED = re.compile(r"_?(?:joint_?|j)?(\d{1,4})")
"""What follows the word of a quantity in the header of a numbered joint."""


def _part_in_header(text: str, word: str) -> str:
    """ "elbow" of "elbow_position"; "joint_3" of "q3"; "" if the word is not at either end."""
    for prefix in ("", *(f"{p}_" for p in PREFIXES)) if word in text else ():
        unprefixed = text.removeprefix(prefix)
        numbered = NUMBERED.fullmatch(unprefixed.removeprefix(word))
        if numbered and unprefixed.startswith(word):
            return f"joint_{numbered[1]}"
        for remainder in (unprefixed.removeprefix(f"{word}_"), unprefixed.removesuffix(f"_{word}")):
            if remainder != unprefixed:
                return remainder
    return ""


def _guess_robot(path: Path, topics: Sequence[str]) -> _KnownRobot:
    channels, why = guessed_of(read_raw(path, topics))
    return _KnownRobot(channels, {}, USUAL_RATE, "q", why=why)


def _read(path: Path, robot: _KnownRobot, topics: Sequence[str]) -> tuple[Log, Stated]:
    """The log in the known channels; its raw columns if the headers do not match any."""
    if robot.channels:
        return matched_log(path, robot.channels, robot.rate, topics, robot.config)
    raw = mapped(read_raw(path, topics), robot.config)
    t, repairs = read_time(raw, robot.rate, path.name)
    names = [name for name in raw.values if not is_time(name)]
    channels, values = ({n: part[n] for n in names} for part in (raw.channels, raw.values))
    log = Log(t, channels, values, path.name, (*raw.repairs, *repairs))  # type: ignore[arg-type]
    return with_rest_reported(log), {}


def _inspect_log(log: Log, robot: _KnownRobot, stated: Stated) -> Inspected:
    health = [_columns(log, robot), *end_findings(log), *_run_check("clock", lambda: clock_findings(log))]
    health += _run_check("columns", lambda: column_findings(log, robot.limits))
    inspected = _findings_of_tell(log, robot, stated)
    if robot.kind and not inspected.refused:  # tell repairs it, with a sentence below
        health = [replace(f, light="yellow") if f.light == "red" else f for f in health]
    return Inspected(inspected.log, (*health, *inspected.findings))


def _findings_of_tell(log: Log, robot: _KnownRobot, stated: Stated) -> Inspected:
    """The findings of the checks of `tell`, in its order."""
    findings: list[Finding] = []
    try:
        rows = drop_spikes(order_rows(drop_unreadable(replace(log, repairs=()))))
    except EtudeError as error:
        return Inspected(None, (_refused("rows", error),))
    findings += _run_check("numbers", lambda: judge_numbers(rows, robot.limits))
    rows = replace(mended(rows, findings), repairs=rows.repairs)  # the findings include the repairs
    motion = seen(rows, rows.channels[robot.path]) if robot.path in rows else None
    if not any(f.light == "red" for f in findings):
        findings += _run_check("motion", lambda: _motion(rows, robot, motion))
    if any(f.light == "red" for f in findings):
        later = "Ranges and commands are checked once the motion is plausible."
        return Inspected(rows, (*findings, Finding("commands", "cannot tell", later)))
    findings += _run_check("commands", lambda: _commands(rows, robot, motion))
    clean, ranges = _ranges(rows, robot, stated)
    of_kind = _run_check("robot", lambda: _kind_findings(clean, robot))
    is_open = any(f.flag or f.light == "red" for f in findings)  # tell asks these first, and judges again
    findings += [*ranges, *(f for f in of_kind if not (is_open and f.flag))]
    if not is_recording(robot.log):  # a recording of a run names its proposal itself
        findings += _run_check("proposal", lambda: _proposal(clean, robot.campaign, robot.log))
    return Inspected(rows, tuple(findings))


def _columns(log: Log, robot: _KnownRobot) -> Finding:
    """Which columns were matched, and how."""
    if not robot.channels:
        fact = f"{robot.why}, so each column is checked separately."
        return Finding("columns", "yellow", fact, "Name the robot with --robot, or see docs/inspect.md.")
    matched = ", ".join(f"{n} ({', '.join(c.parts)})" for n, c in log.channels.items())
    guessed = "" if robot.kind else "guessed from the headers, "
    sentences = [sentence for sentence in log.repairs if sentence not in cut_sentences(log)]
    return Finding("columns", "green", " ".join([f"Matched: {guessed}{matched}.", *sentences]))


def _motion(log: Log, robot: _KnownRobot, motion: Seen | None) -> tuple[Finding, ...]:
    if not robot.channels:
        return (
            Finding("motion", "cannot tell", "Without --robot it is unknown which columns are positions."),
        )
    if motion is None:
        what = "joint positions" if robot.path == "q" else robot.path
        fact = f"The log has no {what}, or is too short."
        return (Finding("motion", "cannot tell", fact),)
    usual = robot.rate if robot.kind else None
    truth = judge_motion(log, robot.path, robot.channels, robot.limits, usual, motion)
    clock = () if robot.kind is None else clock_by_file_of(robot.kind, robot.spec, log)
    return (*motion_findings(log, log.channels[robot.path], motion, robot.limits), *truth, *clock)


def _ranges(log: Log, robot: _KnownRobot, stated: Stated) -> tuple[Log, tuple[Finding, ...]]:
    """The cleaned log, or the same one where it would be refused; and what was done or refused."""
    if not robot.channels:
        return log, ()
    if robot.kind is None:
        return log, _run_check("units", lambda: _units(log, stated))
    try:
        clean = clean_log(log, robot.channels, robot.limits, stated, lambda log: log)
    except EtudeError as error:
        return log, (_refused("units and ranges", error),)
    if clean.repairs:
        return clean, (Finding("units and ranges", "yellow", " ".join(clean.repairs)),)
    return clean, (Finding("units and ranges", "green", "Units and ranges fit the robot."),)


def _units(log: Log, stated: Stated) -> tuple[Finding, ...]:
    check_lengths(log, stated)
    fact = "The values fit SI units; a robot's limits would allow a stricter check (--robot)."
    return (Finding("units", "green", fact),)


def _commands(log: Log, robot: _KnownRobot, motion: Seen | None) -> tuple[Finding, ...]:
    return judged_commands(robot.kind, robot.spec, log, motion, robot.earlier)


def _kind_findings(log: Log, robot: _KnownRobot) -> Sequence[Finding]:
    """Findings of the checks of the kind of robot."""
    if robot.kind is None:
        return ()
    return checks_of(robot.kind, robot.spec, log, own=is_recording(robot.log))


def _proposal(log: Log, campaign: Campaign | None, path: Path) -> Sequence[Finding]:
    """Which proposal of a campaign the log answers. DataError: of none, though one is open."""
    if campaign is None or not (state := campaign.state()).proposals:
        return ()
    earlier = state.round_of_log(sha256_of_log(path))
    if earlier is not None:
        return (Finding("proposal", "green", f"This log was ingested before, as {earlier.number}."),)
    answered = answered_proposal(campaign, state, log)
    if answered is None:
        return ()
    _, number, speed = answered
    slower = "" if speed == FULL else f", run at {speed} %"
    return (Finding("proposal", "green", f"The motion is that of proposal {number}{slower}."),)


def _run_check(check: str, action: Callable[[], Sequence[Finding]]) -> tuple[Finding, ...]:
    """The findings of a check; an unexpected error in the check is also reported as a finding."""
    try:
        return tuple(action())
    except EtudeError as error:
        return (_refused(check, error),)
    except UNEXPECTED as error:
        return (Finding(check, "cannot tell", f"This could not be computed: {error}."),)


def _refused(check: str, error: EtudeError) -> Finding:
    where = f" ({error.where})" if error.where else ""
    return Finding(check, "red", f"{error.fact[:1].upper()}{error.fact[1:]}{where}.", error.next_step)


def read_log(
    path: str | Path, robot: Campaign | str | Path, *, degrees: bool = False, topics: Sequence[str] = ()
) -> Log:
    """The log in a file: columns matched by name, units checked, rows repaired, a sentence for each repair.

    Args:
        path: a file or folder of a format that `etude plugins` lists under etude.readers.
        robot: the robot of the log: an open campaign, a built-in name, or the path of a description.
        degrees: the file's angles are degrees.
        topics: topics of a file with several; none: those of the campaign, or those that match.

    Raises:
        DataError: the log cannot be used; the message has the fault, its place, and the next step.
        UsageError: there is no such robot.
    """
    if isinstance(robot, Campaign):
        kind, spec, config = robot.kind, robot.spec, robot.config.log
    else:
        config = None
        kind, place = find_robot(str(robot))
        with reading(place):
            spec = kind.spec(place)
    expected = kind.expected(spec)
    return logs.read_log(
        path,
        kind.channels(spec),
        rate=expected.rate,
        degrees=degrees,
        limits=expected.limits,
        settle=LogQuestions(kind, spec, Answers()).motion,
        topics=topics,
        config=config,
    )
