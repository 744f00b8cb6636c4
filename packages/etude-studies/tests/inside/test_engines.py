"""The engines: the same results from each, and nothing lost but what was in flight, whoever dies."""

from __future__ import annotations

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from etude import storage
from etude.errors import EtudeError, UsageError
from etude_studies.engines import worker
from etude_studies.engines.choice import open_engine, shard
from etude_studies.engines.each import each
from etude_studies.engines.inline import Inline
from etude_studies.engines.progress import as_line, progress, time_left
from etude_studies.engines.schedule import Event, remove_old_leftovers, run_all, shard_of
from etude_studies.engines.workers import TookTooLong, WorkerDied, Workers
from etude_studies.measured import comparable
from etude_studies.run_file import parquet_bytes, read_made, read_result, result_path
from etude_studies.spec import Spec

HERE = Path(__file__).parent
NOISY = [Spec("engine_runs:noisy", {"rounds": 4}, seed) for seed in range(4)]


def table_bytes(folder: Path, spec: Spec) -> bytes:
    return parquet_bytes(comparable(read_result(result_path(folder, spec), spec)), {})


def shared(tmp_path: Path) -> tuple[list[Spec], Path]:
    """Three runs that share two stages, and where the stages leave their marks."""
    marks = tmp_path / "marks"
    stages = [Spec("engine_runs:stage", {"marks": str(marks)}, seed) for seed in (5, 6)]
    return [Spec("engine_runs:sums", {}, seed, stages) for seed in range(3)], marks


def test_bytes_do_not_depend_on_the_engine(tmp_path: Path) -> None:
    run_all(NOISY, tmp_path / "inline", Inline())
    with Workers(2) as pool:
        run_all(NOISY, tmp_path / "pool", pool)
    for spec in NOISY:
        assert table_bytes(tmp_path / "inline", spec) == table_bytes(tmp_path / "pool", spec)
    whole = read_result(result_path(tmp_path / "pool", NOISY[0]), NOISY[0])
    assert len(whole) == 5
    assert len(comparable(whole)) == 4


def test_workers_have_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")  # of whoever starts them
    spec = Spec("engine_runs:threads", {}, 0)
    with Workers(1) as pool:
        run_all([spec], tmp_path, pool)
    table = read_result(result_path(tmp_path, spec), spec)
    assert dict(table.select("measure", "value").iter_rows()) == {"blas": 1.0, "numba": 1.0}


def test_shared_stages_come_first_and_once_and_a_second_start_runs_nothing(tmp_path: Path) -> None:
    specs, marks = shared(tmp_path)
    store = tmp_path / "store"
    with Workers(2) as pool:
        report = run_all(specs, store, pool)
    assert sorted(marks.read_text().split()) == ["5", "6"]
    assert set(report.ran[:2]) == set(specs[0].needs)
    assert set(report.ran[2:]) == set(specs)
    again = run_all(specs, store, Inline())
    assert (again.ran, again.kept, again.failed) == ((), tuple(specs), {})


def test_a_stage_is_not_run_for_what_is_there(tmp_path: Path) -> None:
    specs, marks = shared(tmp_path)
    store = tmp_path / "store"
    run_all(specs, store, Inline())
    for stage in specs[0].needs:
        result_path(store, stage).unlink()
    assert run_all(specs, store, Inline()).ran == ()
    result_path(store, specs[1]).unlink()
    assert run_all(specs, store, Inline()).ran == (*specs[0].needs, specs[1])
    assert marks.read_text().split() == ["5", "6", "5", "6"]


