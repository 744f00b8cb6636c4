"""The contract of `etude run FOLDER --on DRIVER`: the duties of a robot that Étude may move.

Two levels, because there are two kinds of robots. A `Stream` takes a set-point in each cycle, 50 to 1000
times a second: a user's own class of about 30 lines. `streaming.Streamed` makes a Player of it, and then
Étude keeps the clock, watches and records. A `Player` plays whole motions itself, and calls `watch` with
every sample.

A driver is a factory of one of the two: an entry point of the group `etude.drivers`, `module:factory` or
`file.py:factory`. It is called with the joints' names, the address and the table [driver] of run.toml.
`etude.testing.DriverSuite` holds it to the laws that the docstrings state.

Units are SI and radians; arrays are in the order of `About.joints`, which is never assumed.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Literal, Protocol, Self, runtime_checkable

from etude.types import Array

Control = Literal["feedback", "file", "learned"]
"""Words of `etude ask --control`: margins and logs are kept for each."""
CommandOf = Literal["applied", "measured", "desired"]
OnLoss = Literal["stops", "holds", "goes on", "falls", "unknown"]
MotionPart = Literal["approach", "motion", "return", "hold"]


class Reaction(enum.Enum):
    """The supervisor's answer to a sample. A Player obeys within `About.stop_latency` s."""

    GO = "go"
    HOLD = "hold"
    """Slow down along the path to rest, and wait; a STOP if `About.can_hold` is False."""
    STOP = "stop"
    """Come to rest as fast as is gentle, and go on holding; the motion is over."""
    KILL = "kill"
    """Stop at once, by any means."""


class Ended(enum.Enum):
    """How a motion ended. Only DONE answers the whole proposal."""

    DONE = "done"
    STOPPED = "stopped"
    """By the supervisor, with its reason."""
    INTERRUPTED = "interrupted"
    """By the person: Ctrl-C, SIGTERM, the dead-man switch."""
    REFUSED = "refused"
    """The robot would not start it: nothing moved."""
    FAULT = "fault"
    """The robot stopped by itself: reflex, protective stop, emergency stop, limit."""
    LOST = "lost"
    """No sample for `About.silence` s; what the robot does then is `About.on_loss`."""


