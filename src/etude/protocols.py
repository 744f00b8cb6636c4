"""What the pipeline asks of its parts: the first file to read.

A kind of robot supplies these; design, certify, write, read, clean, train, score, stop, deploy, simulate and
report are one pipeline over them and name no kind. A `Supports...` is an optional ability: a part has it if
it has these methods. What lacks it is named in a sentence, never stubbed. A method that may answer None is
optional too. Shapes and values: `types`. Random numbers are passed in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from etude.types import (
    Array,
    Channel,
    Code,
    Column,
    Cone,
    Delivered,
    Described,
    Expected,
    Figure,
    Finding,
    Index,
    Log,
    Margins,
    Mask,
    Motion,
    Planned,
    Proof,
    Reachable,
    Row,
    Samples,
    Thing,
)

if TYPE_CHECKING:
    from etude._runtime.operators import Piece


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


@runtime_checkable
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


@runtime_checkable
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


# `etude.limits`: (spec, model or None, margins, and by name what its table in the robot file gives) -> Limit
LimitFactory = Callable[..., Limit]


@runtime_checkable
class SupportsDrawing(Protocol):
    """Capability of a `Limit`: what a drawing shows of it, in the robot's world."""

    @property
    def things(self) -> Sequence[Thing]: ...


@runtime_checkable
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


@runtime_checkable
class SupportsScales(Protocol):
    """Capability of `Inputs` with an op: (D,) what the op's channel is divided by first, tanh(c / s) and
    exp(-|c / s|) of "rest"; 1 of plain columns, NaN where an op is no formula.
    """

    def scales(self) -> Array: ...


@runtime_checkable
class SupportsFollowing(Protocol):
    """Capability of `Inputs` of robots whose physics remembers the way: the log with what is remembered, for
    rows that follow one another as in a run from rest; as it is where it carries that. `states` of a motion
    are such. apart: for rows that do not follow one another, so that nothing is remembered. carried: as
    followed, of one row after another, with what the row before left (None: it is the first).
    """

    def followed(self, log: Log) -> Log: ...
    def apart(self, log: Log) -> Log: ...
    def carried(self, row: Log, before: Array | None) -> tuple[Log, Array | None]: ...


@runtime_checkable
class SupportsDrag(Protocol):
    """Capability of `Inputs` of vehicles that know the air's drag. drag: (dx, dy, dz) 1/s, by which attitudes
    are found; drag_c: C99 of void name(const real *body_velocity, real *force), the lateral force per mass
    along the body's x and y; None: not known.
    """

    @property
    def drag(self) -> tuple[float, float, float]: ...
    def drag_c(self, name: str) -> Code | None: ...


@runtime_checkable
class SupportsOnnx(Protocol):
    """Capability of `Inputs` and of a `Mean`: itself as a piece of a graph of ONNX. Law: in a run from rest
    the graph says what Python says of the same rows.
    """

    def onnx(self) -> Piece: ...


@runtime_checkable
class Mean(Protocol):
    """Commands (n, J) from states, without a process; a row's are its own, since what a robot remembers is
    a state too (`SupportsFollowing`). static: the part that remains at rest (gravity). Who looks at states
    that a model's inputs need not hold has their `columns`, as `Inputs` has.
    parameters: identified value and deviation by name, inf where data do not tell.
    """

    def parameters(self) -> Mapping[str, tuple[float, float]]: ...
    def predict(self, log: Log) -> Array: ...
    def static(self, log: Log) -> Array: ...
    def arrays(self) -> Mapping[str, Array]: ...  # of any dtype but object; `Physics.restore` takes them
    def c(self, name: str) -> Code | None: ...


@runtime_checkable
class Physics(Protocol):
    """A mean to learn beside: identified from samples, or nominal, which needs none (None). Stored models
    keep the mean's arrays; restore: it again, bit for bit.
    """

    def __call__(self, samples: Samples | None) -> Mean: ...
    def restore(self, arrays: Mapping[str, Array]) -> Mean: ...


@runtime_checkable
class SupportsWithout(Protocol):
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


@runtime_checkable
class SupportsRegressors(Protocol):
    """Capability of a `Physics` that is linear in its parameters: a regressor for each command (criterion
    d_opt). Who lacks the method has none.
    """

    def regressors(self) -> Sequence[Regressor]: ...


@runtime_checkable
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


@runtime_checkable
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


@runtime_checkable
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


@runtime_checkable
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


