"""Inputs, hyperparameters and reference values of the Lagrangian prior, to sixty digits from elsewhere."""

from __future__ import annotations

import numpy as np

from etude_lagrangian import Joints, Lagrangian
from etude_lagrangian.kernel_parameters import Parameters

TURNING = Joints((0, 1), (2, 3), (4, 5), (False, False))
SLIDING = Joints((0, 1), (2, 3), (4, 5), (False, True))
X = np.array([[0.3, -0.7, 0.5, 1.1, -2.0, 0.4]])
Z = np.array([[-0.4, 0.9, -0.8, 0.6, 1.5, -1.2]])
# u0, √a and √b of the potential, v_00, v_10, v_11, √a and √b of the kinetic energy
THETA = np.log(
    np.concatenate(
        [[2.0], *np.sqrt([[0.8, 1.5], [1.2, 0.6]]), [0.5, 0.9, 0.4], *np.sqrt([[0.7, 1.1], [1.3, 0.9]])]
    )
)
V_00 = 5
ALONE = (THETA, np.delete(THETA, V_00))
"""Of each command by itself: link 0 does not move with joint 1."""

VALUES = np.array([[-6.122450153713, 0.743552498397], [0.9304137441422, -0.1978296037145]])
AT_X = np.array([[26.99053037097, -1.000794356585], [-1.000794356585, 6.759699376591]])
POTENTIAL = np.array([[0.2989399522869, 0.5993752783003], [0.7564751015814, 0.8059031667909]])
SLIDE = np.array([[-3.982073536975, 0.7869427155959], [0.8488636057586, 2.727822070961]])


def joints(J: int, slides: tuple[int, ...] = ()) -> Joints:
    """J joints in columns of q, then w, then u."""
    places = [tuple(range(block * J, (block + 1) * J)) for block in range(3)]
    return Joints(places[0], places[1], places[2], tuple(j in slides for j in range(J)))


def random_parameters(own: Joints, seed: int = 0) -> np.ndarray:
    """theta (P,) of all commands."""
    return 0.4 * np.random.default_rng(seed).normal(size=len(Parameters(own.slides).names()))


def alone(own: Joints, theta: np.ndarray, k: int) -> tuple[Lagrangian, np.ndarray]:
    """Kernel and hyperparameters of one command."""
    kernel = Lagrangian(own, k)
    return kernel, kernel.parameters.theta(Parameters(own.slides).array(theta))


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Six inputs (6, 6) and outputs (6, 2) of the reference likelihoods."""
    i = np.arange(6.0)
    columns = [np.sin(i + 1), np.cos(2 * i), 0.5 * np.sin(3 * i), np.cos(i), np.sin(2 * i + 1), -np.cos(i)]
    return np.column_stack(columns), np.column_stack([3 * np.sin(i), 2 * np.cos(3 * i)])
