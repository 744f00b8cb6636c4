"""Vehicles that are no quadrotors are refused in a sentence: a servo is not taken for a motor."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.cli import main
from etude.errors import DataError
from etude.logs import read_raw

EXAMPLES = Path(__file__).parents[2] / "examples"
T = np.arange(0.0, 2.0, 0.01)
STAMPS = np.round(1e6 * (T + 3.0)).astype(np.int64)


def writer() -> Any:
    spec = importlib.util.spec_from_file_location("make_ulg", EXAMPLES / "px4" / "make_ulg.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HEXA = {  # PX4's generic hexarotor in an X: forward, right, and positive against the clock
    "CA_AIRFRAME": 0,
    "CA_ROTOR_COUNT": 6,
    **{
        f"CA_ROTOR{i}_{key}": value
        for i, place in enumerate(
            [
                (0.0, 0.275, -0.05),
                (0.0, -0.275, 0.05),
                (0.238, -0.1375, -0.05),
                (-0.238, 0.1375, 0.05),
                (0.238, 0.1375, 0.05),
                (-0.238, -0.1375, -0.05),
            ]
        )
        for key, value in zip(("PX", "PY", "KM"), place, strict=True)
    },
}


def flight(
    path: Path, status: dict[str, int], parameters: dict[str, float], motors: int = 4, topic: str = "motors"
) -> Path:
    """A log whose first motors move, with what it says of its airframe."""
    swing = np.stack([np.sin(k * T) for k in range(1, 13)], axis=1)
    moving = np.where(np.arange(12) < motors, 0.5 + 0.1 * swing, np.nan)
    topics: dict[str, Any] = {
        "vehicle_angular_velocity": {"timestamp": STAMPS, "xyz": swing[:, :3]},
        "sensor_combined": {"timestamp": STAMPS, "accelerometer_m_s2": 0.1 * swing[:, :3] - [0.0, 0.0, 9.8]},
        "actuator_motors": {"timestamp": STAMPS, "control": moving},
    }
    if topic == "outputs":
        del topics["actuator_motors"]
        topics["actuator_outputs"] = {"timestamp": STAMPS, "output": 1000.0 + 1000.0 * np.nan_to_num(moving)}
    if status:
        rows = {name: np.full(len(T) // 50, value) for name, value in status.items()}
        topics["vehicle_status"] = {"timestamp": STAMPS[::50], **rows}
    kinds = dict.fromkeys(status, "uint8_t")
    path.write_bytes(writer().ulog_bytes(topics, types=kinds, parameters=parameters))
    return path


def described(path: Path, count: int, **more: Any) -> Path:
    """The example's vehicle with so many motors."""
    own = {
        "commands": [f"motor_{i}" for i in range(1, count + 1)],
        "command_lower": [0.0] * count,
        "command_upper": [1.0] * count,
        **more,
    }
    text = (EXAMPLES / "px4" / "px4_quad.toml").read_text().splitlines()
    kept = [line for line in text if line.partition(" =")[0] not in own]
    at = next(i for i, line in enumerate(kept) if line.startswith("name"))
    lines = [f"{key} = {json.dumps(value)}" for key, value in own.items()]
    path.write_text("\n".join([*kept[: at + 1], *lines, *kept[at + 1 :]]) + "\n")
    return path


