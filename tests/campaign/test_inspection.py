"""inspect says what it sees of any file, with or without a robot, and never breaks."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from small_robot import ROBOT, SHORT, make_campaign, random_motion, write_log

from etude.campaign import Campaign, Inspected, inspect
from etude.cli import main
from etude.logs import Mendable
from etude.types import Finding

EXAMPLES = Path(__file__).parents[2] / "examples"
LIGHTS = ("green", "yellow", "red", "cannot tell")
Rows = np.ndarray


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "pair.toml"
    path.write_text(ROBOT)
    return path


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    """Motions that are long enough for all that a log can tell."""
    return make_campaign(tmp_path, config=SHORT.replace("duration = 8.0", "duration = 12.0"))


@pytest.fixture
def right(campaign: Campaign, tmp_path: Path) -> Path:
    return write_log(tmp_path / "right.csv", random_motion(campaign, 1), 1, start=0.0)


def edited(path: Path, change) -> Path:
    """The log with its rows (T, 5) changed: t, q (2), tau (2)."""
    lines = path.read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    text = [lines[0], *(",".join(map(repr, row)) for row in change(rows).tolist())]
    other = path.with_name("edited.csv")
    other.write_text("\n".join(text) + "\n")
    return other


def lights(found: Inspected) -> dict[str, str]:
    return {f.check: f.light for f in found.findings}


def test_a_right_log_is_green_with_and_without_a_robot(right: Path, robot: Path) -> None:
    described, guessed = inspect(right, robot), inspect(right)
    assert not described.refused
    assert not guessed.refused
    assert {
        "rate",
        "gaps",
        "repeats",
        "jumps",
        "noise",
        "rest",
        "coverage",
        "delay",
        "sign",
        "swapped",
    } <= set(lights(described))
    assert "coverage" not in lights(guessed)
    assert "guessed from the headers, q (hip, knee)" in guessed.findings[0].sentence


def test_a_log_that_was_cut_is_worth_a_look(right: Path, robot: Path) -> None:
    data = right.read_bytes()
    right.write_bytes(data[: data.rindex(b",")])
    found = {f.check: f for f in inspect(right, robot).findings}
    assert found["end"].light == "yellow"
    assert "was cut in the middle of a line" in found["end"].sentence
    assert "was cut" not in found["columns"].sentence


def step(rows: Rows, row: slice, column: int | slice, value: float) -> Rows:
    rows = rows.copy()
    rows[row, column] = value
    return rows


def held(rows: Rows, each: int) -> Rows:
    return rows[(np.arange(len(rows)) // each) * each]


FAULTS = {
    "the clock jumps back": (lambda r: step(r, slice(300, 303), 0, 1.0), "order", "yellow"),
    "the clock jumps ahead": (lambda r: r[(r[:, 0] < 4) | (r[:, 0] > 5)], "gaps", "yellow"),
    "rows repeat": (lambda r: np.repeat(r, 2, axis=0), "repeats", "yellow"),
    "rows are held": (lambda r: np.column_stack([r[:, 0], held(r[:, 1:], 4)]), "held", "yellow"),
    "commands are held": (lambda r: np.column_stack([r[:, :3], held(r[:, 3:], 8)]), "held_commands", "red"),
    "magnitudes": (lambda r: np.column_stack([r[:, :3], np.abs(r[:, 3:])]), "unsigned", "yellow"),
    "copied": (lambda r: r[:, [0, 1, 2, 3, 3]], "copied", "red"),
    "drives off": (lambda r: step(r, slice(300, 400), slice(3, 5), 0.0), "off", "yellow"),
    "a joint never moves": (lambda r: step(r, slice(None), 1, 0.2), "rest", "yellow"),
    "in the brake": (lambda r: step(r, slice(None), slice(1, 3), 0.2), "rest", "red"),
    "a command is dead": (lambda r: step(r, slice(None), 4, 0.0), "dead", "red"),
    "empty cells": (lambda r: step(r, slice(10, 60), 2, np.nan), "empty", "yellow"),
    "an empty column": (lambda r: step(r, slice(None), 3, np.nan), "empty", "red"),
    "coarse": (
        lambda r: np.column_stack([r[:, :1], np.round(r[:, 1:3], 2), r[:, 3:]]),
        "quantisation",
        "yellow",
    ),
    "a wild cell": (lambda r: step(r, slice(300, 301), 1, 0.9), "jumps", "yellow"),
    "clipped": (lambda r: np.clip(r, -1.2, 100.0), "saturation", "yellow"),
    "late": (lambda r: np.column_stack([r[:-6, :1], r[:-6, 1:3], r[6:, 3:]]), "delay", "yellow"),
    "sign": (lambda r: r * [1, 1, 1, -1, 1], "sign", "red"),
    "backwards": (lambda r: np.column_stack([r[:, 0], r[::-1, 1:]]), "direction", "yellow"),
    "swapped": (lambda r: r[:, [0, 1, 2, 4, 3]], "swapped", "red"),
    "one row": (lambda r: r[:1], "columns", "red"),
    "nothing but a header": (lambda r: r[:0], "columns", "red"),
    "stamps of nothing": (lambda r: step(r, slice(None), 0, 5.0), "columns", "red"),
}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_its_light_and_its_sentence(name: str, right: Path, robot: Path) -> None:
    change, check, light = FAULTS[name]
    path = edited(right, change)
    described = inspect(path, robot)
    for found in (described, inspect(path)):
        assert all(f.light in LIGHTS and f.sentence for f in found.findings)
    assert light in [f.light for f in described.findings if f.check == check], described


def test_what_is_mended_is_not_refused_and_is_said_once(right: Path, robot: Path) -> None:
    path = edited(right, lambda r: np.column_stack([r[:, 0], held(r[:, 1:], 4)]))
    found = inspect(path, robot)
    assert not found.refused
    assert sum("Every row is repeated 4 times" in f.sentence for f in found.findings) == 1


def table(path: Path, columns: dict[str, object]) -> Path:
    """A CSV file with these columns."""
    rows = zip(*columns.values(), strict=True)  # type: ignore[call-overload]
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def flight() -> dict[str, object]:
    """Of a vehicle: its orientation and four motors by number, as arms number joints; cells of text."""
    t = 0.02 * np.arange(400)
    half = 0.5 * np.sin(t)
    turn = {"q0": np.cos(half), "q1": np.sin(half), "q2": 0.0 * t, "q3": 0.0 * t}
    motors = {f"u{k}": 0.5 + 0.1 * np.sin(t + k) for k in range(4)}
    return {"t": t, **turn, **motors, "mode": ["position"] * 400, "phi": np.where(t < 3.0, np.nan, t)}


def test_without_a_robot_an_orientation_is_no_four_joints(tmp_path: Path) -> None:
    found = inspect(table(tmp_path / "flight.csv", flight()))
    assert not found.refused
    assert "q0, q1, q2, q3 are not joints but an orientation" in found.findings[0].sentence
    arm = {n: 1.01 * v if n[0] == "q" else v for n, v in flight().items()}  # type: ignore[operator]
    assert "q (joint_0" in inspect(table(tmp_path / "arm.csv", arm)).findings[0].sentence


def test_without_a_robot_no_column_is_needed(tmp_path: Path) -> None:
    """So one that lacks cells, or holds text, is no reason for tell to refuse the log."""
    found = {f.check: f for f in inspect(table(tmp_path / "flight.csv", flight())).findings}
    assert found["empty"].light == "yellow"
    assert "mode: 100 %" in found["empty"].sentence
    assert "mode" not in found["dead"].sentence
    assert found["motion"].sentence == "Without --robot it is unknown which columns are positions."
    assert "units" not in found


def test_a_guess_that_does_not_fit_is_said_and_refuses_nothing(tmp_path: Path) -> None:
    columns = {name: values for name, values in flight().items() if name != "u2"}
    found = inspect(table(tmp_path / "plane.csv", columns))
    assert not found.refused
    assert "The headers do not identify the joints (" in found.findings[0].sentence


@pytest.mark.parametrize(("step", "light"), [(0.02, "green"), (1.0, "yellow"), (1e-5, "yellow")])
def test_a_clock_that_no_robot_has_is_worth_a_look(step: float, light: str, tmp_path: Path) -> None:
    columns = {"t [s]": step * np.arange(400), "x": np.sin(0.02 * np.arange(400))}
    assert lights(inspect(table(tmp_path / "log.csv", columns)))["rate"] == light


@pytest.mark.parametrize(
    "content", [b"", b"\x00\xff\x00", b"a,b\n1,2\n", b"t,q_hip\n0,nan\n1,inf\n", b"PK\x03\x04"]
)
def test_a_file_that_is_no_log_is_a_finding(content: bytes, tmp_path: Path, robot: Path) -> None:
    path = tmp_path / "no.csv"
    path.write_bytes(content)
    assert inspect(path).findings
    assert inspect(path, robot).refused


@pytest.mark.parametrize(("rows", "ms"), [(6, 120), (15, 300)])
def test_a_delay_is_told_however_long(rows: int, ms: int, right: Path, robot: Path) -> None:
    late = edited(right, lambda r: np.column_stack([r[:-rows, :1], r[:-rows, 1:3], r[rows:, 3:]]))
    (found,) = (f for f in inspect(late, robot).findings if f.check == "delay")
    assert found.light == "yellow"
    told = float(re.findall(r"(\d+) ms", found.sentence)[0])
    assert told == pytest.approx(ms, abs=10)


@pytest.mark.parametrize("mends", [False, True])
def test_a_log_that_tell_repairs_is_not_taken_as_it_is(
    mends: bool, right: Path, robot: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = Mendable if mends else Finding
    found = Inspected(
        None, (kind("delay", "yellow", "They are late.", "Ingestion shifts them by this time."),)
    )
    monkeypatch.setattr("etude.campaign.ingest.inspection.inspect", lambda *_, **__: found)
    assert main(["inspect", str(right), "--robot", str(robot)]) == 0
    said = capsys.readouterr().out
    assert ("tell would ingest this log, with the repairs above" in said) == mends
    assert ("tell would ingest this log without repairs" in said) != mends


@pytest.mark.parametrize(
    "seconds", [-0.35, *(pytest.param(own, marks=pytest.mark.slow) for own in (-0.2, 0.2, 0.3, 0.45))]
)
def test_commands_of_a_real_arm_may_be_far_behind_or_ahead(seconds: float, tmp_path: Path) -> None:
    """Six joints of UR10 tell half a second to 35 ms, whatever their friction does."""
    lines = (EXAMPLES / "ur10" / "ur10_exciting.csv").read_text().splitlines()
    rows = np.array([line.split(",") for line in lines[1:2501]], dtype=float)
    for column in range(13, 19):
        rows[:, column] = np.interp(rows[:, 0] - seconds, rows[:, 0], rows[:, column])
    path = tmp_path / "late.csv"
    np.savetxt(path, rows, delimiter=",", header=lines[0], comments="")
    found = [f for f in inspect(path, EXAMPLES / "ur10" / "ur10.toml").findings if f.check == "delay"]
    (told,) = re.findall(r"(\d+) ms (behind|ahead)", found[0].sentence)
    assert told[1] == ("behind" if seconds > 0.0 else "ahead")
    assert float(told[0]) == pytest.approx(1e3 * abs(seconds), abs=35)


def test_a_motion_that_every_delay_fits_tells_none(right: Path, robot: Path) -> None:
    """Commands that grow steadily fit any of them: the longest that is tried is no best one."""

    def slowly(r: Rows) -> Rows:
        t = r[:, 0] + 1.0
        return np.column_stack([r[:, 0], np.sin(0.3 * t), np.cos(0.3 * t), np.exp(0.1 * t), np.exp(0.09 * t)])

    slow = edited(right, slowly)
    (found,) = (f for f in inspect(slow, robot).findings if f.check == "delay")
    assert (found.light, "cannot be determined" in found.sentence) == ("cannot tell", True), found


def test_of_a_vehicle_no_delay_of_joints_is_told() -> None:
    flight = EXAMPLES / "crazyflie" / "log16"
    assert "delay" not in lights(inspect(flight, EXAMPLES / "crazyflie" / "crazyflie.toml"))


def test_random_damage_never_breaks_it(right: Path, robot: Path) -> None:
    data, rng = right.read_bytes(), np.random.default_rng(3)
    path = right.with_name("damaged.csv")
    for _ in range(10):
        raw = bytearray(data[: int(rng.integers(40, len(data)))])
        for place in rng.integers(0, len(raw), 20):
            raw[place] = int(rng.integers(0, 256))
        path.write_bytes(bytes(raw))
        assert inspect(path, robot).findings


def test_the_command_says_draws_and_ends_with_its_code(
    right: Path, robot: Path, tmp_path: Path, capsys
) -> None:
    picture = tmp_path / "log.svg"
    assert main(["inspect", str(right), "--robot", str(robot), "--picture", str(picture)]) == 0
    assert "tell would ingest this log without repairs" in capsys.readouterr().out
    assert picture.read_text().startswith("<svg")
    wrong = edited(right, FAULTS["sign"][0])
    assert main(["inspect", str(wrong), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert found["refused"]
    assert [f["flag"] for f in found["findings"] if f["flag"]] == ["sign"]
    assert main(["inspect", str(tmp_path / "none.csv")]) == 3


def test_marked_spans_are_drawn(right: Path, robot: Path, tmp_path: Path) -> None:
    picture = tmp_path / "log.svg"
    wrong = edited(right, FAULTS["the clock jumps ahead"][0])
    main(["inspect", str(wrong), "--robot", str(robot), "--picture", str(picture)])
    assert "marked: gaps" in picture.read_text()


def test_a_mapping_is_written_for_a_robot(right: Path, robot: Path, capsys) -> None:
    assert main(["inspect", str(right), "--robot", str(robot), "--write-mapping"]) == 0
    assert '"q_hip" = "q_hip"' in capsys.readouterr().out
    assert main(["inspect", str(right), "--write-mapping"]) == 2


def test_a_campaign_s_table_of_names_holds(campaign: Campaign, right: Path) -> None:
    """A log under names that say nothing is looked at as the campaign would, and not by its robot alone."""
    names = dict(zip(right.read_text().splitlines()[0].split(","), "ABCDE", strict=True))
    other = right.with_name("other.csv")
    other.write_text(",".join(names.values()) + "\n" + right.read_text().partition("\n")[2])
    config = campaign.path / "campaign.toml"
    lines = "".join(f'"{name}" = "{letter}"\n' for name, letter in names.items())
    config.write_text(config.read_text().partition("[log]")[0] + "[log.columns]\n" + lines)
    assert inspect(other, campaign.path / "robot.toml").refused
    found = inspect(other, campaign.path)
    assert not found.refused
    assert "By [log.columns]" in found.findings[0].sentence


def one_wild_time(rows: Rows) -> Rows:
    rows[len(rows) // 2, 0] = 1e9
    return rows


def test_what_tell_mends_is_not_called_wrong(right: Path, robot: Path) -> None:
    """One wild time is a pause of decades to who looks at the clock alone."""
    found = inspect(edited(right, one_wild_time), robot)
    assert lights(found)["gaps"] == "yellow"
    assert not found.refused


def constant_command(rows: Rows) -> Rows:
    rows[:, 3] = 1.0
    return rows


def test_what_tell_refuses_stays_wrong(right: Path, robot: Path) -> None:
    found = inspect(edited(right, constant_command), robot)
    assert lights(found)["dead"] == "red"
    assert found.refused


def test_without_a_robot_nothing_is_promised(right: Path, robot: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    assert main(["inspect", str(right)]) == 0
    assert "depends on the robot (--robot)" in capsys.readouterr().out
    assert main(["inspect", str(right), "--robot", str(robot)]) == 0
    assert "tell would ingest this log without repairs" in capsys.readouterr().out
