"""The exported drag is the one that Python flies with, for any motion: `--to c` writes it, in double."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_models import QUADROTOR, quadrotor_model

from compilers import run, tool
from etude import plugins
from etude.types import Array, Motion
from etude_quadrotor import FlightFeedforward
from etude_quadrotor.physics.drag import _fitted

ROOT = Path(__file__).parents[3]
COUNT = 60


@pytest.fixture(scope="module")
def model() -> Any:
    """A vehicle that knows a drag that is not linear."""
    own = QUADROTOR.spec(ROOT / "examples" / "crazyflie" / "crazyflie.toml")
    rng = np.random.default_rng(3)
    velocity = rng.uniform(-3.0, 3.0, (80, 3))
    force = -velocity[:, :2] * [0.4, 0.6] - 0.1 * np.abs(velocity[:, :2]) * velocity[:, :2]
    lateral = _fitted(velocity, force + 0.02 * rng.standard_normal(force.shape), (True, True))
    found = quadrotor_model("", points=12, spec=own)
    return replace(found, inputs=replace(found.inputs, drag=lateral.coefficients, lateral=lateral))


@pytest.fixture(scope="module")
def library(model: Any, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("lean")
    own = QUADROTOR.spec(ROOT / "examples" / "crazyflie" / "crazyflie.toml")
    delivered = plugins.load("etude.targets", "c")(model, QUADROTOR, own, {"name": "own"})
    for file, data in delivered.files.items():
        (folder / file).write_bytes(data)
    assert b"own_lean.c" in delivered.files["CMakeLists.txt"]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-fPIC", "-shared"]
    run([tool("gcc"), *flags, "own.c", "own_lean.c", "-lm", "-o", "own.so"], folder)
    return ctypes.CDLL(str(folder / "own.so"))


def lean(library: ctypes.CDLL, velocity: Array, acceleration: Array, yaw: float = 0.0) -> tuple[int, Array]:
    out = np.zeros(3)
    rows = [np.ascontiguousarray(values) for values in (velocity, acceleration)]
    library.own_lean.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
    return library.own_lean(rows[0].ctypes.data, rows[1].ctypes.data, yaw, out.ctypes.data), out


def states() -> Motion:
    """Velocities beyond those of the training, and the rest of a motion; samples by themselves."""
    rng = np.random.default_rng(5)
    orders = rng.uniform(-1.0, 1.0, (5, COUNT, 3)) * np.array([1.0, 5.0, 2.0, 5.0, 5.0])[:, None, None]
    return Motion(np.arange(COUNT) * 0.1, orders)


def test_the_exported_drag_is_pythons(model: Any, library: ctypes.CDLL) -> None:
    motion = states()
    told = FlightFeedforward(drag=model.inputs.lateral).accelerations(motion)
    assert told is not None
    for k in range(COUNT):
        sure, found = lean(library, motion.orders[1, k], motion.orders[2, k])
        assert sure
        np.testing.assert_allclose(found, told[k] - motion.orders[2, k], atol=1e-10)


def test_a_heading_turns_it(library: ctypes.CDLL) -> None:
    motion, angle = states(), 0.8
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for k in range(5):
        v, a = motion.orders[1:3, k]
        np.testing.assert_allclose(
            lean(library, turn @ v, turn @ a, angle)[1], turn @ lean(library, v, a)[1], atol=1e-12
        )


def test_without_a_direction_of_thrust_nothing_is_added(library: ctypes.CDLL) -> None:
    for v, a in (([1.0, 0.0, 0.0], [0.0, 0.0, -9.0]), ([np.nan, 0.0, 0.0], [0.0, 0.0, 0.0])):
        sure, found = lean(library, np.array(v), np.array(a))
        assert not sure
        np.testing.assert_array_equal(found, 0.0)
