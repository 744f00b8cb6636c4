"""Value types of all parts of Étude; `protocols` has the interfaces of plug-ins.

Shapes: T planned or logged instants, n training samples, k path coordinates (joints; x, y, z), O derivative
orders (0 = position), P parameters of a family, D model inputs, J commands, m of them learned together. SI
units and radians; commands in the robot's own unit. Values are frozen, checked where they enter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from etude._runtime.pictures import Picture

Array = NDArray[np.float64]


Index = NDArray[np.int64]


Mask = NDArray[np.bool_]


Role = Literal["state", "command", "plan", "aside", "truth"]


Row = Mapping[str, Array]  # one instant of a log: (parts,) by channel name


Margins = Mapping[
    str, tuple[Array, Array | float]
]  # by Trajectory.form: (O, k), NaN where not held, and its confidence, 0 where assumed: (O, k) or one number


Column = tuple[str, str, str, str]  # an input: channel, part, unit, op ("": the channel itself; "tanh", ...)


@dataclass(frozen=True)
class Channel:
    """A named signal: `Channel("q", ("lift", "elbow"), ("m", "rad"))`; in files its columns are q_lift,
    q_elbow. role: "state" a possible model input; "command" a model output; "plan" a desired value;
    "aside" any other; "truth" known to simulators only. required: a log without it is refused. For the log
    checks: derivative_of, the channel whose rate this is; acts_on, the coordinate that this command
    does work on; reach, the largest true values; quantum, the sensor's step. nominal: the value in a plan
    of a state that does not follow from the motion (volts).
    """

    name: str
    parts: tuple[str, ...]
    units: tuple[str, ...]
    role: Role = "state"
    required: bool = False
    derivative_of: str = ""
    acts_on: str = ""
    reach: tuple[float, ...] = ()
    quantum: tuple[float, ...] = ()
    nominal: tuple[float, ...] = ()


@dataclass(frozen=True)
class Finding:
    """Result of one log check: a sentence, the next step, spans (s) to mark. flag: the question to the user
    that it raises; "": none, since it is certain and is refused or repaired. light "cannot tell": the check
    is not decided, neither a detection nor a false alarm.
    """

    check: str
    light: Literal["green", "yellow", "red", "cannot tell"]
    sentence: str
    step: str = ""
    flag: str = ""
    spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """A motion, recorded or planned: t (T,) s, increasing, 0 where the trajectory starts; values by
    channel name, each (T, parts). The table is the same for every robot; missing channels are absent.
    repairs: a sentence each. A reader returns a Log for each topic, with a channel for each raw column, not
    matched and not converted.
    """

    t: Array
    channels: Mapping[str, Channel]
    values: Mapping[str, Array]
    source: str = ""
    repairs: tuple[str, ...] = ()

    def __repr__(self) -> str:
        span = f"{self.t[0]:.3g} to {self.t[-1]:.3g} s" if len(self.t) else "empty"
        parts = ", ".join(f"{n} ({len(c.parts)})" for n, c in self.channels.items())
        return f"Log of {len(self.t)} rows, {span}, from {self.source or 'nowhere'}: {parts}"

    def plot(self, path: str | Path | None = None) -> Picture:
        """States and commands over time: shown by a notebook, and saved as SVG if there is a path."""
        from etude._runtime.pictures import picture_of

        return picture_of("log", self, path)

    def __len__(self) -> int:
        return len(self.t)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> Array:
        """(T, parts) of that channel. KeyError with the channels that there are."""
        if name not in self.values:
            raise KeyError(f"the log has no channel {name!r}; it has {', '.join(self.values)}")
        return self.values[name]

    def get(self, name: str) -> Array | None:
        """(T, parts) of that channel, None if the log lacks it."""
        return self.values.get(name)

    def take(self, index: Index | Mask | slice) -> Log:
        """The rows at `index`, in all channels."""
        return replace(self, t=self.t[index], values={n: v[index] for n, v in self.values.items()})

    def put(self, channel: Channel, values: Array) -> Log:
        """The log with one more channel, or one channel replaced; values (T, parts)."""
        shape = (len(self.t), len(channel.parts))
        if values.shape != shape:
            raise ValueError(f"channel {channel.name} has shape {values.shape}, not {shape}")
        return replace(
            self,
            channels={**self.channels, channel.name: channel},
            values={**self.values, channel.name: values},
        )

    def without(self, *names: str) -> Log:
        """The log without these channels."""
        return replace(
            self,
            channels={n: c for n, c in self.channels.items() if n not in names},
            values={n: v for n, v in self.values.items() if n not in names},
        )

    def repaired(self, *sentences: str) -> Log:
        """The log with more repairs on record."""
        return replace(self, repairs=(*self.repairs, *sentences))


def joined_logs(parts: Sequence[Log]) -> Log:
    """Concatenated rows of the logs, times unchanged, with the channels that all of them have."""
    names = [n for n in parts[0].values if all(n in part for part in parts)]
    return replace(
        parts[0],
        t=np.concatenate([part.t for part in parts]),
        channels={n: parts[0].channels[n] for n in names},
        values={n: np.concatenate([part.values[n] for part in parts]) for n in names},
    )


@dataclass(frozen=True, eq=False)
class Expected:
    """Expected values of a robot's logs, for the log checks. rate: usual recording rate in Hz, for the unit
    of times; scale (k,): sizes of the path's coordinates, to normalise motions; limits: lower and upper
    (parts,) of positions, their rates and commands, by channel; rest: keep rows before and after
    the trajectory (a joint at rest is informative, a vehicle on the ground is not).
    """

    rate: float
    scale: Array
    limits: Mapping[str, tuple[Array, Array]]
    rest: bool = True


TARGET = "target"
"""The channel of samples with the reference commands for all prediction errors."""


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """Training samples: rows of several logs at the model's rate. log: states, plans, "command" (n, J); the
    memory of inputs (friction) is a state in it, computed on the whole log before thinning. group (n,):
    number of the segment; its samples are held out together. usable (n, J): False where that command has no
    information (on the ground, braked, saturated); moving (n, J): False where it has little (joint at rest).
    Scores are given over both.
    """

    log: Log
    group: Index
    usable: Mask
    moving: Mask

    def __repr__(self) -> str:
        return f"Samples of {len(np.unique(self.group))} groups, {self.log!r}"

    def __len__(self) -> int:
        return len(self.log)

    @property
    def t(self) -> Array:
        """(n,) s inside each sample's own log."""
        return self.log.t

    @property
    def command(self) -> Array:
        """(n, J) the commands that models predict."""
        return self.log["command"]

    @property
    def target(self) -> Array:
        """(n, J) reference for prediction errors; NaN where there is none.

        It is the channel `TARGET`, else the usable commands while any joint moves.
        """
        reference = self.log.get(TARGET)
        is_commanded = self.usable & self.moving.any(axis=1, keepdims=True)
        return np.where(is_commanded, self.command, np.nan) if reference is None else reference

    def take(self, index: Index | Mask | slice) -> Samples:
        """The samples at `index`."""
        return Samples(self.log.take(index), self.group[index], self.usable[index], self.moving[index])


