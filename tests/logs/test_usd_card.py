"""The Crazyflie's card: units and signs of its variables, events joined by time, damage said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_examples import vector
from ulog_examples import EXAMPLES, loaded

from etude.errors import DataError
from etude.logs import read_log, read_raw
from etude.types import Channel

MAKER = loaded(EXAMPLES / "crazyflie" / "make_usd.py")
MOTORS = tuple(f"m{i}" for i in range(1, 5))
CHANNELS = (
    Channel("command", MOTORS, ("1",) * 4, "command", required=True),
    vector("specific_force", "m/s^2", required=True),
    vector("rates", "rad/s", required=True),
    vector("position", "m", "aside"),
    Channel("attitude", ("roll", "pitch", "yaw"), ("rad",) * 3, "aside"),
)
T = np.arange(0.0, 1.0, 0.01)


def written(path: Path, **extra: object) -> Path:
    """A flight with a faster kind of events beside, which tells nothing of it."""
    wave = np.sin(T)
    variables = {f"acc.{a}": ("f", (wave if a == "x" else 0 * T + (a == "z")).tolist()) for a in "xyz"}
    variables |= {f"gyro.{a}": ("f", (90.0 * wave).tolist()) for a in "xyz"}
    variables |= {
        f"motor.m{i}": ("H", (10_000 * i + (1000 * wave)).astype(int).tolist()) for i in range(1, 5)
    }
    variables |= {
        f"stateEstimate.{a}": ("f", [30.0 * k] * len(T)) for k, a in enumerate(("roll", "pitch", "yaw"))
    }
    other = np.arange(0.0, 1.0, 0.001)
    events = {"fixedFrequency": (T, variables), "estTOF": (other, {"distance": ("f", other.tolist())})}
    path.write_bytes(MAKER.usd_bytes(events))
    return path


def test_the_example_is_the_csv_that_it_was_made_from() -> None:
    one = read_log(EXAMPLES / "crazyflie" / "log16", CHANNELS, rate=200.0)
    other = read_log(EXAMPLES / "crazyflie" / "log16_yaw_first.csv", CHANNELS, rate=200.0)
    for name, atol in (("specific_force", 0.01), ("rates", 1e-5), ("command", 1e-5)):
        np.testing.assert_allclose(one[name], other[name], atol=atol)
    np.testing.assert_allclose(one.t, other.t, atol=1e-6)


def test_units_and_signs(tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "log07"), CHANNELS, rate=200.0)
    assert len(log) == len(T), "the other events do not lead"
    np.testing.assert_allclose(log["rates"][:, 0], 0.5 * np.pi * np.sin(T), atol=1e-6)
    np.testing.assert_allclose(log["specific_force"][:, 2], 9.81, atol=1e-6)
    np.testing.assert_allclose(log["command"][0], np.arange(1, 5) * 10_000 / 65535)
    # the firmware's pitch is positive nose up, in these axes that is a negative turn about y
    np.testing.assert_allclose(log["attitude"][0], np.deg2rad([0.0, -30.0, 60.0]), atol=1e-6)


def test_other_events_are_read_when_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path / "log07")
    assert len(read_raw(path, ("estTOF",))) == 1000
    with pytest.raises(DataError, match=r"no events estTDOA.*fixedFrequency"):
        read_raw(path, ("estTDOA",))


def test_a_log_that_was_cut_says_so(tmp_path: Path) -> None:
    path = written(tmp_path / "log07")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    log = read_log(path, CHANNELS, rate=200.0)
    assert 0.6 < len(log) / len(T) < 0.9
    assert any("checksum does not fit" in sentence for sentence in log.repairs)


@pytest.mark.parametrize(
    "change", [b"\xbc\x07\x00\x01\x00", b"\xbc\x02\x00\xff\xff", b"\xbc\x02\x00\x01\x00\x00\x00name"]
)
def test_what_is_no_such_log(change: bytes, tmp_path: Path) -> None:
    (tmp_path / "log07").write_bytes(change)
    with pytest.raises(DataError):
        read_raw(tmp_path / "log07")
