"""Readers of other packages: asked about unknown files, joined by time, and never trusted to behave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude import plugins
from etude.errors import DataError
from etude.logs import raw_log, read_log
from etude.types import Channel, Log

LOG = make_log()


def topic(word: str, channel: str, every: int) -> Log:
    """A topic of one channel at every so many of the log's times, which it knows itself."""
    part = LOG.take(slice(0, None, every))
    columns = {f"{word}_{j}": part[channel][:, k] for k, j in enumerate(JOINTS)}
    raw = raw_log(columns, "run.bag")
    return Log(part.t, raw.channels, raw.values, "run.bag")


class Bag:
    """Two topics at times of their own."""

    def __call__(self, path: Path, topics: object = ()) -> dict[str, Log]:
        return {"joint_states": topic("position", "q", 1), "drives": topic("effort", "command", 4)}

    def recognises(self, path: Path, head: bytes) -> bool:
        return head.startswith(b"#BAG")


class Broken(Bag):
    def __call__(self, path: Path, topics: object = ()) -> dict[str, Log]:
        raise RuntimeError("no such chunk")


class Deaf(Bag):
    def recognises(self, path: Path, head: bytes) -> bool:
        raise RuntimeError("not today")


@pytest.fixture(params=["good", "broken"])
def brought(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    readers = {"deaf": Deaf(), "bag": Bag() if request.param == "good" else Broken()}
    load = plugins.load
    monkeypatch.setattr(plugins, "names", lambda group: ("csv", "parquet", "gone", *readers))
    monkeypatch.setattr(
        plugins, "load", lambda group, name: readers[name] if name in readers else load(group, name)
    )
    return str(request.param)


def test_a_reader_of_another_package(brought: str, tmp_path: Path) -> None:
    path = tmp_path / "run.bag"
    path.write_bytes(b"#BAG V2.0")
    if brought == "broken":
        with pytest.raises(DataError, match=r"the reader 'bag' failed .*no such chunk"):
            read_log(path, CHANNELS, rate=RATE, limits=LIMITS)
        return
    log = read_log(path, CHANNELS, rate=RATE, limits=LIMITS)
    assert any("joined at the times of joint_states" in sentence for sentence in log.repairs)
    np.testing.assert_array_equal(log["q"], LOG["q"][: len(log)])  # the last rows lack a command
    np.testing.assert_allclose(log["command"][::4], LOG["command"][: len(log) : 4], rtol=1e-12)
    assert len(LOG) - len(log) < 4


def test_files_that_nobody_takes(brought: str, tmp_path: Path) -> None:
    path = tmp_path / "run.xyz"
    path.write_bytes(b"something")
    with pytest.raises(DataError, match=r"no reader for '.xyz' files.*bag"):
        read_log(path, CHANNELS, rate=RATE)


def test_a_reader_without_rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,q\n0,1\n")
    for found, words in (({}, "holds no log"), ({"": raw_log({}, "x")}, "0 rows")):
        monkeypatch.setattr(plugins, "load", lambda group, name, found=found: lambda path, topics: found)
        with pytest.raises(DataError, match=words):
            read_log(path, CHANNELS, rate=RATE)


def test_channels_of_a_raw_log_are_its_columns() -> None:
    raw = raw_log({"a b [deg]": np.arange(3.0)}, "x")
    assert raw.channels == {"a b [deg]": Channel("a b [deg]", ("",), ("",), "aside")}
