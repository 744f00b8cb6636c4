"""Origin of a result: commit, versions, machine, seconds."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, NamedTuple

from etude import __version__
from etude_studies.rows import commit

if TYPE_CHECKING:
    import polars as pl

LIBRARIES = ("numpy", "scipy", "numba", "polars")


class Made(NamedTuple):
    """Where a result comes from: what may differ between two computations of the same run.

    Attributes:
        commit: of the code. versions: by library. machine: processor, cores, system.
        cpu_s, wall_s: seconds. date: UTC, ISO 8601.
    """

    commit: str
    versions: dict[str, str]
    machine: dict[str, str]
    cpu_s: float
    wall_s: float
    date: str


def made_by(work: Callable[[], pl.DataFrame]) -> tuple[pl.DataFrame, Made]:
    """Does the work, and says where and how long."""
    cpu, wall = process_time(), perf_counter()
    table = work()
    spent = round(process_time() - cpu, 3), round(perf_counter() - wall, 3)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return table, Made(_commit(), _versions(), _machine(), *spent, now)


@cache
def _commit() -> str:
    return commit()


def _versions() -> dict[str, str]:
    return {
        "etude": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
    }


@cache
def _machine() -> dict[str, str]:
    system = f"{platform.system()} {platform.machine()}"
    return {"cpu": _processor(), "cores": str(os.cpu_count()), "system": system}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or "unknown"
