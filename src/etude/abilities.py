"""Optional abilities of the pipeline's parts: one small protocol for each.

The first word of a docstring names the part. A part has an ability if it has all its members; `isinstance`
tells. What a part lacks is named in a sentence, never stubbed. A part with only some members of an ability is
refused (`require_whole`). `etude.protocols` has what every part owes.
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
    """`Limit` that looks at more orders of a motion than position, velocity and acceleration."""

    @property
    def orders(self) -> int: ...


@runtime_checkable
class SupportsCoverage(Protocol):
    """`Limit`: which of `limits.certificate.ALL` it looks at, and sentences on what it leaves out."""

    @property
    def looks_at(self) -> tuple[str, ...]: ...
    @property
    def not_verified(self) -> tuple[str, ...]: ...


@runtime_checkable
class SupportsWarnings(Protocol):
    """`Limit` with notices, or sentences alone, that come first in a motion's certificate."""

    def warned(self, trajectory: Trajectory) -> Sequence[str | Notice]: ...


@runtime_checkable
class SupportsRefusal(Protocol):
    """`Limit` that may allow no motion at all: the fact and the next step, or two empty texts."""

    @property
    def refused(self) -> tuple[str, str]: ...


@runtime_checkable
class SupportsRoomCheck(Protocol):
    """`Limit` that raises UnsafeTrajectoryError if it leaves no room for any motion of that form."""

    def check_room(self, form: str) -> None: ...


@runtime_checkable
class SupportsFastCheck(Protocol):
    """`Limit` with a fast answer for searches, whose result is then proved."""

    def keeps(self, piece: Trajectory) -> bool: ...


@runtime_checkable
class SupportsBoxes(Protocol):
    """`Limit` on the path alone, at any speed, so that a search may widen a motion to one side.

    about: the same limit with another box of cones, (k,) to (k,). roughly: whether poses (T, k) of a motion
    of that form about `pose` (k,) keep it, at little cost.
    """

    def about(self, lower: Array, upper: Array) -> Limit: ...
    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]: ...


@runtime_checkable
class SupportsBlocking(Protocol):
    """`Limit` that names what a pose (k,) in a motion of that form runs into; "": nothing."""

    def blocked(self, form: str, pose: Array) -> str: ...


@runtime_checkable
class SupportsOffsets(Protocol):
    """`Limit` of places: rows for a plan's places (K, k) where the robot may be `off` (K, k) beside them."""

    def strayed(self, places: Array, off: Array) -> Sequence[Proof]: ...


@runtime_checkable
class SupportsDrawing(Protocol):
    """`Limit`: what a drawing shows of it, in the robot's world."""

    @property
    def things(self) -> Sequence[Thing]: ...


@runtime_checkable
class SupportsNearby(Protocol):
    """`Limit` of distances: how near what it keeps apart is at poses (T, k), with the ends of as many of the
    narrowest as `lines` says.
    """

    def nearby(self, poses: Array, lines: int) -> Nearby: ...


@runtime_checkable
class SupportsMemory(Protocol):
    """`Inputs` whose physics remembers: a log with what is remembered, as it is if it carries that already.

    followed: rows in order, from rest. apart: rows that do not follow one another. carried: one row after
    another, with what the row before left (None: the first).
    """

    def followed(self, log: Log) -> Log: ...
    def apart(self, log: Log) -> Log: ...
    def carried(self, row: Log, before: Array | None) -> tuple[Log, Array | None]: ...


@runtime_checkable
class SupportsSlow(Protocol):
    """`Physics` that slow samples may tell more of: the samples with those taken as moving, from which the
    physics is fitted again; None where there are too few.
    """

    def slow(self, samples: Samples) -> Samples | None: ...


@runtime_checkable
class SupportsRipple(Protocol):
    """`Physics` that may look for what returns with a position: the samples that tell it, and that physics;
    None: it may not of this robot.
    """

    def rippled(self, samples: Samples) -> tuple[Samples, Physics] | None: ...


@runtime_checkable
class SupportsDrag(Protocol):
    """`Inputs` of vehicles that know the air's drag (dx, dy, dz), 1/s. drag_c: C99 of void name(const real
    *body_velocity, real *force), the lateral force per mass in body axes; None: unknown.
    """

    @property
    def drag(self) -> tuple[float, float, float]: ...
    def drag_c(self, name: str) -> Code | None: ...


