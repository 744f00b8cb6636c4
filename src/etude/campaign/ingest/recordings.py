"""Recordings of motions that Étude sent: their proposal is known, so they need no alignment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.campaign.record.events import MotionEnded, RunBegan
from etude.campaign.record.folder import Campaign
from etude.campaign.record.journal import recorded
from etude.campaign.record.stored_files import FULL, name_of, speed_folder
from etude.deploy.trajectory_files import COEFFICIENTS
from etude.drivers import Ended, Recording, read_recording
from etude.drivers.recordings import HEADER
from etude.errors import DataError
from etude.logs.alignment.alignment import ended, with_plan
from etude.logs.columns.units import start_at_zero
from etude.logs.readers.frames import parquet_metadata
from etude.protocols import Trajectory
from etude.storage import sha256_of
from etude.trajectories.json_text import from_json
from etude.types import Array, Channel, Log

REST_S = 0.5
"""s of rest before and after a motion that are kept."""
STATES = 3
"""Position, velocity and acceleration: what a body's commands depend on."""
LEAST_TAUGHT_S = 2.0
"""s; a motion that was stopped earlier is not used for training."""
MOST_LATE = 0.2
"""Part of the cycles. With 0.4 (MuJoCo in real time, on a busy computer) commands no longer belonged to the
motion, and the evidence was that their sign is inverted.
"""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A recording and its origin.

    Attributes:
        recording: read from its file. control: control of the run; "" if the file is not in the journal.
        lacks_gravity: the robot adds gravity to the commands that it reports.
    """

    recording: Recording
    control: str
    lacks_gravity: bool = False

    @property
    def whole(self) -> bool:
        """Whether it reached the end of its motion, and the motion's time never stopped."""
        return self.recording.ended is Ended.DONE and not self.recording.held

    @property
    def trajectory(self) -> Trajectory:
        return from_json(self.recording.motion.trajectory_json)

    def answers(self, campaign: Campaign) -> int | None:
        """Number of its proposal, if it is the whole committed motion at full speed; otherwise None."""
        motion = self.recording.motion
        path = speed_folder(campaign, motion.number, FULL) / COEFFICIENTS
        committed = recorded(campaign.events()).get(name_of(campaign, path))
        is_full_motion = motion.part == "motion" and motion.speed == FULL and committed == motion.sha256
        to_the_end = motion.duration >= self.trajectory.duration - 1e-9
        return motion.number if is_full_motion and self.whole and to_the_end else None


def is_recording(path: Path) -> bool:
    """Whether a run wrote the file."""
    try:
        return path.suffix == ".parquet" and HEADER in parquet_metadata(path)
    except DataError:
        return False


def is_even(recording: Recording) -> bool:
    """Whether the robot was led by set-points in time."""
    return recording.late <= MOST_LATE * len(recording.t)


def evidence_in(campaign: Campaign, path: Path) -> Evidence | None:
    """The recording in a file; None of other files. DataError: it is damaged or uneven, or has too little."""
    if not is_recording(path):
        return None
    recording, digest = read_recording(path), sha256_of(path)
    control, began = "", None
    for fact in (e.fact for e in campaign.events()):
        if isinstance(fact, RunBegan):
            began = fact
        if isinstance(fact, MotionEnded) and fact.recording_sha256 == digest:
            control = fact.control
            break
    about = {} if began is None else began.told
    lacks_gravity = about.get("gravity_in_command") is False and about.get("command_of") != "measured"
    if recording.reached < LEAST_TAUGHT_S:
        raise DataError(
            f"the motion ended after {recording.reached:.2f} s, too early for training",
            where=str(path),
            next_step="Run it again.",
        )
    if not is_even(recording):
        raise DataError(
            f"{recording.late} of {len(recording.t)} cycles were late: set-points and commands are not "
            "those of the motion",
            where=str(path),
            next_step="Reduce the load of this computer or the driver's rate; then run the motion again.",
        )
    return Evidence(recording, control, lacks_gravity)


