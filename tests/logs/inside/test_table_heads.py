"""What may stand above a table's rows, and times that are text: the same motion, however it begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import JOINTS
from test_table_shapes import EPOCH, LOG, assert_right, plain, read, text

from etude.errors import DataError

TABLE = {"t": LOG.t, **plain()}
NAMES, ROWS = text(TABLE).split("\n", 1)
WIDTH = len(TABLE)


def written(folder: Path, content: str, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize("separator", [" ", "|", "\t", ";", ","])
def test_separators(separator: str, tmp_path: Path) -> None:
    assert_right(read(written(tmp_path, text(TABLE, separator), "run.txt")))


@pytest.mark.parametrize("separator", [" ", ","])
def test_the_header_that_numpy_writes_as_a_comment(separator: str, tmp_path: Path) -> None:
    table, path = np.stack(list(TABLE.values()), axis=1), tmp_path / "run.txt"
    np.savetxt(path, table, header=f"seed 3\n{separator.join(TABLE)}", delimiter=separator)
    assert_right(read(path))
    np.savetxt(path, table, header="a run", delimiter=separator)
    with pytest.raises(DataError, match="no header, only"):
        read(path)


@pytest.mark.parametrize("above", ["Run 7\n", "Recorder 2.1, cell 3\nrate: 100 Hz\n\n", "a;b;c\n"])
def test_lines_above_the_header_are_left_out_and_said(above: str, tmp_path: Path) -> None:
    log = read(written(tmp_path, above + NAMES + "\n" + ROWS))
    assert_right(log)
    assert any("above the header" in sentence for sentence in log.repairs)


@pytest.mark.parametrize("title", ["", "Run 7\n"])
def test_a_row_of_units_is_believed(title: str, tmp_path: Path) -> None:
    """As LabVIEW and drives write it; degrees there are as good as in the header."""
    joints = len(JOINTS)
    table = {n: np.rad2deg(v) if n.startswith("q") else 1e3 * v if n == "t" else v for n, v in TABLE.items()}
    units = ",".join(["ms", *["deg"] * joints, *["Nm"] * joints])
    content = text(table).split("\n", 1)[1]
    log = read(written(tmp_path, f"{title}{NAMES}\n{units}\n{content}"))
    assert_right(log, 1e-9)
    assert "The second row states the units." in log.repairs


def test_two_rows_of_names(tmp_path: Path) -> None:
    """As pandas writes a header of two levels, to CSV and to Parquet."""
    pairs = [("t", ""), *((j, word) for word in ("position", "effort") for j in JOINTS)]
    heads = "\n".join(",".join(level) for level in zip(*pairs, strict=True))
    assert_right(read(written(tmp_path, heads + "\n" + ROWS)))
    frame = pl.DataFrame(dict(zip(map(str, pairs), TABLE.values(), strict=True)))
    frame.write_parquet(tmp_path / "run.parquet")
    assert_right(read(tmp_path / "run.parquet"))


def test_more_cells_than_names_are_refused_as_ever(tmp_path: Path) -> None:
    rows = "\n".join(line + "," for line in ROWS.splitlines())
    with pytest.raises(DataError, match=f"names {WIDTH} columns, but the first row has {WIDTH + 1} cells"):
        read(written(tmp_path, f"{NAMES}\n{rows}\n"))


def test_empty_columns_at_the_end_have_no_name(tmp_path: Path) -> None:
    rows = "\n".join(line + ",," for line in ROWS.splitlines())
    assert_right(read(written(tmp_path, f"{NAMES},,\n{rows}\n")))


def clock(t: float, mark: str) -> str:
    """30:59.98 before noon or so."""
    return f"{30 + int(t) // 60:02d}:{t % 60:09.6f}".replace(".", mark)


def dated(form: str) -> list[str]:
    instants = (
        np.datetime64("2024-05-06T12:30:00") + np.round(LOG.t * 1e9).astype("timedelta64[ns]")
    ).tolist()
    days = [str(np.datetime64(i, "ns")).replace("T", " ") for i in instants]
    if form == "matlab":
        return [f"06-May-2024 {day[11:]}" for day in days]
    if form == "slashes":
        return [day.replace("-", "/") for day in days]
    return days


TIMES = {
    "pandas durations": [f"0 days 00:00:{t:012.9f}" for t in LOG.t],
    "clock": [f"00:00:{t:012.9f}" for t in LOG.t],
    "MATLAB seconds": [f"{t:g} sec" for t in LOG.t],
    "MATLAB dates": dated("matlab"),
    "slashes": dated("slashes"),
    "logging's comma": [f'"2024-05-06 12:{clock(t, ",")}"' for t in LOG.t],
    "compact": [f"20240506T12{clock(t, '.').replace(':', '')}Z" for t in LOG.t],
    "day first": [f"31.12.2024 23:{clock(t, '.')}" for t in LOG.t],
    "of a spreadsheet": [f"5/6/2024 1:{clock(t, '.')} PM" for t in LOG.t],
    "day first, slashes": [f"25/6/2024 01:{clock(t, '.')}" for t in LOG.t],
    "half a day": [f"01:{clock(t, '.')} PM" for t in LOG.t],
    "milliseconds behind a colon": [f"12:{clock(t, ':')}" for t in LOG.t],
    "minutes": [clock(t, ".") for t in LOG.t],
    "dates": dated("iso"),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_as_text(name: str, tmp_path: Path) -> None:
    assert_right(read(written(tmp_path, text({**TABLE, "t": np.array(TIMES[name])}))))


@pytest.mark.parametrize("header", ["", "Unnamed: 0", "index", "__index_level_0__"])
@pytest.mark.parametrize("times", [np.array(TIMES["dates"]), EPOCH + LOG.t], ids=["dates", "numbers"])
def test_an_index_without_a_name_is_the_time(header: str, times: np.ndarray, tmp_path: Path) -> None:
    table = {header: times, **plain()}
    log = read(written(tmp_path, text(table)))
    np.testing.assert_allclose(log["q"], LOG["q"])
    np.testing.assert_allclose(log.t, LOG.t, atol=1e-6)
    assert any("the index" in sentence for sentence in log.repairs)


def test_row_numbers_are_no_time(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no time column"):
        read(written(tmp_path, text({"": np.arange(len(LOG)), **plain()})))


def test_numbers_in_lists_as_numpy_writes_them(tmp_path: Path) -> None:
    """`df.to_csv` of lists of numpy's numbers."""
    lists = {"position": LOG["q"], "effort": LOG["command"]}
    rows = ["t,name,position,effort"]
    for k, t in enumerate(LOG.t):
        cells = [f'"[{", ".join(f"np.float64({v})" for v in own[k])}]"' for own in lists.values()]
        rows.append(",".join([str(t), f'"{list(JOINTS)}"', *cells]))
    assert_right(read(written(tmp_path, "\n".join(rows) + "\n")))
