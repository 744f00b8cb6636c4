"""Logs as files: what is written reads back to the bit, and so do the files of version 0.1."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import FLIGHT_CHANNELS, joint_channels

from etude.errors import DataError
from etude.logs import read_log_file, write_log
from etude.logs.readers.log_file import is_log_file, log_bytes
from etude.types import Channel, Log

RNG = np.random.default_rng(0)
CHANNELS = (*joint_channels(("lift", "elbow")), Channel("volts", ("",), ("V",), "aside", nominal=(12.0,)))


def full_log(channels: tuple[Channel, ...] = CHANNELS) -> Log:
    values = {c.name: RNG.standard_normal((30, len(c.parts))) for c in channels}
    repairs = ("One, with 'quotes' and ü.", "Two.")
    return Log(np.arange(30) / 7 - 1.0, {c.name: c for c in channels}, values, "somewhere/run.csv", repairs)


def assert_equal(one: Log, other: Log) -> None:
    assert (one.source, one.repairs) == (other.source, other.repairs)
    assert list(one.channels.items()) == list(other.channels.items())
    np.testing.assert_array_equal(one.t, other.t)
    for name in one.values:
        np.testing.assert_array_equal(one[name], other[name])
        assert other[name].flags.c_contiguous


@pytest.mark.parametrize("channels", [CHANNELS, FLIGHT_CHANNELS, CHANNELS[:1]])
def test_every_field_of_a_log_reads_back(channels: tuple[Channel, ...], tmp_path: Path) -> None:
    log = full_log(channels)
    log.values[channels[0].name][3] = [np.nan, *[-0.0] * (len(channels[0].parts) - 1)]
    write_log(tmp_path / "0001.parquet", log)
    back = read_log_file(tmp_path / "0001.parquet")
    assert_equal(log, back)
    assert log_bytes(back) == log_bytes(log)
    assert is_log_file(tmp_path / "0001.parquet")


def test_columns_are_channel_and_part(tmp_path: Path) -> None:
    write_log(tmp_path / "0001.parquet", full_log())
    frame = pl.read_parquet(tmp_path / "0001.parquet")
    assert frame.columns[:3] == ["t", "q_lift", "q_elbow"]
    assert "command_lift" in frame.columns
    assert frame.columns[-1] == "volts"


def test_signals_that_would_share_a_column_are_refused() -> None:
    twins = (Channel("q", ("des_x",), ("rad",)), Channel("q_des", ("x",), ("rad",)))
    with pytest.raises(DataError, match="both named 'q_des_x'"):
        log_bytes(full_log(twins))


def test_what_is_no_cleaned_log_is_refused(tmp_path: Path) -> None:
    pl.DataFrame({"t": [0.0, 1.0]}).write_parquet(tmp_path / "x.parquet")
    with pytest.raises(DataError, match="not a cleaned log"):
        read_log_file(tmp_path / "x.parquet")
    assert not is_log_file(tmp_path / "x.parquet")
    assert not is_log_file(tmp_path / "gone.parquet")
    (tmp_path / "cut.parquet").write_bytes(log_bytes(full_log())[:200])
    with pytest.raises(DataError, match="cannot be read as Parquet"):
        read_log_file(tmp_path / "cut.parquet")
    with pytest.raises(DataError):
        read_log_file(tmp_path / "gone.parquet")


@pytest.mark.parametrize("change", ["missing", "text", "metadata"])
def test_a_changed_file_is_refused(change: str, tmp_path: Path) -> None:
    log = full_log()
    write_log(tmp_path / "0001.parquet", log)
    frame = pl.read_parquet(tmp_path / "0001.parquet")
    metadata = {"etude.log": pl.read_parquet_metadata(tmp_path / "0001.parquet")["etude.log"]}
    if change == "missing":
        frame = frame.drop("q_lift")
    elif change == "text":
        frame = frame.with_columns(pl.col("q_lift").cast(pl.String))
    else:
        metadata = {"etude.log": "[1, 2"}
    frame.write_parquet(tmp_path / "0001.parquet", metadata=metadata)
    with pytest.raises(DataError, match="changed or damaged"):
        read_log_file(tmp_path / "0001.parquet")


def test_more_channels_do_not_change_the_others(tmp_path: Path) -> None:
    log = full_log()
    write_log(tmp_path / "0001.parquet", replace(log, repairs=()).put(CHANNELS[0], log["q"]))
    np.testing.assert_array_equal(read_log_file(tmp_path / "0001.parquet")["qd"], log["qd"])
