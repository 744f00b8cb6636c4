"""What is promised of `storage`: after a stop at any system call, the old file or the whole new one."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude import storage
from etude.errors import EtudeError, UsageError

CALLS = ("open", "write", "fsync", "replace", "ftruncate")


class Stop(BaseException):
    """Stands for the process being killed: nothing may catch it and go on."""


def fail_at(patch: pytest.MonkeyPatch, step: int, error: Callable[[], BaseException]) -> list[int]:
    """Makes the `step`-th system call of storage raise; returns a one-element counter of calls seen."""
    seen = [0]

    def wrap(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            seen[0] += 1
            if seen[0] == step:
                raise error()
            return real(*args, **kwargs)

        return call

    for name in CALLS:
        patch.setattr(storage.os, name, wrap(getattr(os, name)))
    return seen


def full() -> BaseException:
    return OSError(errno.ENOSPC, "No space left on device")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a" / "file"
    storage.write_atomic(path, b"old")
    steps = 0
    for step in range(1, 20):
        with pytest.MonkeyPatch.context() as patch:
            seen = fail_at(patch, step, full)
            with contextlib.suppress(EtudeError):
                storage.write_atomic(path, b"new" * 1000)
            steps = seen[0]
        assert path.read_bytes() in (b"old", b"new" * 1000)
        assert [p.name for p in path.parent.iterdir()] == ["file"]
        if steps < step:
            break
        if path.read_bytes() != b"old":
            storage.write_atomic(path, b"old")
    assert steps >= 5


def test_a_failed_folder_leaves_the_old_one_and_nothing_else(tmp_path: Path) -> None:
    old, new = ({"mark": b"", "a/b": b"x" * n, "c": b""} for n in (1, 2))
    for step in range(1, 40):
        storage.write_folder(tmp_path / "out", old, "mark")
        with pytest.MonkeyPatch.context() as patch:
            seen = fail_at(patch, step, full)
            with contextlib.suppress(EtudeError):
                storage.write_folder(tmp_path / "out", new, "mark")
            steps = seen[0]
        assert [p.name for p in tmp_path.iterdir() if not p.name.startswith(".partial-")] == ["out"]
        assert (tmp_path / "out" / "a" / "b").read_bytes() in (b"x", b"xx")
        assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["a", "c", "mark"]
        if steps < step:
            break
    assert steps >= 8
    storage.write_folder(tmp_path / "out", old, "mark")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("error", [full, Stop], ids=["disk full", "killed"])
def test_a_failed_append_loses_no_earlier_line(tmp_path: Path, error: Callable[[], BaseException]) -> None:
    path = tmp_path / "journal"
    storage.append_line(path, "one")
    for step in range(1, 8):
        before = storage.read_lines(path)
        with pytest.MonkeyPatch.context() as patch:
            fail_at(patch, step, error)
            try:
                storage.append_line(path, f"step {step}")
            except (EtudeError, Stop):
                assert storage.read_lines(path) in (before, [*before, f"step {step}"])
            else:
                assert storage.read_lines(path) == [*before, f"step {step}"]


def test_a_full_disk_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fail_at(monkeypatch, 2, full)
    with pytest.raises(EtudeError, match=r"No space left on device .*file.* No stored data was lost"):
        storage.write_atomic(tmp_path / "file", b"data")


def test_a_short_write_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.write
    monkeypatch.setattr(storage.os, "write", lambda handle, data: real(handle, data[:7]))
    storage.write_atomic(tmp_path / "f", bytes(range(100)))
    storage.append_line(tmp_path / "j", "x" * 50)
    assert (tmp_path / "f").read_bytes() == bytes(range(100))
    assert storage.read_lines(tmp_path / "j") == ["x" * 50]


@given(
    lines=st.lists(st.text(st.characters(codec="ascii", min_codepoint=32)), max_size=5),
    cut=st.integers(0, 200),
)
def test_a_torn_line_is_dropped_and_healed(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str], cut: int
) -> None:
    path = tmp_path_factory.mktemp("torn") / "journal"
    path.touch()
    for line in lines:
        storage.append_line(path, line)
    data = path.read_bytes()[:cut]
    path.write_bytes(data)
    whole = data.decode().split("\n")[:-1]
    assert storage.read_lines(path) == whole
    storage.append_line(path, "next")
    assert storage.read_lines(path) == [*whole, "next"]


def test_a_long_torn_line_is_healed(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(b"whole\n" + b"x" * 200_000)
    storage.append_line(path, "next")
    assert storage.read_lines(path) == ["whole", "next"]


def test_a_line_break_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="line break"):
        storage.append_line(tmp_path / "j", "a\nb")


def test_the_second_writer_is_told(tmp_path: Path) -> None:
    with (
        storage.writer_lock(tmp_path),
        pytest.raises(UsageError, match="another process is writing"),
        storage.writer_lock(tmp_path, 0.0),
    ):
        pass
    with storage.writer_lock(tmp_path, 0.0):
        pass


def test_the_writer_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    left = tmp_path / "runs" / f"{storage.TEMPORARY_PREFIX}1-0001.parquet"
    left.parent.mkdir()
    left.write_bytes(b"half")
    with storage.writer_lock(tmp_path):
        assert not left.exists()


def recorded(patch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Every call of storage that touches the disk, with the name of the file or folder, in order."""
    calls: list[tuple[str, str]] = []
    names: dict[int, str] = {}
    real = {name: getattr(os, name) for name in (*CALLS, "close")}

    def opened(path: Any, *args: Any) -> int:
        handle: int = real["open"](path, *args)
        names[handle] = Path(path).name
        return handle

    def on_handle(name: str) -> Callable[..., Any]:
        def call(handle: int, *args: Any) -> Any:
            calls.append((name, names[handle]))
            return real[name](handle, *args)

        return call

    def replaced(source: Any, target: Any) -> None:
        calls.append(("replace", Path(target).name))
        real["replace"](source, target)

    patch.setattr(storage.os, "open", opened)
    patch.setattr(storage.os, "replace", replaced)
    for name in ("write", "fsync"):
        patch.setattr(storage.os, name, on_handle(name))
    return calls


