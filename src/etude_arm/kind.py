"""Robots of joints as a kind: the nouns of one arm, made of its description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from etude.protocols import Controller, Family, Limit, Model, Trajectory
from etude.types import (
    Array,
    Channel,
    Described,
    Expected,
    Figure,
    Finding,
    Index,
    Log,
    Margins,
    Reachable,
    Samples,
)

if TYPE_CHECKING:
    from etude_arm.controller import Fading
    from etude_arm.inputs import ArmInputs
    from etude_arm.physics.mean import ArmPhysics
    from etude_arm.plant.following import Following
    from etude_arm.spec import ArmSpec

HERE = Path(__file__).parent
MODEL_FILES = (".urdf", ".xml", ".mjcf", ".xacro")
"""A xacro is recognised so that it can be refused with how to expand it."""


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
        from etude.trajectories.family import FourierConfig
        from etude_arm.recipe import ArmData

        return {"trajectory": FourierConfig, "data": ArmData}

    @property
    def presets(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
        from etude.toml_tables import decoded, read_text

        path = HERE / "presets.toml"
        return decoded(read_text(path), path.name)

    @property
    def comments(self) -> Mapping[str, Mapping[str, str]]:
        from etude_arm.comments import COMMENTS

        return COMMENTS

    def built_in(self) -> Mapping[str, Path]:
        """The robots in `data/`, by name."""
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
        """robot.toml and, if there is one, the model file beside it, whole."""
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
    ) -> Described:
        """The same of a part of a larger robot, meshes of these folders, these limits and floor."""
        from etude_arm.description import describe

        return describe(path, joints or None, held, mesh_roots, limits, floor)

    def spec(self, path: Path) -> ArmSpec:
        """The robot of a robot file, a URDF or an MJCF. UsageError if it cannot be one."""
        from etude_arm.description import read

        return read(path)[0]

    def home(self, spec: ArmSpec) -> Array:
        """(J,) a pose clear of everything, or without shapes the middle of the position limits."""
        from etude_arm.clearance.of_robot import search_of

        return search_of(spec)[0]

    def reachable(self, spec: ArmSpec) -> Reachable:
        """Ranges, a turn at most, and of an arm with shapes clear poses in them."""
        from etude_arm.clearance.of_robot import reachable_of

        return reachable_of(spec)

    def limit(self, spec: ArmSpec) -> Array:
        """(J,) the largest commands."""
        return spec.command

    def channels(self, spec: ArmSpec) -> Sequence[Channel]:
        return spec.channels()

    def expected(self, spec: ArmSpec) -> Expected:
        """Positions, velocities and commands within the limits; rest before and after is kept."""
        limits = {
            "q": (spec.lower, spec.upper),
            "qd": (-spec.velocity, spec.velocity),
            "qdd": (-spec.acceleration, spec.acceleration),
            "command": (-spec.command, spec.command),
        }
        return Expected(spec.rate, spec.upper - spec.lower, limits)

    def family(self, spec: ArmSpec, config: Any) -> Family:
        """Fourier series of every joint; if omega0 was left open, one period of what suits the robot."""
        from etude_arm.motions import family

        return family(spec, config.trajectory)

    def limits(self, spec: ArmSpec, config: Any, model: Model | None, margins: Margins) -> Sequence[Limit]:  # noqa: ARG002
        """Position, velocity, acceleration and clearance, less what tracking was seen to overshoot; commands
        by the model, or by the model file's masses.
        """
        from etude_arm.motions import limits

        return limits(spec, margins, model)

    def mended(self, spec: ArmSpec) -> tuple[str, ...]:
        """Robots whose mounting was lost: see `mended.lost_mounting`."""
        from etude_arm.mended import lost_mounting

        return ("mounting",) if lost_mounting(spec) else ()

    def largest_error(self, spec: ArmSpec) -> Array:
        """(J,) rad (m) that the largest command holds against its own proportional gain."""
        from etude_arm.motions import largest_error

        return largest_error(spec)

    def ways(self, spec: ArmSpec, motion: Trajectory, pose: Array) -> tuple[Trajectory, Trajectory] | None:
        """Straight moves in joint space, from the pose to the start and from the end back."""
        from etude_arm.motions import ways

        return ways(spec, motion, pose)

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
        """None without a model file; "nominal" only where commands are forces."""
        if spec.model_file is None:
            return {}
        from etude_arm.physics.mean import physics_of

        return physics_of(spec, config.data.friction_fraction, config.data.desired)

    def checks(self, spec: ArmSpec, log: Log) -> Sequence[Finding]:
        """Another rate than the robot file's, which may be another clock."""
        from etude_arm.log_checks import findings

        return findings(spec, log)

    def samples(self, spec: ArmSpec, config: Any, logs: Sequence[Log], groups: Sequence[Index]) -> Samples:
        from etude_arm.recipe import samples_of

        return samples_of(spec, config.data, logs, groups)

    def robot(self, spec: ArmSpec, config: Any) -> Following | None:  # noqa: ARG002
        """The stand-in that the robot file names, else one made from its model file's masses; or None."""
        if spec.plant is None:
            from etude_arm.physics.geometry import has_masses

            if not has_masses(spec):
                return None
            from etude_arm.rehearsal.robot import rehearsed

            return rehearsed(spec)
        from etude_arm.plant.robot import simulated_robot

        return simulated_robot(spec.plant, spec)

    def figure(self, spec: ArmSpec, q: Array) -> Figure | None:
        """The joints and the tips along q (T, J); None without a model file."""
        if spec.model_file is None:
            return None
        from etude_arm.figure import figure

        return figure(spec, q)

    def tests(self, spec: ArmSpec, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]:  # noqa: ARG002
        from etude_arm.motions import tests

        return tests(spec, rng)

    def baselines(self, spec: ArmSpec, config: Any) -> Mapping[str, Controller | None]:
        """Feedback alone, and the simulated robot's exact inverse: what no model can do better."""
        robot = self.robot(spec, config)
        if robot is None:
            return {"pd": None}
        from etude_arm.controller import PerfectController

        return {"pd": None, "perfect": PerfectController(robot)}

    def controller(self, spec: ArmSpec, config: Any, model: Model) -> Controller:  # noqa: ARG002
        """The learned command, faded out where the model knows no better than before any data."""
        from etude_arm.controller import ModelController

        return ModelController(cast("Fading", model), spec)


KIND = ArmKind()
