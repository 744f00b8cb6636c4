"""From file to cleaned log: formats, time, units; and every bad file refused with exit code 3."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, MOTION, RATE, columns_of, make_log, with_values, write_csv

from etude.errors import DataError
from etude.logs import read_log, write_log
from etude.logs.columns.units import Limits
from etude.logs.readers.log_file import log_bytes
from etude.logs.readers.registry import with_rest_reported
from etude.types import Log

LOG = make_log()


def read(path: Path, limits: Limits = LIMITS, degrees: bool = False) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=limits, degrees=degrees)


def limits_of_pan(channel: str, lower: float, upper: float) -> Limits:
    """The robot's limits, but for those of its first joint in that channel."""
    low, high = (values.copy() for values in LIMITS[channel])
    low[0], high[0] = lower, upper
    return {**LIMITS, channel: (low, high)}


def assert_same_motion(log: Log, reference: Log) -> None:
    np.testing.assert_allclose(log.t, reference.t, atol=1e-9)
    np.testing.assert_allclose(log["q"], reference["q"], rtol=1e-12)
    np.testing.assert_allclose(log["command"], reference["command"], rtol=1e-12)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_reads_exactly(tmp_path: Path, separator: str) -> None:
    log = read(write_csv(tmp_path / "run.csv", columns_of(LOG), separator))
    assert_same_motion(log, LOG)
    assert log.repairs == ()
    assert log.source == "run.csv"


def test_comments_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    text = "# recorded on Tuesday\n" + path.read_text()
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert_same_motion(read(path), LOG)


