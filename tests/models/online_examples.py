"""A small robot of two joints, samples of it and a model of them, for the tests of learning on line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.campaign import preset_config
from etude.models import LearnedModel, ModelConfig, select_structures
from etude.types import Log, Samples, joined_samples
from etude_arm import KIND, ArmSpec, Axis

SPEC = ArmSpec("pendulum", tuple(Axis(name, -2.0, 2.0, 2.0, 4.0, 40.0) for name in "ab"), "A", 100.0)
CHANNELS = {channel.name: channel for channel in SPEC.channels()}
LIMITS = -SPEC.command, SPEC.command
CONFIG = preset_config(KIND, "default")
SMALL = ModelConfig(rung="gp", points=90, fit_points=60, steps=5, calibrate=False)


def trajectory(group: int, seconds: float = 25.0) -> Samples:
    """Noisy commands along a smooth motion: gravity, friction, and a ripple."""
    rng = np.random.default_rng(100 + group)
    t = np.arange(0.0, seconds, 0.125)
    speed, phase = rng.uniform(0.3, 0.9, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    angle = t[:, None, None] * speed + phase
    q = 0.5 * np.sin(angle).sum(axis=1)
    qd = 0.5 * (speed * np.cos(angle)).sum(axis=1)
    qdd = -0.5 * (speed**2 * np.sin(angle)).sum(axis=1)
    far = 1.2 * np.cos(q.sum(axis=1))
    command = np.column_stack([8.0 * np.cos(q[:, 0]) + far, far]) + 0.5 * np.sin(8.0 * q)
    command += 1.5 * np.tanh(qd / 0.05) + 0.8 * qd + 0.2 * rng.normal(size=q.shape)
    values = {"q": q, "qd": qd, "qdd": qdd, "command": command}
    log = Log(t, {name: CHANNELS[name] for name in values}, values)
    moving = np.abs(qd) >= 0.03
    return Samples(log, np.full(len(t), group, dtype=np.int64), np.ones_like(moving), moving)


def trained(config: ModelConfig = SMALL, count: int = 2) -> LearnedModel:
    """A model of that many motions."""
    samples = joined_samples([trajectory(group) for group in range(count)])
    inputs, limit = KIND.inputs(SPEC, CONFIG), KIND.limit(SPEC)
    return select_structures(samples, inputs, {}, limit, config, np.random.default_rng(0)).model


def of_structure(structure: str, **changes: object) -> ModelConfig:
    return replace(SMALL, rung=structure, **changes)  # type: ignore[arg-type]
