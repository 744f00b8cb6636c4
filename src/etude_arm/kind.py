"""Kind "arm": the parts of one robot of joints, from its description."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from etude.protocols import Controller, Family, Limit, Model, Trajectory
from etude.storage import sha256_of
from etude.types import (
    Array,
    Channel,
    Delivered,
    Described,
    Expected,
    Figure,
    Finding,
    Index,
    Log,
    Margins,
    Motion,
    Reachable,
    Samples,
    Solid,
)
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    from etude_arm.controller import Fading
    from etude_arm.inputs import ArmInputs
    from etude_arm.physics.mean import ArmPhysics
    from etude_arm.plant.feedback_loop import Following

HERE = Path(__file__).parent
MODEL_FILES = (".urdf", ".xml", ".mjcf", ".xacro")
"""A xacro is recognised so that it can be refused with how to expand it."""


COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": 'N of thesis (3.5), 2 or more (1 is possible with rest = "ramp")',
        "duration": "duration of each recording in s, without the links between its segments",
        "omega0": 'rad/s: a number, a range [low, high], or "none": segments with a suitable period',
        "rest": 'method of starting and ending at rest: "nullspace" or "ramp"',
        "ramp": 'duration of each phase ramp in s, for rest = "ramp"',
    },
    "data": {
        "inputs": '"measured" positions, differentiated; or the "desired" motion, as in the thesis',
        "cutoff_hz": 'zero-phase low-pass: Hz, "auto", or "none"',
        "rate_hz": "samples kept per second of log",
        "least_samples": "short logs keep more per second, up to this number",
        "stick_fraction": "a joint slower than this fraction of its top speed is treated as at rest; 0: "
        "no mask",
        "reversal": "periods of the cutoff around a fast reversal that are not used; 0: all are used",
        "plenty": "samples that a joint must keep for that",
        "trim_s": 'time cut from both ends of a log in s; "auto" is one period of the cutoff',
        "friction_fraction": "width of the friction input as a fraction of the velocity limit; 0: none",
        "presliding": "presliding distance of the friction memory in rad (in m: a tenth); 0: no memory",
        "offset": 'start of thinning: "spread" (different in each log) or the "first" sample',
    },
}


WORLD = "world"
"""The name of MuJoCo's own world body, which takes no pose: a root link of that name lost its mounting."""


def lost_mounting(spec: ArmSpec) -> bool:
    """Whether generation 1 lost this robot's mounting, because its URDF's root link is named world."""
    if spec.mounting is None or not any((*spec.mounting.position, *spec.mounting.rotation)):
        return False
    root = _model_root(spec)
    if root is None or root.tag != "robot":
        return False
    below = {child.get("link") for child in root.iterfind("joint/child")}
    return any(link.get("name") == WORLD not in below for link in root.iterfind("link"))


def divided_by_gear(spec: ArmSpec) -> bool:
    """Whether generation 2 divided torques of this robot's joints by the gear of their actuators."""
    root = _model_root(spec)
    if root is None or root.tag == "robot":
        return False
    return any(
        float(element.get("gear", "1").split()[0]) != 1.0
        for element in root.iter()
        if element.get("gear") and element.get("tendon") is None
    )


def _model_root(spec: ArmSpec) -> ET.Element | None:
    """Root of the model file; None without one that can be read."""
    try:
        return None if spec.model_file is None else ET.parse(spec.model_file).getroot()
    except (OSError, ET.ParseError):
        return None


