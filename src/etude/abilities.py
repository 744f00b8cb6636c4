"""Optional abilities of the pipeline's parts: one small protocol for each.

The first word of a docstring names the part. A part has an ability if it has all its members, which
`isinstance` checks. If a part lacks an ability, the pipeline says so; write no stub. A part with only some
members of an ability is refused (`require_whole`). `etude.protocols` has the required members.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, runtime_checkable

import numpy as np

from etude.codes import Notice
from etude.protocols import Controller, Limit, Model, Physics, Regressor, Trajectory
from etude.types import (
    Array,
    Code,
    Column,
    Delivered,
    Described,
    Figure,
    Index,
    Log,
    Motion,
    Nearby,
    Proof,
    Reachable,
    Samples,
    Solid,
    Thing,
)

if TYPE_CHECKING:
    from etude._runtime.operators import Piece


@runtime_checkable
class SupportsOrder(Protocol):
    """`Limit` of one derivative: 0 position, 1 velocity, ...; rest: whether motions start and end at 0."""

    @property
    def order(self) -> int: ...
    @property
    def rest(self) -> bool: ...


@runtime_checkable
class SupportsOrders(Protocol):
    """`Limit` that needs more derivatives of a motion than position, velocity and acceleration."""

    @property
    def orders(self) -> int: ...


@runtime_checkable
class SupportsCoverage(Protocol):
    """`Limit`: which of `limits.certificate.ALL` it verifies, and sentences on what is not verified."""

    @property
    def looks_at(self) -> tuple[str, ...]: ...
    @property
    def not_verified(self) -> tuple[str, ...]: ...


@runtime_checkable
class SupportsWarnings(Protocol):
    """`Limit` with warnings about a motion, notices or sentences, which come first in its certificate."""

    def warned(self, trajectory: Trajectory) -> Sequence[str | Notice]: ...


@runtime_checkable
class SupportsRefusal(Protocol):
    """`Limit` that may refuse every motion: the fact and the next step, or two empty texts."""

    @property
    def refused(self) -> tuple[str, str]: ...


@runtime_checkable
class SupportsRoomCheck(Protocol):
    """`Limit` that raises UnsafeTrajectoryError if it allows no motion of that form."""

    def check_room(self, form: str) -> None: ...


@runtime_checkable
class SupportsFastCheck(Protocol):
    """`Limit` with a fast check for searches; the result of a search is proved afterwards."""

    def keeps(self, piece: Trajectory) -> bool: ...


@runtime_checkable
class SupportsWitness(Protocol):
    """`Limit` with `keeps` that remembers where this last failed, and tests these instants alone; False: only
    `keeps` decides.
    """

    def fails_again(self, piece: Trajectory) -> bool: ...


@runtime_checkable
class SupportsViolation(Protocol):
    """`Limit` that finds from a few samples that a motion violates it, at less cost than a proof; False: only
    a proof decides.
    """

    def violated(self, piece: Trajectory) -> bool: ...


@runtime_checkable
class SupportsBoxes(Protocol):
    """`Limit` on the path alone, at any speed, so that a search may widen a motion to one side.

    about: the same limit with another box of cones, from lower (k,) to upper (k,). roughly: a cheap test
    whether poses (T, k) of a motion of that form about `pose` (k,) keep the limit.
    """

    def about(self, lower: Array, upper: Array) -> Limit: ...
    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]: ...


@runtime_checkable
class SupportsBlocking(Protocol):
    """`Limit` that names the obstacle of a pose (k,) in a motion of that form; "": none."""

    def blocked(self, form: str, pose: Array) -> str: ...


@runtime_checkable
class SupportsOffsets(Protocol):
    """`Limit` of positions: rows of a plan's positions (K, k), if the robot deviates by `off` (K, k)."""

    def strayed(self, places: Array, off: Array) -> Sequence[Proof]: ...


@runtime_checkable
class SupportsDrawing(Protocol):
    """`Limit`: its shapes in a drawing, in the robot's world frame."""

    @property
    def things(self) -> Sequence[Thing]: ...


@runtime_checkable
class SupportsNearby(Protocol):
    """`Limit` of distances: distances at poses (T, k), with the end points of the `lines` smallest ones."""

    def nearby(self, poses: Array, lines: int) -> Nearby: ...


@runtime_checkable
class SupportsMemory(Protocol):
    """`Inputs` whose physics has a memory: a log with that state, unchanged if it has the state already.

    followed: for rows in order, from rest. apart: for rows that do not follow one another. carried: one row
    at a time, with the state that the previous row left (None: first row).
    """

    def followed(self, log: Log) -> Log: ...
    def apart(self, log: Log) -> Log: ...
    def carried(self, row: Log, before: Array | None) -> tuple[Log, Array | None]: ...


