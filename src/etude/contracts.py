"""The nouns. A kind of robot supplies these; design, certify, write, read, clean, train, score, stop,
deploy, simulate and report are one pipeline over them and name no kind.

Shapes: T planned or logged instants, n training samples, k path coordinates (joints; x, y, z), O
derivative orders (0 = position), P parameters of a family, D model inputs, J commands, m of them
learned together. SI units and radians; commands in the robot's own unit. Values are frozen, checked
where they enter; random numbers are passed in. A method that may answer None is a capability: who lacks
it is named in a sentence, never stubbed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from etude.operators import Piece
    from etude.shown import Picture

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
    q_elbow. role: "state" what a model may look at; "command" what it predicts; "plan" what was wanted;
    "aside" the rest; "truth" known to simulators only. required: no log is usable without. For the log
    doctor: derivative_of, the channel whose rate this is; acts_on, the coordinate that this command
    does work on; reach, the largest true values; quantum, the sensor's step. nominal: what a plan
    assumes of a state that no motion gives (volts).
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
    """One check of the doctor: a sentence, the next step, spans (s) to mark. flag: the question that it
    answers; "": certain, so refused or repaired. "cannot tell" is neither a detection nor a false
    alarm.
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
    channel name, each (T, parts). One table for every robot; what a log lacks is not in it. repairs: a
    sentence each. As a reader gives it: a Log for each topic, a channel for each raw column, nothing
    matched or converted.
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
        from etude.shown import picture_of

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
        """The log with one more channel, or another in its place; values (T, parts)."""
        shape = (len(self.t), len(channel.parts))
        if values.shape != shape:
            raise ValueError(f"channel {channel.name} has shape {values.shape}, not {shape}")
        return replace(
            self,
            channels={**self.channels, channel.name: channel},
            values={**self.values, channel.name: values},
        )

    def without(self, *names: str) -> Log:
        """The log less these channels."""
        return replace(
            self,
            channels={n: c for n, c in self.channels.items() if n not in names},
            values={n: v for n, v in self.values.items() if n not in names},
        )

    def repaired(self, *sentences: str) -> Log:
        """The log with more repairs on record."""
        return replace(self, repairs=(*self.repairs, *sentences))


def joined_logs(parts: Sequence[Log]) -> Log:
    """The rows of one log after the other's, times as they are; a channel that one lacks, the whole
    lacks.
    """
    names = [n for n in parts[0].values if all(n in part for part in parts)]
    return replace(
        parts[0],
        t=np.concatenate([part.t for part in parts]),
        channels={n: parts[0].channels[n] for n in names},
        values={n: np.concatenate([part.values[n] for part in parts]) for n in names},
    )


