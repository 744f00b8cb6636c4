"""A controller's state in a table, as PlotJuggler exports it: what was measured, wanted and sent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log

from etude.errors import DataError
from etude.logs import read_log
from etude.logs.columns.headers import doubles, plain
from etude.types import Log

LOG = make_log()
TOPIC = "/joint_trajectory_controller/controller_state"
WANTED, SENT = 1.1, 0.5
"""Parts of what is measured, so that a mistake shows."""


def read(path: Path) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS)


def table(entry: str, measured: str, wanted: str, effort: str) -> dict[str, np.ndarray]:
    """One release's columns; entry: how one of an array is written."""
    found = {"__time": 1.7e9 + LOG.t, f"{TOPIC}/header/stamp": 1.7e9 + LOG.t}
    for i in range(len(JOINTS)):
        at = entry.format(i)
        found[f"{TOPIC}/{measured}/positions{at}"] = LOG["q"][:, i]
        found[f"{TOPIC}/{wanted}/positions{at}"] = WANTED * LOG["q"][:, i]
        found[f"{TOPIC}/error/positions{at}"] = 0.1 * LOG["q"][:, i]
        found[f"{TOPIC}/{effort}/effort{at}"] = LOG["command"][:, i]
    return found


def written(path: Path, columns: dict[str, object]) -> Path:
    pl.DataFrame(columns).write_csv(path)
    return path


@pytest.mark.parametrize("entry", ["[{}]", ".{}"])
@pytest.mark.parametrize(("measured", "wanted"), [("feedback", "reference"), ("actual", "desired")])
@pytest.mark.parametrize("effort", ["output", "measured"])
def test_entries_are_joints_by_number(
    entry: str, measured: str, wanted: str, effort: str, tmp_path: Path
) -> None:
    own = table(entry, measured, wanted, measured if effort == "measured" else effort)
    log = read(written(tmp_path / "run.csv", own))
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])
    assert any("were read as pan_joint, lift_joint, elbow_joint, in this order" in s for s in log.repairs)


def test_names_beside_the_entries_decide(tmp_path: Path) -> None:
    """As pandas or a recorder of one's own writes them; a table of numbers alone has no names."""
    own: dict[str, object] = dict(table("[{}]", "feedback", "reference", "output"))
    for i, name in enumerate(JOINTS):
        own[f"{TOPIC}/joint_names[{i}]"] = [name] * len(LOG)
    names = list(own)
    turned = dict(zip(names, [own[name] for name in names], strict=True))
    for kind in (
        "feedback/positions",
        "reference/positions",
        "error/positions",
        "output/effort",
        "joint_names",
    ):
        first, last = f"{TOPIC}/{kind}[0]", f"{TOPIC}/{kind}[2]"
        turned[first], turned[last] = own[last], own[first]
    log = read(written(tmp_path / "run.csv", turned))
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])


def test_of_humble_the_older_names_are_left_out_beside_the_newer(tmp_path: Path) -> None:
    newer = table("[{}]", "feedback", "reference", "output")
    older = {
        name: -value
        for name, value in table("[{}]", "actual", "desired", "actual").items()
        if "error" not in name
    }
    measured = {name: -2.0 * value for name, value in older.items() if "effort" not in name}
    log = read(written(tmp_path / "run.csv", {**measured, **newer}))
    np.testing.assert_array_equal(log["q"], LOG["q"])


def test_another_count_of_joints_is_refused(tmp_path: Path) -> None:
    own = {
        name: value
        for name, value in table("[{}]", "feedback", "reference", "output").items()
        if "[2]" not in name
    }
    with pytest.raises(DataError, match="numbered 0, 1, which are not the 3 parts"):
        read(written(tmp_path / "run.csv", own))


@pytest.mark.parametrize(
    ("header", "means"),
    [
        ("a_controller_state_feedback_positions_0", "position_0"),
        ("controller_state_actual_velocities_12", "velocity_12"),
        ("x_controller_state_reference_accelerations_1", "acceleration_desired_1"),
        ("controller_state_desired_positions_2", "position_desired_2"),
        ("controller_state_output_effort_0", "effort_0"),
        ("controller_state_feedback_effort_0", "effort_0"),
        ("controller_state_joints_elbow_feedback_position", "position_elbow"),
        ("controller_state_output_positions_0", ""),
        ("controller_state_reference_effort_0", ""),
        ("controller_state_error_positions_0", ""),
        ("controller_state_feedback_positions", ""),
        ("joint_states_elbow_position", ""),
    ],
)
def test_what_a_column_means(header: str, means: str) -> None:
    assert plain(header) == means


def test_the_first_of_two_that_say_the_same_is_taken() -> None:
    stem = "/controller_state"
    twice = [f"{stem}/{p}/effort[0]" for p in ("output", "actual", "feedback")]
    assert doubles([*twice, f"{stem}/output/effort[1]", "t"]) == set(twice[:2])
