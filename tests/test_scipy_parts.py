"""BLAS and L-BFGS-B of SciPy without their packages: the same routines, the same points, and nothing else."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import scipy
from scipy.linalg import blas as public_blas
from scipy.linalg import lapack as public_lapack
from scipy.optimize import minimize

from etude._runtime import scipy_parts

LIGHT = """
import sys, numpy as np
from etude._runtime.scipy_parts import dpotrf, dtrmm
from etude._runtime.scipy_parts import minimise
seen = []
minimise(lambda x: (seen.append(x), (float(x @ x), 2.0 * x))[1], np.array([1.0, 2.0]), steps=5)
assert seen and abs(seen[-1]).max() < 1e-6
print([name for name in ("scipy.linalg", "scipy.optimize", "scipy.special") if name in sys.modules])
import scipy.linalg, scipy.optimize
A = np.array([[4.0, 1.0], [1.0, 3.0]])
assert (scipy.linalg.cholesky(A, lower=True) == dpotrf(A, lower=1, clean=1)[0]).all()
assert scipy.optimize.minimize(lambda x: float(x @ x), [1.0], method="L-BFGS-B").success
"""


def run(program: str) -> str:
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return found.stdout.strip()


@pytest.mark.skipif(
    ".".join(scipy.__version__.split(".")[:2]) not in scipy_parts.VERSIONS,
    reason="this SciPy is not known: put it in VERSIONS, and if all tests here pass then it may stay there",
)
def test_they_load_no_package_and_leave_it_whole() -> None:
    assert run(LIGHT) == "[]"


def test_the_routines_are_those_of_the_package() -> None:
    rng = np.random.default_rng(0)
    A = np.asfortranarray(np.tril(rng.standard_normal((70, 70))) + 9.0 * np.eye(70))
    B = np.asfortranarray(rng.standard_normal((70, 13)))
    assert np.array_equal(scipy_parts.dtrmm(1.0, A, B, lower=1), public_blas.dtrmm(1.0, A, B, lower=1))
    for own, known in (
        (scipy_parts.dpotrf, public_lapack.dpotrf),
        (scipy_parts.dpotri, public_lapack.dpotri),
    ):
        assert np.array_equal(own(A @ A.T, lower=1)[0], known(A @ A.T, lower=1)[0])


def test_a_file_that_is_not_there_is_none() -> None:
    assert scipy_parts.extension("linalg", "_no_such_file") is None


class Valley:
    """Rosenbrock's function, and where it was asked."""

    def __init__(self, size: int) -> None:
        self.points: list[np.ndarray] = []
        self.start = np.random.default_rng(size).uniform(-2.0, 2.0, size)

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        self.points.append(x.copy())
        step, gradient = x[1:] - x[:-1] ** 2, np.zeros_like(x)
        gradient[:-1] = -400.0 * x[:-1] * step - 2.0 * (1.0 - x[:-1])
        gradient[1:] += 200.0 * step
        return float(100.0 * step @ step + (1.0 - x[:-1]) @ (1.0 - x[:-1])), gradient


CASES = pytest.mark.parametrize(
    ("size", "given", "reach"),
    [
        (2, {"steps": 200}, None),
        (7, {"steps": 25, "kept": 20, "searched": 10}, None),
        (7, {"steps": 60}, 0.4),
        (12, {"steps": 60, "evaluations": 9}, None),
        (5, {"steps": 1}, 3.0),
        (6, {"steps": 40, "kept": 3, "searched": 2}, 5.0),
    ],
)


@CASES
@pytest.mark.parametrize("alone", [True, False])
def test_it_asks_where_scipy_asks(
    size: int, given: dict[str, int], reach: float | None, alone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit the points of `scipy.optimize.minimize`, by the compiled file and without it."""
    if not alone:
        monkeypatch.setattr(scipy_parts, "VERSIONS", ())
    ours, theirs = Valley(size), Valley(size)
    bounds = None if reach is None else [(p - reach, p + 0.7 * reach) for p in ours.start]
    scipy_parts.minimise(ours, ours.start, bounds=bounds, **given)
    names = {"steps": "maxiter", "kept": "maxcor", "searched": "maxls", "evaluations": "maxfun"}
    options = {names[name]: value for name, value in given.items()}
    minimize(theirs, theirs.start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    assert len(ours.points) == len(theirs.points) > 1
    assert np.array_equal(ours.points, theirs.points)


def test_a_start_beyond_a_bound_is_drawn_in() -> None:
    ours, theirs = Valley(3), Valley(3)
    bounds = [(p + 0.1, p + 1.0) for p in ours.start]
    scipy_parts.minimise(ours, ours.start, steps=20, bounds=bounds)
    minimize(theirs, theirs.start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 20})
    assert np.array_equal(ours.points, theirs.points)