def truncated(path: Path, _: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def emptied(path: Path, _: Path) -> None:
    path.write_bytes(b"")


def of_another_run(path: Path, other: Path) -> None:
    shutil.copy(other, path)


def of_another_format(path: Path, _: Path) -> None:
    table = read_result(path, NOISY[0])
    path.write_bytes(parquet_bytes(table, {"format": "0", "hash": NOISY[0].hash}))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (truncated, "cannot be read as Parquet"),
        (emptied, "cannot be read as Parquet"),
        (of_another_run, "of another run"),
        (of_another_format, "of format 0"),
    ],
)
def test_an_unfit_result_is_computed_again_and_said_so(
    tmp_path: Path, spoil: Callable[[Path, Path], None], said: str
) -> None:
    run_all(NOISY[:2], tmp_path, Inline())
    before = table_bytes(tmp_path, NOISY[0])
    spoil(result_path(tmp_path, NOISY[0]), result_path(tmp_path, NOISY[1]))
    told: list[Event] = []
    report = run_all(NOISY[:2], tmp_path, Inline(), told.append)
    assert report.ran == (NOISY[0],)
    assert said in report.recomputed[NOISY[0]]
    assert "noisy seed 0 is computed again" in told[0].text
    assert table_bytes(tmp_path, NOISY[0]) == before


def test_a_run_that_fails_stops_nobody_else(tmp_path: Path) -> None:
    bad = Spec("engine_runs:raising", {}, 0)
    heirs = [Spec("engine_runs:sums", {}, 0, [bad])]
    heirs.append(Spec("engine_runs:sums", {}, 1, heirs))
    leaving = Spec("engine_runs:leaving", {}, 0)
    missing = Spec("engine_runs:nothing", {}, 0)
    report = run_all([bad, *heirs, leaving, missing, NOISY[0]], tmp_path, Inline())
    assert report.ran == (NOISY[0],)
    assert report.failed[bad].startswith("ValueError: the matrix is not positive definite [")
    assert "engine_runs.py, line" in report.failed[bad]
    assert report.failed[heirs[0]] == "it needs raising seed 0, which failed"
    assert report.failed[heirs[1]] == "it needs sums seed 0, which failed"
    assert report.failed[leaving].startswith("SystemExit: 3")
    assert "has no attribute 'nothing'" in report.failed[missing]
    assert [path.name for path in tmp_path.iterdir()] == [f"{NOISY[0].hash}.parquet"]


def test_values_that_are_not_numbers_are_kept_and_said_so(tmp_path: Path) -> None:
    spec = Spec("engine_runs:not_a_number", {}, 0)
    report = run_all([spec], tmp_path, Inline())
    assert report.noted == {spec: "1 of 4 values are not finite, the first is error mean at 2"}
    assert read_result(result_path(tmp_path, spec), spec)["value"].is_nan().sum() == 1


def test_a_run_whose_worker_died_is_tried_again_and_then_given_up(tmp_path: Path) -> None:
    dying = []
    for times in (1, 2):
        deaths = tmp_path / f"deaths{times}"
        deaths.mkdir()
        dying.append(Spec("engine_runs:dying", {"deaths": str(deaths), "times": times}, 0))
    told: list[Event] = []
    with Workers(2) as pool:
        report = run_all([*dying, *NOISY], tmp_path / "store", pool, told.append)
    assert set(report.ran) == {dying[0], *NOISY}
    assert report.failed == {dying[1]: "its process died (signal 9), 2 times"}
    assert sum("is tried again" in event.text for event in told) == 2
    assert (told[-1].done, told[-1].total) == (6, 6)


def test_an_endless_call_is_ended_and_its_neighbours_are_not() -> None:
    with Workers(2, limit_s=1.0) as pool:
        endless = pool.submit(time.sleep, 3600.0)
        processes = [pool.submit(os.getpid) for _ in range(4)]
        with pytest.raises(TookTooLong, match="not done after 1 s"):
            endless.result()
        assert {own.result() for own in processes} != {os.getpid()}
        assert pool.submit(abs, -2).result() == 2