def joined_samples(parts: Sequence[Samples]) -> Samples:
    """Concatenated samples; groups unchanged."""
    return Samples(
        joined_logs([part.log for part in parts]),
        np.concatenate([part.group for part in parts]),
        np.concatenate([part.usable for part in parts]),
        np.concatenate([part.moving for part in parts]),
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """A trajectory at times t (T,) s: orders (O, T, k), orders[i] the i-th time derivative of the path."""

    t: Array
    orders: Array


@dataclass(frozen=True, eq=False)
class Cone:
    """|rows_m p + offset_m| <= 1 + slope_m p at M instants: rows (c, M, P), offset (c, M), slope (M, P)
    or None. c = 1 without slope is a slab; c > 1 a ball, or with slope a cone. A zero column: that
    parameter has no effect.
    """

    name: str
    rows: Array
    offset: Array
    slope: Array | None = None


@dataclass(frozen=True)
class Proof:
    """One row of the certificate: a proved interval of `quantity`, and its limit less the tracking margin
    with that confidence (0: assumed, not measured). where: "forearm and table at 3.2 s". note: a remark on
    the row. control: the control that the margin was measured under, in words. A quantity that is not
    verified has a row too, with NaN as its numbers.
    """

    axis: str
    quantity: str
    lower: float
    upper: float
    proved_lower: float
    proved_upper: float
    method: str
    status: Literal["proved", "sampled", "not verified"] = "proved"
    tracking_margin: float = 0.0
    confidence: float = 1.0
    where: str = ""
    control: str = ""
    note: str = ""


@dataclass(frozen=True, eq=False)
class Planned:
    """Model inputs along a plan: X (T, D); gains (T, J), square roots of the sample weights; vjp (in_X,
    in_gains) -> (O, T, k), the gradient in the motion (vector-Jacobian product) at a constant memory.
    """

    X: Array
    gains: Array
    vjp: Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Code:
    """C99 code of a function `name` over the type `real`, with the helpers of deploy/targets/c99/prelude.c.
    Names that it defines begin with `name`. body: the definitions, the function last:

    Inputs: void name(const real *channel, ..., real *memory, real *x); memory is all zero to begin.
    Mean: void name(const real *channel, ..., real *memory, real *command), without memory where it needs
    none, and name_static(const real *channel, ..., real *command), what remains at rest.
    Process: void name(const real *x, real *mean, real *variance); the argument variance exists where VARIANCE
    is 1, and may be a null pointer. On entry it holds a sufficient variance: the function may return an upper
    bound of at most that value in place of the variance. 0 on entry: return the variance itself.
    data: static tables by name, of real or int; variance: tables for variances alone. reads: the channels, in
    order; memory: its size in words; rate: Hz at which it must be called, if it has a memory; work: reals on
    the stack; operations: at most so many on real numbers in one call, and more of them for variances.
    """

    body: str
    data: Mapping[str, Any]
    variance: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[str, ...] = ()
    memory: int = 0
    rate: float = 0.0
    work: int = 0
    operations: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Described:
    """Complete description of a robot: the files of a campaign folder by name, robot.toml among them, and a
    sentence for each assumption that a person should confirm.
    """

    files: Mapping[str, bytes]
    confirm: tuple[str, ...] = ()


FAR = 100.0
"""m. Half the edge of the square that represents an infinite plane; pictures clip it."""
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
# corners of each side, in turn
CUBE_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


@dataclass(frozen=True, eq=False)
class Thing:
    """An object in a robot's surroundings, as flat faces.

    Attributes:
        name: given by a person.
        kind: "solid": the robot stays outside; "plane": an infinite plane, whose points show a part near the
            robot, which stays on one side; "inside": the robot stays inside; "carried" by the robot;
            "stand": a line from its base down to the floor.
        points: (T, P, 3) m in the world along the poses of a figure, T = 1 for a fixed object.
        faces: convex polygons, each as the indices of its points in order.
    """

    name: str
    kind: Literal["solid", "plane", "inside", "carried", "stand"]
    points: Annotated[Array, "(T, P, 3)", "NaN"]
    faces: tuple[tuple[int, ...], ...]

    @classmethod
    def plane(cls, name: str, point: Sequence[float] | Array, normal: Sequence[float] | Array) -> Thing:
        """A plane as a square about one of its points (3,), m; normal (3,) to the allowed side."""
        foot, unit = np.array(point, dtype=float), np.array(normal) / np.linalg.norm(normal)
        across = np.cross(unit, np.eye(3)[np.argmin(np.abs(unit))])
        across /= np.linalg.norm(across)
        along = np.cross(unit, across)
        corners = [foot + FAR * (a * across + b * along) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return cls(name, "plane", np.array(corners)[None], ((0, 1, 2, 3),))

    @classmethod
    def box(cls, name: str, lower: Sequence[float] | Array, upper: Sequence[float] | Array) -> Thing:
        """A solid between two corners (3,), m."""
        low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
        return cls(name, "solid", (0.5 * (low + high) + 0.5 * (high - low) * CUBE)[None], CUBE_FACES)


@dataclass(frozen=True, eq=False)
class Figure:
    """A robot as sticks: points (T, P, 3) m in the world along T poses; sticks (S, 2) pairs of points; tips:
    the points at its ends; things: its surroundings and its load.
    """

    points: Annotated[Array, "(T, P, 3)", "NaN"]
    sticks: Annotated[Index, "(S, 2)"]
    tips: tuple[int, ...]
    things: tuple[Thing, ...] = ()


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid part of a robot, as triangles: points (V, 3) m in its own frame; faces (F, 3), indices of
    points, counterclockwise as seen from outside.
    """

    name: str
    points: Annotated[Array, "(V, 3)"]
    faces: Annotated[Index, "(F, 3)"]


@dataclass(frozen=True, eq=False)
class Nearby:
    """Distances of a robot at T poses, for the R rows of a certificate.

    Attributes:
        pairs: the two names of each row: parts of the robot, or a part and an obstacle.
        kept: (R,) m. Required distance.
        neighbours: (R,) whether both are parts that are close to each other in every pose.
        distance: (T, R) m at the pose itself, at most `farthest`.
        narrowest: (T, L) the rows with the least slack over the required distance first, neighbours last.
        ends: (T, L, 2, 3) m in the world, the nearest points of both sides; NaN beyond `farthest`.
        farthest: m, from which on nobody measures.
    """

    pairs: tuple[tuple[str, str], ...]
    kept: Annotated[Array, "(R,)"]
    neighbours: Annotated[Mask, "(R,)"]
    distance: Annotated[Array, "(T, R)"]
    narrowest: Annotated[Index, "(T, L)"]
    ends: Annotated[Array, "(T, L, 2, 3)", "NaN"]
    farthest: float


@dataclass(frozen=True, eq=False)
class Reachable:
    """Where a robot's motions can be: lower, upper (k,), ends of each coordinate's range, of a hinge one turn
    at most; poses (n, k) inside them that are clear of everything and seen from home in a straight line,
    home first; none where nothing has to be kept clear of.
    """

    lower: Annotated[Array, "(k,)", "NaN"]
    upper: Annotated[Array, "(k,)", "NaN"]
    poses: Annotated[Array, "(n, k)"]

    @property
    def clear(self) -> tuple[Array, Array]:
        """(k,) ends between which clear poses lie; of a robot without any, the range."""
        if not len(self.poses):
            return self.lower, self.upper
        return self.poses.min(axis=0), self.poses.max(axis=0)


@dataclass(frozen=True, eq=False)
class Delivered:
    """A model as another program takes it: files by name (with folders: "a/b.h"), sentences for people and
    facts for machines about them.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