def log_of(campaign: Campaign, evidence: Evidence, source: str) -> Log:
    """The recorded data in the campaign's channels and order, in the time of the trajectory."""
    recording, path = evidence.recording, campaign.kind.path
    joints = recording.motion.joints
    order = [joints.index(axis) for axis in campaign.axes]
    t = recording.t - recording.began
    last = recording.reached + (REST_S if evidence.whole else 0.0)
    use = (t >= -REST_S) & (t <= last)
    for start, end in recording.held:
        use &= ~((recording.t >= start) & (recording.t <= end))
    values: dict[str, Array] = {path: recording.q[:, order], **_extra_channels(campaign.channels, recording)}
    rate = next((c.name for c in campaign.channels if c.derivative_of == path), "")
    values |= {rate: recording.qd[:, order]} if recording.qd is not None and rate else {}
    values.setdefault(campaign.command.name, recording.command[:, order])
    channels: dict[str, Channel] = {name: campaign.channel(name) for name in values}
    rows = {name: np.ascontiguousarray(value[use]) for name, value in values.items()}
    log = Log(t[use], channels, rows, source)
    added = file_gravity(campaign, log[path]) if evidence.lacks_gravity else None
    if added is None:
        return log
    log = log.put(campaign.command, log[campaign.command.name] + added)
    return log.repaired(
        "The robot adds gravity after its commands, so the gravity of the model file was added to the log."
    )


def _extra_channels(channels: Sequence[Channel], recording: Recording) -> dict[str, Array]:
    """(n, parts) values of each channel that the robot records in addition to its joints, by log columns."""
    names = {c.name: [f"{c.name}_{part}" for part in c.parts] for c in channels}
    return {
        channel: np.stack([recording.extra[name] for name in columns], axis=1)
        for channel, columns in names.items()
        if all(name in recording.extra for name in columns)
    }


def file_gravity(campaign: Campaign, q: Array) -> Array | None:
    """(n, k) gravity commands by the model file in poses q (n, k); None without a file, or for other units.

    For a robot that adds gravity by itself, they are added to the learned commands and subtracted from those
    that are sent. So an error of the file has no effect.
    """
    from etude.campaign.ingest.questions import body_of

    body, path = body_of(campaign.kind, campaign.spec), campaign.kind.path
    if body is None:
        return None
    channels = [campaign.channel(path)]
    while len(channels) < STATES and (
        rates := [c for c in campaign.channels if c.derivative_of == channels[-1].name]
    ):
        channels.append(rates[0])
    values = {c.name: q if order == 0 else np.zeros_like(q) for order, c in enumerate(channels)}
    still = Log(np.arange(len(q), dtype=float), {c.name: c for c in channels}, values)
    return np.asarray(body.predict(still))


def placed(campaign: Campaign, evidence: Evidence, log: Log) -> tuple[Log, int | None]:
    """The cleaned log with its plan and proposal number if it has one; otherwise the log alone and None."""
    number = evidence.answers(campaign)
    if number is not None:
        return planned_log(campaign, evidence, log), number
    recording = evidence.recording
    why = recording.reason or recording.ended.value
    sentence = f"The motion ended at {recording.reached:.2f} s ({why}); the log is used up to there."
    return start_at_zero(log).repaired(sentence), None


def planned_log(campaign: Campaign, evidence: Evidence, log: Log) -> Log:
    """The log with the planned motion at its own times, since set-points lag after lost cycles."""
    trajectory, recording = evidence.trajectory, evidence.recording
    log = ended(log, trajectory.duration)
    t = recording.t - recording.began
    lag = np.where((recording.at > 0.0) & (recording.at < trajectory.duration), t - recording.at, 0.0)
    lag = np.where(np.abs(lag) > 0.5 / recording.motion.rate, lag, 0.0)
    planned = replace(log, t=log.t - np.interp(log.t, t, lag))
    return replace(with_plan(planned, trajectory, campaign.channels, campaign.kind.path), t=log.t)
