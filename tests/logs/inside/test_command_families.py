"""Several families of columns that mean the same are asked about once; units and scales are read."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, joint_channels, make_log

from etude.errors import DataError
from etude.logs import read_log
from etude.logs.config import LogConfig
from etude.types import Array, Log

LOG = make_log()


def written(path: Path, **columns: Array) -> Path:
    """A table of columns (T, 3) by a pattern of their header, {} the joint's number."""
    table = {"t": LOG.t} | {
        word.format(j + 1): values[:, j] for word, values in columns.items() for j in range(3)
    }
    np.savetxt(
        path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments=""
    )
    return path


def read(path: Path, columns: dict[str, str] | None = None, unit: str = "N m") -> Log:
    config = LogConfig(columns or {})
    return read_log(path, joint_channels(unit=unit), rate=RATE, limits=LIMITS, config=config)


def families(path: Path, other: str = "TorqueSm{}", values: Array | None = None) -> Path:
    other_values = 0.5 * LOG["command"] + 1.0 if values is None else values
    return written(path, **{"q{}": LOG["q"], "Torque{}": LOG["command"], other: other_values})


@pytest.mark.parametrize(
    "other", ["TorqueSm{}", "TorqueCur{}", "torque_filtered_{}", "motor_torque_{}", "tau_cmd{}"]
)
def test_two_families_of_the_command_are_asked_about(other: str, tmp_path: Path) -> None:
    path = families(tmp_path / "run.csv", other)
    with pytest.raises(DataError, match=r"Torque1 and the like, .* may all be the commands") as problem:
        read(path)
    lines = problem.value.next_step.split(": ")[1].rstrip(".").split(" or ")
    found = [read(path, tomllib.loads(line))["command"] for line in lines]
    np.testing.assert_allclose(found[0], LOG["command"], atol=1e-9)
    np.testing.assert_allclose(found[1], 0.5 * LOG["command"] + 1.0, atol=1e-9)


@pytest.mark.parametrize(
    ("other", "values"),
    [
        ("torque_des_{}", None),
        ("torque_limit_{}", None),
        ("torque_error_{}", None),
        ("TorqueSm{} [A]", None),
        ("TorqueSm{}", np.zeros_like(LOG["command"])),
        ("TorqueSm{}", LOG["command"]),
    ],
    ids=["desired", "limit", "error", "unit", "standing", "copy"],
)
def test_what_is_no_other_measurement_of_the_command_is_no_question(
    other: str, values: Array | None, tmp_path: Path
) -> None:
    found = read(families(tmp_path / "run.csv", other, values))
    np.testing.assert_allclose(found["command"], LOG["command"], atol=1e-9)


def test_a_family_of_named_joints_is_told_as_a_whole(tmp_path: Path) -> None:
    table = {f"{joint}.effort": LOG["command"][:, j] for j, joint in enumerate(JOINTS)}
    table |= {f"{joint}.effort_raw": 2.0 * LOG["command"][:, j] for j, joint in enumerate(JOINTS)}
    table |= {"t": LOG.t} | {f"q_{joint}": LOG["q"][:, j] for j, joint in enumerate(JOINTS)}
    path = tmp_path / "run.csv"
    np.savetxt(
        path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments=""
    )
    with pytest.raises(DataError, match="may all be the commands"):
        read(path)
    np.testing.assert_allclose(
        read(path, {"command": "effort_raw"})["command"], 2.0 * LOG["command"], atol=1e-9
    )


