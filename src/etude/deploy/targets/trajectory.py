"""`etude export --to trajectory`: a motion with the model's commands along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude import plugins
from etude._runtime.options import taken
from etude.deploy.exporters.knots import SPACE, names_of
from etude.deploy.feedforward import (
    MotionWithCommands,
    require_forces,
    with_accelerations,
    with_commands,
    within_tilt,
)
from etude.deploy.playback_certificate import certified_playback
from etude.deploy.trajectory_files import CERTIFICATE, COEFFICIENTS, command_unit, csv_bytes, table_rate
from etude.errors import UsageError
from etude.limits.certificate import require_certified
from etude.models.learned_model import LearnedModel
from etude.protocols import Kind, Limit, Trajectory
from etude.types import Array, Delivered, Log

EXPORTERS = "etude.exporters"
TABLE = "commands.csv"
FORMAT = "ros2_yaml"
"""JointTrajectory as text, the default: it needs no further packages."""


@dataclass(frozen=True)
class MotionWithLimits:
    """A motion, its limits, and the control that their margins apply to, in words."""

    trajectory: Trajectory
    limits: Sequence[Limit]
    control: str = ""


@dataclass(frozen=True)
class TrajectoryOptions:
    """motion: as `model_export.supplied` gives it; format: names of exporters, with commas; rate: Hz."""

    motion: MotionWithLimits | None = None
    config: Any = None
    format: str = ""
    rate: float | None = None
    model_hash: str = ""


class Along:
    """The target (`protocols.Target`)."""

    needs = ("motion", "config")

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
        """commands.csv, at the robot's rate: set-points, commands and deviations; each format with `effort`.

        Raises:
            UsageError: unknown options, no motion, a format without commands, or commands that are no forces.
            UnsafeTrajectoryError: the motion, or the one that its receiver plays, violates a limit.
        """
        settings = taken(options, TrajectoryOptions, "trajectory")
        if settings.motion is None:
            raise UsageError("there is no motion to follow", next_step="--set motion=trajectory.json")
        motion, limits = settings.motion.trajectory, settings.motion.limits
        control = settings.motion.control
        proof = require_certified(motion, limits, control=control)
        rate = float(settings.rate or table_rate(spec))
        controller = kind.controller(spec, settings.config, model)
        what = with_accelerations(with_commands(motion, model), controller, model.inputs.orders)
        what = within_tilt(what, limits)
        files = {
            COEFFICIENTS: motion.to_json().encode(),
            TABLE: csv_bytes(motion, model.inputs, rate, lambda log: _columns(model, log, what)),
            CERTIFICATE: proof.to_json().encode(),
        }
        unit = command_unit(spec)
        formats, notes = _formats(settings.format, kind, spec, unit, what)
        for name in formats:
            played_files, sentences = _played(name, what, settings.motion, kind, spec)
            files |= played_files
            notes = (*notes, *sentences)
        units = next((c.units for c in kind.channels(spec) if c.role == "command"), ())
        unit_text = ", ".join(dict.fromkeys(units)) or "1"
        sentence = f"{TABLE}: set-points, commands and deviations ({unit_text}), {rate:g} times a second."
        return Delivered(files, (sentence, *notes), {"rate": rate, "formats": list(formats)})


def _columns(model: LearnedModel, log: Log, what: MotionWithCommands) -> dict[str, Array]:
    mean, variance = model.predict(log)
    columns: dict[str, Array] = {}
    for word, values in (("command", mean), ("deviation", np.sqrt(variance))):
        columns |= {f"{word}_{name}": column for name, column in zip(model.commands, values.T, strict=True)}
    if what.acceleration is not None:
        setpoints = what.acceleration(log.t)
        columns |= {f"a{axis}_command": column for axis, column in zip(SPACE, setpoints.T, strict=True)}
    return columns


def _formats(
    requested: str, kind: Kind, spec: Any, unit: str, what: MotionWithCommands
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The requested formats; by default a JointTrajectory, if this robot supports it."""
    if requested and what.acceleration is not None:
        return tuple(requested.split(",")), ()
    if requested:
        require_forces(unit, spec.name, f"Export without a format: {TABLE} has any unit.")
        return tuple(requested.split(",")), ()
    try:
        require_forces(unit, spec.name, "")
    except UsageError as problem:
        return (), (f"No JointTrajectory: {problem.fact}.",)
    if names_of(kind, spec) == SPACE:
        return (), ("No JointTrajectory: the path is x, y, z.",)
    return (FORMAT,), (f"{FORMAT}: with effort, for joint_trajectory_controller of Jazzy and later.",)


def _played(
    name: str, what: Trajectory | MotionWithCommands, motion: MotionWithLimits, kind: Kind, spec: Any
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """The files of a format in a folder of its name, proved for the motion that is played; and sentences."""
    exporter = plugins.load(EXPORTERS, name)
    files, proof = certified_playback(exporter, what, kind, spec, motion.limits, motion.control)
    contents = {**files, CERTIFICATE: proof.to_json().encode()}
    return {f"{name}/{file}": data for file, data in contents.items()}, proof.notes


ALONG = Along()