@dataclass(frozen=True, eq=False)
class Expected:
    """What the log doctor may expect of a robot's logs. rate: Hz at which they are usually recorded, which
    tells the unit of their times; scale (k,): sizes of the path's coordinates, in parts of which motions
    are compared; limits: lower and upper (parts,) of positions, their rates and commands, by channel; rest:
    rows before and after the trajectory are kept (a joint at rest teaches, a vehicle on the ground does
    not).
    """

    rate: float
    scale: Array
    limits: Mapping[str, tuple[Array, Array]]
    rest: bool = True


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """What models learn from: rows of several logs at the model's rate. log: states, plans, "command"
    (n, J); what inputs remember (friction) is a state in it, computed on the whole log before thinning.
    group (n,): the segment, what is held out together. usable (n, J): False where that command says
    nothing (on the ground, braked, saturated); moving (n, J): False where it says little (joint at
    rest). Scores are given over both.
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
        """(n, J) what models predict."""
        return self.log["command"]

    def take(self, index: Index | Mask | slice) -> Samples:
        """The samples at `index`."""
        return Samples(self.log.take(index), self.group[index], self.usable[index], self.moving[index])


def joined_samples(parts: Sequence[Samples]) -> Samples:
    """One after the other; groups as they are."""
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


class Trajectory(Protocol):
    """A pure function of time on [0, duration] s with exact derivatives, and the text that it is stored
    as. form: "fourier", "moves", ...: margins are kept for each. Proofs and groups go piece by piece.
    """

    @property
    def form(self) -> str: ...
    @property
    def duration(self) -> float: ...
    # (start s, one of `trajectories.chain.LABELS`, piece); smooth between;
    # a single one is its own piece
    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]: ...
    def motion(self, t: Array, orders: int = 3) -> Motion: ...
    # of a piece: values (M, k), amplitudes (k,) for rounding, kappa: max_t |.| <= max |values| / kappa;
    # 2: squared norms
    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]: ...
    def slowed(self, factor: float) -> Trajectory: ...
    def to_json(self) -> str: ...


class Family(Protocol):
    """Which segments may be proposed: parameters p (P,) <-> trajectory, with the way back of gradients."""

    @property
    def size(self) -> int: ...
    def drawn(self, rng: np.random.Generator) -> Family: ...  # with what no search refines (omega0)
    def trajectory(self, p: Array) -> Trajectory: ...
    def parameters(self, trajectory: Any) -> Array: ...
    def motion(self, p: Array, t: Array, orders: int) -> Motion: ...
    def pull(self, p: Array, t: Array, gradient: Array) -> Array: ...  # (P,) of sum(gradient * orders)
    def rows(
        self, order: int, degree: int
    ) -> tuple[Array, Array, float]: ...  # bound in p: (k, M, P), (k, M), kappa


@dataclass(frozen=True, eq=False)
class Cone:
    """|rows_m p + offset_m| <= 1 + slope_m p at M instants: rows (c, M, P), offset (c, M), slope (M, P)
    or None. c = 1 without slope is a slab; c > 1 a ball, or with slope a cone. Zero columns: not
    coupled.
    """

    name: str
    rows: Array
    offset: Array
    slope: Array | None = None


@dataclass(frozen=True)
class Proof:
    """One row of the certificate: the interval that holds `quantity`, and its limit less tracking's
    margin with that confidence (0: nobody measured it). where: "forearm and table at 3.2 s". control: which
    one the margin is of, in words. What is not looked at is a row too, its numbers NaN.
    """

    axis: str
    quantity: str
    lower: float
    upper: float
    proved_lower: float
    proved_upper: float
    method: str
    status: Literal["proved", "sampled", "not looked at"] = "proved"
    margin: float = 0.0
    confidence: float = 1.0
    where: str = ""
    control: str = ""


class Limit(Protocol):
    """One limit: how the search keeps it, how the final bytes are judged, what it measures. One that is
    not convex gives a penalty; its cones, if any, say where to search and prove nothing. Its result is
    drawn towards `Kind.home` until `prove` is content, and then grown, part by part, as far as that holds.
    """

    @property
    def name(self) -> str: ...
    def cones(self, family: Family) -> Sequence[Cone]: ...
    def penalty(self, motion: Motion) -> tuple[float, Array] | None: ...  # 0 where kept; gradient (O, T, k)
    def prove(self, piece: Trajectory) -> Sequence[Proof]: ...
    def of_motion(
        self, motion: Motion
    ) -> Array: ...  # (T, r) what is limited, by the rows of `prove`: plans and runs


@dataclass(frozen=True, eq=False)
class Planned:
    """A plan as the model will see its log: X (T, D); gains (T, J), square roots of the samples'
    weights; pull (in_X, in_gains) -> (O, T, k), the gradient in the motion, with what is remembered
    held fixed.
    """

    X: Array
    gains: Array
    pull: Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Code:
    """C99 of a function `name` over the type `real` and with the helpers of deploy/c99/prelude.c, no name of
    its own but such as begin with `name`. body: its definitions, the function last:

    Inputs: void name(const real *channel, ..., real *memory, real *x); memory is all zero to begin.
    Mean: void name(const real *channel, ..., real *memory, real *command), without memory where it needs
    none, and name_static(const real *channel, ..., real *command), what remains at rest.
    Process: void name(const real *x, real *mean, real *variance); variance is there where VARIANCE is 1, and
    may be 0 then too. It holds what is enough: an upper bound that is no larger may be said in place of the
    variance, and 0 asks for that itself.
    data: static tables by name, of real or int; variance: those that variances alone need. reads: the
    channels, in order; memory: words of it; rate: Hz at which it must be called, as it remembers; work: reals
    on the stack; operations: of real numbers in one call at worst, and those more for variances.
    """

    body: str
    data: Mapping[str, Any]
    variance: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[str, ...] = ()
    memory: int = 0
    rate: float = 0.0
    work: int = 0
    operations: tuple[int, int] = (0, 0)


class Inputs(Protocol):
    """One feature map for planned and measured motion. Laws, exactly: plan(m, keep).X ==
    of_log(states(m))[keep]; `step` along a log gives `of_log`. rate: Hz at which both must be sampled,
    as inputs remember; 0: anyhow.
    """

    @property
    def columns(self) -> Sequence[Column]: ...
    @property
    def orders(self) -> int: ...
    @property
    def rate(self) -> float: ...
    def states(
        self, motion: Motion
    ) -> Log: ...  # what a perfect run leaves: states and plans (the thesis's inputs)
    def of_log(self, log: Log) -> Array: ...
    def plan(self, motion: Motion, keep: Index | None = None) -> Planned: ...
    def step(
        self, row: Row, memory: Array | None
    ) -> tuple[Array, Array]: ...  # x (D,), memory; None to begin
    def rates(
        self, motion: Motion
    ) -> tuple[Array, Array] | None: ...  # dX/dt, d2X/dt2; takes two orders more
    def tuned(
        self, samples: Samples
    ) -> Inputs: ...  # with stick speeds, play, drag, volts, memory at the end
    def arrays(self) -> Mapping[str, Array]: ...  # what `tuned` has set, to be stored with a model
    def restore(self, arrays: Mapping[str, Array]) -> Inputs: ...  # the same inputs with it
    def c(self, name: str) -> Code | None: ...


class Scaled(Protocol):
    """Capability of `Inputs` with an op: (D,) what the op's channel is divided by first, tanh(c / s) and
    exp(-|c / s|) of "rest"; 1 of plain columns, NaN where an op is no formula.
    """

    def scales(self) -> Array: ...


class Followed(Protocol):
    """Capability of `Inputs` of robots whose physics remembers the way: the log with what is remembered, for
    rows that follow one another as in a run from rest; as it is where it carries that. `states` of a motion
    are such. apart: for rows that do not follow one another, so that nothing is remembered. carried: as
    followed, of one row after another, with what the row before left (None: it is the first).
    """

    def followed(self, log: Log) -> Log: ...
    def apart(self, log: Log) -> Log: ...
    def carried(self, row: Log, before: Array | None) -> tuple[Log, Array | None]: ...


class Dragging(Protocol):
    """Capability of `Inputs` of vehicles that know the air's drag. drag: (dx, dy, dz) 1/s, by which attitudes
    are found; drag_c: C99 of void name(const real *body_velocity, real *force), the lateral force per mass
    along the body's x and y; None: not known.
    """

    @property
    def drag(self) -> tuple[float, float, float]: ...
    def drag_c(self, name: str) -> Code | None: ...


class Graphed(Protocol):
    """Capability of `Inputs` and of a `Mean`: itself as a piece of a graph of ONNX. Law: in a run from rest
    the graph says what Python says of the same rows.
    """

    def onnx(self) -> Piece: ...


class Mean(Protocol):
    """Commands (n, J) from states, without a process; a row's are its own, since what a robot remembers is
    a state too (`Followed`). static: the part that remains at rest (gravity). Who looks at states that a
    model's inputs need not hold has their `columns`, as `Inputs` has.
    parameters: identified value and deviation by name, inf where data do not tell.
    """

    def parameters(self) -> Mapping[str, tuple[float, float]]: ...
    def predict(self, log: Log) -> Array: ...
    def static(self, log: Log) -> Array: ...
    def arrays(self) -> Mapping[str, Array]: ...  # of any dtype but object; `Physics.restore` takes them
    def c(self, name: str) -> Code | None: ...


class Physics(Protocol):
    """A mean to learn beside: identified from samples, or nominal, which needs none (None). Stored models
    keep the mean's arrays; restore: it again, bit for bit.
    """

    def __call__(self, samples: Samples | None) -> Mean: ...
    def restore(self, arrays: Mapping[str, Array]) -> Mean: ...


class HeldOutPhysics(Protocol):
    """Capability of a `Physics` whose means from parts of the same samples share work: `without` says, by
    number of a fold, what the mean that has not seen it says of all samples, (n, J); fold (n,). A fold
    without which nothing can be identified is missing. Who lacks the method is asked fold by fold.
    """

    def without(self, samples: Samples, fold: Index) -> Mapping[int, Array]: ...


class Regressor(Protocol):
    """Features (n, p) of one command at model inputs X (n, D), in its unit, their weights N(0, 1) before any
    data; pullback: the gradient (n, D) of sum(G * features), G (n, p).
    """

    def transform(self, X: Array) -> Array: ...
    def pullback(self, X: Array, G: Array) -> Array: ...


class Regressed(Protocol):
    """Capability of a `Physics` that is linear in its parameters: a regressor for each command (criterion
    d_opt). Who lacks the method has none.
    """

    def regressors(self) -> Sequence[Regressor]: ...


class Posterior(Protocol):
    """One latent function given its data, as designs see it; X (T, D), Z (r, D). Variances without
    noise.
    """

    @property
    def noise_variance(self) -> float: ...
    @property
    def signal_variance(self) -> float: ...
    def predict(self, X: Array) -> tuple[Array, Array]: ...
    def mean_gradient(self, X: Array) -> Array: ...
    def variance_gradient(self, X: Array, g: Array) -> Array: ...
    def covariance(self, X: Array, Z: Array) -> Array: ...
    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array: ...


@dataclass(frozen=True, eq=False)
class FitData:
    """What a member learns one group of m commands from. X (n, D); Y, usable, moving (n, m): a joint
    kernel leaves out single entries. Rows: `chosen` for hyperparameters, `kept` (increasing) to condition
    on, or as inducing inputs of all. group (n,): trajectories; fold (n,): what is held out together, of a
    single trajectory its stretches. commands: names of the m. kernels: m, or one for all; floor (m,) of
    the noise; start: last round's.
    """

    X: Array
    Y: Array
    usable: Mask
    moving: Mask
    group: Index
    fold: Index
    chosen: Index
    kept: Index
    columns: Sequence[Column]
    commands: tuple[str, ...]
    kernels: Sequence[Any]
    floor: Array
    start: Process | None
    config: Any
    rng: np.random.Generator


class Process(Protocol):
    """A Gaussian process of m commands learned together: one alone, with a shared kernel (one latent
    function for all), or joint (one each, given all). Mean and variance (T, m), without noise, in the
    units of `FitData.Y`; noise_variance, signal_variance (m,).
    """

    @property
    def noise_variance(self) -> Array: ...
    @property
    def signal_variance(self) -> Array: ...
    def latents(
        self,
    ) -> Sequence[tuple[Posterior, tuple[int, ...]]]: ...  # for designs, with the commands of each
    def predict(self, X: Array) -> tuple[Array, Array]: ...
    # means and variances with noise (k, m) of the samples own (k,), all of `kept` in one fold, from what
    # was learned of other folds; Y (n, m): outputs to predict from, if not those of `FitData`
    def held_out(self, own: Index, Y: Array | None = None) -> tuple[Array, Array]: ...
    def arrays(self) -> Mapping[str, Array]: ...  # of any dtype but object
    def c(self, name: str) -> Code | None: ...


class Member(Protocol):
    """How one group of commands is learned, entry point `etude.models`; restore: the process again from
    its arrays, bit for bit (it need hold nothing out).
    """

    def __call__(self, fit: FitData) -> Process: ...
    def restore(self, arrays: Mapping[str, Array]) -> Process: ...


# `etude.kernels`: (Inputs.columns, names of the group's commands) -> a kernel as of models/gp/kernel_algebra
KernelFactory = Callable[[Sequence[Column], tuple[str, ...]], Any]


@dataclass(frozen=True, eq=False)
class Candidate:
    """What takes part in the answer for some commands; weights (m,) add up to 1 for each command; units
    (2, m): offset and factor from the process's standardised outputs to commands; calibration (m,):
    factor on the variance.
    """

    rung: str
    commands: tuple[int, ...]
    weights: Array
    mean: Mean | None
    process: Process | None
    units: Array
    calibration: Array


class Model(Protocol):
    """What was learned: each command's best candidate, or several averaged (variance: sum w (v + (m -
    average)^2)). Candidates of weight 0 take no part: they are the other rungs. worth (J,): independent
    samples that a sample is worth, from held-out residuals (changed-robot test).
    """

    @property
    def inputs(self) -> Inputs: ...
    @property
    def candidates(self) -> Sequence[Candidate]: ...
    def worth(self) -> Array: ...
    def predict(self, log: Log) -> tuple[Array, Array]: ...  # what to command (n, J): faded to what is safe
    # given the data, nothing faded: what scores and designs ask; (n, J), noise and calibration included
    def posterior(self, log: Log) -> tuple[Array, Array]: ...
    def static(self, log: Log) -> Array: ...  # gravity, with physics or without


class Controller(Protocol):
    """What is added to a robot's feedback: a model, frozen or learning on line, its C, ILC, adaptive
    control.
    """

    def planned(
        self, motion: Motion
    ) -> Array | None: ...  # (T, J) ahead of the run; None where measurements count
    def command(self, t: float, row: Row) -> tuple[Array, Array]: ...  # (J,) and its deviation
    def observe(self, t: float, row: Row) -> None: ...


class Accelerating(Protocol):
    """Capability of a `Controller` of robots whose feedback takes accelerations: (T, k) what it is to be told
    along a motion, the motion's own and what the model adds to it; None: the motion's own.
    """

    def accelerations(self, motion: Motion) -> Array | None: ...


@dataclass(frozen=True)
class Described:
    """A robot's description, whole: files that a campaign folder needs, robot.toml among them, by name,
    and a sentence for each assumption that a person should confirm.
    """

    files: Mapping[str, bytes]
    confirm: tuple[str, ...] = ()


class Robot(Protocol):
    """Anything that turns a trajectory into a log; a real one is a person with two files. One with the
    attribute `asks_each_tick`, True, asks a controller that plans nothing at every tick, and shows it what
    was measured, so that it can learn on the way.
    """

    def run(self, trajectory: Any, controller: Controller | None, rng: np.random.Generator) -> Log: ...
    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]: ...  # tracking error and unit per axis
    def changed(self, **what: float) -> Robot: ...  # payload=0.2, friction=1.5; what it cannot is an error


class Kind(Protocol):
    """The plug-in, entry point `etude.robots`: from one description (robot.toml) to the nouns. spec:
    the kind's frozen dataclass, with `name` and `rate` (Hz of its logs); config: the campaign's tables,
    of which `trajectory` (with `duration`, s) and `data` are the kind's own dataclasses and the others
    shared. path: the channel that is compared with the trajectory; home (k,): a pose inside every
    limit; limit (J,): how far each command reaches. samples: the one recipe that truly differs, of
    `logs/steps.py`, given all logs at once, since some facts (the lag of motors) are common to them;
    ways: approach and return, take-off and landing. Who has `states_in_words` says what axes and signs
    its states have, for headers in C.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def tables(self) -> Mapping[str, type]: ...  # dataclasses of [trajectory] and [data]
    # preset -> table -> key -> value, laid over the dataclasses' defaults; "default" and "thesis" at least
    @property
    def presets(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]: ...
    @property
    def comments(
        self,
    ) -> Mapping[str, Mapping[str, str]]: ...  # table -> key -> what people read in campaign.toml
    def built_in(self) -> Mapping[str, Path]: ...  # robots that come with it, by name
    def recognises(self, path: Path) -> bool: ...  # is this file (.toml, .urdf, ...) a description for it?
    def described(self, path: Path) -> Described: ...
    def spec(self, path: Path) -> Any: ...
    def home(self, spec: Any) -> Array: ...
    def limit(self, spec: Any) -> Array: ...
    def channels(self, spec: Any) -> Sequence[Channel]: ...
    def expected(self, spec: Any) -> Expected: ...  # for `logs.read.read_log` and `logs.identity.align`
    def family(self, spec: Any, config: Any) -> Family: ...
    def limits(self, spec: Any, config: Any, model: Model | None, margins: Margins) -> Sequence[Limit]: ...
    def ways(
        self, spec: Any, motion: Trajectory, pose: Array
    ) -> tuple[Trajectory, Trajectory] | None: ...  # to, fro
    def inputs(self, spec: Any, config: Any) -> Inputs: ...
    def physics(self, spec: Any, config: Any) -> Mapping[str, Physics]: ...  # "nominal", "identified"
    def checks(
        self, spec: Any, log: Log
    ) -> Sequence[Finding]: ...  # beside those over channels: ground, scale
    def samples(
        self, spec: Any, config: Any, logs: Sequence[Log], groups: Sequence[Index]
    ) -> Samples: ...  # (T,) each
    def robot(self, spec: Any, config: Any) -> Robot | None: ...
    # of simulated campaigns: motions never trained on, and what learning is held against ("pd",
    # "perfect", ...)
    def tests(self, spec: Any, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]: ...
    def baselines(self, spec: Any, config: Any) -> Mapping[str, Controller | None]: ...
    def controller(
        self, spec: Any, config: Any, model: Model
    ) -> Controller: ...  # the model beside the feedback


