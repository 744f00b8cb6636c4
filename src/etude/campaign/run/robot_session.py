"""Session with a connected robot: motions in sequence, each in the journal before its first set-point."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from etude.campaign.ingest.recordings import file_gravity
from etude.campaign.record.events import Figures, MotionEnded, MotionSent, RobotMotion
from etude.campaign.record.folder import Campaign
from etude.campaign.record.journal import jsonable
from etude.campaign.run.certified_motions import CertifiedMotion, require_accepted
from etude.campaign.run.run_history import slowest
from etude.drivers import (
    About,
    Bounds,
    Ended,
    Person,
    PlannedMotion,
    Player,
    Reaction,
    Recording,
    Sample,
    Supervisor,
    write_recording,
)
from etude.errors import EtudeError, LinkLost, RobotStopped, UnsafeTrajectoryError, UsageError, typed
from etude.storage import sha256_of
from etude.types import Array, Index

RECORDINGS, KEPT_RECORDINGS = "recordings", 60
"""Where they are, and how many of motions that ended well stay: logs that were taken in are in runs, too."""
STATUS_S = 1.0
"""Between two lines of status."""
MEAN_S = 0.1
"""Over which residuals of commands are averaged."""
BEFORE_STOP_S, SATURATED = 0.5, 0.99
"""s before a stop in which a command counts as its cause, from this part of its limit."""
BYTES_A_VALUE, LEAST_FREE = 8, 64 * 2**20
"""Of a recording before it is packed; bytes that stay free on the disk beside it."""
JOURNAL_WAIT_S = 600.0
"""For another writer when a motion has ended: what is computed meanwhile is one."""
Tell = Callable[[str, Mapping[str, Any]], None]
"""Receives the name of an event and what it holds."""
OnSample = Callable[[Campaign, PlannedMotion, Sample], None]
"""Receives each sample of a motion, and returns at once."""


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a motion.

    Attributes:
        fact: its end, as in the journal. recording: its recording. path: file of the recording.
    """

    fact: MotionEnded
    recording: Recording
    path: Path

    @property
    def done(self) -> bool:
        return self.fact.ended == Ended.DONE.value


