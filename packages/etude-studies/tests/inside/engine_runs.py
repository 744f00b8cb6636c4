"""Runs for the tests of the engines: they end at once, never, or with their process."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from etude_studies.measured import Measured

Settings, Needs = Mapping[str, Any], Mapping[str, pl.DataFrame]


def noisy(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    """Linear algebra of some size, so that the number of threads would show in the last digits."""
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((300, 300))
    errors = np.linalg.solve(matrix @ matrix.T + np.eye(300), matrix).sum(axis=1)
    found = [Measured(k, "fourier", "", "mean", "error", errors[k]) for k in range(settings["rounds"])]
    return [*found, Measured(0, "", "", "mean", "cpu_train", time.perf_counter())]


def stage(settings: Settings, seed: int, needs: Needs) -> pl.DataFrame:
    """A shared stage with columns of its own; leaves a mark each time."""
    with open(settings["marks"], "a", encoding="utf-8") as file:
        file.write(f"{seed}\n")
    return pl.DataFrame({"draw": np.random.default_rng(seed).standard_normal(5)})


def sums(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    """The sums of what it needs, in their order."""
    return [
        Measured(k, "", "", "mean", "sum", seed + table["draw"].sum())
        for k, table in enumerate(needs.values())
    ]


def raising(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    raise ValueError("the matrix is not positive definite")


def leaving(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    raise SystemExit(3)


def not_a_number(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    return [Measured(k, "", "", "mean", "error", float("nan") if k == 2 else 1.0) for k in range(4)]


def dying(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    """Its process is killed as often as settings say; after that it works."""
    if len(os.listdir(settings["deaths"])) < settings["times"]:
        Path(settings["deaths"], str(time.monotonic_ns())).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return [Measured(0, "", "", "mean", "survived", 1.0)]


def lasting(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    """Leaves the number of its process; seeds of 2 and more never end."""
    Path(settings["pids"], str(os.getpid())).touch()
    while seed >= 2:
        pass
    return [Measured(0, "", "", "mean", "error", float(seed))]


def threads(settings: Settings, seed: int, needs: Needs) -> list[Measured]:
    """How many each library would use."""
    from threadpoolctl import threadpool_info

    blas = [own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas"]
    return [
        Measured(0, "", "", "mean", "blas", max(blas)),
        Measured(0, "", "", "mean", "numba", int(os.environ["NUMBA_NUM_THREADS"])),
    ]