class Choosing(Protocol):
    """Capability of a `Kind` whose descriptions may hold more than one robot needs: `described` of the
    joints that move (names or patterns; none: those that the file's one robot has), with others held at
    given positions, folders in which to look for meshes first, limits (joint or pattern -> "lower",
    "upper", "velocity", "command") in place of the file's, and the floor's height, m. Who lacks the method
    has none.
    """

    def chosen(
        self,
        path: Path,
        joints: Sequence[str],
        held: Mapping[str, float],
        mesh_roots: Sequence[Path],
        limits: Mapping[str, Mapping[str, float]],
        floor: float | None = None,
    ) -> Described: ...


@dataclass(frozen=True, eq=False)
class Thing:
    """Something beside a robot, as flat faces.

    Attributes:
        name: that a person gave it.
        kind: "solid": the robot stays out of it; "plane": one face without end, of which the points show a
            part about the robot, which stays on one side; "inside": it stays in there; "carried" by it;
            "stand": a line from its base down to the floor.
        points: (T, P, 3) m in the world along the poses of a figure, T = 1 for what stands still.
        faces: convex polygons, each the numbers of its points in order.
    """

    name: str
    kind: Literal["solid", "plane", "inside", "carried", "stand"]
    points: Array
    faces: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Figure:
    """A robot as sticks: points (T, P, 3) m in the world along T poses; sticks (S, 2) pairs of points; tips:
    the points at its ends; things: what stands around it and what it carries.
    """

    points: Array
    sticks: Index
    tips: tuple[int, ...]
    things: tuple[Thing, ...] = ()


