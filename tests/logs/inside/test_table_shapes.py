"""Tables in the shapes that people have: the same motion, however it was exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude.errors import DataError
from etude.logs import read_log, read_raw
from etude.logs.readers.csv_tables import BLOCK
from etude.types import Log

LOG = make_log()
ROWS = len(LOG)
EPOCH = 1_700_000_000


def read(path: Path) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS)


def assert_right(log: Log, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(log.t, LOG.t, atol=1e-6)
    np.testing.assert_allclose(log["q"], LOG["q"], atol=tolerance)
    np.testing.assert_allclose(log["command"], LOG["command"], atol=tolerance)


def plain(pattern: str = "{}_{}", words: tuple[str, str] = ("q", "tau")) -> dict[str, np.ndarray]:
    """Header -> values; the pattern takes word and joint."""
    pairs = zip(words, (LOG["q"], LOG["command"]), strict=True)
    return {pattern.format(w, j): own[:, k] for w, own in pairs for k, j in enumerate(JOINTS)}


def text(table: dict[str, np.ndarray], separator: str = ",", decimal: str = ".") -> str:
    rows = zip(*table.values(), strict=True)
    lines = [separator.join(str(value).replace(".", decimal) for value in row) for row in rows]
    return "\n".join([separator.join(table), *lines]) + "\n"


@pytest.mark.parametrize("space", ["", "/arm"])
def test_plotjuggler(space: str, tmp_path: Path) -> None:
    table = {"__time": EPOCH + LOG.t, f"{space}/joint_states/header/stamp": EPOCH + LOG.t}
    table |= {
        f"{space}/joint_states/{j}/{word}": LOG[channel][:, k]
        for k, j in enumerate(JOINTS)
        for word, channel in (("position", "q"), ("effort", "command"))
    }
    path = tmp_path / "run.csv"
    path.write_text(text(table))
    assert_right(read(path))


def test_plotjuggler_with_two_topics_has_a_row_for_each_message(tmp_path: Path) -> None:
    """Half of the rows hold positions, the other half, between them, efforts."""
    q = pl.DataFrame({"__time": LOG.t, **plain("/joint_states/{1}/{0}", ("position", "x"))}).select(
        "__time", "^.*position$"
    )
    u = pl.DataFrame({"__time": LOG.t + 0.004, **plain("/drives/{1}/{0}", ("x", "effort"))}).select(
        "__time", "^.*effort$"
    )
    both = pl.concat([q, u], how="diagonal").sort("__time")
    renamed = both.rename({name: name.replace("/drives", "") for name in both.columns})
    renamed.write_csv(tmp_path / "run.csv")
    log = read(tmp_path / "run.csv")
    np.testing.assert_array_equal(log["q"], LOG["q"][1 : 1 + len(log)])
    between = np.stack([np.interp(log.t + 0.01, LOG.t + 0.004, u) for u in LOG["command"].T], axis=1)
    np.testing.assert_allclose(log["command"], between, atol=1e-9)
    assert any("joined by time" in sentence for sentence in log.repairs)


def test_a_few_empty_cells_are_no_topics(tmp_path: Path) -> None:
    table = {"t": LOG.t, **plain()}
    table["q_pan_joint"] = np.where(np.arange(ROWS) % 50 == 7, np.nan, table["q_pan_joint"])
    path = tmp_path / "run.csv"
    path.write_text(text(table))
    assert len(read(path)) == ROWS - 40


def echoed(arrays: tuple[str, ...], names: tuple[str, ...] = JOINTS) -> str:
    own = {"position": LOG["q"], "velocity": np.gradient(LOG["q"], 0.01, axis=0), "effort": LOG["command"]}
    lines = []
    for row, t in enumerate(LOG.t):
        order = np.roll((2, 0, 1), row % 3)
        ns = round(1e9 * t)
        cells = [EPOCH + ns // 10**9, ns % 10**9, "base", *(names[k] for k in order)]
        lines.append(",".join(map(str, [*cells, *(own[a][row, k] for a in arrays for k in order)])))
    return "\n".join(lines) + "\n"


def test_ros2_topic_echo(tmp_path: Path) -> None:
    """Without a header, names in every row, in an order that changes."""
    path = tmp_path / "run.csv"
    path.write_text(echoed(("position", "velocity", "effort")))
    log = read(path)
    assert_right(log)
    assert any("ros2 topic echo --csv" in sentence for sentence in log.repairs)


def test_ros2_topic_echo_of_messages_without_names(tmp_path: Path) -> None:
    """Three arrays of as many values as the robot has joints, in its order, which is said."""
    stamps = [(int(t), round(1e9 * (t % 1.0))) for t in LOG.t]
    rows = np.hstack([LOG["q"], np.gradient(LOG["q"], LOG.t, axis=0), LOG["command"]])
    lines = [
        f"{s},{n},," + ",".join(map(str, row)) for (s, n), row in zip(stamps, rows.tolist(), strict=True)
    ]
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    log = read(tmp_path / "run.csv")
    assert_right(log)
    assert any("in this order" in sentence for sentence in log.repairs)
    (tmp_path / "two.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines) + "\n")
    with pytest.raises(DataError, match="without names of joints has 8 values"):
        read(tmp_path / "two.csv")


def test_ros2_topic_echo_with_two_values_a_joint_is_asked_about(tmp_path: Path) -> None:
    """Position and velocity, or position and effort? Its header line is in the message."""
    path = tmp_path / "run.csv"
    path.write_text(echoed(("position", "effort")))
    with pytest.raises(DataError, match="two values for each joint") as refused:
        read(path)
    header = refused.value.next_step.partition(": ")[2]
    path.write_text(f"{header}\n{path.read_text()}")
    assert_right(read(path))


def test_ros2_topic_echo_of_positions_lacks_a_command(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(echoed(("position",)))
    with pytest.raises(DataError, match="no column for channel 'command'"):
        read(path)


@pytest.mark.parametrize("form", ["{}", "array('d', {})", "({})"])
def test_a_row_for_each_message(form: str, tmp_path: Path) -> None:
    """Names, positions and efforts as lists in cells, as scripts write them."""

    def cell(values: object) -> str:
        inner = str(values)
        return form.format(inner if form != "({})" else inner.strip("[]"))

    frame = pl.DataFrame(
        {
            "header.stamp.sec": [EPOCH + int(t) for t in LOG.t],
            "header.stamp.nanosec": [round(1e9 * (t - int(t))) for t in LOG.t],
            "name": [str(list(JOINTS))] * ROWS,
            "position": [cell(row) for row in LOG["q"].tolist()],
            "effort": [cell(row) for row in LOG["command"].tolist()],
        }
    )
    frame.write_csv(tmp_path / "run.csv")
    assert_right(read(tmp_path / "run.csv"))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text({"t": LOG.t, **plain()}, separator, ","))
    log = read(path)
    assert_right(log)
    assert "Numbers were read with a decimal comma." in log.repairs


def test_semicolons_with_points(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text({"t": LOG.t, **plain()}, ";"))
    assert_right(read(path))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(encoding: str, end: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    mark = "\ufeff" if encoding.endswith("e") else ""
    content = mark + text({"t": LOG.t, **plain()}).replace("\n", end)
    path.write_bytes(content.encode(encoding))
    assert_right(read(path))


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "SEP=;", "# of my controller\nsep=;"])
def test_the_line_by_which_excel_knows_the_separator_is_no_header(first: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"\ufeff{first}\n" + text({"t": LOG.t, **plain()}, ";", ","), encoding="utf-8")
    assert_right(read(path))


@pytest.mark.parametrize("zone", ["", "Z", "+02:00", " UTC"])
@pytest.mark.parametrize("between", ["T", " "])
def test_dates_are_times(zone: str, between: str, tmp_path: Path) -> None:
    """As pandas writes its index: whole seconds have no fraction."""
    stamps = (np.datetime64("2024-02-28T23:59:55", "us") + np.round(1e6 * LOG.t).astype("m8[us]")).astype(str)
    cells = [stamp.removesuffix(".000000").replace("T", between) + zone for stamp in stamps.tolist()]
    path = tmp_path / "run.csv"
    path.write_text(text({"time": np.array(cells, dtype=object), **plain()}))
    log = read(path)
    np.testing.assert_allclose(log.t, LOG.t, atol=1e-6)
    np.testing.assert_array_equal(log["q"], LOG["q"])


def test_a_date_that_there_is_not_is_an_empty_cell(tmp_path: Path) -> None:
    cells = ["2024-02-28T12:00:00", "2024-02-31T12:00:01", "noon", "", "2024-02-28T12:00:02.5"]
    (tmp_path / "run.csv").write_text("time,q\n" + "".join(f"{cell},1.0\n" for cell in cells))
    t = read_raw(tmp_path / "run.csv")["time"][:, 0]
    assert np.flatnonzero(np.isnan(t)).tolist() == [1, 2, 3]
    assert t[4] - t[0] == 2.5e9


def test_what_was_read_is_said_where_columns_are_missing(tmp_path: Path) -> None:
    lists = {"q": [[[cell] for cell in row] for row in LOG["q"].tolist()], "tau": [["no"]] * len(LOG)}
    pl.DataFrame({"t": LOG.t, **lists}).write_parquet(tmp_path / "run.parquet")
    with pytest.raises(
        DataError,
        match=r"no column.*Rename.*notes: Columns q, tau hold lists without numbers",
    ):
        read(tmp_path / "run.parquet")


def test_stamps_in_two_columns(tmp_path: Path) -> None:
    whole = LOG.t.astype(int)
    stamps = {"header.stamp.sec": EPOCH + whole, "header.stamp.nanosec": np.round(1e9 * (LOG.t - whole))}
    path = tmp_path / "run.csv"
    path.write_text(text({**stamps, **plain()}))
    assert_right(read(path))


def test_blocks_join_where_a_line_is_cut(tmp_path: Path) -> None:
    """A file of several blocks, at whose borders lines and line ends are torn."""
    rows = np.arange(3 * BLOCK // 20, dtype=float)
    values = np.sin(rows)
    for end in ("\n", "\r\n"):
        lines = (f"{t:.0f},{v!r}" for t, v in zip(rows, values.tolist(), strict=True))
        (tmp_path / "run.csv").write_bytes((f"t,q{end}" + end.join(lines) + end).encode())
        assert (tmp_path / "run.csv").stat().st_size > 3 * BLOCK
        raw = read_raw(tmp_path / "run.csv")
        np.testing.assert_array_equal(raw["t"][:, 0], rows)
        np.testing.assert_array_equal(raw["q"][:, 0], values)


def test_text_in_a_column_of_numbers_is_nan_wherever_it_is(tmp_path: Path) -> None:
    rows = 2 * BLOCK // 8
    cells = [f"{i},{i % 7}" for i in range(rows)]
    for bad in (3, rows // 2, rows - 1):
        cells[bad] = f"{bad}, oops"
    cells[5] = "5,  1.5 "
    (tmp_path / "run.csv").write_text("t,q\n" + "\n".join(cells) + "\n")
    q = read_raw(tmp_path / "run.csv")["q"][:, 0]
    assert np.flatnonzero(np.isnan(q)).tolist() == [3, rows // 2, rows - 1]
    assert q[5] == 1.5


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_row_wider_than_the_header_is_named_in_figures(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    header, *rows = text({"t": LOG.t, **plain()}, separator).splitlines()
    path.write_text("\n".join([header, *(f"{row}{separator}" for row in rows)]), encoding="utf-8")
    names = 1 + 2 * len(JOINTS)
    with pytest.raises(DataError, match=f"names {names} columns, but the first row has {names + 1} cells"):
        read(path)