@runtime_checkable
class SupportsSlow(Protocol):
    """`Physics` that may also be fitted to slow samples: the samples with the slow ones marked as moving, for
    another fit; None if there are too few.
    """

    def slow(self, samples: Samples) -> Samples | None: ...


@runtime_checkable
class SupportsRipple(Protocol):
    """`Physics` that may identify ripple, a force periodic in the position: the samples for that, and the
    physics with ripple; None: not for this robot.
    """

    def rippled(self, samples: Samples) -> tuple[Samples, Physics] | None: ...


@runtime_checkable
class SupportsDrag(Protocol):
    """`Inputs` of vehicles with known air drag (dx, dy, dz), 1/s. drag_c: C99 of void name(const real
    *body_velocity, real *force), the lateral force per mass in body axes; None: unknown.
    """

    @property
    def drag(self) -> tuple[float, float, float]: ...
    def drag_c(self, name: str) -> Code | None: ...


@runtime_checkable
class SupportsNotes(Protocol):
    """`Inputs` with notices, or sentences, about the result of `fitted`."""

    @property
    def notes(self) -> Sequence[str | Notice]: ...


@runtime_checkable
class SupportsOnnx(Protocol):
    """`Inputs` or `Mean` as a piece of an ONNX graph, with the results of Python in a run from rest."""

    def onnx(self) -> Piece: ...


@runtime_checkable
class SupportsColumns(Protocol):
    """`Mean` that reads states beyond the model's inputs: their columns, as in `Inputs`."""

    @property
    def columns(self) -> Sequence[Column]: ...


@runtime_checkable
class SupportsVariations(Protocol):
    """`Mean` of a model file: derivatives of its commands by possible errors of the file.

    gravity (3,): m/s^2 in the world. pulls (n, J, 3): for each m/s^2 of gravity along an axis of the world.
    links (n, J, L, 10): for mass (kg), first moments (kg m) and inertia (xx yy zz xy xz yz, kg m^2, about the
    origin) of each link that an axis moves, in its frame, in the order of the axes.
    link_parameters (J, L, 10): those of the file, by command.
    """

    @property
    def gravity(self) -> Array: ...
    @property
    def link_parameters(self) -> Array: ...
    def pulls(self, log: Log) -> Array: ...
    def links(self, log: Log) -> Array: ...


@runtime_checkable
class SupportsWithout(Protocol):
    """`Physics` that shares work between folds (n,): by number of a fold, predictions (n, J) of all samples
    by the mean identified without that fold. A fold is missing if nothing can be identified without it.
    """

    def without(self, samples: Samples, fold: Index) -> Mapping[int, Array]: ...


@runtime_checkable
class SupportsRegressors(Protocol):
    """`Physics` that is linear in its parameters: a regressor for each command (criterion d_opt)."""

    def regressors(self) -> Sequence[Regressor]: ...


@runtime_checkable
class SupportsFastMoments(Protocol):
    """`Model`: mean (n, J) alone; mean and an upper bound of `posterior`'s variance, at lower cost.

    prior_deviation (J,): before any data. least (J,): lower bound of all variances; None: unknown.
    """

    @property
    def prior_deviation(self) -> Array: ...
    @property
    def least(self) -> Array | None: ...
    def mean(self, log: Log) -> Array: ...
    def at_most(self, log: Log) -> tuple[Array, Array]: ...


@runtime_checkable
class SupportsAccelerations(Protocol):
    """`Controller` for a feedback that takes accelerations (T, k): the motion's plus the model's correction;
    None: the motion's own.
    """

    def accelerations(self, motion: Motion) -> Array | None: ...


@runtime_checkable
class SupportsEachTick(Protocol):
    """`Robot` that, if True, calls a controller without a plan at each tick, and passes it measurements."""

    @property
    def asks_each_tick(self) -> bool: ...


@runtime_checkable
class SupportsEngines(Protocol):
    """`Robot`, a frozen dataclass, that runs on more than one simulator: replace(robot, engine=name)."""

    @property
    def engine(self) -> str: ...


@runtime_checkable
class SupportsTestRuns(Protocol):
    """`Robot` that runs a test to its end, however badly it goes."""

    def test(self, trajectory: Any, controller: Controller | None, rng: np.random.Generator) -> Log: ...


@runtime_checkable
class SupportsAssumptions(Protocol):
    """`Robot` made from a real robot's description: sentences on values that were assumed."""

    @property
    def assumed(self) -> tuple[str, ...]: ...