@runtime_checkable
class SupportsNotes(Protocol):
    """`Inputs` with notices, or sentences alone, on what `fitted` found."""

    @property
    def notes(self) -> Sequence[str | Notice]: ...


@runtime_checkable
class SupportsOnnx(Protocol):
    """`Inputs` or `Mean` as a piece of an ONNX graph, which in a run from rest says what Python says."""

    def onnx(self) -> Piece: ...


@runtime_checkable
class SupportsColumns(Protocol):
    """`Mean` that reads states which the model's inputs do not hold: their columns, as of `Inputs`."""

    @property
    def columns(self) -> Sequence[Column]: ...


@runtime_checkable
class SupportsVariations(Protocol):
    """`Mean` of a model file: what its commands change by if the file is wrong in one thing.

    gravity (3,): m/s^2 in the world. pulls (n, J, 3): for each m/s^2 of gravity along an axis of the world.
    links (n, J, L, 10): for mass (kg), first moments (kg m) and inertia (xx yy zz xy xz yz, kg m^2, about the
    origin) of each link that an axis moves, in its frame, in the order of the axes.
    """

    @property
    def gravity(self) -> Array: ...
    def pulls(self, log: Log) -> Array: ...
    def links(self, log: Log) -> Array: ...


@runtime_checkable
class SupportsWithout(Protocol):
    """`Physics` that shares work between folds (n,): by number of a fold what the mean without it says of all
    samples, (n, J). A fold without which nothing can be identified is missing.
    """

    def without(self, samples: Samples, fold: Index) -> Mapping[int, Array]: ...


@runtime_checkable
class SupportsRegressors(Protocol):
    """`Physics` that is linear in its parameters: a regressor for each command (criterion d_opt)."""

    def regressors(self) -> Sequence[Regressor]: ...


@runtime_checkable
class SupportsFastMoments(Protocol):
    """`Model`: mean (n, J) alone; mean and a variance that is at least that of `posterior`, for less.

    prior_deviation (J,): before any data. least (J,): variance claimed anywhere, None: none.
    """

    @property
    def prior_deviation(self) -> Array: ...
    @property
    def least(self) -> Array | None: ...
    def mean(self, log: Log) -> Array: ...
    def at_most(self, log: Log) -> tuple[Array, Array]: ...


@runtime_checkable
class SupportsAccelerations(Protocol):
    """`Controller` of a feedback that takes accelerations (T, k): the motion's and what the model adds; None:
    the motion's own.
    """

    def accelerations(self, motion: Motion) -> Array | None: ...


@runtime_checkable
class SupportsEachTick(Protocol):
    """`Robot` that, if True, asks a controller that plans nothing at each tick and shows it measurements."""

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
    """`Robot` made from a real robot's description: sentences on what nobody described."""

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
    """`Kind`: its robot along positions q (T, k) of its path, to be drawn."""

    def figure(self, spec: Any, q: Array) -> Figure | None: ...


@runtime_checkable
class SupportsSolids(Protocol):
    """`Kind`: its robot as B solid parts, none where nothing says how it looks, for pictures in space.

    placed: (T, B, 3, 4) rotation and place, m, of each in the world along a motion of its path, which may
    hold positions alone.
    """

    def solids(self, spec: Any) -> Sequence[Solid]: ...
    def placed(self, spec: Any, motion: Motion) -> Annotated[Array, "(T, B, 3, 4)"]: ...


@runtime_checkable
class SupportsPoses(Protocol):
    """`Kind` whose robots may stand where no motion goes: poses (k,) by name, from which its ways lead."""

    def poses(self, spec: Any) -> Mapping[str, Annotated[Array, "(k,)"]]: ...


@runtime_checkable
class SupportsLeadIn(Protocol):
    """`Kind` whose families make motions that move at their ends: whether this robot's get a lead-in from
    rest and a lead-out to rest.
    """

    def from_rest(self, spec: Any) -> bool: ...


@runtime_checkable
class SupportsReachable(Protocol):
    """`Kind` that knows where its robots can be: motions are then looked for about clear poses all over it,
    and what they sweep is reported. Without it, or None: motions about home alone.
    """

    def reachable(self, spec: Any) -> Reachable | None: ...


