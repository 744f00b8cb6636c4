"""Small models of every member, for an arm and for vehicles, learned from made-up motion within seconds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from etude import plugins
from etude.models import (
    Kernel,
    LearnedModel,
    ModelConfig,
    Silent,
    SquaredExponential,
    ard_se,
    member_named,
    structured,
)
from etude.protocols import Candidate, FitData
from etude.types import Array, Log, Samples
from etude_arm import ArmInputs, ArmPhysics
from etude_lagrangian import gip_lin

ARM: Any = plugins.load("etude.robots", "arm")
QUADROTOR: Any = plugins.load("etude.robots", "quadrotor")
KERNELS: dict[str, Any] = {
    "structured": structured,
    "standing": plugins.load("etude.kernels", "standing"),
    "gip_lin": gip_lin,
}
SHARED = {"ssgp_fixed", "ssgp_learned"}


def arm_spec(name: str = "arm4") -> Any:
    return ARM.spec(ARM.built_in()[name])


def swings(widths: dict[str, Array], count: int, seed: int = 0) -> dict[str, Array]:
    """Channels that swing to and fro, each part at its own pace."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)[:, None]
    found = {}
    for name, width in widths.items():
        pace, phase = rng.uniform(1.0, 6.0, len(width)), rng.uniform(0.0, 6.0, len(width))
        found[name] = width * np.sin(2.0 * np.pi * pace * t + phase)
    return found


def arm_log(spec: Any, count: int, seed: int = 0) -> Log:
    """States of an arm and commands of a smooth law with friction."""
    speed = np.asarray(spec.velocity)
    low, high = (np.array([getattr(axis, end) for axis in spec.axes]) for end in ("lower", "upper"))
    values = swings({"q": 0.3 * (high - low), "qd": 0.6 * speed, "qdd": 2.0 * speed}, count, seed)
    values["q"] = values["q"] + 0.5 * (low + high)
    values["qd"] = values["qd"] ** 3 / (0.6 * speed) ** 2  # rests for a while, so that friction remembers
    q, qd, qdd = values["q"], values["qd"], values["qdd"]
    law = 0.4 * np.sin(q) + 0.2 * np.tanh(qd / (0.05 * speed)) + 0.05 * qdd / speed + 0.1 * np.cos(q[:, ::-1])
    channels = {c.name: c for c in ARM.channels(spec)}
    values["command"] = np.asarray(spec.command) * law * 0.6
    return Log(np.arange(count) / 25.0, {name: channels[name] for name in values}, values)


def turning_round(log: Log, inputs: ArmInputs) -> Log:
    """The log with friction that turns round at once in every other joint and over 1 mrad between them, and
    what it remembers, where physics does.
    """
    if inputs.presliding_distances is None:
        return log
    log, J = inputs.followed(log), log["q"].shape[1]
    parts = log.channels["friction_turning"].parts
    over = [i for i, part in enumerate(parts) if part.endswith(" within 0.001")]
    friction = np.where(np.arange(J) % 2, log["friction_turning"][:, over], np.sign(log["qd"]))
    return log.put(log.channels["command"], log["command"] + 0.2 * np.abs(log["command"]).max(0) * friction)


