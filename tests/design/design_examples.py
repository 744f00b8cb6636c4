"""A small robot, a model that has learned two motions of it, and derivatives by differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from etude.models.contracts import Posterior
from etude.models.features import FeatureMap
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import structured_kernel
from etude.models.physics.kinematics import KinematicTree
from etude.models.physics.rigid_body import RigidBodyModel
from etude.models.physics.transmission import joint_drives
from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.random import random_trajectory

FAMILIES = {
    "nullspace": TrajectoryFamily(harmonics=4, duration=30.0),
    "ramp, omega0 free": TrajectoryFamily(harmonics=2, duration=30.0, omega0=(0.2, 0.5), rest="ramp"),
}


@dataclass(frozen=True)
class Model:
    features: FeatureMap
    posteriors: tuple[Posterior, ...]
    stick_velocity: np.ndarray
    fallback: RigidBodyModel | None = None


def robot() -> RobotSpec:
    axes = (Axis("base", -0.9, 0.7, 0.5, 1.0, 50.0), Axis("tip", 0.2, 1.6, 0.8, 2.0, 20.0))
    return RobotSpec("pair", axes, "N m", 100.0)


def arm() -> RigidBodyModel:
    """Two links of 0.4 m in a vertical plane, 2 kg and 1 kg with their mass half-way."""
    link = np.zeros((3, 10))
    for body, mass in ((1, 2.0), (2, 1.0)):
        link[body] = [mass, 0.2 * mass, 0.0, 0.0, 0.001, 0.05 * mass, 0.05 * mass, 0.0, 0.0, 0.0]
    tree = KinematicTree(
        parent=np.array([0, 0, 1]),
        position=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]),
        rotation=np.tile(np.eye(3), (3, 1, 1)),
        joint_body=np.array([1, 2]),
        joint_axis=np.tile([0.0, 1.0, 0.0], (2, 1)),
        joint_anchor=np.zeros((2, 3)),
        joint_slides=np.zeros(2, dtype=bool),
        joint_zero=np.zeros(2),
        gravity=np.array([0.0, 0.0, -9.81]),
        nominal=link,
    )
    unknown = np.zeros(2)
    return RigidBodyModel(
        tree,
        joint_drives(2),
        np.full(2, 0.05),
        np.zeros((2, 20)),
        np.zeros((2, 6)),
        unknown.astype(int),
        unknown,
    )


def model(seed: int = 0, points: int = 60, stick: float = 0.02) -> Model:
    """Two outputs of very different size, each with a structured kernel, from two random motions."""
    rng, spec = np.random.default_rng(seed), robot()
    features = FeatureMap(2, np.array([0.05, 0.05]))
    motions = [random_trajectory(rng, spec, TrajectoryFamily(duration=30.0)) for _ in range(2)]
    samples = [motion.sample(np.linspace(1.0, 29.0, points // 2)) for motion in motions]
    X = np.concatenate([features.transform(s.q, s.qd, s.qdd) for s in samples])
    posteriors = []
    for j, size in enumerate((30.0, 2.0)):
        y = size * (np.sin(X[:, j]) + 0.5 * X[:, 6 + j] + 0.2 * X[:, 4 + j])
        kernel = structured_kernel(2, j)
        theta = kernel.initial(0.5 * np.ptp(X, axis=0), size)
        posteriors.append(ExactGP(kernel, theta, np.log(0.03 * size)).condition(X, y - y.mean()))
    return Model(features, tuple(posteriors), np.full(2, stick), arm())


def differences(function: Callable[[np.ndarray], float], at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences of fourth order."""
    out = np.empty_like(at)
    for index in np.ndindex(at.shape):
        shift = np.zeros_like(at)
        shift[index] = step
        near = function(at + shift) - function(at - shift)
        far = function(at + 2.0 * shift) - function(at - 2.0 * shift)
        out[index] = (8.0 * near - far) / (12.0 * step)
    return out


def assert_same(exact: np.ndarray, approximate: np.ndarray, tolerance: float = 1e-6) -> None:
    """Equal to `tolerance` of the largest entry."""
    np.testing.assert_allclose(exact, approximate, rtol=0.0, atol=tolerance * np.abs(exact).max())