class Drawn(Protocol):
    """Capability of a `Kind`: its robot along positions q (T, k) of its path. Who lacks it is not drawn."""

    def figure(self, spec: Any, q: Array) -> Figure | None: ...


class Mended(Protocol):
    """Capability of a `Kind`: codes of docs/known_faults.md that what earlier generations wrote of this robot
    has.
    """

    def mended(self, spec: Any) -> Sequence[str]: ...


class Posed(Protocol):
    """Capability of a `Kind` whose robots stand elsewhere than motions may be: poses (k,) by name, beside
    home, from which its ways lead.
    """

    def poses(self, spec: Any) -> Mapping[str, Array]: ...


class Resting(Protocol):
    """Capability of a `Kind` whose families make motions that are in motion at their ends: whether those of
    this robot get a lead-in from rest and a lead-out to rest. Who lacks it sends motions as they are.
    """

    def from_rest(self, spec: Any) -> bool: ...


@dataclass(frozen=True, eq=False)
class Reachable:
    """Where a robot's motions can be: lower, upper (k,), ends of each coordinate's range, of a hinge one turn
    at most; poses (n, k) inside them that are clear of everything and seen from home in a straight line,
    home first; none where nothing has to be kept clear of.
    """

    lower: Array
    upper: Array
    poses: Array

    @property
    def clear(self) -> tuple[Array, Array]:
        """(k,) ends between which clear poses lie; of a robot without any, the range."""
        if not len(self.poses):
            return self.lower, self.upper
        return self.poses.min(axis=0), self.poses.max(axis=0)