@runtime_checkable
class SupportsSelection(Protocol):
    """`Kind` whose descriptions may hold more than one robot needs.

    chosen: `described` of the joints that move (names or patterns; none: the file's one robot), with others
    held at positions, folders in which to look for meshes first, limits (joint or pattern -> "lower",
    "upper", "velocity", "acceleration", "command") in place of the file's, the floor's height, m, and a file
    of limits (MoveIt's joint_limits.yaml) that count where they are tighter.
    """

    def chosen(
        self,
        path: Path,
        joints: Sequence[str],
        held: Mapping[str, float],
        mesh_roots: Sequence[Path],
        limits: Mapping[str, Mapping[str, float]],
        floor: float | None = None,
        joint_limits: Path | None = None,
    ) -> Described: ...


@runtime_checkable
class SupportsFigure(Protocol):
    """`Kind`: a drawing of its robot along positions q (T, k) of its path."""

    def figure(self, spec: Any, q: Array) -> Figure | None: ...


@runtime_checkable
class SupportsSolids(Protocol):
    """`Kind`: its robot as B solid parts for pictures in space; none if its shapes are unknown.

    placed: (T, B, 3, 4) rotation and position (m) of each part in the world along a motion of its path; the
    motion may have positions alone.
    """

    def solids(self, spec: Any) -> Sequence[Solid]: ...
    def placed(self, spec: Any, motion: Motion) -> Annotated[Array, "(T, B, 3, 4)"]: ...


@runtime_checkable
class SupportsPoses(Protocol):
    """`Kind` with named poses (k,) outside of all motions, from which approaches start."""

    def poses(self, spec: Any) -> Mapping[str, Annotated[Array, "(k,)"]]: ...


@runtime_checkable
class SupportsLeadIn(Protocol):
    """`Kind` whose families have motions that do not end at rest: whether this robot's motions get a lead-in
    from rest and a lead-out to rest.
    """

    def from_rest(self, spec: Any) -> bool: ...


@runtime_checkable
class SupportsReachable(Protocol):
    """`Kind` with known workspaces: the search then covers clear poses all over the workspace, and the report
    shows the ranges that motions sweep. Without it, or None: motions about home alone.
    """

    def reachable(self, spec: Any) -> Reachable | None: ...


@runtime_checkable
class SupportsLargestError(Protocol):
    """`Kind` with known feedback gains: largest position errors (k,) under feedback; NaN: unknown."""

    def largest_error(self, spec: Any) -> Annotated[Array, "(k,)", "NaN"]: ...


@runtime_checkable
class SupportsCollecting(Protocol):
    """`Kind` with a feedforward for training motions, once a model was learned."""

    def collecting(self, spec: Any, config: Any, model: Model) -> Controller | None: ...


@runtime_checkable
class SupportsStateText(Protocol):
    """`Kind` with a text on axes and signs of its states, for C headers."""

    @property
    def states_in_words(self) -> str: ...


@runtime_checkable
class SupportsBody(Protocol):
    """`Kind`: text that identifies the moving body. Other masses, loads or mountings are another body: a
    model of one body does not hold for another.
    """

    def body(self, spec: Any, /) -> str: ...


@runtime_checkable
class SupportsParameters(Protocol):
    """`Kind`: physical constants of a robot with intervals, for `export --to parameters`.

    samples: the model's training samples; logs: the same logs as recorded.
    """

    def parameters(self, spec: Any, config: Any, samples: Samples, logs: Sequence[Log]) -> Delivered: ...


@runtime_checkable
class SupportsKnownFaults(Protocol):
    """`Kind`: codes of docs/known_faults.md that apply to earlier versions' files of this robot."""

    def mended(self, spec: Any) -> Sequence[str]: ...


@runtime_checkable
class SupportsCommandUnit(Protocol):
    """Description (`Kind.spec`) with one unit for all commands: "N m", "N", "A", "V", "pwm", ..."""

    @property
    def command_unit(self) -> str: ...


@runtime_checkable
class SupportsTableRate(Protocol):
    """Description of a robot whose set-points have another rate (Hz) than its logs."""

    @property
    def table_rate(self) -> float: ...


@runtime_checkable
class SupportsConfirmation(Protocol):
    """Description with assumptions: sentences that a person should confirm."""

    @property
    def confirm(self) -> Sequence[str]: ...


@runtime_checkable
class SupportsAgreement(Protocol):
    """Description: the same once a person has confirmed all of it, as motions of a simulation take it."""

    def agreed(self) -> Any: ...


@runtime_checkable
class SupportsFileDoubt(Protocol):
    """`Kind`: whether the masses of the model file look like placeholders, which judge no log."""

    def made_up(self, spec: Any) -> bool: ...


