"""Loaded model file of a robot: MuJoCo's model, and notes on how it was made."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.errors import UsageError
from etude.types import Index
from etude_arm.clearance.surroundings import Wall
from etude_arm.loading.compiled_model_check import check_agreement
from etude_arm.loading.expected import Expected

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Loaded:
    """A model of exactly the chosen joints; every other joint is welded at its held position.

    Static bodies are merged into their parents, and invalid inertias are repaired. Every collision shape is a
    geom named "link#k", after the link of the file that it belongs to; those of the base are geoms of the
    world. Meshes are convex hulls.

    Attributes:
        xml: URDF or MJCF text without actuators, for `mujoco.MjSpec.from_string(xml, assets=assets)`.
        assets: the meshes that it names.
        joints: the chosen joints in the requested order; see `columns`.
        held: the file's other moving joints and the position each is held at, rad or m.
        notes: one sentence for each repair or assumption, which the user confirms once.
        unverified: one sentence for each thing that a certificate does not verify: guessed shapes, a base
            assumed fixed, joints assumed held.
        excluded: pairs of geoms that an MJCF excludes from contact, by name.
        planes: planes of an MJCF's world, in the frame of the file; they are not shapes of the model.
        beside: shape -> name, for objects in an MJCF's world beside the robot.
        source: the file, for messages.
        links: body -> link of the file, where the body has another name.
        added: "tool" and "payload" -> name of what the model calls "name#0", where they have shapes.
        expected: facts of file and additions at one pose; every compiled model is checked against them.
        shapes: whether the model has any.
    """

    xml: str
    assets: Mapping[str, bytes]
    joints: tuple[str, ...]
    held: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    excluded: tuple[tuple[str, str], ...] = ()
    planes: tuple[Wall, ...] = ()
    beside: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    links: Mapping[str, str] = field(default_factory=dict)
    added: Mapping[str, str] = field(default_factory=dict)
    expected: Expected | None = None
    shapes: bool = True

    def spec(self) -> Any:
        """A new `mujoco.MjSpec`, to add sensors, actuators or excluded pairs to. Errors as `model`."""
        assert self._checked is not None
        return self._read()

    def model(self) -> mujoco.MjModel:
        """A new copy of the compiled model.

        Raises:
            UsageError: MuJoCo cannot read the model.
            UnsafeModelError: it differs from the description.
        """
        return copy.copy(self._checked)

    def check(self, model: mujoco.MjModel) -> None:
        """Raises an UnsafeModelError if the model compiled from `spec` differs from the description; shapes
        may be absent.
        """
        if self.expected is not None:
            check_agreement(model, self.expected, self.source, shapes=self.shapes, whole=False)

    @cached_property
    def _checked(self) -> mujoco.MjModel:
        try:
            model = self._read().compile()
        except ValueError as problem:
            raise refused(problem, self.source) from None
        if self.expected is not None:
            check_agreement(model, self.expected, self.source, shapes=self.shapes)
        return model

    def _read(self) -> Any:
        import mujoco

        try:
            return mujoco.MjSpec.from_string(self.xml, assets=dict(self.assets))
        except ValueError as problem:
            raise refused(problem, self.source) from None

    def columns(self, model: mujoco.MjModel) -> Index:
        """(J,) addresses of `joints` in a model's qpos, which for hinges and slides are those in qvel."""
        return np.array([int(model.jnt_qposadr[model.joint(name).id]) for name in self.joints])


def refused(problem: ValueError, where: str = "") -> UsageError:
    """The error for a model that MuJoCo cannot load, with MuJoCo's message."""
    message = "; ".join(line.strip() for line in str(problem).splitlines() if line.strip())
    of_masses = "mass" in message or "inertia" in message
    return UsageError(
        f"MuJoCo cannot load the model: {message}",
        where=where,
        next_step="Every moving link needs its own mass and inertia."
        if of_masses
        else "Correct that place of the model file.",
    )