@dataclass(eq=False)
class RobotSession:
    """A connected robot and the present level of its learned command.

    Attributes:
        waived: sentences that a simulation waives. seconds: of motion so far.
        level: of the last learned command, 0 or 1.
        on: the driver's name, as typed. seen: a further receiver of the samples.
        stood_since: this computer's clock at the end of the last motion, s. stood: s of rest between motions.
    """

    campaign: Campaign
    player: Player
    about: About
    person: Person
    tell: Tell
    waived: tuple[str, ...] = ()
    on: str = ""
    seen: OnSample = lambda _, __, ___: None
    level: float = 0.0
    seconds: float = 0.0
    stood_since: float | None = None
    stood: float = 0.0
    interrupted: threading.Event = field(default_factory=threading.Event)

    @property
    def columns(self) -> Index:
        """Columns of the campaign's axes in the driver's arrays."""
        return np.array([self.about.joints.index(axis) for axis in self.campaign.axes])

    def pose(self) -> Array:
        """(k,) the robot's pose: the set-point that holds it, or else the measured one.

        Raises:
            LinkLost: it does not say. RobotStopped: it reports a fault.
        """
        sample = self.player.where()
        if sample.fault:
            raise RobotStopped(
                f"{self.about.name} reports a fault: {sample.fault}",
                next_step="Clear it at the robot, then run again.",
            )
        q = sample.q if sample.asked is None else sample.asked
        if not np.isfinite(q).all() or q.shape != (len(self.about.joints),):
            raise LinkLost(
                f"{self.about.name} does not report its position",
                next_step="Check its connection, then run again.",
            )
        return np.asarray(q[self.columns], dtype=float)

    def play(self, motion: CertifiedMotion, meanwhile: Callable[[], None] = lambda: None) -> Result:
        """Send one motion, which is in the journal before it starts, and store its recording.

        meanwhile: starts what is computed while it moves, and may hold the journal until that is done.

        Raises:
            UnsafeTrajectoryError: the robot refuses it. RobotStopped: it was stopped, or stopped by itself.
            LinkLost: nothing was heard of the robot. KeyboardInterrupt: a person stopped it.
            UsageError: another robot answers now. EtudeError: no room on the disk; nothing moved.
        """
        planned = motion.for_driver(self.campaign, self.about)
        require_accepted(self.player.check(planned), motion)
        self._require_same_robot()
        require_room(self.campaign.path, planned)
        fact = RobotMotion(
            part=motion.part,
            speed=motion.speed,
            first=motion.first,
            sha256=planned.sha256,
            control=motion.control,
            identity=self.about.identity,
        )
        with self.campaign.writing():
            sent = MotionSent(**vars(fact), start=tuple(motion.start.tolist()))
            self.campaign.commit(sent, motion.number)
        self.tell("motion_sent", {"number": motion.number, "duration": planned.duration, **vars(fact)})
        meanwhile()
        result = self._store_end(motion, fact, *self._play_recorded(motion, planned))
        self.level = motion.fade[1] if motion.learned is not None else 0.0
        self._require_done(motion, result)
        return result

    def _play_recorded(self, motion: CertifiedMotion, planned: PlannedMotion) -> tuple[Recording, Supervisor]:
        bounds = _in_driver_order(motion.bounds(self.campaign, self.about), self.about, self.campaign)
        predicted = motion.predicted(planned.t)
        predicted = None if predicted is None else predicted[:, np.argsort(self.columns)]
        supervisor = Supervisor(bounds, self.about, planned, predicted)
        watch = _Watching(self, supervisor, planned)
        if self.stood_since is not None:
            self.stood += time.monotonic() - self.stood_since
        with resting_on_signals(self.player, self.interrupted):
            recording = self.player.play(planned, watch, motion.control)  # type: ignore[arg-type]
        self.stood_since = time.monotonic()
        self.seconds += recording.reached
        if self.interrupted.is_set() and recording.ended in (Ended.STOPPED, Ended.FAULT):
            recording = replace(recording, ended=Ended.INTERRUPTED)
        if supervisor.reason and recording.ended is Ended.STOPPED:
            recording = replace(recording, reason=supervisor.reason)
        return recording, supervisor

    def _store_end(
        self,
        motion: CertifiedMotion,
        fact: RobotMotion,
        recording: Recording,
        supervisor: Supervisor,
    ) -> Result:
        """Store the recording and commit the end of the motion."""
        path, problem = free_path(self.campaign.path / RECORDINGS, f"{motion.number:04d}.{motion.part}"), None
        try:
            write_recording(path, recording)
        except EtudeError as error:  # that the motion ended is worth more than what it left
            problem = error
        worst = supervisor.worst_error[self.columns]
        ended = MotionEnded(
            **vars(fact),
            ended=recording.ended.value,
            reason=recording.reason,
            reached=float(recording.reached),
            late=recording.late,
            worst_error=jsonable(worst),
            residual=self._residual(motion, recording),
            recording="" if problem else path.relative_to(self.campaign.path).as_posix(),
            recording_sha256="" if problem else sha256_of(path),
        )
        with self.campaign.writing(JOURNAL_WAIT_S):
            self.campaign.commit(ended, motion.number)
        prune_recordings(self.campaign)
        self.tell("motion_ended", {"number": motion.number, **vars(ended)})
        if problem is not None:
            raise problem
        return Result(ended, recording, path)

    def _residual(self, motion: CertifiedMotion, recording: Recording) -> Figures:
        """(k,) largest mean over `MEAN_S` of |command - predicted|; () where nothing was predicted."""
        t = recording.at
        inside = (t > 0.0) & (t < recording.reached)
        predicted = motion.predicted(t[inside])
        if predicted is None or inside.sum() < 2:
            return ()
        residuals = recording.command[inside][:, self.columns] - predicted
        rows = max(1, round(MEAN_S * (inside.sum() - 1) / max(float(np.ptp(t[inside])), MEAN_S)))
        total = np.cumsum(np.vstack([np.zeros(residuals.shape[1]), residuals]), axis=0)
        return jsonable(np.abs(total[rows:] - total[:-rows]).max(axis=0) / rows)

    def _require_same_robot(self) -> None:
        now, before = self.player.about().answers_as, self.about.answers_as
        if now != before:
            raise UsageError(
                f"another robot answers now: {now!r}, not {before!r}",
                next_step="Check the address and the payload; nothing was sent to it.",
            )

    def _require_done(self, motion: CertifiedMotion, result: Result) -> None:
        """The error of a motion that did not reach its end."""
        fact, where = result.fact, f"{motion.part} {motion.number}, {result.fact.reached:.2f} s"
        why = fact.reason.rstrip(".") or fact.ended
        on = f" --on {typed(self.on)}" if self.on else ""
        next_step = (
            f"Remove the cause, then: etude run {typed(self.campaign.path)}{on}. It plans a new approach "
            "from there."
        )
        if result.done:
            return
        if fact.ended == Ended.INTERRUPTED.value:
            raise KeyboardInterrupt
        if fact.ended == Ended.REFUSED.value:
            raise UnsafeTrajectoryError(f"the robot did not start: {why}", where=where, next_step=next_step)
        if fact.ended == Ended.LOST.value:
            does = after_loss(self.about)
            raise LinkLost(
                f"no sample came from {self.about.name}: {why}",
                where=where,
                next_step=f"{does[0].upper()}{does[1:]}. {next_step}",
            )
        raise RobotStopped(
            f"stopped: {why}", where=where, next_step=f"{next_step}{self._if_again(motion, result.recording)}"
        )

    def _if_again(self, motion: CertifiedMotion, recording: Recording) -> str:
        """The next step if the next run stops at the same place."""
        weak = self._too_weak(recording)
        slow = motion.speed == slowest(motion.control)
        if not weak and not slow:
            return ""
        mend = "limits or home" if slow else "its velocity and acceleration"
        # the model file is part of the campaign, which refuses another one
        masses = " With corrected masses begin anew: etude init FOLDER --robot FILE." if slow else ""
        return (
            f"{weak} If it stops there again without an obstacle, correct {mend} in robot.toml, and write "
            f"another motion: etude ask {typed(self.campaign.path)} --new.{masses}"
        )

    def _too_weak(self, recording: Recording) -> str:
        """A sentence on a command that was at its limit just before the end; "" if none was."""
        by_joint = self.campaign.command.acts_on == self.campaign.kind.path  # a vehicle has other commands
        if recording.command is None or not by_joint:
            return ""
        at = recording.at
        last = (at > recording.reached - BEFORE_STOP_S) & (at <= recording.reached)
        limit = np.asarray(self.campaign.kind.limit(self.campaign.spec), dtype=float)
        used = np.abs(recording.command[last][:, self.columns]) / limit
        if not len(used):
            return ""
        joint = int(np.argmax(used.max(axis=0)))
        if not used[:, joint].max() >= SATURATED:
            return ""
        unit = self.campaign.command.units[joint]
        # a body that is heavier than its file is the usual cause, and this number shows it
        rest = file_gravity(self.campaign, recording.q[last][-1:, self.columns])
        expected = (
            "" if rest is None else f"; at rest there the model file expects {rest[0, joint]:.3g} {unit}"
        )
        axis, most = self.campaign.axes[joint], limit[joint]
        return f" The command of {axis} was at its limit, {most:.3g} {unit}{expected}."