class Impatient(Inline):
    """An engine that ends the runs of odd seeds."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if args[0].seed % 2:
            future: Future[Any] = Future()
            future.set_exception(TookTooLong("it was not done after 9 s and was ended"))
            return future
        return super().submit(fn, *args, **kwargs)


def test_an_endless_run_is_reported_and_the_rest_goes_on(tmp_path: Path) -> None:
    report = run_all(NOISY, tmp_path, Impatient())
    assert report.ran == (NOISY[0], NOISY[2])
    assert set(report.failed.values()) == {"it was not done after 9 s and was ended"}


class Odd(Exception):
    """One that cannot be made again from its pack."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} and {second}")


def raise_odd(_: int) -> None:
    raise Odd("this", "that")


def unpackable(_: int) -> object:
    return lambda: 0


def end_process(cell: int) -> None:
    os._exit(cell)


def test_each_keeps_the_order_and_raises_what_the_work_raises() -> None:
    assert list(each(abs, range(-5, 0), 2)) == [5, 4, 3, 2, 1]
    with pytest.raises(ZeroDivisionError):
        list(each((1).__truediv__, [1.0, 0], 2)) and list(each(one_over, [1, 0], 2))
    with pytest.raises(EtudeError, match="Odd: this and that"):
        next(each(raise_odd, [1], 1))
    with pytest.raises((AttributeError, EtudeError), match=r"lambda"):
        next(each(unpackable, [1], 1))
    with pytest.raises(WorkerDied, match="exit code 7"):
        next(each(end_process, [7], 1))


def one_over(x: float) -> float:
    return 1 / x


def full(handle: int, data: bytes) -> None:
    os.write(handle, data[:100])
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_ends_it_with_a_sentence_and_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_all(NOISY[:1], tmp_path, Inline())
    monkeypatch.setattr(storage, "_write_all", full)
    with pytest.raises(EtudeError, match="No space left on device"):
        run_all(NOISY, tmp_path, Inline())
    assert [path.name for path in tmp_path.iterdir()] == [f"{NOISY[0].hash}.parquet"]


def test_old_leftovers_go_and_young_ones_may_be_another_shards(tmp_path: Path) -> None:
    old, young = tmp_path / ".partial-1-a.parquet", tmp_path / ".partial-2-b.parquet"
    for path in (old, young):
        path.touch()
    os.utime(old, (0.0, 0.0))
    remove_old_leftovers(tmp_path)
    assert not old.exists()
    assert young.exists()


@pytest.mark.parametrize("shards", [1, 2, 3, 7])
def test_shards_run_everything_once(shards: int) -> None:
    parts = [shard_of([*NOISY, NOISY[1]], own, shards) for own in range(1, shards + 1)]
    assert sorted(spec.seed for part in parts for spec in part) == [0, 1, 2, 3]
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_options() -> None:
    assert shard("3/8") == (3, 8)
    for text in ("0/8", "9/8", "3", "a/b", "1/0", "-1/2"):
        with pytest.raises(UsageError, match="no shard"):
            shard(text)
    with open_engine(3, limit_s=2.0) as engine:
        assert engine.window == 6
    for wrong in ({"workers": 0}, {"limit_s": 0.0}, {"limit_s": float("nan")}):
        with pytest.raises(UsageError):
            open_engine(**wrong)
    for wrong in ({"workers": 2}, {"limit_s": 1.0}):
        with pytest.raises(UsageError, match="not for a cluster"):
            open_engine(cluster="tcp://127.0.0.1:1", **wrong)


def test_the_time_left() -> None:
    assert time_left(Event("", 1, 4), 20.0) == "1 min left"
    assert time_left(Event("", 3, 4), 60.0) == "20 s left"
    assert time_left(Event("", 1, 101), 90.0) == "2 h 30 min left"
    assert time_left(Event("", 0, 4), 60.0) == time_left(Event("", 4, 4), 60.0) == ""
    assert (
        as_line(Event("A1 seed 3: 45 s of CPU", 3, 4), 60.0) == "3 of 4: A1 seed 3: 45 s of CPU (20 s left)"
    )