@pytest.mark.parametrize(
    ("source", "factor"), [("-0.5 * Raw{}", -0.5), ("-Raw{}", -1.0), ("2e-3*Raw{}", 2e-3), ("Raw{}", 1.0)]
)
@pytest.mark.parametrize("whole", [False, True])
def test_a_mapping_states_signs_and_scales(source: str, factor: float, whole: bool, tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", **{"q{}": LOG["q"], "Raw{}": LOG["command"] / factor})
    each = {f"tau_{joint}": source.format(j + 1) for j, joint in enumerate(JOINTS)}
    log = read(path, {"command": source.format("")} if whole else each)
    np.testing.assert_allclose(log["command"], LOG["command"], rtol=1e-9, atol=1e-9)
    said = next(sentence for sentence in log.repairs if "[log.columns]" in sentence)
    assert (f"{factor:g} * Raw1" in said) is (factor != 1.0)


def test_a_scale_says_what_a_count_is(tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", **{"q{}": LOG["q"], "Current{} [counts]": LOG["command"] / 0.01})
    limits = {**LIMITS, "command": (-1e5 * np.ones(3), 1e5 * np.ones(3))}
    plain = read_log(path, joint_channels(unit="A"), rate=RATE, limits=limits)
    np.testing.assert_allclose(plain["command"], LOG["command"] / 0.01, rtol=1e-9)
    assert any("the unit of the drive" in sentence for sentence in plain.repairs)
    told = read(path, {"command": "0.01 * Current"}, unit="A")
    np.testing.assert_allclose(told["command"], LOG["command"], rtol=1e-9, atol=1e-9)
    assert not any("the unit of the drive" in sentence for sentence in told.repairs)


@pytest.mark.parametrize("unit", ["‰", "N m"])
def test_a_stated_unit_is_not_asked_for(unit: str, tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", **{"q{}": LOG["q"], f"Mom{{}} [{unit}]": 50.0 * LOG["command"]})
    with pytest.raises(DataError, match=f'The header says {unit}: .*"command_.*" = "0.15') as refused:
        read(path, {"command": "Mom"})
    assert "State the unit" not in refused.value.next_step


def test_a_command_of_another_quantity_and_positions_in_counts_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", **{"q{}": LOG["q"], "tau{} [A]": LOG["command"]})
    with pytest.raises(DataError, match=r"in A, but command is in N m.*tau1 \[A\]"):
        read(path)
    path = written(tmp_path / "run.csv", **{"q{} [ticks]": LOG["q"] / 1e-3, "tau{}": LOG["command"]})
    with pytest.raises(DataError, match="in ticks, but q is in rad"):
        read(path)
    found = read(path, {"q": "1e-3 * q"})
    np.testing.assert_allclose(found["q"], LOG["q"], rtol=1e-9, atol=1e-9)


TURN = 2.0 * math.pi
SPELLINGS = [
    *(("q", unit, 1.0) for unit in ("radians", "radian")),
    *(("q", unit, math.pi / 180.0) for unit in ("degree", "degs")),
    *(("q", unit, TURN) for unit in ("rev", "turns", "revolutions")),
    *(("qd", unit, 1.0) for unit in ("rad/sec", "rad s^-1", "rad s⁻¹", "rad*s-1", "radians per second")),
    *(("qd", unit, math.pi / 180.0) for unit in ("deg/sec", "deg s^-1", "degrees/second")),
    *(("qd", unit, TURN / 60.0) for unit in ("rpm", "rev/min", "RPM", "revolutions per minute")),
    *(("command", unit, 1.0) for unit in ("N·m", "N-m", "N m", "Nm", "newton meters", "N.m")),
    *(("command", unit, 1e-3) for unit in ("mNm", "mN·m", "N mm", "mN-m")),
    *(("command", unit, 0.0980665) for unit in ("kgf cm", "kg·cm")),
]


@pytest.mark.parametrize(("channel", "unit", "factor"), SPELLINGS)
def test_units_of_the_field_are_read(channel: str, unit: str, factor: float, tmp_path: Path) -> None:
    velocity = np.gradient(LOG["q"], LOG.t, axis=0)
    values = {"q": LOG["q"], "qd": velocity, "command": LOG["command"]}
    words = {"q": "position_{}", "qd": "velocity_{}", "command": "effort_{}"}
    columns = {
        words[name] + (f" [{unit}]" if name == channel else ""): own / (factor if name == channel else 1.0)
        for name, own in values.items()
    }
    found = read_log(written(tmp_path / "run.csv", **columns), CHANNELS, rate=RATE, limits=LIMITS)
    np.testing.assert_allclose(found[channel], values[channel], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("unit", ["‰", "per mille of rated torque", "%"])
def test_parts_of_a_rated_torque_are_taken_as_they_are_and_said(unit: str, tmp_path: Path) -> None:
    columns = {"q{}": LOG["q"], f"tau{{}} [{unit}]": LOG["command"]}
    found = read(written(tmp_path / "run.csv", **columns))
    np.testing.assert_allclose(found["command"], LOG["command"], rtol=1e-9, atol=1e-9)
    assert any("the unit of the drive" in sentence for sentence in found.repairs)


@pytest.mark.parametrize(
    "header", ["t [seconds]", "Time (sec)", "time_sec", "time [msec]", "time_milliseconds"]
)
def test_times_are_read_in_any_spelling_of_their_unit(header: str, tmp_path: Path) -> None:
    per_second = 1000.0 if "m" in header.lower().split("time")[-1] else 1.0
    path = written(tmp_path / "run.csv", **{"q{}": LOG["q"], "tau{}": LOG["command"]})
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 0] *= per_second
    first = path.read_text().splitlines()[0].replace("t,", f"{header},", 1)
    np.savetxt(path, rows, delimiter=",", header=first, comments="", fmt="%.10g")
    np.testing.assert_allclose(read(path).t, LOG.t, atol=1e-6)