class ArmKind:
    """Implements `protocols.Kind`. Modules are loaded when needed: most commands need few of them."""

    @property
    def name(self) -> str:
        return "arm"

    @property
    def path(self) -> str:
        return "q"

    @property
    def tables(self) -> Mapping[str, type]:
        from etude.trajectories.config import FourierConfig
        from etude_arm.config import ArmData

        return {"trajectory": FourierConfig, "data": ArmData}

    @property
    def presets(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
        from etude.toml_tables import packaged

        return packaged(HERE / "presets.toml")

    @property
    def comments(self) -> Mapping[str, Mapping[str, str]]:

        return COMMENTS

    def built_in(self) -> Mapping[str, Path]:
        """The robots in `data/` by name."""
        return {path.stem: path for path in sorted((HERE / "data").glob("*.toml"))}

    def recognises(self, path: Path) -> bool:
        """A URDF, xacro or MJCF, or a robot file that names this kind or none."""
        if path.suffix.lower() in MODEL_FILES:
            return True
        from etude.errors import UsageError
        from etude.toml_tables import decoded, read_text
        from etude_arm.robot_file import KINDS

        try:
            return path.suffix.lower() == ".toml" and decoded(read_text(path), "").get("kind", "") in KINDS
        except UsageError:
            return False

    def described(self, path: Path) -> Described:
        """robot.toml and, if it names one, a whole copy of the model file."""
        from etude_arm.description import describe

        return describe(path)

    def chosen(
        self,
        path: Path,
        joints: Sequence[str],
        held: Mapping[str, float],
        mesh_roots: Sequence[Path],
        limits: Mapping[str, Mapping[str, float]],
        floor: float | None = None,
        joint_limits: Path | None = None,
    ) -> Described:
        """The same for a part of a larger robot, with these mesh folders, limits and floor."""
        from etude_arm.description import describe

        return describe(path, joints or None, held, mesh_roots, limits, floor, joint_limits)

    def spec(self, path: Path) -> ArmSpec:
        """The robot of a robot file, a URDF or an MJCF. UsageError if it cannot be one."""
        if path.suffix.lower() == ".toml":
            from etude_arm.robot_file import read_robot

            return read_robot(path)
        from etude_arm.description import read

        return read(path)[0]

    def home(self, spec: ArmSpec) -> Array:
        """A pose (J,) clear of everything, rad (m); without shapes, the middle of the position limits."""
        from etude_arm.clearance.robot_clearance import search_of

        return search_of(spec)[0]

    def reachable(self, spec: ArmSpec) -> Reachable:
        """Ranges, within one turn, and clear poses for an arm with shapes."""
        from etude_arm.clearance.robot_clearance import reachable_of

        return reachable_of(spec)

    def limit(self, spec: ArmSpec) -> Array:
        """Largest commands (J,)."""
        return spec.command

    def channels(self, spec: ArmSpec) -> Sequence[Channel]:
        return spec.channels()

    def expected(self, spec: ArmSpec) -> Expected:
        """Ranges of positions, velocities and commands; rest before and after a motion is kept."""
        limits = {
            "q": (spec.lower, spec.upper),
            "qd": (-spec.velocity, spec.velocity),
            "qdd": (-spec.acceleration, spec.acceleration),
            "command": (-spec.command, spec.command),
        }
        return Expected(spec.rate, spec.upper - spec.lower, limits)

    def family(self, spec: ArmSpec, config: Any) -> Family:
        """Fourier series of every joint; without omega0, one period that suits the robot."""
        from etude_arm.motions import family

        return family(spec, config.trajectory)

    def limits(self, spec: ArmSpec, config: Any, model: Model | None, margins: Margins) -> Sequence[Limit]:  # noqa: ARG002
        """Position, velocity, acceleration and clearance less the tracking margins, and limits of the
        commands.

        The model predicts the commands; without one, the masses in the model file do.
        """
        from etude_arm.motions import limits

        return limits(spec, margins, model)

    def mended(self, spec: ArmSpec) -> tuple[str, ...]:
        """Faults of earlier versions that this robot's files have."""
        faults = {"mounting": lost_mounting(spec), "gear": divided_by_gear(spec)}
        return tuple(code for code, has in faults.items() if has)

    def largest_error(self, spec: ArmSpec) -> Array:
        """Position errors (J,), rad (m), at which the proportional gain gives the largest command."""
        from etude_arm.motions import largest_error

        return largest_error(spec)

    def approaches(
        self, spec: ArmSpec, motion: Trajectory, pose: Array
    ) -> tuple[Trajectory, Trajectory] | None:
        """Straight moves in joint space from the pose to the start, and from the end to the pose."""
        from etude_arm.motions import approaches

        return approaches(spec, motion, pose)

    def inputs(self, spec: ArmSpec, config: Any) -> ArmInputs:
        from etude_arm.inputs import ArmInputs
        from etude_arm.physics.geometry import has_masses

        data = config.data
        presliding = data.presliding if config.model.remembers else 0.0
        physics = spec.model_file is not None and data.presliding > 0.0 and has_masses(spec)
        return ArmInputs.of(
            spec, data.friction_fraction, data.desired, presliding, data.stick_fraction, physics
        )

    def physics(self, spec: ArmSpec, config: Any) -> Mapping[str, ArmPhysics]:
        """Physics by name; empty without a model file. "nominal" requires commands that are forces."""
        if spec.model_file is None:
            return {}
        from etude_arm.physics.mean import physics_of

        data = config.data
        return physics_of(spec, data.friction_fraction, data.desired, data.stick_fraction)

    def with_payload(self, spec: ArmSpec, text: str, mass: float, centre: Array) -> str:
        """The robot file with an additional load."""
        from etude_arm.payload_table import with_payload

        return with_payload(text, spec, mass, centre)

    def parameters(
        self,
        spec: ArmSpec,
        config: Any,
        samples: Samples,
        logs: Sequence[Log],  # noqa: ARG002
    ) -> Delivered:
        """Base parameters and friction."""
        from etude_arm.identified.parameter_report import report

        return report(spec, self.physics(spec, config).get("identified"), samples, config.data)

    def made_up(self, spec: ArmSpec) -> bool:
        """Whether the inertias of the model file look like placeholders: those of most links are the same."""
        from etude_arm.loading.implausible import alike

        return alike(spec)

    def checks(self, spec: ArmSpec, log: Log) -> Sequence[Finding]:
        """Findings of the arm's own log checks, such as another rate than that of the robot file."""
        from etude_arm.log_checks import findings

        return findings(spec, log)

    def samples(self, spec: ArmSpec, config: Any, logs: Sequence[Log], groups: Sequence[Index]) -> Samples:
        from etude_arm.preprocessing import samples_of

        return samples_of(spec, config.data, logs, groups)

    def robot(self, spec: ArmSpec, config: Any) -> Following | None:  # noqa: ARG002
        """The simulated robot that the robot file names, else one from its model file's masses; None without
        both.
        """
        if spec.plant is None:
            from etude_arm.physics.geometry import has_masses

            if not has_masses(spec):
                return None
            from etude_arm.rehearsal.rehearsed_robot import rehearsed

            return rehearsed(spec)
        from etude_arm.plant.robot import simulated_robot

        return simulated_robot(spec.plant, spec)

    def body(self, spec: ArmSpec) -> str:
        """Hash of the model file and of the additions in robot.toml."""
        file = spec.model_file
        linked = sha256_of(file) if file is not None and file.is_file() else ""
        carried = (spec.mounting, spec.tool, spec.payload, sorted(spec.held.items()))
        return sha256(repr((spec.names, spec.command_unit, linked, *carried)).encode()).hexdigest()

    def figure(self, spec: ArmSpec, q: Array) -> Figure | None:
        """Joints and tips along q (T, J), rad (m); None without a model file."""
        if spec.model_file is None:
            return None
        from etude_arm.figure import figure

        return figure(spec, q)

    def solids(self, spec: ArmSpec) -> Sequence[Solid]:
        """Shapes of the distance checks, by rigid part; empty without a model file or shapes."""
        from etude_arm.solids import solids

        return solids(spec)

    def placed(self, spec: ArmSpec, motion: Motion) -> Array:
        """Frames (T, B, 3, 4) of the parts, m, by the kinematics of the distance checks."""
        from etude_arm.solids import placed

        return placed(spec, motion.orders[0])

    def tests(self, spec: ArmSpec, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]:  # noqa: ARG002
        from etude_arm.motions import tests

        return tests(spec, rng)

    def baselines(self, spec: ArmSpec, config: Any) -> Mapping[str, Controller | None]:
        """Feedback alone, and the simulated robot's exact inverse, which no model can exceed."""
        robot = self.robot(spec, config)
        if robot is None:
            return {"pd": None}
        from etude_arm.controller import PerfectController

        return {"pd": None, "perfect": PerfectController(robot)}

    def controller(self, spec: ArmSpec, config: Any, model: Model) -> Controller:  # noqa: ARG002
        """The learned command, faded where the model has no more information than before any data."""
        from etude_arm.controller import ModelController

        return ModelController(cast("Fading", model), spec)


KIND = ArmKind()
