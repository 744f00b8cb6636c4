"""The protocols of the pipeline's parts: the first file to read.

A kind of robot supplies a `Kind` and what it returns. Design, certification, training, export, simulation
and reports are one pipeline over these, and know no kind. `abilities` has the optional abilities, one
small protocol for each. If a part lacks an ability, the pipeline says so; write no stub. A method that may
return None is optional too. `types` has shapes and values. Random generators are arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

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
    Finding,
    Index,
    Log,
    Margins,
    Mask,
    Motion,
    Planned,
    Proof,
    Row,
    Samples,
)


class Trajectory(Protocol):
    """A pure function of time on [0, duration] s with exact derivatives, and the text that stores it.

    `form`: "fourier", "moves", ...; each form has its own tracking margins. Each piece is proved by itself.
    """

    @property
    def form(self) -> str: ...
    @property
    def duration(self) -> float: ...
    # (start s, one of `trajectories.chain.LABELS`, piece), each smooth; a single piece is itself
    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]: ...
    def motion(self, t: Array, orders: int = 3) -> Motion: ...
    # values (M, k), amplitudes (k,) for rounding, kappa: max_t |.| <= max |values| / kappa; degree 2: of
    # squared norms
    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]: ...
    def slowed(self, factor: float) -> Trajectory: ...
    def to_json(self) -> str: ...


@runtime_checkable
class Family(Protocol):
    """The segments that may be proposed: a map of parameters p (P,) to trajectories, with its gradient."""

    @property
    def size(self) -> int: ...
    def drawn(self, rng: np.random.Generator) -> Family: ...  # random values that no search refines (omega0)
    def trajectory(self, p: Array) -> Trajectory: ...
    def parameters(self, trajectory: Any) -> Array: ...
    def motion(self, p: Array, t: Array, orders: int) -> Motion: ...
    def vjp(self, p: Array, t: Array, gradient: Array) -> Array: ...  # (P,) of sum(gradient * orders)
    # the trajectory's bound, linear in p: (k, M, P), (k, M), kappa
    def rows(self, order: int, degree: int) -> tuple[Array, Array, float]: ...


@runtime_checkable
class Limit(Protocol):
    """One limit: its constraints on a search, its proof of final bytes, and the quantity that it bounds.

    A nonconvex limit has a penalty, 0 inside, with its gradient in the motion's orders; its cones only bound
    the search. The unit is free: the search weighs it. `(0.0, zeros)` only judges, as do no cones with None.
    The pipeline shrinks a motion towards `Kind.home` until `prove` holds, then expands it part by part.
    """

    @property
    def name(self) -> str: ...
    def cones(self, family: Family) -> Sequence[Cone]: ...
    def penalty(self, motion: Motion) -> tuple[float, Array] | None: ...  # 0 inside; gradient (O, T, k)
    def prove(self, piece: Trajectory) -> Annotated[Sequence[Proof], "not empty"]: ...
    def of_motion(self, motion: Motion) -> Array: ...  # (T, r), by the rows of `prove`


# `etude.limits`: (spec, model or None, margins, and the keys of its table in the robot file) -> Limit
LimitFactory = Callable[..., Limit]


@runtime_checkable
class Inputs(Protocol):
    """One feature map for planned and measured motion.

    Exactly: plan(m, keep).X == of_log(states(m))[keep], and `step` along a log gives `of_log`. rate: Hz at
    which both must be sampled if inputs depend on earlier samples; 0: any rate.
    """

    @property
    def columns(self) -> Sequence[Column]: ...
    @property
    def orders(self) -> int: ...
    @property
    def rate(self) -> float: ...
    def states(self, motion: Motion) -> Log: ...  # of a perfect run: states and plans
    def of_log(self, log: Log) -> Array: ...
    def plan(self, motion: Motion, keep: Index | None = None) -> Planned: ...
    def step(self, row: Row, memory: Array | None) -> tuple[Array, Array]: ...  # x (D,), memory; None: begin
    def rates(self, motion: Motion) -> tuple[Array, Array] | None: ...  # dX/dt, d2X/dt2; two orders more
    def fitted(self, samples: Samples) -> Inputs: ...  # with stick speeds, backlash, drag, volts, memory
    def arrays(self) -> Mapping[str, Array]: ...  # what `fitted` has set, stored with a model
    def restore(self, arrays: Mapping[str, Array]) -> Inputs: ...
    def c(self, name: str) -> Code | None: ...


@runtime_checkable
class Mean(Protocol):
    """Commands (n, J) from states, without a process. static: the part at rest (gravity). parameters: value
    and deviation by name, inf where data do not determine it. Hysteresis is a state (`SupportsMemory`).
    """

    def parameters(self) -> Mapping[str, tuple[float, float]]: ...
    def predict(self, log: Log) -> Array: ...
    def static(self, log: Log) -> Array: ...
    def arrays(self) -> Mapping[str, Array]: ...  # any dtype but object, for `Physics.restore`
    def c(self, name: str) -> Code | None: ...


@runtime_checkable
class Physics(Protocol):
    """A mean function for processes: identified from samples, or nominal (None). restore: bit for bit."""

    def __call__(self, samples: Samples | None) -> Mean: ...
    def restore(self, arrays: Mapping[str, Array]) -> Mean: ...


class Regressor(Protocol):
    """Features (n, p) of one command at inputs X (n, D), in its unit, their weights N(0, 1) before any data;
    pullback: the gradient (n, D) of sum(G * features), G (n, p).
    """

    def transform(self, X: Array) -> Array: ...
    def pullback(self, X: Array, G: Array) -> Array: ...


@runtime_checkable
class Posterior(Protocol):
    """Posterior of one latent function, for designs; X (T, D), Z (r, D). Variances are without noise."""

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
    """Training data of one group of m commands.

    X (n, D); Y, usable, moving (n, m): a joint kernel leaves out single entries. Rows: `chosen` for
    hyperparameters, `kept` (increasing) to condition on, or as inducing inputs. group (n,): number of the
    trajectory; fold (n,): samples that are held out together, stretches of a single trajectory. commands: m
    names. kernels: m, or one for all; floor (m,): least noise; start: last round's process.
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
    """A Gaussian process of m commands learned together: one alone, with a shared kernel (one latent function
    for all), or joint (one each, given all). Mean and variance (T, m), without noise, in the units of
    `FitData.Y`; noise_variance, signal_variance (m,).
    """

    @property
    def noise_variance(self) -> Array: ...
    @property
    def signal_variance(self) -> Array: ...
    def latents(self) -> Sequence[tuple[Posterior, tuple[int, ...]]]: ...  # for designs; commands of each
    def predict(self, X: Array) -> tuple[Array, Array]: ...
    # cross-validation: means and variances with noise (k, m) of samples own (k,), which are all of `kept` in
    # one fold, given the other folds; Y (n, m): outputs to condition on, if not those of `FitData`
    def held_out(self, own: Index, Y: Array | None = None) -> tuple[Array, Array]: ...
    def arrays(self) -> Mapping[str, Array]: ...  # of any dtype but object
    def c(self, name: str) -> Code | None: ...


