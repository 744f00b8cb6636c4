"""Models of given sizes for `etude bench c99`: joints without a robot, processes on random points."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude import plugins
from etude.models import LearnedModel, Posteriors, ard_se, posterior_given, structured
from etude.protocols import Candidate, Kind
from etude.types import Array
from etude_sparse import SparseSpectrumGP

AXIS = """
[[axis]]
name = "joint{number}"
lower = -2.0
upper = 2.0
velocity = 1.0
acceleration = 3.0
command = 10.0
"""


@dataclass(frozen=True)
class Sized:
    """A model with its robot."""

    model: LearnedModel
    kind: Kind
    spec: Any


@dataclass(frozen=True)
class _Data:
    friction_fraction: float
    presliding: float
    stick_fraction: float = 0.05
    desired: bool = False


@dataclass(frozen=True)
class _Model:
    remembers: bool


@dataclass(frozen=True)
class _Config:
    data: _Data
    model: _Model


def sized(member: str, joints: int, points: int, seed: int = 0) -> Sized:
    """A process for each joint: "ard_se" on q, qd, qdd; "structured" on all inputs of `tell`; "ssgp"."""
    kind: Kind = plugins.load("etude.robots", "arm")
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "robot.toml"
        head = 'name = "bench"\ncommand_unit = "N m"\nrate = 100.0\n'
        path.write_text(head + "".join(AXIS.format(number=j) for j in range(joints)), encoding="utf-8")
        spec = kind.spec(path)
    whole = member == "structured"
    config = _Config(_Data(0.02 if whole else 0.0, 0.01 if whole else 0.0), _Model(whole))
    inputs = kind.inputs(spec, config)
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (points, len(inputs.columns)))
    Y = np.sin(X[:, :joints]) + 0.3 * X[:, joints : 2 * joints]
    names = tuple(f"joint{j}" for j in range(joints))
    posteriors = tuple(_posterior(member, X, Y[:, j], inputs.columns, names[j], rng) for j in range(joints))
    process = Posteriors(posteriors)
    units = np.stack([np.zeros(joints), np.full(joints, 3.0)])
    every = tuple(range(joints))
    candidate = Candidate("gp", every, np.ones(joints), None, process, units, np.ones(joints))
    ranges = np.stack([X.min(axis=0), X.max(axis=0)])
    model = LearnedModel(inputs, (candidate,), names, ranges, True, np.ones(joints))
    return Sized(model, kind, spec)


def _posterior(member: str, X: Array, y: Array, columns: Any, name: str, rng: np.random.Generator) -> Any:
    if member == "ssgp":
        theta = np.concatenate([[0.0], np.log(np.full(X.shape[1], 2.0))])
        points = rng.standard_normal((200, X.shape[1]))
        return SparseSpectrumGP(points, theta, np.log(0.1)).condition(X, y)
    kernel = structured(columns, (name,)) if member == "structured" else ard_se(columns, (name,))
    theta = kernel.initial(np.full(X.shape[1], 2.0), 1.0) + 0.1 * rng.standard_normal(kernel.size)
    return posterior_given(kernel, theta, 0.01, X, y)