@dataclass(frozen=True, eq=False)
class Sample:
    """One state of the robot.

    Attributes:
        t: the robot's own clock, s.
        q: (J,) measured positions, rad or m. qd: (J,) measured velocities, if it measures them.
        command: (J,) commands that the model predicts, in the campaign's unit; see `About.command_of`.
        asked: (J,) the set-point in force at t, if the robot reports it. Approaches start there, since
            feedback sags.
        seen: this computer's clock at arrival, s; a Player fills it. It shows silence, lateness and drift,
            and counts cycles if the robot's clock is virtual.
        at: trajectory time of `asked`, s; a Player fills both, None before the first set-point.
        fault: the reason if the robot does not follow any more; otherwise empty.
        extra: other measurements, by column of a log: rates_x of a vehicle, for example; command_NAME of each
            rotor, if there is not one command for each joint; temperature, voltage, ...
    """

    t: float
    q: Array
    command: Array | None = None
    qd: Array | None = None
    asked: Array | None = None
    seen: float = 0.0
    at: float | None = None
    fault: str = ""
    extra: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class VelocityEnvelope:
    """Velocity limits that shrink towards a joint's ends, as controllers of Franka robots enforce them.

    The upper limit of joint j at q is min(most, offset + sqrt(slope * (upper - q))), the lower one
    -min(most, offset + sqrt(slope * (q - lower))); below 0 they count as 0. All (J,).
    """

    most: Array
    offset: Array
    slope: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class About:
    """A robot's description of itself, needed before it moves. Nothing is guessed: a missing value blocks.

    Attributes:
        name: of the robot. identity: serial number, bus path or address; it is written into every recording,
            and a change needs a confirmation. payload: kg in the robot's setting, beyond what is always
            mounted; a change needs a confirmation, too. None: there is no such setting, or it is known only
            after the connection.
        joints: names, which are matched with the campaign's, never by order alone.
        rate: Hz at which it takes set-points (a Stream) or gives samples (a Player).
        command_unit: "N m", "A", "1", ...: has to be the campaign's. command_of: meaning of `Sample.command`.
        gravity_in_command: False where the robot adds gravity by itself (libfranka, UR's direct torque).
        controls: "learned" only if the effort of `send` is added to the feedback.
        learned_as: meaning of `send`'s effort. "": the model's command. The name of an exporter: the learned
            part of the accelerations in its files, m/s^2, in addition to the motion's own. It decreases with
            the speed while a motion is braked.
        lower, upper, velocity, acceleration, jerk, command, torque_rate: (J,) limits that the robot enforces;
            None: it enforces none. command: where drives saturate. envelope: velocity limits by position.
        can_hold: the robot can obey HOLD and continue after it.
        stop_latency: s from STOP to the first decelerating set-point.
        stopping_time: largest time from `stop` to rest of a moving robot, s; it then holds its pose.
        on_loss: reaction if this program dies: the robot brakes and holds, holds its last set-point, goes on,
            or its motors stop and it falls.
        silence: s without a sample that count as a lost link.
        encoder_step: (J,) rad or m of one step; None: unknown.
        real: False for a simulation, which needs nobody at the button.
        virtual: the robot's clock is simulated: it alone measures cycles, silence and lateness.
    """

    name: str
    identity: str
    joints: tuple[str, ...]
    rate: float
    command_unit: str
    command_of: CommandOf | None
    gravity_in_command: bool | None
    controls: tuple[Control, ...] = ("feedback",)
    learned_as: str = ""
    lower: Array | None = None
    upper: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    jerk: Array | None = None
    command: Array | None = None
    torque_rate: Array | None = None
    envelope: VelocityEnvelope | None = None
    can_hold: bool = False
    stop_latency: float = 0.05
    stopping_time: float = 0.5
    on_loss: OnLoss = "unknown"
    silence: float = 0.1
    encoder_step: Array | None = None
    real: bool = True
    virtual: bool = False
    payload: float | None = None

    @property
    def answers_as(self) -> str:
        """Its identity, and what it is set to carry."""
        return identity_with(self.identity, self.payload)


CARRIES = ", set to carry "


def identity_with(identity: str, payload: float | None) -> str:
    """A robot's identity, and the payload that it is set to carry, kg."""
    return identity if payload is None else f"{identity}{CARRIES}{payload:g} kg"


def is_identity_of(identity: str, about: About) -> bool:
    """Whether an identity with a payload is this robot's; without its payload, the identity alone counts."""
    return (identity if about.payload is not None else identity.partition(CARRIES)[0]) == about.answers_as


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """What is to be run. The supervisor, the recording and the journal all name it by `sha256`.

    Attributes:
        number: of the proposal. part: of it. speed: per cent. sha256: of the bytes of `trajectory_json`.
        joints: in the order of the columns, which is the driver's own; names: in that of the trajectory.
        t: (n,) s at rate Hz (`About.rate`), from 0; the last row is the end, exactly.
        q, qd, qdd: (n, J) exact at these times.
        effort: (n, J) learned command, of which `About.learned_as` says what it is, less gravity where the
            robot adds it; None: feedback alone.
        trajectory_json: for a Player that wants pieces rather than points.
    """

    number: int
    part: MotionPart
    speed: int
    sha256: str
    joints: tuple[str, ...]
    names: tuple[str, ...]
    rate: float
    t: Array
    q: Array
    qd: Array
    qdd: Array
    effort: Array | None = None
    trajectory_json: str = ""

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.t[-1])