@runtime_checkable
class Controller(Protocol):
    """What is added to a robot's feedback: a model, frozen or learning on line, its C, ILC, adaptive
    control.
    """

    def planned(
        self, motion: Motion
    ) -> Array | None: ...  # (T, J) ahead of the run; None where measurements count
    def command(self, t: float, row: Row) -> tuple[Array, Array]: ...  # (J,) and its deviation
    def observe(self, t: float, row: Row) -> None: ...


@runtime_checkable
class SupportsAccelerations(Protocol):
    """Capability of a `Controller` of robots whose feedback takes accelerations: (T, k) what it is to be told
    along a motion, the motion's own and what the model adds to it; None: the motion's own.
    """

    def accelerations(self, motion: Motion) -> Array | None: ...


@runtime_checkable
class Robot(Protocol):
    """Anything that turns a trajectory into a log; a real one is a person with two files. One with the
    attribute `asks_each_tick`, True, asks a controller that plans nothing at every tick, and shows it what
    was measured, so that it can learn on the way.
    """

    def run(self, trajectory: Any, controller: Controller | None, rng: np.random.Generator) -> Log: ...
    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]: ...  # tracking error and unit per axis
    def changed(self, **what: float) -> Robot: ...  # payload=0.2, friction=1.5; what it cannot is an error


@runtime_checkable
class Kind(Protocol):
    """The plug-in, entry point `etude.robots`: from one description (robot.toml) to the nouns. spec:
    the kind's frozen dataclass, with `name` and `rate` (Hz of its logs); config: the campaign's tables,
    of which `trajectory` (with `duration`, s) and `data` are the kind's own dataclasses and the others
    shared. path: the channel that is compared with the trajectory; home (k,): a pose inside every
    limit; limit (J,): how far each command reaches. samples: the one preprocessing that truly differs, by
    `logs/cleaning/filters.py`, given all logs at once: some facts (the lag of motors) are common to them;
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


@runtime_checkable
class SupportsSelection(Protocol):
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


@runtime_checkable
class SupportsFigure(Protocol):
    """Capability of a `Kind`: its robot along positions q (T, k) of its path. Who lacks it is not drawn."""

    def figure(self, spec: Any, q: Array) -> Figure | None: ...


@runtime_checkable
class SupportsKnownFaults(Protocol):
    """Capability of a `Kind`: codes of docs/known_faults.md that what earlier generations wrote of this robot
    has.
    """

    def mended(self, spec: Any) -> Sequence[str]: ...


@runtime_checkable
class SupportsPoses(Protocol):
    """Capability of a `Kind` whose robots stand elsewhere than motions may be: poses (k,) by name, beside
    home, from which its ways lead.
    """

    def poses(self, spec: Any) -> Mapping[str, Array]: ...


@runtime_checkable
class SupportsLeadIn(Protocol):
    """Capability of a `Kind` whose families make motions that are in motion at their ends: whether those of
    this robot get a lead-in from rest and a lead-out to rest. Who lacks it sends motions as they are.
    """

    def from_rest(self, spec: Any) -> bool: ...


@runtime_checkable
class SupportsReachable(Protocol):
    """Capability of a `Kind` that knows where its robots can be: motions are then looked for about clear
    poses all over it, and what they visit is told. Who lacks the method, or answers None, has motions about
    home alone.
    """

    def reachable(self, spec: Any) -> Reachable | None: ...


@runtime_checkable
class SupportsBoxes(Protocol):
    """Capability of a `Limit` on the path alone, however fast it is gone through. about: the same limit, its
    cones another box (k,), (k,) for searches; roughly: whether poses (T, k) of a motion of that form about
    `pose` (k,) keep it, for little. A part of a motion may then be widened to one side as long as the path
    keeps the limit.
    """

    def about(self, lower: Array, upper: Array) -> Limit: ...
    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]: ...


@runtime_checkable
class SupportsBlocking(Protocol):
    """Capability of a `Limit` that can say what a pose (k,) in a motion of that form runs into: a phrase,
    "" for nothing.
    """

    def blocked(self, form: str, pose: Array) -> str: ...


@runtime_checkable
class SupportsLargestError(Protocol):
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


# `etude.targets`: (model, kind, spec, options) -> files of a model that leaves. options: those of the command
# that were given, and "model_hash"; a name that the target does not know is a UsageError.
# Attribute `needs`: more that it asks of the campaign, names of `campaign.supplied`, options then too
Target = Callable[[Any, Kind, Any, Mapping[str, Any]], Delivered]
