"""ModelConfig: every choice in making a model from a data set, named and visible."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from etude.errors import UsageError
from etude.models.lesson import SCHEDULES, Schedule
from etude.models.processes import PROCESSES, SPECTRAL

Kind = Literal["nominal", "identified", "gp", "identified+gp"]
KINDS: tuple[Kind, ...] = ("nominal", "identified", "gp", "identified+gp")
PHYSICS: tuple[Kind, ...] = ("nominal", "identified")
"""Kinds that predict without a process."""
FLOORS = (0.001, 0.002, 0.004, 0.012)
"""Noise floors tried with noise_floor = "auto", as parts of the command limit."""


@dataclass(frozen=True)
class ModelConfig:
    """How a data set becomes an inverse dynamics model.

    Attributes:
        kind: one of `KINDS`, or "auto": the ladder trains all that the robot allows and chooses.
        kernel: "structured" (posture, friction, linear and remainder) or "ard_se" (thesis 2.3).
        process: member of the model family that learns each output, a name in `processes.PROCESSES`.
        points: samples each output's process is conditioned on, or members of its dictionary, or samples of
            each of its local processes, at most; the other approximations learn from every moving sample.
        basis: inducing inputs, spectral points or basis points of a process that has such, at most.
        fit_points: of these, samples for the hyperparameters, at most.
        fit_spacing_s: the latter are at least this far apart: nearer ones repeat each other, and the
            likelihood then takes their agreement for precision. With the structured kernel less, where short
            logs would leave fewer than 100.
        steps, method: length and method of the training: iterations of "lbfgs"; of "minimize" line searches
            or, if negative, evaluations of the likelihood (see `training.fit`).
        schedule: what becomes of the hyperparameters of the last log's model (thesis 6.1): "update" trains on
            from them, with spectral points if there are such; "constant" keeps those of the first training,
            noise included; "reinitialise" trains from the data's scales. Inducing inputs are chosen anew
            each time.
        prior: "weak" log-normal priors on the hyperparameters, or "none": maximum likelihood, with learned
            spectral points at once and without their guards.
        noise_floor: least noise deviation as a part of the command limit (never more than a tenth of the
            command's own deviation); "auto" chooses among `FLOORS` by how well each trajectory is predicted
            from the others, at four times the cost.
        friction_fraction: v0 of the friction feature as a part of the velocity limit; 0 for no such feature.
        calibrate: multiply variances by the held-out z^2 where that exceeds 1.
        guard: outputs that linear regression predicts better on trajectories held out fall back to it (see
            `models.guard`).
    """

    kind: Kind | Literal["auto"] = "auto"
    kernel: Literal["structured", "ard_se"] = "structured"
    process: str = "exact"
    points: int = 600
    basis: int = 100
    fit_points: int = 300
    fit_spacing_s: float = 0.5
    steps: int = 60
    method: Literal["lbfgs", "minimize"] = "lbfgs"
    schedule: Schedule = "update"
    prior: Literal["weak", "none"] = "weak"
    noise_floor: float | Literal["auto"] = 0.002
    friction_fraction: float = 0.02
    calibrate: bool = True
    guard: bool = True

    def __post_init__(self) -> None:
        _one_of("kind", self.kind, (*KINDS, "auto"))
        _one_of("kernel", self.kernel, ("structured", "ard_se"))
        _one_of("method", self.method, ("lbfgs", "minimize"))
        _one_of("schedule", self.schedule, SCHEDULES)
        _one_of("prior", self.prior, ("weak", "none"))
        _one_of("process", self.process, tuple(PROCESSES))
        if self.basis < 1:
            raise UsageError("basis must be at least 1", where=f"model.basis = {self.basis}")
        for name in ("points", "fit_points"):
            if getattr(self, name) < 2:
                raise UsageError(f"{name} must be at least 2", where=f"model.{name} = {getattr(self, name)}")
        if self.steps < 0 and self.method == "lbfgs":
            raise UsageError(
                "negative steps count evaluations of the likelihood, which L-BFGS cannot be limited to",
                where=f"model.steps = {self.steps}",
                next_step="Set method = 'minimize', or a number of iterations.",
            )
        numbers = ["fit_spacing_s", "friction_fraction"]
        for name in numbers if self.noise_floor == "auto" else [*numbers, "noise_floor"]:
            value = getattr(self, name)
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0):
                raise UsageError(f"{name} must be a number >= 0", where=f"model.{name} = {value!r}")
        if self.kernel == "structured" and self.process in SPECTRAL:
            raise UsageError(
                "A sparse spectrum stands for the squared exponential kernel",
                where=f"model.process = {self.process!r}",
                next_step="Set kernel = 'ard_se', or choose another process.",
            )
        if self.kernel == "structured" and self.friction_fraction == 0:
            raise UsageError(
                "The structured kernel needs the friction feature",
                where="model.friction_fraction = 0",
                next_step="Set friction_fraction, for example to 0.02, or kernel = 'ard_se'.",
            )


def _one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise UsageError(f"{name} must be one of {', '.join(allowed)}", where=f"model.{name} = {value!r}")


PRESETS = {
    "default": ModelConfig(),
    "thesis": ModelConfig(
        kind="gp",
        kernel="ard_se",
        process="thesis_dictionary_error",
        points=500,
        fit_points=500,
        fit_spacing_s=0.0,
        steps=25,
        method="minimize",
        prior="none",
        noise_floor=0.0,
        friction_fraction=0.0,
        calibrate=False,
        guard=False,
    ),
}