@dataclass(frozen=True, eq=False)
class Recording:
    """The recording of a motion. `trajectory time = robot time - began` is exact, so it needs no alignment.

    Attributes:
        motion: the planned one. ended: its end. reason: a sentence on the end; of STOPPED it is
            `Supervisor.reason`, which a Player does not know and leaves "".
        began: the robot's clock at trajectory time 0, s. t: (n,) the robot's clock.
        at: (n,) trajectory time of the set-point in force, s: t - began, except for waits and braking.
        q, command, asked: (n, J); asked is the set-point in force at each t. qd: None if not measured.
            NaN where a sample lacked the value.
        reached: trajectory time that was reached, s. late: number of missed cycles.
        identity, command_unit: as `About` had them at that time.
        held: (start, end) s of the robot's clock from the first braking set-point of a HOLD to full speed.
        extra: (n,) each of the samples' other measurements; NaN where a sample lacked one.
    """

    motion: PlannedMotion
    ended: Ended
    reason: str
    began: float
    t: Array
    at: Array
    q: Array
    qd: Array | None
    command: Array
    asked: Array
    reached: float
    late: int = 0
    identity: str = ""
    command_unit: str = ""
    held: tuple[tuple[float, float], ...] = ()
    extra: Mapping[str, Array] = field(default_factory=dict)


Watch = Callable[[Sample], Reaction]
"""The supervisor: called with every sample, in the order in which they come."""


@runtime_checkable
class Stream(Protocol):
    """A robot that takes a set-point in each cycle. One thread makes all calls, except `stop`."""

    def about(self) -> About:
        """Description of the robot, also before `__enter__`; moves nothing."""
        ...

    def __enter__(self) -> Self:
        """Connect. Nothing moves, and brakes stay as they are."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """Come to rest and disconnect, also after a fault."""
        ...

    def state(self) -> Sample:
        """The newest sample. The call may wait for up to one cycle: then the robot is the clock."""
        ...

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        """Send the set-point (J,) of the coming cycle, due at the next sample. Returns at once."""
        ...

    def ready(self, control: Control) -> None:
        """Start to follow set-points from the present pose: servo mode, torque on."""
        ...

    def stop(self, kill: bool = False) -> None:
        """Come to rest and hold. From any thread or signal handler; idempotent; never raises; works without
        `ready`.
        """
        ...


@runtime_checkable
class Player(Protocol):
    """A robot that plays whole motions itself."""

    def about(self) -> About: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...

    def where(self) -> Sample:
        """A new sample, never a cached one; moves nothing."""
        ...

    def check(self, motion: PlannedMotion) -> Sequence[str]:
        """Reasons to refuse this motion, a sentence each; moves nothing."""
        ...

    def play(self, motion: PlannedMotion, watch: Watch, control: Control) -> Recording:
        """Play a motion from its first point, where the robot has to stand (else `Ended.REFUSED`), and block.

        Records from before the first set-point until rest. Never raises for a reaction of the robot:
        `Recording.ended` reports it.
        """
        ...

    def stop(self, kill: bool = False) -> None:
        """As `Stream.stop`."""
        ...


Factory = Callable[[tuple[str, ...], str, Mapping[str, Any]], "Stream | Player"]
"""(joints of the campaign, address or "", table [driver] of run.toml) -> driver. It does not connect."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of the supervisor. All (J,), except where a float.

    Attributes:
        error: |q - asked|. A tracking margin holds in 95 % of runs by design, so a bound is larger:
            4 times an assumed margin, twice a measured one, and at least 5 encoder steps; never beyond the
            distance to the hard limit.
        for_s: s that an error has to last. One sample is a glitch of the bus, 20 ms are a collision.
        lower, upper, velocity: hard limits of measured values. effort: of |command|; None: unknown.
        residual: of |command - predicted|, means over 0.1 s, under the learned command, where stiff feedback
            hides a push from `error`; None before logs give a value.
        silence: s without a sample. clock: largest drift between the robot's clock and this computer's, s.
    """

    error: Array
    lower: Array
    upper: Array
    velocity: Array
    for_s: float = 0.02
    silence: float = 0.1
    effort: Array | None = None
    residual: Array | None = None
    clock: float = 0.5


class Person(Protocol):
    """The person at the stop button."""

    def agrees(self, sentences: Sequence[str], word: str) -> bool:
        """Show sentences on the motion: place, duration, speed; wait for `word`, typed in full."""
        ...

    def alive(self) -> bool:
        """The dead-man switch: False stops the motion."""
        ...
