"""Names that differ: a few lines of TOML rename columns, and a log writes its own lines."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude.errors import DataError
from etude.logs import raw_log, read_log, read_raw
from etude.logs.columns.mapping import LogConfig, mapped, mapping_text
from etude.logs.columns.units import read_time
from etude.toml_tables import write_table

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


def test_commands_of_a_drive_do_not_stand_beside_others(tmp_path: Path) -> None:
    """Per mille of one joint would be learned as its N m."""
    path = foreign(tmp_path / "run.csv")
    first = next(iter(MOTORS))
    names = {f"{to} [‰]" if to == first else to: header for to, header in NAMES.items()}
    with pytest.raises(DataError, match=rf"{first} \[‰\].*one is in N m, as in \"{first}\" = \"FACTOR"):
        read_log(path, CHANNELS, rate=RATE, limits=LIMITS, config=LogConfig(names))
    scaled = names | {f"{first} [‰]": "", first: f"0.5 * {MOTORS[first]}"}
    log = read_log(
        path, CHANNELS, rate=RATE, limits=LIMITS, config=LogConfig({k: v for k, v in scaled.items() if v})
    )
    np.testing.assert_allclose(log["command"][:, 0], 0.5 * LOG["command"][:, 0], atol=1e-9)


def test_what_is_mapped_takes_the_place_of_a_column_of_that_name() -> None:
    raw = raw_log({"q_a": np.zeros(3), "filtered": np.ones(3), "aside": np.ones(3)}, "x")
    found = mapped(raw, LogConfig({"q_a": "filtered"}, ignored=("aside",)))
    assert list(found.values) == ["q_a"]
    assert (found["q_a"] == 1.0).all()


def test_a_mapping_fits_whole_or_not_at_all() -> None:
    raw = raw_log({"ActPos1": np.ones(3), "ActPos2": np.ones(3)}, "x")
    with pytest.raises(DataError, match=r"no column 'ActPost2'.*Did you mean ActPos2"):
        mapped(raw, LogConfig({"q_a": "ActPos1", "q_b": "ActPost2"}))
    with pytest.raises(DataError, match=r"no column 'other', which \[log.columns\] names"):
        mapped(raw, LogConfig({"q_a": "other"}))
    with pytest.raises(DataError, match=r"no column 'Curr1'"):
        mapped(raw, LogConfig({"tau_a": "-0.061 * Curr1"}))


def test_a_log_in_the_names_on_the_left_is_read_as_it_is_and_says_so() -> None:
    names = LogConfig({"t": "Zeit", "q_a [deg]": "ActPos1", "command": "Moment"})
    raw = raw_log({"time": np.arange(3.0), "q_a": np.ones(3), "command_a": np.ones(3)}, "x")
    found = mapped(raw, names)
    assert list(found.values) == list(raw.values)
    (said,) = found.repairs
    assert "none of the headers of [log.columns]" in said
    assert mapped(raw, LogConfig()).repairs == ()
    fewer = raw_log({"time": np.arange(3.0), "q_a": np.ones(3)}, "x")
    with pytest.raises(DataError, match="no column 'Zeit'"):
        mapped(fewer, names)


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
    assert '# "command_lift_joint" = ""' in text
    assert '# Not understood: "clock", "Zeit", ' in text
    near = mapping_text(["elbow_joint_q_raw", "gear"], CHANNELS)
    assert '# "q_elbow_joint" = ""  # "elbow_joint_q_raw"?' in near
    assert '# "qd_elbow_joint" = ""  # optional' in text
    assert '"qd_des_' not in text, "what no log needs is asked for"


def test_what_is_written_goes_to_the_end_of_a_campaign_s_file() -> None:
    """campaign.toml has a table [log] of its own: it stands once."""
    own = write_table("log", LogConfig(), {})
    read = tomllib.loads(own + "\n" + mapping_text([f"q{k}" for k in range(3)], CHANNELS))["log"]
    assert read["ignored"] == []
    assert read["columns"]["q_elbow_joint"] == "q2"


HEADERLESS = {f"q_{joint}": f"column {k}" for k, joint in enumerate(JOINTS, 1)} | {
    f"command_{joint} [N m]": f"column {k}" for k, joint in enumerate(JOINTS, 1 + len(JOINTS))
}


def numbers(path: Path) -> Path:
    """Positions and commands without a header, without times."""
    np.savetxt(path, np.column_stack([LOG["q"], LOG["command"]]), delimiter=",", fmt="%.12g")
    return path


def test_a_file_without_header_and_times_is_read_by_the_numbers_of_its_columns(tmp_path: Path) -> None:
    path = numbers(tmp_path / "run.csv")
    config = LogConfig(HEADERLESS, rate=RATE)
    log = read_log(path, CHANNELS, rate=RATE, limits=LIMITS, config=config)
    np.testing.assert_allclose(log["q"], LOG["q"], atol=1e-9)
    np.testing.assert_allclose(log["command"], LOG["command"], atol=1e-9)
    np.testing.assert_allclose(log.t, np.arange(len(LOG)) / RATE, atol=1e-12)
    assert any("columns are numbered from 1" in sentence for sentence in log.repairs)
    assert any(f"{RATE:g} rows a second by [log] rate" in sentence for sentence in log.repairs)


def test_without_a_word_on_them_such_files_are_refused_with_what_to_write(tmp_path: Path) -> None:
    path = numbers(tmp_path / "run.csv")
    with pytest.raises(DataError, match=rf"no header, only {2 * len(JOINTS)} columns.*\"t\" = \"column 1\""):
        read_log(path, CHANNELS, rate=RATE, limits=LIMITS)
    with pytest.raises(DataError, match=r"no time column.*rate = 500"):
        read_log(path, CHANNELS, rate=RATE, limits=LIMITS, config=LogConfig(HEADERLESS))
    with pytest.raises(DataError, match=r"no column 'column 99'"):
        mapped(read_raw(path), LogConfig(HEADERLESS | {"t": "column 99"}))


def test_a_rate_never_replaces_times_that_are_there() -> None:
    raw = raw_log({"t": np.array([0.0, 0.1, 0.4]), "q_a": np.ones(3)}, "x")
    assert mapped(raw, LogConfig(rate=500.0)).t.tolist() == raw.t.tolist()
    known = replace(raw_log({"q_a": np.ones(3)}, "x"), t=np.array([0.0, 0.1, 0.4]))  # of a bag
    assert mapped(known, LogConfig(rate=500.0)).t.tolist() == [0.0, 0.1, 0.4]


def test_headers_that_may_be_the_time_are_offered() -> None:
    raw = raw_log({"rec.time_cont": np.arange(3.0), "centimeter": np.ones(3)}, "x")
    with pytest.raises(DataError, match=r"Is it rec\.time_cont\? Name it"):
        read_time(raw, RATE, "x")