class Roaming(Protocol):
    """Capability of a `Kind` that knows where its robots can be: motions are then looked for about clear
    poses all over it, and what they visit is told. Who lacks the method, or answers None, has motions about
    home alone.
    """

    def reachable(self, spec: Any) -> Reachable | None: ...


class Placed(Protocol):
    """Capability of a `Limit` on the path alone, however fast it is gone through. about: the same limit, its
    cones another box (k,), (k,) for searches; roughly: whether poses (T, k) of a motion of that form about
    `pose` (k,) keep it, for little. A part of a motion may then be widened to one side as long as the path
    keeps the limit.
    """

    def about(self, lower: Array, upper: Array) -> Limit: ...
    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]: ...


class Blocking(Protocol):
    """Capability of a `Limit` that can say what a pose (k,) in a motion of that form runs into: a phrase,
    "" for nothing.
    """

    def blocked(self, form: str, pose: Array) -> str: ...


class Gained(Protocol):
    """Capability of a `Kind` that knows its robots' feedback: largest position errors (k,) that it allows,
    NaN where unknown.
    """

    def largest_error(self, spec: Any) -> Array: ...


# `etude.exporters`: (trajectory or model, kind, spec) -> files; `back(files)` is what their receiver
# plays: certify that; `notes(files)`, if there is one, are sentences on what they hold beside the motion
Exporter = Callable[[Any, Kind, Any], Mapping[str, bytes]]
# `etude.readers`: (path, topics or ()) -> a Log for each topic, at times of its own; attribute
# `recognises(path, head)`
Reader = Callable[[Any, Sequence[str]], Mapping[str, Log]]


@dataclass(frozen=True, eq=False)
class Delivered:
    """A model as another program takes it: files by name (with folders: "a/b.h"), sentences for people and
    facts for machines about them.
    """

    files: Mapping[str, bytes]
    said: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


# `etude.targets`: (model, kind, spec, options) -> files of a model that leaves. options: those of the command
# that were given, and "model_hash"; a name that the target does not know is a UsageError.
# Attribute `needs`: more that it asks of the campaign, names of `campaign.supplied`, options then too
Target = Callable[[Any, Kind, Any, Mapping[str, Any]], Delivered]