def test_a_file_is_on_the_disk_before_its_name_and_its_name_before_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    calls = recorded(monkeypatch)
    storage.write_atomic(folder / "file", b"data")
    temporary = f"{storage.TEMPORARY_PREFIX}{os.getpid()}-file"
    assert calls == [
        ("write", temporary),
        ("fsync", temporary),
        ("replace", "file"),
        ("fsync", "folder"),
    ]


def test_a_line_is_on_the_disk_before_success(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch)
    storage.append_line(tmp_path / "journal", "one")
    written = [("write", "journal"), ("fsync", "journal")]
    # a new file is lost with its folder's entry
    assert calls == [*written, ("fsync", tmp_path.name)]
    calls.clear()
    storage.append_line(tmp_path / "journal", "two")
    assert calls == written


def test_files_of_the_user_in_a_replaced_folder_stay(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    storage.write_folder(folder, {"mark": b"1", "a.c": b"old", "sub/b.c": b"old"}, "mark")
    elsewhere.write_bytes(b"theirs")
    (folder / "main.c").write_bytes(b"mine")
    (folder / "build").mkdir()
    (folder / "build" / "out.o").write_bytes(b"mine")
    (folder / "link").symlink_to(elsewhere)
    storage.write_folder(folder, {"mark": b"2", "a.c": b"new"}, "mark", ("a.c", "sub/b.c"))
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert found == {
        "mark": b"2",
        "a.c": b"new",
        "main.c": b"mine",
        "build/out.o": b"mine",
        "link": b"theirs",
    }
    assert (folder / "link").is_symlink()
