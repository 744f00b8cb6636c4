"""Names that differ: a few lines of TOML rename columns, and a log writes its own lines."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude.errors import DataError
from etude.logs.frames import raw_log
from etude.logs.mapping import LogConfig, mapped, mapping_text
from etude.logs.read import read_log

LOG = make_log()
DEGREES = {f"q_{joint} [deg]": f"ActPos{k}" for k, joint in enumerate(JOINTS, 1)}
MOTORS = {f"command_{joint}": f"Moment{k}" for k, joint in enumerate(JOINTS, 1)}
NAMES = {"t": "Zeit", **DEGREES, **MOTORS}


def foreign(path: Path) -> Path:
    columns = [LOG.t, *np.rad2deg(LOG["q"]).T, *LOG["command"].T]
    header = ",".join(NAMES.values())
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def test_a_mapping_renames_columns_and_says_their_unit(tmp_path: Path) -> None:
    path = foreign(tmp_path / "run.csv")
    with pytest.raises(DataError, match="no column for channel"):
        read_log(path, CHANNELS, rate=RATE, limits=LIMITS)
    log = read_log(path, CHANNELS, rate=RATE, limits=LIMITS, config=LogConfig(NAMES))
    np.testing.assert_allclose(log["q"], LOG["q"], atol=1e-9)
    np.testing.assert_allclose(log["command"], LOG["command"], atol=1e-9)
    assert any("ActPos1 as q_pan_joint [deg]" in sentence for sentence in log.repairs)


def test_a_unit_in_the_file_is_kept_and_one_in_the_mapping_wins() -> None:
    raw = raw_log({"Winkel [deg]": np.ones(3), "Zeit": np.arange(3.0)}, "x")
    assert list(mapped(raw, LogConfig({"q_a": "Winkel [deg]"})).values) == ["q_a [deg]", "Zeit"]
    assert list(mapped(raw, LogConfig({"q_a [rad]": "Winkel [deg]"})).values) == ["q_a [rad]", "Zeit"]


def test_what_is_mapped_takes_the_place_of_a_column_of_that_name() -> None:
    raw = raw_log({"q_a": np.zeros(3), "filtered": np.ones(3), "aside": np.ones(3)}, "x")
    found = mapped(raw, LogConfig({"q_a": "filtered"}, ignored=("aside",)))
    assert list(found.values) == ["q_a"]
    assert (found["q_a"] == 1.0).all()


def test_a_mapping_fits_whole_or_not_at_all() -> None:
    raw = raw_log({"ActPos1": np.ones(3), "ActPos2": np.ones(3)}, "x")
    with pytest.raises(DataError, match=r"no column 'ActPost2'.*Did you mean ActPos2"):
        mapped(raw, LogConfig({"q_a": "ActPos1", "q_b": "ActPost2"}))
    assert mapped(raw, LogConfig({"q_a": "other"})).repairs == ()


def test_what_is_written_for_a_log_reads_it() -> None:
    headers = ["time_ms", "gear", *(f"{j}.position" for j in JOINTS), *(f"{j}.effort" for j in JOINTS)]
    table = tomllib.loads(mapping_text(headers, CHANNELS))["log"]["columns"]
    assert table == {
        "t": "time_ms",
        **{f"q_{j}": f"{j}.position" for j in JOINTS},
        **{f"command_{j}": f"{j}.effort" for j in JOINTS},
    }
    numbered = [f"q{k}" for k in range(3)]
    assert tomllib.loads(mapping_text(numbered, CHANNELS))["log"]["columns"]["q_elbow_joint"] == "q2"


def test_what_is_missing_is_a_blank_with_the_nearest_headers() -> None:
    text = mapping_text(["clock", *NAMES.values()], CHANNELS)
    assert "columns" in tomllib.loads(text)["log"]
    assert '# "command_lift_joint" = ""  # which of ' in text
    assert '"qd_' not in text, "what no log needs is asked for"