@runtime_checkable
class Member(Protocol):
    """Learning method of a group of commands, entry point `etude.models`. restore: the process from its
    arrays, bit for bit; it need not support `held_out`.
    """

    def __call__(self, fit: FitData) -> Process: ...
    def restore(self, arrays: Mapping[str, Array]) -> Process: ...


# `etude.kernels`: (Inputs.columns, names of the group's commands) -> a kernel as of models/gp/kernel_algebra
KernelFactory = Callable[[Sequence[Column], tuple[str, ...]], Any]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One term of the prediction of some commands. weights (m,) add up to 1 over the candidates of a command;
    units (2, m): offset and factor of the process's standardised outputs; calibration (m,): factor on the
    variance.
    """

    structure: str
    commands: tuple[int, ...]
    weights: Array
    mean: Mean | None
    process: Process | None
    units: Array
    calibration: Array


@runtime_checkable
class Model(Protocol):
    """A learned model: each command's best candidate, or an average (variance: sum w (v + (m - average)^2)).
    Candidates of weight 0 are structures that were not selected. worth (J,): number of independent samples
    that one sample counts as in change detection, from held-out residuals.
    """

    @property
    def inputs(self) -> Inputs: ...
    @property
    def candidates(self) -> Sequence[Candidate]: ...
    def worth(self) -> Array: ...
    def predict(self, log: Log) -> tuple[Array, Array]: ...  # (n, J), blended with a safe command
    def posterior(self, log: Log) -> tuple[Array, Array]: ...  # with noise and calibration
    def static(self, log: Log) -> Array: ...  # gravity, with physics or without


@runtime_checkable
class Controller(Protocol):
    """Feedforward: the command added to a robot's feedback, by a frozen or online model, its C, ILC, ..."""

    def planned(self, motion: Motion) -> Array | None: ...  # (T, J) in advance; None if it needs measurements
    def command(self, t: float, row: Row) -> tuple[Array, Array]: ...  # (J,) and its deviation
    def observe(self, t: float, row: Row) -> None: ...


@runtime_checkable
class Robot(Protocol):
    """A simulated robot: it turns a trajectory into a log. (A real robot runs a file, and returns a file.)"""

    def run(self, trajectory: Any, controller: Controller | None, rng: np.random.Generator) -> Log: ...
    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]: ...  # tracking error and unit per axis
    def changed(self, **what: float) -> Robot: ...  # payload=0.2, friction=1.5; an error if it cannot