@pytest.mark.parametrize("terminal", [False, True])
def test_progress_says_every_run(tmp_path: Path, terminal: bool) -> None:
    page = io.StringIO()
    with progress(Console(file=page, force_terminal=terminal, width=100)) as tell:
        run_all(NOISY, tmp_path, Inline(), tell)
    said = page.getvalue()
    assert [said.count(f"noisy seed {seed}: ") for seed in range(4)] == [1, 1, 1, 1]
    if not terminal:
        assert len(said.splitlines()) == 5
        assert "\x1b" not in said


def test_where_a_result_comes_from_is_kept(tmp_path: Path) -> None:
    with Workers(1) as pool:
        run_all(NOISY[:1], tmp_path, pool)
    made = read_made(result_path(tmp_path, NOISY[0]))
    assert made.cpu_s > 0.0
    assert made.versions["python"] == ".".join(map(str, sys.version_info[:3]))
    assert made.machine["cores"] == str(os.cpu_count())


SCRIPT = """
import sys
from pathlib import Path
from etude.cli.entrance import end_on_interrupt
from etude_studies.engines.schedule import run_all
from etude_studies.engines.workers import Workers
from etude_studies.spec import Spec
if __name__ == "__main__":
    if sys.argv[2] == "told":
        end_on_interrupt("Over.")
    folder = Path(sys.argv[1])
    specs = [Spec("engine_runs:lasting", {"pids": str(folder / "pids")}, seed) for seed in range(4)]
    with Workers(2) as pool:
        run_all(specs, folder / "store", pool)
"""


@pytest.mark.parametrize("how", ["killed", "told", "plain"])
def test_no_worker_outlives_the_parent_and_what_is_done_is_kept(tmp_path: Path, how: str) -> None:
    (tmp_path / "pids").mkdir()
    script = tmp_path / "runs.py"
    script.write_text(SCRIPT)
    places = os.pathsep.join(part for part in (str(HERE), os.environ.get("PYTHONPATH")) if part)
    command = [sys.executable, str(script), str(tmp_path), how]
    specs = [Spec("engine_runs:lasting", {"pids": str(tmp_path / "pids")}, seed) for seed in range(4)]
    wanted = [result_path(tmp_path / "store", spec) for spec in specs[:2]]
    parent = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": places}, stderr=subprocess.PIPE)
    try:
        assert soon(lambda: all(path.exists() for path in wanted))
        assert soon(lambda: len(list((tmp_path / "pids").iterdir())) == 2)
        parent.send_signal(signal.SIGKILL if how == "killed" else signal.SIGINT)
        parent.communicate(timeout=60.0)
    finally:
        parent.kill()
        parent.communicate()
    assert parent.returncode == {"killed": -signal.SIGKILL, "told": 130, "plain": -signal.SIGINT}[how]
    pids = [int(path.name) for path in (tmp_path / "pids").iterdir()]
    assert soon(lambda: not any(alive(pid) for pid in pids))
    assert sorted((tmp_path / "store").glob("*")) == sorted(wanted)
    assert run_all(specs[:2], tmp_path / "store", Inline()).kept == tuple(specs[:2])


def soon(holds: Callable[[], bool], within_s: float = 60.0) -> bool:
    deadline = time.monotonic() + within_s
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.02)
    return holds()


def alive(process: int) -> bool:
    """Whether a process runs; one that ended and that nobody has collected does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_a_worker_leaves_numba_alone_once_it_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba refuses to compile when it finds its own variable changed after its threads were launched."""
    monkeypatch.setitem(sys.modules, "numba", sys)
    assert "NUMBA_NUM_THREADS" not in worker._unread()
    monkeypatch.delitem(sys.modules, "numba")
    assert "NUMBA_NUM_THREADS" in worker._unread()
    assert "OPENBLAS_NUM_THREADS" in worker._unread()
