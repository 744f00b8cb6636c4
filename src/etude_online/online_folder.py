"""Folder of an online model for the robot's computer, which `runtime` opens."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec
import numpy as np

from etude import __version__
from etude._runtime.options import taken
from etude.errors import DataError, UsageError
from etude.models.learned_model import LearnedModel
from etude.models.store import model_bytes
from etude.progress import counted
from etude.protocols import Kind
from etude.types import Delivered, Log, Motion
from etude_online import guard as hedge
from etude_online.command import learning_command
from etude_online.guard_effort import (
    Feedback,
    FeedbackLaw,
    StatedFeedback,
    command_limits,
    feedback_of,
)
from etude_online.learner import OnlineConfig
from etude_online.methods import known

MODEL, SETTINGS, CERTIFICATE, README, HASHES = (
    *("model.npz", "settings.json", "certificate.json", "README.md", "hashes.json"),
)
ROBOT = "robot/"
"""Where the files of the description lie; robot.toml is one of them."""
TABLES = ("trajectory", "data", "model")
"""Of a campaign's configuration, what nouns of a kind are made from."""


@dataclass(frozen=True)
class OnlineOptions:
    """Inputs of the target beside the model.

    Attributes:
        description: files of the robot's description by name, robot.toml among them.
        logs: of the robot under its own feedback, which tell what that adds.
        learning: how to go on. seed: of what the learners draw. model_hash: for the certificate.
    """

    description: Mapping[str, bytes]
    logs: Sequence[Log]
    learning: OnlineConfig = field(default_factory=OnlineConfig)
    seed: int = 0
    model_hash: str = ""


def write(
    model: LearnedModel, kind: Kind, spec: Any, config: Any, options: OnlineOptions
) -> Mapping[str, bytes]:
    """The folder's files by name.

    Args:
        model: its commands come from exact processes or dictionaries, or have such ones beside physics.
        kind, spec, config: of the robot, as in its campaign.

    Raises:
        UsageError: the model cannot go on learning, or no description is given. DataError: the logs do not
            tell what the feedback adds, so that nothing could judge what is learned; or the robot's
            controller takes no learned command (a vehicle whose motors nobody described).
    """
    if "robot.toml" not in options.description:
        raise UsageError("the robot's description has no robot.toml")
    limits = command_limits(kind, spec)
    feedback = feedback_of(options.logs, kind.channels(spec), kind.path, limits, spec.rate)
    rng = np.random.default_rng(options.seed)
    for j in counted(range(len(model.commands))):  # or it would be refused on the robot
        learning_command(model, j, options.learning, rng)
    home = kind.home(spec)
    orders = np.stack([home, *np.zeros((model.inputs.orders - 1, len(home)))])
    states = model.inputs.states(Motion(np.zeros(1), orders[:, None]))
    kind.controller(spec, config, model).command(0.0, {n: v[0] for n, v in states.values.items()})
    files = {ROBOT + name: data for name, data in options.description.items()}
    files[MODEL] = model_bytes(model)
    files[SETTINGS] = _json(_settings(kind, config, options, feedback))
    files[CERTIFICATE] = _json(_certificate(model, spec, limits, feedback, options))
    files[README] = _readme(model, kind, spec, feedback).encode()
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in sorted(files.items())}
    return {**files, HASHES: _json({"etude": __version__, "files": hashes})}


@dataclass(frozen=True)
class FolderOptions:
    """Options of the target: what the campaign supplies, how to learn, what its learners draw, and the s in
    which what they learned counts half (None: for ever), a number or its text.
    """

    description: Mapping[str, bytes]
    logs: Sequence[Log]
    config: Any
    method: str = "variance"
    half_life: float | str | None = None
    seed: int = 0
    model_hash: str = ""


class Online:
    """The target `online` (`protocols.Target`): options method, half_life and seed."""

    needs = ("config", "logs", "description")

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
        """Errors as `write`; UsageError: an option or a method that there is not."""
        settings = taken(options, FolderOptions, "online")
        online_options = OnlineOptions(
            settings.description,
            settings.logs,
            OnlineConfig(known(settings.method), half_life=_seconds(settings.half_life)),
            seed=int(settings.seed),
            model_hash=settings.model_hash,
        )
        advice = "Open it on the robot: etude_online.runtime.open_online(FOLDER)."
        return Delivered(write(model, kind, spec, settings.config, online_options), (advice,))


ONLINE = Online()


