"""Runs on a real Dask cluster of separate processes, one of which is killed in the middle of a run."""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from etude.errors import UsageError
from etude_studies.engines.choice import open_engine
from etude_studies.engines.inline import Inline
from etude_studies.engines.schedule import Event, run_all
from etude_studies.measured import comparable
from etude_studies.run_file import parquet_bytes, read_result, result_path
from etude_studies.spec import Spec

NOISY = [Spec("engine_runs:noisy", {"rounds": 4}, seed) for seed in range(4)]
DEATHS = 2


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="pip install 'distributed>=2024.8'")
    import dask

    settings = {
        "distributed.scheduler.allowed-failures": DEATHS - 1,
        "distributed.worker.daemon": True,
        "distributed.logging.distributed": "critical",
    }
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as own,
    ):
        yield own


def dying(folder: Path, times: int) -> Spec:
    folder.mkdir()
    return Spec("engine_runs:dying", {"deaths": str(folder), "times": times}, 0)


def test_the_cluster_gives_the_same_bytes(cluster: Any, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    stages = [Spec("engine_runs:stage", {"marks": str(marks)}, seed) for seed in (5, 6)]
    specs = [*NOISY, Spec("engine_runs:sums", {}, 0, stages)]
    run_all(specs, tmp_path / "inline", Inline())
    marks.unlink()
    with open_engine(cluster=cluster.scheduler_address) as engine:
        report = run_all(specs, tmp_path / "dask", engine)
        again = run_all(specs, tmp_path / "dask", engine)
    assert set(report.ran) == {*specs, *stages}
    assert again.ran == ()
    assert sorted(marks.read_text().split()) == ["5", "6"]
    for spec in specs:
        here, there = (
            parquet_bytes(comparable(read_result(result_path(tmp_path / name, spec), spec)), {})
            for name in ("inline", "dask")
        )
        assert here == there


def test_a_killed_worker_costs_no_run(cluster: Any, tmp_path: Path) -> None:
    once, bad = dying(tmp_path / "once", 1), Spec("engine_runs:raising", {}, 0)
    told: list[Event] = []
    with open_engine(cluster=cluster.scheduler_address) as engine:
        report = run_all([once, bad, *NOISY], tmp_path / "store", engine, told.append)
    assert set(report.ran) == {once, *NOISY}
    assert report.failed[bad].startswith("ValueError: the matrix is not positive definite")
    assert (told[-1].done, told[-1].total) == (6, 6)
    assert len(list((tmp_path / "once").iterdir())) == 1


def test_a_deadly_run_is_given_up_and_the_rest_goes_on(cluster: Any, tmp_path: Path) -> None:
    always = dying(tmp_path / "always", 99)
    heir = Spec("engine_runs:sums", {}, 0, [always])
    with open_engine(cluster=cluster.scheduler_address) as engine:
        report = run_all([heir], tmp_path / "store", engine)
        after = run_all(NOISY, tmp_path / "store", engine)
    assert report.failed == {
        always: f"all {DEATHS} workers that had it died, 2 times",
        heir: "it needs dying seed 0, which failed",
    }
    assert len(list((tmp_path / "always").iterdir())) == 2 * DEATHS
    assert set(after.ran) == set(NOISY)


def test_an_address_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="pip install 'distributed>=2024.8'")
    monkeypatch.setattr("etude_studies.engines.cluster.ANSWER_S", 0.3)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        for address in (
            f"tcp://127.0.0.1:{silent.getsockname()[1]}",
            "tcp://127.0.0.1:1",
            "nonsense",
            "x://y:1",
        ):
            with pytest.raises(UsageError, match=r"no Dask scheduler answers: .+dask scheduler"):
                open_engine(cluster=address)


def test_without_the_package_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'distributed>=2024.8'"):
        open_engine(cluster="tcp://127.0.0.1:1")