@runtime_checkable
class SupportsJointTables(Protocol):
    """Description: the table of each joint in its file, by keys, among them "lower", "upper", "velocity",
    "acceleration", "jerk", "torque_rate" and "envelope"; None where a value is not stated.
    """

    @property
    def joint_tables(self) -> Sequence[Mapping[str, Any]]: ...


@runtime_checkable
class SupportsPlant(Protocol):
    """Description that may name a built-in simulated plant; such a robot exists only in simulation."""

    @property
    def plant(self) -> str | None: ...


@runtime_checkable
class SupportsStatedLimits(Protocol):
    """[trajectory] table whose keys may narrow the robot's limits: the same table without these keys."""

    @property
    def described(self) -> Any: ...


@runtime_checkable
class SupportsRobotCheck(Protocol):
    """`Exporter` that raises UsageError for a robot whose motions it cannot write, before one is designed."""

    def require_robot(self, kind: Any, spec: Any) -> None: ...


@runtime_checkable
class SupportsFileNotes(Protocol):
    """`Exporter`: sentences for the certificate on the content of its files beside the motion."""

    def notes(self, files: Mapping[str, bytes]) -> tuple[str, ...]: ...


@runtime_checkable
class SupportsCommandedFiles(Protocol):
    """`Exporter` whose files may command other accelerations (T, 3) than the motion's; None: they do not.

    answered: those (T, 3) that the receiver's own loop may make of them: limits of tilt hold for all.
    strays: positions (K, k), and the largest deviation from each if the learned accelerations are wrong.
    """

    def accelerations(self, files: Mapping[str, bytes]) -> Array | None: ...
    def answered(self, files: Mapping[str, bytes]) -> Array | None: ...
    def strays(self, files: Mapping[str, bytes]) -> tuple[Array, Array] | None: ...


@runtime_checkable
class SupportsPayload(Protocol):
    """`Kind`: the text of a robot file with a load (kg, negative if put down) added to its payload.

    centre (3,): m in the frame of the link that the last axis moves. UsageError: nothing would be left.
    """

    def with_payload(self, spec: Any, text: str, mass: float, centre: Array) -> str: ...


@runtime_checkable
class SupportsPlacement(Protocol):
    """`Driver` of a simulation that begins at a pose, rad or m by joint, unless its settings have another.

    Called before it is connected.
    """

    def place(self, pose: Mapping[str, float]) -> None: ...


@runtime_checkable
class SupportsNeeds(Protocol):
    """Target, names of `model_export.supplied` that become options; Criterion: "reference", "identified"."""

    @property
    def needs(self) -> str | Sequence[str]: ...


ABILITIES: Mapping[str, tuple[type, ...]] = {
    "Limit": (
        SupportsOrder,
        SupportsOrders,
        SupportsCoverage,
        SupportsWarnings,
        SupportsRefusal,
        SupportsRoomCheck,
        SupportsFastCheck,
        SupportsWitness,
        SupportsViolation,
        SupportsBoxes,
        SupportsBlocking,
        SupportsOffsets,
        SupportsDrawing,
        SupportsNearby,
    ),
    "Inputs": (SupportsMemory, SupportsDrag, SupportsNotes, SupportsOnnx),
    "Mean": (SupportsOnnx, SupportsColumns, SupportsVariations),
    "Physics": (SupportsWithout, SupportsSlow, SupportsRipple, SupportsRegressors),
    "Model": (SupportsFastMoments,),
    "Controller": (SupportsAccelerations,),
    "Robot": (SupportsEachTick, SupportsEngines, SupportsTestRuns, SupportsAssumptions),
    "Kind": (
        SupportsSelection,
        SupportsFigure,
        SupportsSolids,
        SupportsPoses,
        SupportsLeadIn,
        SupportsReachable,
        SupportsLargestError,
        SupportsCollecting,
        SupportsStateText,
        SupportsBody,
        SupportsParameters,
        SupportsKnownFaults,
        SupportsPayload,
        SupportsFileDoubt,
    ),
    "Description": (
        SupportsCommandUnit,
        SupportsTableRate,
        SupportsConfirmation,
        SupportsAgreement,
        SupportsJointTables,
        SupportsPlant,
    ),
    "[trajectory]": (SupportsStatedLimits,),
    "Exporter": (SupportsRobotCheck, SupportsFileNotes, SupportsCommandedFiles),
    "Driver": (SupportsPlacement,),
    "Target": (SupportsNeeds,),
    "Criterion": (SupportsNeeds,),
}
"""Part -> its optional abilities."""