@runtime_checkable
class SupportsLargestError(Protocol):
    """`Kind` that knows its robots' feedback: largest position errors (k,) that it allows, NaN: unknown."""

    def largest_error(self, spec: Any) -> Annotated[Array, "(k,)", "NaN"]: ...


@runtime_checkable
class SupportsCollecting(Protocol):
    """`Kind` that adds something to the feedback of motions that teach, once a model was learned."""

    def collecting(self, spec: Any, config: Any, model: Model) -> Controller | None: ...


@runtime_checkable
class SupportsStateText(Protocol):
    """`Kind` that says what axes and signs its states have, for headers in C."""

    @property
    def states_in_words(self) -> str: ...


@runtime_checkable
class SupportsBody(Protocol):
    """`Kind`: what moves, as the description says. Other masses, loads or mountings are another body: what
    was learned of one says nothing of the commands of another.
    """

    def body(self, spec: Any, /) -> str: ...


@runtime_checkable
class SupportsParameters(Protocol):
    """`Kind`: physical constants of a robot with intervals, for `export --to parameters`.

    samples: that the model was learned from; logs: the same as they were recorded.
    """

    def parameters(self, spec: Any, config: Any, samples: Samples, logs: Sequence[Log]) -> Delivered: ...


@runtime_checkable
class SupportsKnownFaults(Protocol):
    """`Kind`: codes of docs/known_faults.md that earlier versions' files of this robot have."""

    def mended(self, spec: Any) -> Sequence[str]: ...


@runtime_checkable
class SupportsCommandUnit(Protocol):
    """Description (`Kind.spec`) with one unit for all commands: "N m", "N", "A", "V", "pwm", ..."""

    @property
    def command_unit(self) -> str: ...


@runtime_checkable
class SupportsTableRate(Protocol):
    """Description of a robot that takes set-points at another rate (Hz) than that of its logs."""

    @property
    def table_rate(self) -> float: ...


@runtime_checkable
class SupportsConfirmation(Protocol):
    """Description made with assumptions: sentences that a person should confirm."""

    @property
    def confirm(self) -> Sequence[str]: ...


@runtime_checkable
class SupportsJointTables(Protocol):
    """Description: what its file says of each joint by its keys, among them "lower", "upper", "velocity",
    "acceleration", "jerk", "torque_rate" and "envelope"; None where it says nothing.
    """

    @property
    def joint_tables(self) -> Sequence[Mapping[str, Any]]: ...


@runtime_checkable
class SupportsPlant(Protocol):
    """Description that may name a built-in simulated plant, of which nothing else is real."""

    @property
    def plant(self) -> str | None: ...


@runtime_checkable
class SupportsStatedLimits(Protocol):
    """[trajectory] table whose keys may narrow the robot's limits: the same table without that."""

    @property
    def described(self) -> Any: ...


@runtime_checkable
class SupportsFileNotes(Protocol):
    """`Exporter`: sentences for the certificate on what its files hold beside the motion."""

    def notes(self, files: Mapping[str, bytes]) -> tuple[str, ...]: ...


@runtime_checkable
class SupportsCommandedFiles(Protocol):
    """`Exporter` whose files may command other accelerations (T, 3) than the motion's; None: they do not.

    strays: places (K, k), and how far a robot may be off each where what was learned of these is wrong.
    """

    def accelerations(self, files: Mapping[str, bytes]) -> Array | None: ...
    def strays(self, files: Mapping[str, bytes]) -> tuple[Array, Array] | None: ...


@runtime_checkable
class SupportsPayload(Protocol):
    """`Kind`: the text of a robot file with a load (kg, less than 0 if put down) added to what it carries.

    centre (3,): m in the frame of the link that the last axis moves. UsageError: nothing would be left.
    """

    def with_payload(self, spec: Any, text: str, mass: float, centre: Array) -> str: ...


@runtime_checkable
class SupportsNeeds(Protocol):
    """Target, names of `campaign.supplied` that become options; Criterion: "reference" or "identified"."""

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
    ),
    "Description": (
        SupportsCommandUnit,
        SupportsTableRate,
        SupportsConfirmation,
        SupportsJointTables,
        SupportsPlant,
    ),
    "[trajectory]": (SupportsStatedLimits,),
    "Exporter": (SupportsFileNotes, SupportsCommandedFiles),
    "Target": (SupportsNeeds,),
    "Criterion": (SupportsNeeds,),
}
"""Part -> its optional abilities."""
