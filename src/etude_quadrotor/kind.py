"""Kind "quadrotor": the parts of one multirotor, from its description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.protocols import Controller, Family, Limit, Model, Physics, Robot, Trajectory
from etude.types import (
    Array,
    Channel,
    Delivered,
    Described,
    Expected,
    Finding,
    Index,
    Log,
    Margins,
    Motion,
    Samples,
    Solid,
)

if TYPE_CHECKING:
    from etude_quadrotor.inputs import QuadrotorInputs
    from etude_quadrotor.spec import QuadrotorSpec

HERE = Path(__file__).parent


COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": "N of thesis (3.3)",
        "duration": "duration of each flight in s",
        "omega0": 'rad/s, or "none" for one period in the duration',
        "start": '"moving", with the plan\'s velocity, or "hover", at rest, as the thesis',
        "rest": "whether the plan itself starts and ends at rest",
        "free_centre": "whether x and y also have a constant term",
        "tilt": "largest angle of the planned thrust from the vertical in rad, unless the vehicle's is less",
        "lean": "whether simulated flights compensate the drag learned from earlier ones",
        "centre": "constant terms of x and y in m if they are not free; in a room without 0, relative to "
        "its middle",
    },
    "data": {
        "averaged": "means over each sample interval; false: single samples, as in the thesis",
        "lag_s": 'lag of the motion behind the commands in s; "auto" measures it',
        "first_s": "time cut from the start of a flight in s",
        "last_s": "time cut from its end in s",
        "altitude": "whether the altitude is an input",
        "acceleration": '"specific_force", or "kinematic", as the thesis',
        "body_velocity": "whether the velocity is an input; drag depends on it",
        "battery_voltage": "whether the voltage may be an input; it is used if held-out flights improve",
        "trims": "whether the identified physics have a constant for each motor",
    },
}


class QuadrotorKind:
    """Implements `protocols.Kind`. Modules are loaded when needed: most commands need few of them."""

    @property
    def name(self) -> str:
        return "quadrotor"

    @property
    def path(self) -> str:
        return "position"

    @property
    def tables(self) -> Mapping[str, type]:
        from etude_quadrotor.config import FlightConfig, FlightData

        return {"trajectory": FlightConfig, "data": FlightData}

    @property
    def presets(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
        from etude.toml_tables import packaged

        return packaged(HERE / "presets.toml")

    @property
    def comments(self) -> Mapping[str, Mapping[str, str]]:

        return COMMENTS

    @property
    def states_in_words(self) -> str:
        from etude_quadrotor.channels import IN_WORDS

        return IN_WORDS

    def built_in(self) -> Mapping[str, Path]:
        """The vehicles in `data/` by name."""
        return {path.stem: path for path in sorted((HERE / "data").glob("*.toml"))}

    def recognises(self, path: Path) -> bool:
        """A robot file that names this kind, or a vehicle."""
        from etude.errors import UsageError
        from etude.toml_tables import decoded, read_text
        from etude_quadrotor.spec_file import KINDS

        try:
            return path.suffix.lower() == ".toml" and decoded(read_text(path), "").get("kind") in KINDS
        except UsageError:
            return False

    def described(self, path: Path) -> Described:
        """robot.toml alone: a vehicle has no other files."""
        from etude.limits import made_limits
        from etude_quadrotor.channels import AXES
        from etude_quadrotor.spec_file import spec_to_toml

        spec = self.spec(path)
        made_limits(spec.limits, spec, None, {}, AXES)  # a wrong name in a table is refused now
        return Described({"robot.toml": spec_to_toml(spec).encode()})

    def spec(self, path: Path) -> QuadrotorSpec:
        """The vehicle of a robot file. UsageError if it cannot be one."""
        from etude_quadrotor.spec_file import read_spec

        return read_spec(path)

    def home(self, spec: QuadrotorSpec) -> Array:
        """Middle of the workspace (3,) m."""
        from etude_quadrotor.motions import home

        return home(spec)

    def limit(self, spec: QuadrotorSpec) -> Array:
        """Half range (n,) of each command, in its unit."""
        return spec.reach

    def channels(self, spec: QuadrotorSpec) -> Sequence[Channel]:
        from etude_quadrotor.channels import readable

        return readable(spec)

    def expected(self, spec: QuadrotorSpec) -> Expected:
        """Workspace, speed and commands; flight before and after the trajectory is trimmed."""
        from etude_quadrotor.channels import expected

        return expected(spec)

    def family(self, spec: QuadrotorSpec, config: Any) -> Family:
        """Fourier series of x, y and z of one base frequency (thesis (3.3))."""
        from etude_quadrotor.motions import centred, flight_family

        return flight_family(centred(spec, config.trajectory))

    def body(self, spec: QuadrotorSpec) -> str:
        """Hash of the vehicle that determines the commands; another payload needs a new model."""
        curve = (spec.thrust_curve,) if spec.thrust_curve else ()
        return sha256(
            repr((spec.vehicle, spec.command_unit, spec.command_names, *spec.rotors, *curve)).encode()
        ).hexdigest()

    def limits(
        self,
        spec: QuadrotorSpec,
        config: Any,
        model: Model | None,
        margins: Margins,
    ) -> Sequence[Limit]:
        """Box, cylinder, speed, lift, thrust and tilt, less the tracking margins."""
        from etude_quadrotor.motions import limits

        return limits(spec, config.trajectory, margins, model)

    def approaches(
        self,
        spec: QuadrotorSpec,
        motion: Trajectory,
        pose: Array,
    ) -> tuple[Trajectory, Trajectory] | None:
        """From rest to the plan's start, moving or not, and back from its end; take-off and landing from the
        ground.
        """
        from etude_quadrotor.motions import approaches

        return approaches(spec, motion, pose)

    def poses(self, spec: QuadrotorSpec) -> Mapping[str, Array]:
        """The pose on the ground, below the middle of the workspace."""
        from etude_quadrotor.motions import home, standing

        return {"ground": standing(spec, home(spec))}

    def from_rest(self, spec: QuadrotorSpec) -> bool:
        """True for a real vehicle: it hovers before its first set-point and after its last.

        Built-in simulated vehicles start as in the thesis.
        """
        return spec.plant is None

    def inputs(self, spec: QuadrotorSpec, config: Any) -> QuadrotorInputs:
        return replace(config.data.inputs(), commands=len(spec.command_names))  # type: ignore[no-any-return]

    def physics(self, spec: QuadrotorSpec, config: Any) -> Mapping[str, Physics]:
        """ "nominal" only if the motors are described and commands are in V."""
        from etude_quadrotor.physics.flight_physics import Identified, Nominal

        models: dict[str, Physics] = {"identified": Identified(spec.body, config.data.trims)}
        return models if spec.body is None else {"nominal": Nominal(spec.body), **models}

    def parameters(
        self,
        spec: QuadrotorSpec,
        config: Any,  # noqa: ARG002
        samples: Samples,  # noqa: ARG002
        logs: Sequence[Log],
    ) -> Delivered:
        """Hover thrust, thrust curve, lag of the motors, centre of mass and drag, from the recorded logs."""
        from etude_quadrotor.flight_parameters import report

        return report(spec, logs)

    def checks(self, spec: QuadrotorSpec, log: Log) -> Sequence[Finding]:
        """Findings on time on the ground and on the scale of the commands."""
        from etude_quadrotor.log_checks import findings

        return findings(spec, log)

    def samples(
        self, spec: QuadrotorSpec, config: Any, logs: Sequence[Log], groups: Sequence[Index]
    ) -> Samples:
        from etude_quadrotor.preprocessing import flight_samples

        return flight_samples(spec, config.data, logs, groups)

    def robot(self, spec: QuadrotorSpec, config: Any) -> Robot | None:
        """The simulated vehicle that the robot file names; None without one."""
        if spec.plant is None:
            return None
        from etude_quadrotor.plant.robot import simulated_robot

        return simulated_robot(spec, config)

    def solids(self, spec: QuadrotorSpec) -> Sequence[Solid]:
        """The vehicle."""
        from etude_quadrotor.solids import solids

        return solids(spec)

    def placed(self, spec: QuadrotorSpec, motion: Motion) -> Array:  # noqa: ARG002
        """Frames (T, 1, 3, 4) of the vehicle, m, with the tilt that its acceleration requires."""
        from etude_quadrotor.solids import placed

        return placed(motion)

    def tests(self, spec: QuadrotorSpec, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]:
        """A flight drawn uniformly from the safe ones of the thesis's form, and one on their edge."""
        from etude_quadrotor.motions import trial_flights

        return trial_flights(spec, config.trajectory, rng)

    def baselines(self, spec: QuadrotorSpec, config: Any) -> Mapping[str, Controller | None]:  # noqa: ARG002
        """Feedforwards without learning, and the exact drag, which no model can exceed."""
        from etude_quadrotor.controller import baselines

        return baselines(spec)

    def collecting(self, spec: QuadrotorSpec, config: Any, model: Model) -> Controller | None:  # noqa: ARG002
        """Feedforward of simulated flights once a model exists: the lean against the drag."""
        from etude_quadrotor.controller import leaning

        return leaning(model) if config.trajectory.lean else None

    def controller(self, spec: QuadrotorSpec, config: Any, model: Model) -> Controller:  # noqa: ARG002
        """Feedforward of acceleration, learned drag, and the model's gated voltages."""
        from etude_quadrotor.controller import learned

        return learned(spec, model)


KIND = QuadrotorKind()
