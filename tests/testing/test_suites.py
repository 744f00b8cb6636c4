"""The suites over members and kernels that come with Étude; and that they notice wrong processes, readers and
exporters. Criteria and readers keep theirs in their own rooms.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mutants import Twin, laws, noticed

from etude import plugins
from etude.errors import DataError
from etude.models import member_named
from etude.protocols import FitData, Kind, Trajectory
from etude.testing import ExporterSuite, KernelSuite, ProcessSuite, ReaderSuite
from etude.trajectories import from_json
from etude_arm import KIND

OWN = {name: plugins.load("etude.readers", name) for name in ("csv", "parquet")}

MEMBERS = {name: member_named(name) for name in plugins.BUILT_IN["etude.models"] if name != "all_lin"}
"""Those that learn commands one by one."""

POINTWISE = ("local_gp", "lwpr")
"""Members without covariances between inputs: designs see a guide in their place."""
COARSE = ("lwpr",)
"""Receptive fields know little of 90 samples, and keep a noise of their own."""
OPS = (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"), ("qd", "memory"), ("qd", "rest"))
COLUMNS = [(channel, part, "1", op) for channel, op in OPS for part in "ab"]
NOISY = ("standing",)
"""Kernels with noise of each sample's own."""


def process_suite(own: Any, commands_: int = 1, covariances_: bool = True) -> ProcessSuite:
    class Suite(ProcessSuite):
        member = own
        commands = commands_
        covariances = covariances_

    return Suite()


def red(suite: object, skipped: tuple[str, ...] = ()) -> dict[str, Exception]:
    return {name: error for name, error in laws(suite, skipped).items() if error is not None}


@pytest.mark.parametrize("name", MEMBERS)
def test_every_member_keeps_the_laws(name: str) -> None:
    skipped = ("test_it_learned_something", "test_a_larger_floor_means_more_noise") if name in COARSE else ()
    assert not red(process_suite(MEMBERS[name], 1, name not in POINTWISE), skipped)


@pytest.mark.parametrize("name", ["exact", "vfe"])
def test_members_that_learn_two_commands_keep_them_too(name: str) -> None:
    assert not red(process_suite(MEMBERS[name], 2))


def changed(**changes: Callable[..., Any]) -> Any:
    """The exact member, its process with other methods."""

    class Wrong:
        def __call__(self, fit: FitData) -> Any:
            return Twin(MEMBERS["exact"](fit), **changes)

        def restore(self, arrays: Mapping[str, Any]) -> Any:
            return MEMBERS["exact"].restore(arrays)

    return Wrong()


class Floorless:
    """Ignores the noise floor."""

    def __call__(self, fit: FitData) -> Any:
        return MEMBERS["exact"](replace(fit, floor=np.full_like(fit.floor, 0.02)))

    restore = staticmethod(MEMBERS["exact"].restore)


class Moody:
    """Draws its own random numbers."""

    def __call__(self, fit: FitData) -> Any:
        noise = 1e-6 * np.random.default_rng().standard_normal(fit.Y.shape)
        return MEMBERS["exact"](replace(fit, Y=fit.Y + noise))

    restore = staticmethod(MEMBERS["exact"].restore)


def _knows(process: Any, own: Any, Y: Any = None) -> Any:
    """Held-out predictions that have seen the samples they are of."""
    mean, variance = process.held_out(own, Y)
    return (mean if Y is None else 0.5 * (mean + Y[own])), variance


PROCESSES: dict[str, Any] = {
    "held out knows what it predicts": changed(held_out=_knows),
    "held out without noise": changed(held_out=lambda p, *a: (p.held_out(*a)[0], 0.0 * p.held_out(*a)[1])),
    "no number": changed(predict=lambda p, X: (p.predict(X)[0] * np.nan, p.predict(X)[1])),
    "a flat mean": changed(predict=lambda p, X: tuple(part.ravel() for part in p.predict(X))),
    "a negative variance": changed(predict=lambda p, X: (p.predict(X)[0], -p.predict(X)[1] - 1e-9)),
    "learned nothing": changed(predict=lambda p, X: (0.0 * p.predict(X)[0], p.predict(X)[1])),
    "rows know their company": changed(predict=lambda p, X: (p.predict(X)[0] + X.mean(), p.predict(X)[1])),
    "stored rounded": changed(
        arrays=lambda p: {n: np.round(a, 5) if a.dtype == float else a for n, a in p.arrays().items()}
    ),
    "a command without a latent function": changed(latents=lambda _: []),
    "a gradient without sign": changed(
        latents=lambda p: [
            (Twin(q, covariance_gradient=lambda o, *a: -o.covariance_gradient(*a)), own)
            for q, own in p.latents()
        ]
    ),
    "the floor ignored": Floorless(),
    "another draw each time": Moody(),
}


