"""Étude reads every header that it writes, whatever joints are called; `init` refuses names that no header
can hold, and what a spreadsheet would run is text.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from etude.campaign import Campaign, create_campaign, write_table
from etude.deploy import csv_bytes, read_table
from etude.errors import UsageError
from etude.logs import header_row, matched_log, restored, text_cell
from etude.logs.readers.cells import FORMULA
from etude.trajectories import PointToPoint
from etude.types import Channel, Log

ROBOT = """name = "pair"
command_unit = "N m"
rate = 50.0
[[axis]]
name = {one}
lower = -1.0
upper = 1.0
velocity = 1.0
acceleration = 2.0
command = 20.0
[[axis]]
name = {two}
lower = -1.5
upper = 0.5
velocity = 1.0
acceleration = 2.0
command = 10.0
"""
ODD = (
    *("a,b", "é ü", '"x"', 'x"', "elbow.position", "=1+2", "+x", "-y", "@SUM(A1)", "a [deg]", "b_[rad]", "q"),
    *(
        "time",
        "a;b;c;d;e;f",
        "x'y",
        "'=k",
        "1",
        "2",
        "a/b/effort",
        "#a",
        "j (deg)",
        "vel",
        "q_a",
        "名前",
        "a_deg",
    ),
    *(
        "a\\b",
        "sep=;",
        "a|b",
        "NaN",
        "x:y",
        "b_N m",
        "a  b",
        "0.5",
        "tau",
        "t",
        "position_1",
        "command_q",
        "🦾",
    ),
)
REFUSED = ("a\nb", "c\rd", "a\tb", "", " a", "a ", "\x00", "a\u2028b", "a\x85b", "a\u202eb", "\x7f")


def made(folder: Path, one: str, two: str) -> Campaign:
    from etude.toml_tables import toml_value

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.toml").write_text(
        ROBOT.format(one=toml_value(one), two=toml_value(two)), encoding="utf-8"
    )
    return create_campaign(folder / "lab", str(folder / "robot.toml"))[0]


def read_back(campaign: Campaign, folder: Path) -> None:
    """trajectory.csv, with commands beside it, is a log of the same joints and numbers."""
    motion = PointToPoint(np.array([[0.1, -0.2], [0.4, 0.3], [0.1, -0.2]]), 1.0)
    inputs = campaign.kind.inputs(campaign.spec, campaign.config)
    command = np.arange(1.0, 3.0)
    names = [f"command_{axis}" for axis in campaign.axes]
    table = csv_bytes(
        motion, inputs, 50.0, lambda log: dict(zip(names, command[:, None] * np.sin(log.t), strict=True))
    )
    path = folder / "log.csv"
    path.write_bytes(table)
    header, rows = read_table(table)
    log, stated = matched_log(path, campaign.channels, 50.0)
    assert "q" not in stated
    for name, first in (("q", 1), ("command", rows.shape[1] - 2)):
        np.testing.assert_array_equal(log[name], rows[:, first : first + 2], err_msg=f"{name} of {header}")


PAIRS = list(itertools.pairwise(ODD))


@pytest.mark.parametrize(("one", "two"), PAIRS)
def test_odd_names_are_read_as_they_were_written(tmp_path: Path, one: str, two: str) -> None:
    read_back(made(tmp_path, one, two), tmp_path)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(min_size=1, max_size=8), st.text(st.sampled_from("ab=\"'[]().,;:_ qdeg#1+-@|/"), min_size=1))
@example('"', "'")
def test_any_name_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, one: str, two: str) -> None:
    folder = tmp_path_factory.mktemp("any")
    campaign = None
    with contextlib.suppress(UsageError):
        campaign = made(folder, one, two)
    if campaign is not None:
        read_back(campaign, folder)
    else:
        assert not (folder / "lab").exists()


@pytest.mark.parametrize("name", REFUSED)
def test_names_that_no_line_can_show_are_refused_first(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="name"):
        made(tmp_path, name, "b")
    assert not (tmp_path / "lab").exists()


@given(
    st.lists(st.text(st.characters(blacklist_categories=("Cc", "Cs", "Zl", "Zp")), max_size=9), min_size=1)
)
def test_no_cell_begins_as_a_formula_and_each_is_given_back(names: list[str]) -> None:
    names = [*names, "end"]
    cells = next(csv.reader(io.StringIO(header_row(names))), [""])
    assert [restored(cell) for cell in cells] == names
    assert not any(cell.startswith(FORMULA) for cell in cells)
    assert all(text_cell(name) == name for name in names if name.isidentifier())


def test_a_table_of_commands(tmp_path: Path) -> None:
    command = Channel("command", ("=a", "b,c"), ("N m", "N m"), "command")
    parts = {
        "command": command,
        "deviation": command,
        "outside": Channel("outside", ("data",), ("1",), "aside"),
    }
    values = {name: np.ones((3, len(own.parts))) for name, own in parts.items()}
    write_table(tmp_path / "c.csv", Log(np.arange(3.0), parts, values, ""))
    names = next(csv.reader((tmp_path / "c.csv").read_text().splitlines()))
    assert names[:3] == ["time", "command_=a", "command_b,c"]