class Description(Protocol):
    """One robot, read from robot.toml by its kind: a frozen dataclass. rate: Hz of its logs."""

    @property
    def name(self) -> str: ...
    @property
    def rate(self) -> float: ...


@runtime_checkable
class Kind(Protocol):
    """A kind of robot, entry point `etude.robots`: it makes all the parts above from a robot.toml.

    config: the campaign's tables;
    `trajectory` (with `duration`, s) and `data` are the kind's dataclasses. path: the channel compared with
    the trajectory. home (k,): a pose inside every limit. limit (J,): the largest magnitude of each command.
    samples: preprocessing of all logs at once, with `etude.logs`.
    approaches: motions to the start of a motion and back to the pose; None: there are none.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def tables(
        self,
    ) -> Annotated[Mapping[str, type], "keys trajectory, data"]: ...  # dataclasses of [trajectory] and [data]
    @property  # preset -> table -> key -> value over the defaults
    def presets(self) -> Annotated[Mapping[str, Mapping[str, Mapping[str, Any]]], "keys default, thesis"]: ...
    @property  # table -> key -> comment in campaign.toml
    def comments(self) -> Mapping[str, Mapping[str, str]]: ...
    def built_in(self) -> Mapping[str, Path]: ...  # robots that come with it, by name
    def recognises(self, path: Path) -> bool: ...  # whether this .toml, .urdf, ... describes one
    def described(self, path: Path) -> Described: ...
    def spec(self, path: Path) -> Annotated[Any, Description]: ...
    def home(self, spec: Any) -> Annotated[Array, "(k,)"]: ...
    def limit(self, spec: Any) -> Annotated[Array, "(J,)"]: ...
    def channels(self, spec: Any) -> Sequence[Channel]: ...
    def expected(self, spec: Any) -> Expected: ...
    def family(self, spec: Any, config: Any) -> Family: ...
    def limits(self, spec: Any, config: Any, model: Model | None, margins: Margins) -> Sequence[Limit]: ...
    def approaches(
        self, spec: Any, motion: Trajectory, pose: Array
    ) -> tuple[Trajectory, Trajectory] | None: ...
    def inputs(self, spec: Any, config: Any) -> Inputs: ...
    def physics(self, spec: Any, config: Any) -> Mapping[str, Physics]: ...  # "nominal", "identified"
    def checks(self, spec: Any, log: Log) -> Sequence[Finding]: ...  # in addition to those of channels
    def samples(self, spec: Any, config: Any, logs: Sequence[Log], groups: Sequence[Index]) -> Samples: ...
    def robot(self, spec: Any, config: Any) -> Robot | None: ...
    # for simulated campaigns: motions left out of training, and controllers to compare with ("pd", ...)
    def tests(self, spec: Any, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]: ...
    def baselines(self, spec: Any, config: Any) -> Mapping[str, Controller | None]: ...
    def controller(self, spec: Any, config: Any, model: Model) -> Controller: ...


@runtime_checkable
class Exporter(Protocol):
    """Files for a receiver of a trajectory, or of a motion with commands; entry point `etude.exporters`.

    back: the curve that the receiver plays of these bytes, at rest before the first row and after the last.
    The pipeline certifies that curve. `trajectories.splined.Splined` interpolates points as receivers do.
    """

    def __call__(self, trajectory: Any, kind: Kind, spec: Any, /) -> Mapping[str, bytes]: ...
    def back(self, files: Mapping[str, bytes]) -> Trajectory: ...


@runtime_checkable
class Reader(Protocol):
    """A format of logs, entry point `etude.readers`: a Log for each topic (topics may be ()), with its own
    times. recognises: whether a file with those first bytes has this format.
    """

    def __call__(self, path: Any, topics: Sequence[str], /) -> Mapping[str, Log]: ...
    def recognises(self, path: Path, head: bytes, /) -> bool: ...


# `etude.targets`: (model, kind, spec, options) -> files of an exported model. options: the given options of
# the command, and "model_hash"; a name that the target does not know is a UsageError.
Target = Callable[[Any, Kind, Any, Mapping[str, Any]], Delivered]


def members(protocol: type) -> tuple[str, ...]:
    """Names that a protocol declares, those of its bases first."""
    namespaces = [vars(kind) for kind in protocol.__mro__[::-1] if getattr(kind, "_is_protocol", False)]
    named = [[*part.get("__annotations__", ()), *part] for part in namespaces]
    return tuple(dict.fromkeys(name for part in named for name in part if not name.startswith("_")))
