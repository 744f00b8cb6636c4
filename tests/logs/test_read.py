"""From file to cleaned log: formats, time, units; and every bad file refused with exit code 3."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import MOTION, SPEC, columns_of, make_log, write_csv

from etude.errors import DataError
from etude.logs.log import RobotLog
from etude.logs.parquet import parquet_bytes, read_parquet, write_parquet
from etude.logs.read import read_log

LOG = make_log()


def assert_same_motion(log: RobotLog, reference: RobotLog) -> None:
    np.testing.assert_allclose(log.t, reference.t, atol=1e-9)
    np.testing.assert_allclose(log.q, reference.q, rtol=1e-12)
    np.testing.assert_allclose(log.tau, reference.tau, rtol=1e-12)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_reads_exactly(tmp_path: Path, separator: str) -> None:
    log = read_log(write_csv(tmp_path / "run.csv", columns_of(LOG), separator), SPEC)
    assert_same_motion(log, LOG)
    assert log.repairs == ()
    assert log.source == "run.csv"


def test_comments_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    text = "# recorded on Tuesday\n" + path.read_text()
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert_same_motion(read_log(path, SPEC), LOG)


def test_foreign_parquet(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pl.DataFrame(columns_of(LOG, "{joint}.{channel}")).write_parquet(path)
    assert_same_motion(read_log(path, SPEC), LOG)


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
    log = read_log(write_csv(tmp_path / "run.csv", columns), SPEC)
    assert_same_motion(log, LOG)
    assert [s for s in log.repairs if "converted" in s] == (
        [f"Time was converted from {reported} (column {header})."] if reported else []
    )


def test_ros_stamps(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    nanos = np.round(columns.pop("t") * 1e9) + 5e8
    stamps = {"header.stamp.sec": 1.7e9 + nanos // 1e9, "header.stamp.nanosec": nanos % 1e9}
    log = read_log(write_csv(tmp_path / "run.csv", {**stamps, **columns}), SPEC)
    assert_same_motion(log, LOG)


def test_time_that_fits_no_unit(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    columns["t"] = columns["t"] / 1000
    with pytest.raises(DataError, match=r"step 1e-05 fits no unit at 100 Hz.*time column"):
        read_log(write_csv(tmp_path / "run.csv", columns), SPEC)
    columns.pop("t")
    with pytest.raises(DataError, match=r"there is no time column.*timestamp"):
        read_log(write_csv(tmp_path / "run.csv", columns), SPEC)


def test_degrees_are_refused_unless_named_or_asked_for(tmp_path: Path) -> None:
    degrees = replace(LOG, q=np.rad2deg(LOG.q))
    path = write_csv(tmp_path / "run.csv", columns_of(degrees))
    with pytest.raises(DataError, match="look like degrees, not radians") as problem:
        read_log(path, SPEC)
    assert problem.value.exit_code == 3
    asked = read_log(path, SPEC, degrees=True)
    np.testing.assert_allclose(asked.q, LOG.q)
    assert "Angles were converted from degrees, as asked." in asked.repairs
    named = {(f"{k} [deg]" if k.startswith("q") else k): v for k, v in columns_of(degrees).items()}
    log = read_log(write_csv(tmp_path / "named.csv", named), SPEC)
    np.testing.assert_allclose(log.q, LOG.q)
    assert "Channel q was converted from the unit in its headers." in log.repairs


@pytest.mark.parametrize("factor", [180 / np.pi, 1e3])
def test_small_motions_betray_their_unit_by_the_velocity(tmp_path: Path, factor: float) -> None:
    small = make_log(replace(MOTION, amplitudes=(1e-3, 1e-3, 1e-3)), noise=1e-7)
    columns = columns_of(replace(small, q=small.q * factor))
    for j, joint in enumerate(SPEC.names):
        columns[f"qd_{joint}"] = np.gradient(small.q[:, j], small.t)
    with pytest.raises(DataError, match=r"position and velocity disagree by a factor"):
        read_log(write_csv(tmp_path / "run.csv", columns), SPEC)


def test_positions_outside_the_limits(tmp_path: Path) -> None:
    tight = replace(SPEC, axes=(replace(SPEC.axes[0], upper=0.75), *SPEC.axes[1:]))
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    assert any("outside its position limits; kept" in s for s in read_log(path, tight).repairs)
    narrow = replace(SPEC, axes=(replace(SPEC.axes[0], lower=-0.05, upper=0.05), *SPEC.axes[1:]))
    with pytest.raises(DataError, match=r"outside the limits -0.05 to 0.05 rad.*pan_joint.*another robot"):
        read_log(path, narrow)


def test_commands_beyond_the_limit(tmp_path: Path) -> None:
    largest = float(np.abs(LOG.tau[:, 0]).max())
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    low = replace(SPEC, axes=(replace(SPEC.axes[0], command=largest / 1.2), *SPEC.axes[1:]))
    assert any("above its limit" in s for s in read_log(path, low).repairs)
    with pytest.raises(DataError, match=r"the command reaches .*pan_joint.*correct the command limit"):
        read_log(path, replace(low, axes=(replace(low.axes[0], command=largest / 5), *low.axes[1:])))
    milli = write_csv(tmp_path / "milli.csv", columns_of(replace(LOG, tau=LOG.tau * 1e3)))
    with pytest.raises(DataError, match="a thousandth of the unit: convert it to N m"):
        read_log(milli, SPEC)


def test_reordered_columns_give_the_same_log(tmp_path: Path) -> None:
    columns = columns_of(LOG)
    shuffled = {k: columns[k] for k in np.random.default_rng(3).permutation(list(columns))}
    assert_same_motion(read_log(write_csv(tmp_path / "run.csv", shuffled), SPEC), LOG)


CSV = "t,q_pan,q_lift,q_elbow,tau_pan,tau_lift,tau_elbow\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("run.csv", b"", "empty (0 bytes)"),
        ("run.csv", b"  \n\n", "blank"),
        ("run.csv", CSV.encode(), "0 rows"),
        ("run.csv", CSV[:20].encode(), "has no complete line"),
        ("run.csv", b"1,2,3,4\n5,6,7,8\n", "numbers where the column names should be"),
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
        ("run.parquet", parquet_bytes(LOG)[:-200], "cannot be read as Parquet"),
        ("run.bag", b"#ROSBAG V2.0\n", "no reader for '.bag' files"),
    ],
)
def test_bad_files(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError) as problem:
        read_log(path, SPEC)
    assert words in str(problem.value)
    assert name in str(problem.value)
    assert problem.value.next_step
    assert problem.value.exit_code == 3


def test_missing_file(tmp_path: Path) -> None:
    for name in ("gone.csv", "gone.parquet"):
        with pytest.raises(DataError, match="no such log file"):
            read_log(tmp_path / name, SPEC)


def test_cut_csv_loses_its_last_line_only(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    data = path.read_bytes()
    path.write_bytes(data[: data.rfind(b",")])
    log = read_log(path, SPEC)
    np.testing.assert_array_equal(log.t, LOG.t[:-1])
    assert log.repairs == ("The last line has no end (a cut file?) and was dropped.",)


def test_text_in_cells_is_dropped_with_its_row(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(LOG))
    lines = path.read_text().split("\n")
    lines[10] = lines[10].replace(lines[10].split(",")[3], "n/a")
    lines[20] = lines[20].rsplit(",", 2)[0]
    path.write_text("\n".join(lines))
    log = read_log(path, SPEC)
    np.testing.assert_array_equal(log.t, np.delete(LOG.t, [9, 19]))


def test_cleaned_logs_read_back_exactly(tmp_path: Path) -> None:
    samples = MOTION.sample(LOG.t)
    full = replace(
        LOG, qd=samples.qd, q_des=samples.q, qd_des=samples.qd, qdd_des=samples.qdd, tau_ff=LOG.tau / 3,
        q_true=samples.q, repairs=("One, with 'quotes' and ü.", "Two."), source="somewhere/run.csv",
    )  # fmt: skip
    write_parquet(full, tmp_path / "0001.parquet")
    back = read_parquet(tmp_path / "0001.parquet")
    for field in RobotLog.__dataclass_fields__:
        a, b = getattr(full, field), getattr(back, field)
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, field
    assert_same_motion(read_log(tmp_path / "0001.parquet", SPEC), full)


def test_a_cleaned_log_of_another_robot_is_refused(tmp_path: Path) -> None:
    write_parquet(replace(LOG, names=("a", "b", "c")), tmp_path / "0001.parquet")
    with pytest.raises(DataError, match=r"the log has the joints a, b, c, the robot pan_joint"):
        read_log(tmp_path / "0001.parquet", SPEC)


def test_a_foreign_parquet_is_no_cleaned_log(tmp_path: Path) -> None:
    pl.DataFrame({"t": [0.0, 1.0]}).write_parquet(tmp_path / "x.parquet")
    with pytest.raises(DataError, match="not a cleaned log"):
        read_parquet(tmp_path / "x.parquet")
