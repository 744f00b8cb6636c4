"""PX4 logs: topics joined, axes turned, set-points as parts of full scale, and what is missing named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_examples import vector

from etude import plugins
from etude.errors import DataError, UsageError
from etude.logs import cut_sentences, read_log, read_raw
from etude.types import Channel

pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
import ulog_examples as ulogs

MOTORS = tuple(f"motor_{i}" for i in range(1, 5))
CHANNELS = (
    Channel("command", MOTORS, ("1",) * 4, "command", required=True),
    vector("specific_force", "m/s^2", required=True),
    vector("rates", "rad/s", required=True),
    vector("position", "m", "aside"),
    Channel("orientation", ("w", "x", "y", "z"), ("1",) * 4, "aside"),
)
FLIP = np.array([1.0, -1.0, -1.0])


def test_body_and_motors_are_read_in_the_frames_of_etude(tmp_path: Path) -> None:
    log = read_log(ulogs.write_ulog(tmp_path / "flight.ulg"), CHANNELS, rate=200.0)
    own = ulogs.topics()
    np.testing.assert_allclose(log["rates"], own["vehicle_angular_velocity"]["xyz"] * FLIP, atol=1e-6)
    force = own["sensor_combined"]["accelerometer_m_s2"] * FLIP
    np.testing.assert_allclose(log["specific_force"], force, atol=1e-5)
    assert log["specific_force"][:, 2].mean() > 9.0, "at rest an accelerometer reads g upwards"
    np.testing.assert_allclose(log["command"], own["actuator_motors"]["control"][:, :4], atol=1e-6)
    np.testing.assert_allclose(log.t, ulogs.T, atol=1e-9)


def test_the_sign_of_an_attitude_does_not_jump(tmp_path: Path) -> None:
    """Of two signs PX4 may log either; interpolated between them an attitude would be anything."""
    angle = np.linspace(0.0, 0.5, len(ulogs.T))
    q = np.stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle], axis=1)
    q[::2] *= -1.0
    own = {**ulogs.topics(), "vehicle_attitude": {"timestamp": ulogs.STAMPS + 3000, "q": q}}
    log = read_log(ulogs.write_ulog(tmp_path / "flight.ulg", own), CHANNELS, rate=200.0)
    np.testing.assert_allclose(np.linalg.norm(log["orientation"], axis=1), 1.0, atol=1e-5)


def test_position_is_east_north_up(tmp_path: Path) -> None:
    place = {"x": np.full(len(ulogs.T), 1.0), "y": 2.0 + 0.0 * ulogs.T, "z": -3.0 + 0.0 * ulogs.T}
    own = {**ulogs.topics(), "vehicle_local_position": {"timestamp": ulogs.STAMPS, **place}}
    raw = read_raw(ulogs.write_ulog(tmp_path / "flight.ulg", own))
    assert [raw[f"position_{a} [m]"][0, 0] for a in "xyz"] == [2.0, 1.0, 3.0]


def test_older_logs_have_pulse_widths(tmp_path: Path) -> None:
    own = ulogs.topics()
    controls = own.pop("actuator_motors")["control"][:, :4]
    pulses = np.hstack([1000.0 + 900.0 * controls, np.zeros((len(ulogs.T), 12))])
    idle = {"timestamp": ulogs.STAMPS, "output": np.full((len(ulogs.T), 16), 900.0)}
    own |= {
        "actuator_outputs": idle,
        "actuator_outputs:1": {"timestamp": ulogs.STAMPS, "output": pulses},
    }
    path = ulogs.write_ulog(tmp_path / "flight.ulg", own, parameters={"PWM_MAX": 1900, "PWM_MAIN_MAX2": -1})
    log = read_log(path, CHANNELS, rate=200.0)
    np.testing.assert_allclose(log["command"], controls, atol=1e-4)
    assert any("Outputs 1 to 4 of actuator_outputs were read" in sentence for sentence in log.repairs)


def test_motors_that_were_logged_too_slowly_are_reported(tmp_path: Path) -> None:
    own = ulogs.topics()
    own["actuator_motors"] = {name: values[::10] for name, values in own["actuator_motors"].items()}
    log = read_raw(ulogs.write_ulog(tmp_path / "flight.ulg", own))
    assert any("actuator_motors was recorded 10 times a second" in sentence for sentence in log.repairs)


def test_the_battery_is_a_column(tmp_path: Path) -> None:
    raw = read_raw(ulogs.write_ulog(tmp_path / "flight.ulg"))
    assert raw["battery_voltage [V]"][0, 0] == 12.5


def test_topics_can_be_read_as_recorded(tmp_path: Path) -> None:
    path = ulogs.write_ulog(tmp_path / "flight.ulg")
    np.testing.assert_allclose(
        read_raw(path, ("battery_status",))["voltage_v"][:, 0], np.linspace(12.5, 12.0, 8), rtol=1e-6
    )
    with pytest.raises(DataError, match=r"no topic esc_status.*It has .*battery_status"):
        read_raw(path, ("esc_status",))


def test_a_log_without_what_is_needed(tmp_path: Path) -> None:
    path = ulogs.write_ulog(
        tmp_path / "flight.ulg", {"cpuload": {"timestamp": ulogs.STAMPS, "load": ulogs.T}}
    )
    with pytest.raises(DataError, match=r"no topic vehicle_angular_velocity or .*SDLOG_PROFILE"):
        read_raw(path)


@pytest.mark.parametrize("topic", ["vehicle_angular_velocity", "sensor_combined", "actuator_motors"])
def test_what_is_missing_is_named_by_its_topic(topic: str, tmp_path: Path) -> None:
    own = ulogs.topics()
    del own[topic]
    path = ulogs.write_ulog(tmp_path / "flight.ulg", own)
    if topic == "vehicle_angular_velocity":  # rates are in sensor_combined too
        assert "gyro_x [rad/s]" in read_raw(path).values
        return
    with pytest.raises(DataError, match=rf"no topic {topic} or .*it has .*battery_status.*SDLOG_PROFILE"):
        read_raw(path)


def test_motors_of_a_disarmed_vehicle_are_off(tmp_path: Path) -> None:
    """However long it stands there, the flight behind it is read."""
    own = ulogs.topics()
    disarmed = ulogs.T < 2.5
    own["actuator_motors"]["control"][disarmed] = np.nan
    log = read_log(ulogs.write_ulog(tmp_path / "flight.ulg", own), CHANNELS, rate=200.0)
    assert len(log) == len(ulogs.T)
    assert (log["command"][disarmed] == 0.0).all()
    assert (log["command"][~disarmed] > 0.3).all()
    assert any("62.5 % of actuator_motors the vehicle is disarmed" in sentence for sentence in log.repairs)


def test_a_topic_that_falls_silent_is_not_drawn_through(tmp_path: Path) -> None:
    own = ulogs.topics()
    heard = (ulogs.T < 1.0) | (ulogs.T > 1.3)
    own["actuator_motors"] = {name: values[heard] for name, values in own["actuator_motors"].items()}
    log = read_log(ulogs.write_ulog(tmp_path / "flight.ulg", own), CHANNELS, rate=200.0)
    assert not ((log.t > 1.001) & (log.t < 1.299)).any()
    assert len(log) == pytest.approx(heard.sum(), abs=2)
    assert any("Topic actuator_motors is silent for 0.3" in sentence for sentence in log.repairs)


def test_a_log_cut_in_a_record_is_read_up_to_there(tmp_path: Path) -> None:
    path = ulogs.write_ulog(tmp_path / "flight.ulg")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    log = read_log(path, CHANNELS, rate=200.0)
    assert 0.4 < len(log) / len(ulogs.T) < 0.6
    (cut,) = cut_sentences(log)
    left = float(cut.removesuffix(" s of it remain.").rpartition(" ")[2])
    assert left == pytest.approx(np.ptp(log.t), abs=0.05)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(DataError):
        read_raw(path)


def test_only_a_whole_log_is_taken_for_one(tmp_path: Path) -> None:
    """Cut at any byte of its last message. Between two messages nobody can tell: ULog has no end."""
    path = ulogs.write_ulog(tmp_path / "flight.ulg")
    data = path.read_bytes()
    assert not cut_sentences(read_raw(path))
    motors = data.rindex(b"D\x02\x00") - 2  # size, kind and topic of the last message
    assert motors + 3 + int.from_bytes(data[motors : motors + 2], "little") == len(data)
    for size in range(motors + 1, len(data)):
        path.write_bytes(data[:size])
        assert cut_sentences(read_raw(path)), size


def test_damage_that_leads_in_a_circle_is_refused(tmp_path: Path) -> None:
    """A message of no known kind, longer than the file: pyulog went back as far as it had not read."""
    path = ulogs.write_ulog(tmp_path / "flight.ulg")
    path.write_bytes(path.read_bytes()[:16] + b"\x40\x00\x00" * 20)
    with pytest.raises(DataError, match="cannot be read as ULog"):
        read_raw(path)


def test_without_the_library_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    read_ulog = plugins.load("etude.readers", "ulog")
    monkeypatch.setattr("etude.logs.readers.extras.importlib.import_module", gone)
    with pytest.raises(UsageError, match=r"pip install 'pyulog>=1.1'"):
        read_ulog(ulogs.write_ulog(tmp_path / "flight.ulg"))