def after_loss(about: About) -> str:
    """The robot's reaction to a lost link, as a clause."""
    does = {
        "stops": "it stops by itself",
        "holds": "it holds where it is",
        "goes on": "it GOES ON",
        "falls": "it FALLS",
    }
    return does.get(about.on_loss, "its reaction is unknown")


class _Watching:
    """The supervisor, the dead-man switch, and a line of status a second."""

    def __init__(self, session: RobotSession, supervisor: Supervisor, planned: PlannedMotion) -> None:
        self.session, self.supervisor, self.planned = session, supervisor, planned
        self.reported = time.monotonic()

    def __call__(self, sample: Sample) -> Reaction:
        reaction = self.supervisor.watch(sample)
        self.session.seen(self.session.campaign, self.planned, sample)
        if reaction is Reaction.GO and not self.session.person.alive():
            self.session.interrupted.set()
            return Reaction.STOP
        now = time.monotonic()
        if now - self.reported >= STATUS_S:
            self.reported = now
            worst = self.supervisor.worst_error[self.session.columns]
            fields = {"number": self.planned.number, "part": self.planned.part, "at": sample.at}
            fields |= {"of": self.planned.duration, "worst_error": worst.tolist()}
            self.session.tell("status", fields)
        return reaction


def _in_driver_order(bounds: Bounds, about: About, campaign: Campaign) -> Bounds:
    """The bounds in the driver's order of joints."""
    order = np.array([campaign.axes.index(joint) for joint in about.joints])
    arrays = {name: value[order] for name, value in vars(bounds).items() if isinstance(value, np.ndarray)}
    return replace(bounds, **arrays)