@pytest.mark.parametrize("wrong", PROCESSES.values(), ids=PROCESSES)
def test_wrong_processes(wrong: Any) -> None:
    assert noticed(process_suite(wrong))


@pytest.mark.parametrize("name", plugins.BUILT_IN["etude.kernels"])
def test_every_kernel_keeps_the_laws(name: str) -> None:
    class Suite(KernelSuite):
        kernel, width = plugins.load("etude.kernels", name)(COLUMNS, ("a",)), len(COLUMNS)
        noisy = name in NOISY

    assert not red(Suite())


class Csv(ReaderSuite):
    reader = OWN["csv"]
    suffix = ".csv"

    def write(self, path: Path, columns: dict[str, list[float]]) -> None:
        pl.DataFrame(columns).write_csv(path)


class Parquet(ReaderSuite):
    reader = OWN["parquet"]
    suffix = ".parquet"

    def write(self, path: Path, columns: dict[str, list[float]]) -> None:
        pl.DataFrame(columns).write_parquet(path)


def reader_laws(suite: ReaderSuite, folder: Path) -> bool:
    """Whether every law holds."""
    for name in [name for name in dir(suite) if name.startswith("test_")]:
        try:
            getattr(suite, name)(folder)
        except Exception:
            return False
    return True


def _lenient(own: Any, path: Path, topics: Any) -> Any:
    try:
        return own(path, topics)
    except DataError:
        return {}


def _scaled(own: Any, path: Path, topics: Any) -> Any:
    logs = own(path, topics)
    return {
        n: replace(log, values={k: v * (1 + 1e-12) for k, v in log.values.items()}) for n, log in logs.items()
    }


def _padded(own: Any, path: Path, topics: Any) -> Any:
    """A cut file filled up with zeros."""
    logs = own(path, topics)
    return {
        n: replace(log, values={k: np.vstack([v, 0.0 * v[:1]]) for k, v in log.values.items()})
        for n, log in logs.items()
    }


READERS: dict[str, Any] = {
    "refuses nothing": _lenient,
    "a little off": _scaled,
    "rows that are not there": _padded,
}


@pytest.mark.parametrize("change", READERS.values(), ids=READERS)
def test_wrong_readers(change: Any, tmp_path: Path) -> None:
    class Suite(Csv):
        reader = Twin(OWN["csv"], __call__=change)

    assert not reader_laws(Suite(), tmp_path)


def test_a_reader_that_does_not_know_its_own_files(tmp_path: Path) -> None:
    class Suite(Csv):
        reader = Twin(OWN["csv"], recognises=lambda *_: False, __call__=lambda own, *a: own(*a))

    assert not reader_laws(Suite(), tmp_path)


class Json:
    """Exports the trajectory's own text; `digits` of its coefficients, `faster` by a factor."""

    def __init__(self, digits: int | None = None, slower: float = 1.0, dated: bool = False) -> None:
        self.digits, self.slower, self.dated, self.count = digits, slower, dated, 0

    def __call__(self, trajectory: Trajectory, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        facts = json.loads(trajectory.slowed(self.slower).to_json())
        if self.digits is not None:
            facts["coefficients"] = np.round(facts["coefficients"], self.digits).tolist()
        self.count += 1
        extra = {"log.txt": str(self.count).encode()} if self.dated else {}
        return {"trajectory.json": json.dumps(facts).encode(), **extra}

    def back(self, files: Mapping[str, bytes]) -> Trajectory:
        return from_json(files["trajectory.json"])


def exporter_suite(own: Any) -> ExporterSuite:
    class Suite(ExporterSuite):
        exporter = own
        kind, robot = KIND, "arm4"

    return Suite()


def test_an_exporter_keeps_the_laws() -> None:
    assert not red(exporter_suite(Json()))


@pytest.mark.parametrize(
    "wrong", [Json(digits=2), Json(slower=0.7), Json(dated=True)], ids=["rounded", "too fast", "dated"]
)
def test_wrong_exporters(wrong: Any) -> None:
    assert noticed(exporter_suite(wrong))