def _seconds(half_life: float | str | None) -> float | None:
    try:
        return None if half_life is None else float(half_life)
    except ValueError:
        raise UsageError(
            f"half_life = {half_life!r} is not a number of seconds",
            next_step="--set half_life=30, for example.",
        ) from None


def stored_feedback(feedback: Feedback) -> dict[str, Any]:
    """As JSON."""
    if isinstance(feedback, FeedbackLaw):
        law = {name: getattr(feedback, name).tolist() for name in ("kp", "kd", "sigma")}
        return {"law": {**law, "path": feedback.path}}
    return {"told": {"sigma": feedback.sigma.tolist()}}


def read_feedback(stored: Mapping[str, Any]) -> Feedback:
    """What `stored_feedback` wrote."""
    if "law" in stored:
        law = stored["law"]
        kp, kd, sigma = (np.array(law[name]) for name in ("kp", "kd", "sigma"))
        return FeedbackLaw(kp, kd, sigma, law["path"])
    return StatedFeedback(np.array(stored["told"]["sigma"]))


def _settings(kind: Kind, config: Any, options: OnlineOptions, feedback: Feedback) -> dict[str, Any]:
    return {
        "kind": kind.name,
        "seed": options.seed,
        "learning": asdict(options.learning),
        "feedback": stored_feedback(feedback),
        "config": {name: msgspec.to_builtins(getattr(config, name)) for name in TABLES},
    }


def read_config(stored: Mapping[str, Any], classes: Mapping[str, type]) -> Any:
    """The tables of a configuration, by attribute.

    Raises:
        DataError: written by another version, whose tables were others.
    """
    try:
        tables: dict[str, Any] = {name: msgspec.convert(stored[name], type=classes[name]) for name in TABLES}
    except (msgspec.ValidationError, KeyError) as error:
        raise DataError(
            f"the settings are of another version ({error})", next_step="Export it again."
        ) from error
    return _Tables(**tables)


@dataclass(frozen=True)
class _Tables:
    trajectory: Any
    data: Any
    model: Any


def _certificate(
    model: LearnedModel, spec: Any, limits: Any, feedback: Feedback, options: OnlineOptions
) -> dict[str, Any]:
    return {
        "robot": spec.name,
        "model_sha256": options.model_hash,
        "proved": [
            "every command is finite and within its limits",
            f"no command is further than A from the trained model's, where A is {hedge.AUTHORITY:g} times "
            "its own error as estimated from the feedback, over the last 2 to 20 s",
            "over any N decisions in a row (0.1 s, or five ticks) the sum of (error with learning - "
            "error without) / A is at most 8 + 0.018 N, whatever is learned; errors as estimated from "
            "the feedback",
        ],
        "not_proved": [
            "that the tracking error is smaller: the bound is of the feedback's effort, to first order",
            "anything where the controller's own encoder or plan is false: feedback and guard then agree",
            "an error of the command's sensor below six deviations of the feedback's law",
        ],
        "commands": [
            {"name": name, "lower": float(low), "upper": float(high), "deviation_of_feedback": float(sigma)}
            for name, low, high, sigma in zip(model.commands, *limits, feedback.sigma, strict=True)
        ],
        "feedback": stored_feedback(feedback),
    }


def _readme(model: LearnedModel, kind: Kind, spec: Any, feedback: Feedback) -> str:
    measured = ", ".join(f"`{name}`" for name in dict.fromkeys(("command", kind.path, *feedback.channels)))
    return f"""# {spec.name}: a feedforward that goes on learning

For the controller's loop of `{spec.name}` at {spec.rate:g} Hz; commands: {", ".join(model.commands)}.

```python
from etude_online.runtime import open_online

robot = open_online("this folder")            # compiles and warms up: no tick pays for it
plan = robot.planned_row([path, rate, bend])  # {kind.path} and its derivatives, (k,) each, SI units
command, deviation = robot.command(t, plan)   # add it to your feedback, at every control tick
robot.observe(t, measured)                    # the same tick's measurements, the applied command in them
robot.save("tonight.npz")                     # open_online("this folder", "tonight.npz") goes on from there
```

`measured` holds {measured}, one array each, and states that are measured besides. `t` is in
seconds; if the clock jumps, learning continues with its own clock. Whatever is measured, the
command stays finite, within its limits, and near the trained model's (certificate.json).
`robot.reports()` gives a sentence for each reaction of the guard. `robot.outside(motion)` gives, before a
run, the share of a plan's rows at which each command is outside of what was trained, as `etude predict` does.

A changed file is refused (hashes.json). The hashes find damage; they are no signature.
"""


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()