Handler = Callable[[int, FrameType | None], Any]


def resting_on_signals(player: Player, interrupted: threading.Event) -> AbstractContextManager[None]:
    """While the robot moves, Ctrl-C and SIGTERM bring it to rest; a second one stops it at once."""

    def come_to_rest(_: object) -> Handler:
        def handle(_: int, __: FrameType | None) -> None:
            player.stop(kill=interrupted.is_set())
            interrupted.set()

        return handle

    return _on_signals(come_to_rest)


def held_on_signals(player: Player) -> AbstractContextManager[None]:
    """While the robot stands, Ctrl-C and SIGTERM let it hold first, and then act as before."""

    def hold(before: Any) -> Handler:
        def handle(number: int, frame: FrameType | None) -> None:
            with contextlib.suppress(Exception):
                player.stop()
            if callable(before):
                before(number, frame)
            elif before is signal.SIG_DFL:
                raise KeyboardInterrupt

        return handle

    return _on_signals(hold)


@contextlib.contextmanager
def _on_signals(made: Callable[[Any], Handler]) -> Iterator[None]:
    """Ctrl-C and SIGTERM handled by what is made of their handlers so far; of the main thread alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        signal.signal(number, made(handler))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def require_room(folder: Path, motion: PlannedMotion) -> None:
    """UsageError: the disk has no room for what the motion will leave; nothing moves."""
    arrays = 4 * motion.q.size * BYTES_A_VALUE
    free = shutil.disk_usage(folder).free
    if free < arrays + LEAST_FREE:
        raise UsageError(
            f"the disk has {free / 2**20:.0f} MB left; a recording may take {arrays / 2**20:.0f} MB, and "
            f"{LEAST_FREE / 2**20:.0f} MB have to stay free",
            where=str(folder),
            next_step="Nothing moved. Free some space, then run the command again.",
        )


def prune_recordings(campaign: Campaign) -> None:
    """Remove recordings of motions that ended well, except the newest; those of stopped motions stay."""
    events = [e.fact for e in campaign.events() if isinstance(e.fact, MotionEnded)]
    done = [fact.recording for fact in events if fact.ended == Ended.DONE.value and fact.recording]
    for name in set(done[:-KEPT_RECORDINGS]) - set(done[-KEPT_RECORDINGS:]):
        (campaign.path / name).unlink(missing_ok=True)


def free_path(folder: Path, stem: str) -> Path:
    """A new file name in the folder: stem.1.parquet, stem.2.parquet, ..."""
    folder.mkdir(exist_ok=True)
    taken = {
        int(number) for path in folder.glob(f"{stem}.*") if (number := path.name.split(".")[2]).isdigit()
    }
    return folder / f"{stem}.{max(taken, default=0) + 1}.parquet"


@contextlib.contextmanager
def only_one(campaign: Campaign, about: About) -> Iterator[None]:
    """Lock for one run at a time of a campaign, and of a real robot. UsageError: there is another run."""
    with contextlib.ExitStack() as held:
        held.enter_context(
            _lock_file(campaign.path / ".run.lock", "another etude run is active in this campaign")
        )
        if about.real:
            named = hashlib.sha256(about.identity.encode()).hexdigest()[:16]
            place = _runtime_folder() / f"robot-{named}.lock"
            held.enter_context(_lock_file(place, f"another etude run moves this robot, {about.identity}"))
        yield


def _runtime_folder() -> Path:
    """This user's folder for locks, which a new start of the machine empties."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "etude" if base else Path(tempfile.gettempdir()) / f"etude-{os.getuid()}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _lock_file(path: Path, fact: str) -> Iterator[None]:
    import fcntl

    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(fact, where=str(path), next_step="Let it end, or stop it with Ctrl-C.") from None
        yield
    finally:
        os.close(handle)