def test_foreign_parquet(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pl.DataFrame(columns_of(LOG, "{joint}.{channel}")).write_parquet(path)
    assert_same_motion(read(path), LOG)


@pytest.mark.parametrize(
    ("header", "factor", "reported"),
    [
        ("t", 1e3, "ms"),
        ("timestamp", 1e9, "ns"),
        ("time_us", 1e6, "us"),
        ("time [ms]", 1e3, "ms"),
        ("Time (s)", 1.0, ""),
        ("__time", 1.0, ""),
    ],
)
def test_time_units(tmp_path: Path, header: str, factor: float, reported: str) -> None:
    columns = columns_of(LOG)
    columns = {header: columns.pop("t") * factor, **columns}
    log = read(write_csv(tmp_path / "run.csv", columns))
    assert_same_motion(log, LOG)
    assert [s for s in log.repairs if "converted" in s] == (
        [f"Time was converted from {reported} (column {header})."] if reported else []
    )


def test_ros_stamps(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    nanos = np.round(columns.pop("t") * 1e9) + 5e8
    stamps = {"header.stamp.sec": 1.7e9 + nanos // 1e9, "header.stamp.nanosec": nanos % 1e9}
    log = read(write_csv(tmp_path / "run.csv", {**stamps, **columns}))
    assert_same_motion(log, LOG)


def test_time_that_fits_no_unit(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    columns["t"] = columns["t"] / 1000
    with pytest.raises(DataError, match=r"step 1e-05 fits no unit at 100 Hz.*time column"):
        read(write_csv(tmp_path / "run.csv", columns))
    columns.pop("t")
    with pytest.raises(DataError, match=r"there is no time column.*timestamp"):
        read(write_csv(tmp_path / "run.csv", columns))


def test_degrees_are_refused_unless_named_or_asked_for(tmp_path: Path) -> None:
    degrees = with_values(LOG, q=np.rad2deg(LOG["q"]))
    path = write_csv(tmp_path / "run.csv", columns_of(degrees))
    with pytest.raises(DataError, match="look like degrees, not radians") as problem:
        read(path)
    assert problem.value.exit_code == 3
    asked = read(path, degrees=True)
    np.testing.assert_allclose(asked["q"], LOG["q"])
    assert "Angles were converted from degrees, as asked." in asked.repairs
    named = {(f"{k} [deg]" if k.startswith("q") else k): v for k, v in columns_of(degrees).items()}
    log = read(write_csv(tmp_path / "named.csv", named))
    np.testing.assert_allclose(log["q"], LOG["q"])
    assert "Channel q was converted from deg, as stated." in log.repairs


@pytest.mark.parametrize("factor", [180 / np.pi, 1e3])
def test_small_motions_betray_their_unit_by_the_velocity(tmp_path: Path, factor: float) -> None:
    small = make_log(replace(MOTION, amplitudes=(1e-3, 1e-3, 1e-3)), noise=1e-7)
    columns = columns_of(with_values(small, q=small["q"] * factor))
    for j, joint in enumerate(JOINTS):
        columns[f"qd_{joint}"] = np.gradient(small["q"][:, j], small.t)
    with pytest.raises(DataError, match=r"q and qd disagree by a factor"):
        read(write_csv(tmp_path / "run.csv", columns))


def test_positions_outside_the_limits(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    tight = read(path, limits_of_pan("q", -1.0, 0.75))
    assert any("outside its position limits; kept" in s for s in tight.repairs)
    with pytest.raises(DataError, match=r"outside the limits -0.05 to 0.05 rad.*pan_joint.*unit and gear"):
        read(path, limits_of_pan("q", -0.05, 0.05))


def test_the_command_named_is_the_one_outside_not_the_largest(tmp_path: Path) -> None:
    """Of a motor that is off at -0.1 of full scale, and otherwise below 1."""
    command = LOG["command"].copy()
    command[:, 0] = np.where(np.arange(len(LOG)) < 20, -0.1, 0.2 + 0.7 * np.abs(np.sin(LOG.t)))
    path = write_csv(tmp_path / "run.csv", columns_of(with_values(LOG, command=command)))
    found = read(path, limits_of_pan("command", 0.0, 1.0))
    assert any("pan_joint reached -0.1 N m, outside its limit 0 to 1 N m" in s for s in found.repairs)


def test_commands_beyond_the_limit(tmp_path: Path) -> None:
    largest = float(np.abs(LOG["command"][:, 0]).max())
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    low = read(path, limits_of_pan("command", -largest / 1.2, largest / 1.2))
    assert any("outside its limit" in s for s in low.repairs)
    with pytest.raises(DataError, match=r"the command of pan_joint reaches .*correct the limit"):
        read(path, limits_of_pan("command", -largest / 5, largest / 5))
    milli = with_values(LOG, command=LOG["command"] * 1e3)
    with pytest.raises(DataError, match="a thousandth of the unit: convert it to N m"):
        read(write_csv(tmp_path / "milli.csv", columns_of(milli)))


def test_reordered_columns_give_the_same_log(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    shuffled = {k: columns[k] for k in np.random.default_rng(3).permutation(list(columns))}
    assert_same_motion(read(write_csv(tmp_path / "run.csv", shuffled)), LOG)


CSV = "t,q_pan,q_lift,q_elbow,tau_pan,tau_lift,tau_elbow\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("run.csv", b"", "empty (0 bytes)"),
        ("log07", b"", "empty (0 bytes)"),
        ("run.csv", b"  \n\n", "blank"),
        ("run.csv", CSV.encode(), "0 rows"),
        ("run.csv", CSV[:20].encode(), "has no complete line"),
        ("run.csv", b"1,2,3,4\n5,6,7,8\n", "the file has no header, only 4 columns of numbers"),
        ("run.csv", bytes(range(256)) * 40, "binary file"),
        ("run.csv", b"a,b\0,c\n" * 9, "binary file"),
        ("run.csv", b"PAR1" + bytes(range(256)), "this is a Parquet file"),
        ("run.csv", (CSV + "x,x,x,x,x,x,x\n" * 60).encode(), "no numbers"),
        (
            "run.csv",
            CSV.replace("q_lift", "q_pan").encode() + b"1,2,3,4,5,6,7\n" * 60,
            "'q_pan' appears twice",
        ),
        ("run.parquet", b"", "empty (0 bytes)"),
        ("run.parquet", bytes(range(256)) * 40, "cannot be read as Parquet"),
        ("run.parquet", (CSV + "0,1,1,1,1,1,1\n" * 60).encode(), "cannot be read as Parquet"),
        ("run.parquet", log_bytes(LOG)[:-200], "cannot be read as Parquet"),
        ("run.bag", b"#ROSBAG V2.0\n", "no reader for '.bag' files"),
        ("run.dat", bytes(range(256)) * 40, "no reader for '.dat' files"),
        ("run.log", b"1 2 3 4\n5 6 7 8\n", "no header, only 4 columns of numbers"),
        ("run.csv", b"4000,mag,0.19,-0.08\n4000,baro,487.7\n" * 60, "the header line holds a number"),
    ],
)
def test_bad_files(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError) as problem:
        read(path)
    assert words in str(problem.value)
    assert name in str(problem.value)
    assert problem.value.next_step
    assert problem.value.exit_code == 3


def test_missing_file(tmp_path: Path) -> None:
    for name in ("gone.csv", "gone.parquet"):
        with pytest.raises(DataError, match="no such log file"):
            read(tmp_path / name)


def test_cut_csv_loses_its_last_line_only(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    data = path.read_bytes()
    path.write_bytes(data[: data.rfind(b",")])
    log = read(path)
    np.testing.assert_array_equal(log.t, LOG.t[:-1])
    said = "The log was cut in the middle of a line, which was dropped."
    assert log.repairs == (f"{said} {np.ptp(log.t):.3g} s of it remain.",)


@pytest.mark.parametrize("name", ["run.dat", "run.log", "run.asc", "run.out"])
def test_tables_by_another_name(name: str, tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv", columns_of(LOG)).rename(tmp_path / name)
    assert_same_motion(read(tmp_path / name), LOG)


@pytest.mark.parametrize("separator", [",", ";", " "])
def test_a_first_row_that_lacks_cells_is_a_row_like_others(separator: str, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    lines = path.read_text().replace(",", separator).splitlines()
    lines[1] = lines[1].rpartition(separator)[0]
    path.write_text("\n".join(lines) + "\n")
    log = read(path)
    np.testing.assert_array_equal(log.t, LOG.t[1:] - LOG.t[1])
    assert any(said.startswith("Dropped 1 row with empty") for said in log.repairs)


def left_of(t: list[float]) -> str:
    """What is said of the rest of a log with these times that was cut."""
    log = Log(np.array(t), {}, {}, "run.csv", ("The log was cut.",))
    return with_rest_reported(log).repairs[0].removeprefix("The log was cut.").strip()


def test_what_is_left_is_told_in_seconds_whatever_single_stamps_say() -> None:
    t = np.arange(0.0, 8.0, 0.01)
    assert left_of([*t]) == "7.99 s of it remain."
    for wild in (2.68e154, -1.79e308, 1e9):
        stray = t.copy()
        stray[[100, 500]] = wild, -wild
        assert left_of([*stray]) in ("7.95 s of it remain.", "7.96 s of it remain.")
    assert left_of([*(1e150 * t)]) == "Its times do not show how much remains."
    assert left_of([*t[:300], *(t[300:] + 2.0)]) == "9.99 s of it remain."  # a pause is part of it
    assert left_of([1.0]) == left_of([1.0, 1.0]) == ""


def test_a_last_line_without_an_end_may_be_whole(tmp_path: Path) -> None:
    """Its last number may lack digits, so that it goes; that more is missing nobody can tell."""
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    path.write_bytes(path.read_bytes().rstrip())
    log = read(path)
    np.testing.assert_array_equal(log.t, LOG.t[:-1])
    assert log.repairs == ("The last line is incomplete (a truncated file?) and was dropped.",)


def test_text_in_cells_is_dropped_with_its_row(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    lines = path.read_text().split("\n")
    lines[10] = lines[10].replace(lines[10].split(",")[3], "n/a")
    lines[20] = lines[20].rsplit(",", 2)[0]
    path.write_text("\n".join(lines))
    log = read(path)
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [9, 19]))


def test_a_stored_log_is_read_with_the_robots_channels(tmp_path: Path) -> None:
    write_log(tmp_path / "0001.parquet", LOG.take(np.arange(2000)))
    log = read(tmp_path / "0001.parquet")
    assert_same_motion(log, LOG)
    assert log.channels["q"] is next(c for c in CHANNELS if c.name == "q")
    order = (2, 0, 1)
    moved = {n: replace(c, parts=tuple(c.parts[i] for i in order)) for n, c in LOG.channels.items()}
    other = replace(LOG, channels=moved, values={n: v[:, order] for n, v in LOG.values.items()})
    write_log(tmp_path / "0002.parquet", other)
    assert_same_motion(read(tmp_path / "0002.parquet"), LOG)


def test_a_stored_log_of_another_robot_is_refused(tmp_path: Path) -> None:
    channels = {n: replace(c, parts=("a", "b", "c")) for n, c in LOG.channels.items()}
    write_log(tmp_path / "0001.parquet", replace(LOG, channels=channels))
    with pytest.raises(DataError, match=r"the log has a, b, c in its channel q, but the robot has pan_joint"):
        read(tmp_path / "0001.parquet")
    write_log(tmp_path / "0002.parquet", LOG.without("command"))
    with pytest.raises(DataError, match="the log has no channel command"):
        read(tmp_path / "0002.parquet")


def test_the_recorded_clock_may_be_kept(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(replace(LOG, t=LOG.t + 5.0)))
    assert read(path).t[0] == 0.0
    assert read_log(path, CHANNELS, rate=RATE, own_clock=True).t[0] == 5.0


def test_a_folder_in_place_of_a_file(tmp_path: Path) -> None:
    for name in ("run.csv", "run.parquet"):
        (tmp_path / name).mkdir()
        with pytest.raises(DataError, match="this is a folder"):
            read(tmp_path / name)
    (tmp_path / "plain").write_text("x")
    with pytest.raises(DataError, match="no such log file"):
        read(tmp_path / "plain" / "run.csv")
    with pytest.raises(DataError, match="cannot be read"):
        read(tmp_path / "nul\0.csv")


def test_a_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    for name in ("run.csv", "run.parquet"):
        with pytest.raises(DataError, match="may not be read"):
            read(tmp_path / name)


def test_a_wild_command_in_a_single_row_is_dropped(tmp_path: Path) -> None:
    command = LOG["command"].copy()
    command[77, 1] = 1e5
    log = read(write_csv(tmp_path / "run.csv", columns_of(with_values(LOG, command=command))))
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, 77))
    assert log.repairs == ("Dropped 1 row with a single outlier command.",)


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("run.csv.gz", "Unpack it"),
        ("run.xlsx", "as CSV"),
        ("run.bag", "rosbags-convert"),
        ("run.npz", "CSV or Parquet"),
    ],
)
def test_what_nobody_reads_has_a_next_step(name: str, step: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"\x1f\x8b something")
    with pytest.raises(DataError, match="no reader") as refused:
        read_log(path, CHANNELS, rate=RATE)
    assert step in refused.value.next_step