@pytest.mark.parametrize(
    ("status", "parameters", "said"),
    [
        ({}, {"MAV_TYPE": 4}, "a helicopter (MAV_TYPE 4)"),
        ({}, {"MAV_TYPE": 15}, "a tricopter (MAV_TYPE 15)"),
        ({}, {"MAV_TYPE": 22}, "a VTOL aircraft (MAV_TYPE 22)"),
        ({"system_type": 1}, {}, "a fixed-wing aircraft (vehicle_status.system_type 1)"),
        ({"system_type": 0, "vehicle_type": 2}, {}, "a fixed-wing aircraft (vehicle_status.vehicle_type 2)"),
        ({"system_type": 2, "is_vtol": 1}, {"MAV_TYPE": 2}, "a VTOL aircraft (vehicle_status.is_vtol)"),
        ({}, {"CA_AIRFRAME": 2}, "a VTOL aircraft (CA_AIRFRAME 2)"),
        ({}, {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 3}, "a vehicle of 3 rotors (CA_ROTOR_COUNT 3)"),
        ({}, HEXA | {"CA_ROTOR4_AX": 0.2}, "a multirotor with tilted rotors (CA_ROTOR4_AX 0.2)"),
        ({}, HEXA | {"CA_ROTOR5_TILT": 1}, "a multirotor whose rotors tilt (CA_ROTOR5_TILT 1)"),
    ],
)
def test_a_log_of_another_airframe_is_refused(
    tmp_path: Path, status: dict[str, int], parameters: dict[str, float], said: str
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    with pytest.raises(DataError, match="only flat multirotors are supported") as problem:
        read_raw(flight(tmp_path / "own.ulg", status, parameters))
    assert said in problem.value.fact


@pytest.mark.parametrize(
    ("status", "parameters"),
    [
        ({}, {}),
        ({}, {"MAV_TYPE": 2, "CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4}),
        ({"system_type": 2, "vehicle_type": 1, "is_vtol": 0}, {"MAV_TYPE": 0}),
    ],
)
def test_quadrotors_and_logs_that_do_not_say_are_read(
    tmp_path: Path, status: dict[str, int], parameters: dict[str, int]
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    found = read_raw(flight(tmp_path / "own.ulg", status, parameters))
    assert found is not None


@pytest.mark.parametrize(
    ("parameters", "topic"),
    [
        (HEXA | {"THR_MDL_FAC": 0.3, "MC_ROLL_P": 5.0, "MPC_XY_VEL_D_ACC": 0.2}, "motors"),
        (HEXA, "outputs"),
        ({"MAV_TYPE": 13}, "outputs"),
    ],
)
def test_the_motors_of_a_hexarotor_are_read_in_their_order(
    tmp_path: Path, parameters: dict[str, float], topic: str
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    raw = read_raw(flight(tmp_path / "own.ulg", {}, parameters, 6, topic))
    names = [name for name in raw.values if name.startswith("motor_")]
    assert names == [f"motor_{i}" for i in range(1, 7)]
    for i, name in enumerate(names):
        np.testing.assert_allclose(raw[name][:, 0], 0.5 + 0.1 * np.sin((i + 1) * T), atol=1e-6)
    curved = "THR_MDL_FAC is 0.3, for robot.toml: thrust_curve = 0.3."
    assert (curved in raw.repairs) == ("THR_MDL_FAC" in parameters)
    late = "MC_ROLL_P is 5, for robot.toml: attitude_gain = 5."
    assert (late in raw.repairs) == ("MC_ROLL_P" in parameters)
    assert not any("velocity_damping" in sentence for sentence in raw.repairs), "it is the usual one"
    said = [sentence for sentence in raw.repairs if "rotors = " in sentence]
    if "CA_ROTOR_COUNT" not in parameters:
        assert not said
        return
    (rotors,) = (json.loads(sentence.partition("rotors = ")[2].rstrip(".")) for sentence in said)
    right, left = rotors[:2]  # x forward, y left; PX4's first motor is the right one, with the clock
    assert right == [0.0, -0.275, -1.0]
    assert left == [0.0, 0.275, 1.0]
    assert rotors[2] == [0.238, 0.1375, -1.0]


def test_an_allocation_that_is_singular_is_refused_with_what_it_lacks(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    alike = HEXA | {f"CA_ROTOR{i}_KM": 0.05 for i in range(6)}
    with pytest.raises(DataError, match="singular: these rotors cannot make thrust and yaw moment apart"):
        read_raw(flight(tmp_path / "own.ulg", {}, alike, 6))


def test_a_hexarotor_learns_from_its_log_and_a_quadrotor_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    log = flight(tmp_path / "own.ulg", {}, HEXA, 6)
    for count, code in ((6, 0), (4, 3)):
        lab, robot = tmp_path / f"lab{count}", described(tmp_path / f"{count}.toml", count, rate=25.0)
        assert main(["init", str(lab), "--robot", str(robot)]) == 0
        said = capsys.readouterr()
        assert main(["tell", str(lab), str(log), "--foreign"]) == code, said
        said = capsys.readouterr()
        assert ("Learned: 1" in said.out) == (count == 6), said
        if count == 6:
            assert main(["export", str(lab), "--to", "parameters"]) == 0
            assert "30 s of flight above the ground are needed" in capsys.readouterr().out
        assert ("1, 2, 3, 4, 5, 6, which are not the 4" in said.err) == (count == 4), said
