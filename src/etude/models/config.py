"""ModelConfig: every choice in making a model from samples, of any robot, named and visible."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from etude import plugins
from etude.errors import UsageError, did_you_mean

Structure = Literal["nominal", "identified", "linear", "gp", "nominal+gp", "identified+gp", "linear+gp"]
STRUCTURES: tuple[Structure, ...] = (
    "nominal",
    "identified",
    "linear",
    "gp",
    "nominal+gp",
    "identified+gp",
    "linear+gp",
)
Schedule = Literal["update", "constant", "reinitialise", "first"]
SCHEDULES: tuple[Schedule, ...] = ("update", "constant", "reinitialise", "first")
FLOORS: dict[str, tuple[float, ...]] = {"limit": (0.001, 0.002, 0.004, 0.012), "deviation": (0.4, 0.25, 0.15)}
"""Noise floors tried with noise_floor = "auto", by what they are parts of. Training goes down the second row,
each from the optimum of the last: a high floor has one smooth optimum, where a low one may fall for lengths
that are too short."""
SPECTRAL = ("ssgp_fixed", "ssgp_learned")
"""Members that stand for the squared exponential kernel alone."""
OFFERED = ("default", "standing", "slow", "ripple", "gip_lin", "all_lin")
"""Names of `candidates`."""
LEAST_SEGMENTS = 4
"""Of held-out motion; fewer decide nothing between two models."""
USUAL_COMMANDS = 4
"""Of the robots on which `fit_points` was set; more commands gain by docs/decisions/0050-short-logs.md."""
LEAST_VALUES = {
    "points": 2,
    "fit_points": 2,
    "basis": 1,
    "starts": 1,
    "process_from": 1,
    "warm_from": 1,
    "warm_steps": 0,
    "inducing": 0,
}


@dataclass(frozen=True)
class ModelConfig:
    """How samples become a model. The defaults are the arms'; each kind's presets lay its own over them.

    Attributes:
        rung: one of `STRUCTURES`, or "auto": what the robot allows is trained, and chosen for each command.
        choose_by: held-out error by which it chooses: mean "squared" or mean "absolute" error, each
            trajectory with one vote.
        replace: "stack", from two trajectories on all candidates are averaged, with the weights that predict
            trajectories left out best (`selection.stacking`); with one, and with the others, a structure is
            chosen. It replaces the one that is best for all commands where it predicts the folds better: by
            more than these scatter ("chance", and "stack" with one trajectory); or each of them ("every"),
            and physics stand until some structure does.
        process_from: trajectories from which structures with a process compete with physics; stretches of one
            trajectory are no new trajectories, and flatter processes.
        kernel: "structured" (posture, friction, linear and remainder), "ard_se" (thesis 2.3), or a plug-in.
        sharing: "separate": a process for each command; "shared": one kernel and one noise for all.
        process: member of the model family that learns a group of commands: a name in `etude.models`, or
            a plug-in.
        points: samples each process is conditioned on, or members of its dictionary, or samples of each of
            its local processes, at most; the other approximations learn from every sample that counts.
        inducing: where twice as many samples count, exact processes learn from up to four times as many,
            through those of so many evenly spread ones that tell something; else, and with 0, from `points`
            alone. So do the defaults beside candidates with samples of their own, from two trajectories on.
        basis: inducing inputs, spectral points or basis points of a process that has such, at most.
        fit_points: samples for the hyperparameters, at most, of up to four commands; see `for_commands`.
        fit_spacing_s: the latter are at least this far apart: nearer ones repeat each other, and the
            likelihood then takes their agreement for precision. With an arm's kernels an eightieth of what
            the trajectories last, where that is less.
        candidates: beside "default", processes that are averaged with it in its structure: names in
            `ensemble.CANDIDATES`. Only with the structured kernel, exact processes and several folds.
        steps, method: length and method of the training: iterations of "lbfgs"; of "minimize" line searches
            or, if negative, evaluations of the likelihood; of "descent" steps of fixed rate (see `fit`).
        warm_from: trajectories from which training goes on from the last model, as `schedule` says; with
            fewer the first ones' bad optimum would be kept.
        warm_steps: of a training that goes on; 0: as many as `steps`.
        starts: starts of the training; the best result is used.
        schedule: what becomes of the hyperparameters of the last model (thesis 6.1): "update" trains on from
            them (with several starts: beside fresh ones), with spectral points if there are such; "constant"
            keeps those of the first training, noise included; "first" is constant too, and fitted to the
            first trajectory alone, its units included (thesis 5); "reinitialise" trains from the data's
            scales. Inducing inputs are chosen anew each time.
        prior: "weak" log-normal priors on the hyperparameters, or "none": maximum likelihood, with learned
            spectral points at once and without their guards.
        noise_floor: least noise deviation, a part of what `floor_of` says; "auto" chooses among `FLOORS` by
            how well each trajectory is predicted from the others.
        floor_of: "limit": the command's limit, never more than a tenth of the command's own deviation, and
            processes learn in command units; "deviation": that of what the process learns, which is
            standardised.
        stretch_s: of a single trajectory, stretches of this length are held out.
        calibrate: multiply variances by the held-out z² where that exceeds 1; with replace = "stack" by what
            makes intervals hold on the next log (`selection.width`).
        student_t: fit the tails of the held-out errors, for the reported density.
    """

    rung: Structure | Literal["auto"] = "auto"
    choose_by: Literal["squared", "absolute"] = "squared"
    process_from: int = 1
    kernel: str = "structured"
    sharing: Literal["separate", "shared"] = "separate"
    process: str = "exact"
    points: int = 600
    inducing: int = 1000
    basis: int = 100
    fit_points: int = 300
    fit_spacing_s: float = 0.5
    candidates: tuple[str, ...] = OFFERED
    steps: int = 30
    warm_from: int = 3
    warm_steps: int = 10
    method: Literal["lbfgs", "minimize", "descent"] = "lbfgs"
    starts: int = 1
    schedule: Schedule = "update"
    prior: Literal["weak", "none"] = "weak"
    noise_floor: float | Literal["auto"] = 0.002
    floor_of: Literal["limit", "deviation"] = "limit"
    stretch_s: float = 8.0
    calibrate: bool = True
    student_t: bool = False
    replace: Literal["stack", "chance", "every"] = "stack"

    def __post_init__(self) -> None:
        _one_of("rung", self.rung, (*STRUCTURES, "auto"))
        _one_of("choose_by", self.choose_by, ("squared", "absolute"))
        _one_of("replace", self.replace, ("stack", "chance", "every"))
        _one_of("sharing", self.sharing, ("separate", "shared"))
        _one_of("method", self.method, ("lbfgs", "minimize", "descent"))
        _one_of("schedule", self.schedule, SCHEDULES)
        _one_of("prior", self.prior, ("weak", "none"))
        _one_of("floor_of", self.floor_of, ("limit", "deviation"))
        for name in self.candidates:
            _one_of("candidates", name, OFFERED)
        if "default" not in self.candidates:
            raise UsageError(
                "the default is always a candidate", where=f"model.candidates = {self.candidates}"
            )
        plugins.require_known("etude.kernels", self.kernel, "model.kernel")
        plugins.require_known("etude.models", self.process, "model.process")
        self._check_numbers()
        self._check_kernel()

    def for_commands(self, commands: int) -> ModelConfig:
        """The same for a robot of so many: an arm's hyperparameters grow in number with its joints."""
        return replace(self, fit_points=max(self.fit_points, self.fit_points * commands // USUAL_COMMANDS))

    @property
    def floors(self) -> tuple[float, ...]:
        """The noise floors to try, parts of what `floor_of` says."""
        return FLOORS[self.floor_of] if self.noise_floor == "auto" else (self.noise_floor,)

    @property
    def standardised(self) -> bool:
        """Whether processes learn standardised outputs; else outputs that are centred, in command units."""
        return self.floor_of == "deviation" or self.sharing == "shared"

    @property
    def stacks(self) -> bool:
        """Whether logs left out weigh candidates, and say how wide variances are."""
        return self.replace == "stack"

    @property
    def weighs(self) -> bool:
        """Whether candidates are compared on more than what each holds out."""
        return self.stacks or self.averages

    @property
    def averages(self) -> bool:
        """Whether other candidates than the default can take part."""
        is_separate = (self.kernel, self.process, self.sharing) == ("structured", "exact", "separate")
        return is_separate and set(self.candidates) != {"default"}

    @property
    def remembers(self) -> bool:
        """Whether a candidate looks at what friction remembers."""
        return self.averages and bool({"standing", "slow"} & set(self.candidates))

    def _check_numbers(self) -> None:
        for name, least in LEAST_VALUES.items():
            if getattr(self, name) < least:
                raise UsageError(
                    f"{name} must be at least {least}", where=f"model.{name} = {getattr(self, name)}"
                )
        if self.steps < 0 and self.method != "minimize":
            raise UsageError(
                f"negative steps are evaluations of the likelihood, which {self.method} does not support",
                where=f"model.steps = {self.steps}",
                next_step="Set method = 'minimize', or a number of iterations.",
            )
        numbers = ["fit_spacing_s", "stretch_s"]
        for name in numbers if self.noise_floor == "auto" else [*numbers, "noise_floor"]:
            value = getattr(self, name)
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0):
                raise UsageError(f"{name} must be a number >= 0", where=f"model.{name} = {value!r}")
        if self.stretch_s == 0:
            raise UsageError("stretch_s must be above 0", where="model.stretch_s = 0")

    def _check_kernel(self) -> None:
        if self.kernel != "ard_se" and self.process in SPECTRAL:
            raise UsageError(
                "A sparse spectrum stands for the squared exponential kernel",
                where=f"model.process = {self.process!r}",
                next_step="Set kernel = 'ard_se', or choose another process.",
            )
        if self.kernel == "structured" and self.sharing == "shared":
            raise UsageError(
                "The structured kernel is for one command, so commands cannot share it",
                where="model.sharing = 'shared'",
                next_step="Set kernel = 'ard_se', or sharing = 'separate'.",
            )


def _one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise UsageError(
            f"{name} must be one of {', '.join(allowed)}, not {value!r}",
            where=f"model.{name}",
            next_step=f"{did_you_mean(value, allowed)}Write one of these.",
        )
