"""ArmSettings: everything that makes one run of chapter 6 differ from another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import msgspec

from etude.campaign import CampaignConfig
from etude.models import ModelConfig
from etude.protocols import Family, Robot
from etude_studies.thesis.own_omega0 import JointByJointFamily
from etude_studies.world import World

Motions = Literal["scaled", "amplitude", "designed", "chirp", "prbs", "condition"]


@dataclass(frozen=True)
class ArmSettings:
    """One arm of the comparison; its seed apart. Keys of tables are laid over the preset's.

    Attributes:
        robot: a built-in simulated arm. preset: of its kind.
        motions: random ones enlarged to the limits, random ones of random amplitude, or, after a first one
            that is random and enlarged: designed, chirps, binary ones, or of least condition number.
        rounds: trajectories, K.
        data, model, design: keys other than the preset's.
        draw: which draw of the random motions; tests do not depend on it.
        own_omega0: a base frequency for every joint.
        steps_grow: round k trains k times as many steps.
        beside: also linear regression and identified rigid bodies on the same logs.
        described: also what the thesis describes of single runs; see `arm_measures.description`.
        source: digest of the source of a method that is not Étude's, so that another version is another run.
        again: round at which members of the dictionary are kept and trained from the start values too.
        plant: factors of the simulated arm's "gain", "friction" and "noise"; see `perturbed`.
        rounding: which draw of last digits recorded logs get; 0: their own.
    """

    robot: str = "arm4"
    preset: str = "thesis"
    motions: Motions = "scaled"
    rounds: int = 6
    data: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)
    design: Mapping[str, Any] = field(default_factory=dict)
    draw: int = 0
    own_omega0: bool = False
    steps_grow: bool = False
    beside: bool = False
    described: bool = False
    again: int = 0
    source: str = ""
    plant: Mapping[str, float] = field(default_factory=dict)
    rounding: int = 0

    @property
    def simulated(self) -> Robot:
        """What the motions are run on."""
        return perturbed(self.world.robot, self.plant)

    @property
    def config(self) -> CampaignConfig:
        """The preset with these keys. UsageError for a value that is not possible."""
        base = world_of(self.robot, self.preset).config
        # runs of the default protocol were made when one structure was chosen
        base = replace(base, model=replace(base.model, replace="chance"))
        return replace(
            base,
            data=replace(base.data, **self.data),
            model=replace(base.model, **self.model),
            design=replace(base.design, **self.design),
        )

    @property
    def world(self) -> World:
        """The robot as such a campaign treats it."""
        return replace(world_of(self.robot, self.preset), config=self.config)

    def model_of(self, number: int) -> ModelConfig:
        """How the model of round `number` is trained."""
        config = self.config.model
        return replace(config, steps=number * config.steps) if self.steps_grow else config

    @property
    def family(self) -> Family:
        """The motions that may be drawn or designed."""
        world = self.world
        family = world.kind.family(world.spec, world.config)
        return JointByJointFamily.of(family) if self.own_omega0 else family  # type: ignore[arg-type]


def perturbed(robot: Robot, plant: Mapping[str, float]) -> Robot:
    """A simulated arm with feedback gains, friction and encoder noise times the factors of `plant`.

    What its owner knows of it stays as it is: limits, and with them all motions.
    """
    if not plant:
        return robot
    gain, friction, noise = (plant.get(name, 1.0) for name in ("gain", "friction", "noise"))
    changed: Any = robot.changed(friction=friction)
    control = changed.parameters.controller
    controller = msgspec.structs.replace(
        control,
        kp=tuple(gain * kp for kp in control.kp),
        kd=tuple(gain * kd for kd in control.kd),
        encoder_noise_degrees=noise * control.encoder_noise_degrees,
    )
    perturbed_robot: Robot = replace(
        changed, parameters=msgspec.structs.replace(changed.parameters, controller=controller)
    )
    return perturbed_robot


@lru_cache(maxsize=8)
def world_of(robot: str, preset: str) -> World:
    """A robot of a preset, read once a process."""
    return World.of(robot, preset)