def fit_data(
    X: Array, Y: Array, columns: Any, commands: tuple[str, ...], kernel: Any, config: Any
) -> FitData:
    every, n = np.ones(Y.shape, dtype=np.bool_), len(X)
    groups = np.repeat(np.arange(3), -(-n // 3))[:n].astype(np.int64)
    return FitData(
        X, Y, every, every, groups, groups, np.arange(0, n, 2), np.arange(n), columns, commands, [kernel],
        np.full(Y.shape[1], 0.02), None, config, np.random.default_rng(1),
    )  # fmt: skip


def arm_model(
    member: str = "exact",
    kernel: str = "structured",
    *,
    points: int = 48,
    physics: bool = False,
    memory: bool = False,
    together: bool = False,
    spec: Any = None,
    desired: bool = False,
) -> LearnedModel:
    """One process for each command, or one for all, perhaps beside identified physics."""
    spec = spec or arm_spec()
    presliding = 0.01 if memory else 0.0
    inputs = ArmInputs.of(spec, 0.02, presliding=presliding, stick_fraction=0.05, physics=memory and physics)
    log = turning_round(arm_log(spec, points), inputs)
    X, command = inputs.of_log(log), log["command"]
    mean = None
    if physics:
        every = np.ones(command.shape, dtype=np.bool_)
        mean = ArmPhysics(spec)(Samples(log, np.zeros(points, dtype=np.int64), every, every))
    left = command - (0.0 if mean is None else mean.predict(log))
    config = ModelConfig(points=points, basis=24, steps=2, kernel="ard_se", fit_points=points)
    J, structure = command.shape[1], "identified+gp" if physics else "gp"
    groups = [tuple(range(J))] if together else [(j,) for j in range(J)]
    candidates = []
    for group in groups:
        own = list(group)
        units = np.stack([left[:, own].mean(axis=0), left[:, own].std(axis=0)])
        names = tuple(spec.names[j] for j in own)
        made = _kernel(kernel, inputs.columns, names)
        fit = fit_data(X, (left[:, own] - units[0]) / units[1], inputs.columns, names, made, config)
        process: Any = member_named(member)(fit)
        scale = np.full(len(own), 1.3)
        candidates.append(Candidate(structure, group, np.ones(len(own)), mean, process, units, scale))
    return _model(inputs, candidates, spec.names, X)


def _kernel(name: str, columns: Any, commands: tuple[str, ...]) -> Kernel:
    if name == "short":  # fewer inputs, so that points are near enough to say something
        return SquaredExponential(tuple(range(0, len(columns), 3)))
    return ard_se(columns, commands) if name == "ard_se" else KERNELS[name](columns, commands)


def _model(inputs: Any, candidates: list[Candidate], names: Any, X: Array) -> LearnedModel:
    ranges = np.stack([X.min(axis=0), X.max(axis=0)])
    return LearnedModel(inputs, tuple(candidates), tuple(names), ranges, True, np.ones(len(names)))


def averaged(*models: LearnedModel, least: bool = False) -> LearnedModel:
    """All candidates of models with the same inputs, with weights that differ by command."""
    first = models[0]
    J = len(first.commands)
    shares = np.random.default_rng(3).dirichlet(np.ones(len(models)), size=J).T
    candidates = [
        replace(c, weights=shares[k][list(c.commands)]) for k, m in enumerate(models) for c in m.candidates
    ]
    doubt = np.linspace(0.0, 0.2, J) if least else None
    return replace(first, candidates=tuple(candidates), least=doubt, width=np.linspace(0.4, 3.0, J))


def alone(model: LearnedModel, *, grows: bool) -> LearnedModel:
    """Its means without their processes."""
    found = []
    for c in model.candidates:
        m = len(c.commands)
        assert c.process is not None
        silent = Silent(c.process, np.full(m, 1.2), np.full(m, 0.3), c.process.signal_variance, grows=grows)
        found.append(replace(c, structure="identified", process=silent))
    return replace(model, candidates=tuple(found))


def quadrotor_spec(name: str) -> Any:
    """A built-in vehicle; "hexa": six described motors in V; "octo": eight of which nobody knows."""
    if name not in ("hexa", "octo"):
        return QUADROTOR.spec(QUADROTOR.built_in()[name])
    own, count = quadrotor_spec("quadrotor"), {"hexa": 6, "octo": 8}[name]
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    rotors = [(0.2 * float(np.cos(a)), 0.2 * float(np.sin(a)), (-1.0) ** i) for i, a in enumerate(angles)]
    return replace(
        own,
        name=name,
        command_names=tuple(f"motor_{i + 1}" for i in range(count)),
        command_unit="V" if name == "hexa" else "1",
        command_lower=(0.0,) * count,
        command_upper=(11.1 if name == "hexa" else 1.0,) * count,
        plant=None,
        vehicle=own.vehicle if name == "hexa" else None,
        rotors=tuple(rotors) if name == "hexa" else (),
    )


TURNS, RATES = [0, 1, 2, 0, 1, 2, 0, 1], [0, 1, 2, 1, 0, 2, 2, 0]
"""Axes that move each motor."""


def quadrotor_log(spec: Any, count: int, seed: int = 0) -> Log:
    widths = {
        "altitude": np.array([0.5]),
        "specific_force": np.array([1.0, 1.0, 2.0]),
        "rates": np.full(3, 1.5),
        "angular_acceleration": np.full(3, 6.0),
        "body_velocity": np.full(3, 1.0),
        "body_acceleration": np.full(3, 1.0),
    }
    values = swings(widths, count, seed)
    values["altitude"] = values["altitude"] + 1.0
    values["specific_force"] = values["specific_force"] + np.array([0.0, 0.0, 9.81])
    channels = {c.name: c for c in QUADROTOR.channels(spec)}
    lower, upper = np.asarray(spec.command_lower), np.asarray(spec.command_upper)
    size = 0.3 * (upper - lower)
    push = (
        values["specific_force"][:, 2:] / 9.81 + 0.02 * values["angular_acceleration"][:, TURNS[: len(size)]]
    )
    values["command"] = lower + size * (push + 0.1 * np.sin(values["rates"][:, RATES[: len(size)]]))
    return Log(np.arange(count) / 10.0, {name: channels[name] for name in values}, values)


def quadrotor_model(
    name: str, *, physics: str = "identified", points: int = 40, spec: Any = None
) -> LearnedModel:
    """A process on what physics leave, for all commands at once."""
    from etude_quadrotor import QuadrotorInputs

    spec = spec or quadrotor_spec(name)
    count = len(spec.command_names)
    inputs = QuadrotorInputs(commands=count)
    log = quadrotor_log(spec, points)
    every = np.ones(log["command"].shape, dtype=np.bool_)
    samples = Samples(log, np.repeat(np.arange(2), points // 2), every, every)
    mean = QUADROTOR.physics(spec, QUADROTOR_CONFIG)[physics](samples)
    X, left = inputs.of_log(log), log["command"] - mean.predict(log)
    config = ModelConfig(points=points, basis=24, steps=2, kernel="ard_se", sharing="shared")
    units = np.stack([left.mean(axis=0), left.std(axis=0) + 1e-3])
    names = tuple(spec.command_names)
    kernel = ard_se(inputs.columns, names)
    fit = fit_data(X, (left - units[0]) / units[1], inputs.columns, names, kernel, config)
    process: Any = member_named("exact")(fit)
    candidate = Candidate(
        f"{physics}+gp", tuple(range(count)), np.ones(count), mean, process, units, np.full(count, 1.1)
    )
    return _model(inputs, [candidate], names, X)


class _Data:
    trims = True


class _Config:
    data = _Data()


QUADROTOR_CONFIG: Any = _Config()
