"""With a model file: an encoder's zero that is off is asked about, and computed commands are said. Logs of
two robots contradict each other, with the file and without one, and one log contradicts itself.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_robot import random_motion
from test_changed_load import ARM, TIMES, arm, saved, written
from test_payload import carrying

from etude import tell
from etude.campaign import Campaign, create_campaign, inspect
from etude.campaign.ingest.questions import body_of, file_findings_of
from etude.campaign.ingest.tell import surveyed
from etude.errors import DataError
from etude.logs import Mendable
from etude.types import Array, Finding, Log

JOINTS = ("turn", "lift", "bend")
FRICTION = np.array([3.0, 4.0, 2.0])


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return arm(tmp_path_factory.mktemp("file"))


def log_of(
    path: Path,
    lab: Campaign,
    offset: Array | float = 0.0,
    masses: Array | float = 1.0,
    friction: float = 1.0,
    seed: int = 7,
    clock: float = 1.0,
    warm: float = 1.0,
) -> Path:
    """The arm along a motion: encoders that read `offset` (3,) too much, masses times the file's, times that
    are `clock` times too long, and friction that goes to `warm` times what it is.
    """
    motion = random_motion(lab, seed)
    t = np.arange(0.0, TIMES * motion.duration, 0.02)
    orders = motion.motion(t % motion.duration, 3).orders
    states = Log(t, {}, {}, "states")
    for channel, values in zip(lab.channels, orders, strict=False):
        states = states.put(channel, values)
    body = body_of(lab.kind, lab.spec)
    assert body is not None
    links = replace(body.model, inertial=body.model.inertial * np.repeat(masses * np.ones(3), 10))  # type: ignore[attr-defined]
    rubs = friction * np.linspace(1.0, warm, len(t))[:, None] * FRICTION
    command = links.predict(*orders) + rubs * np.tanh(orders[1] / 0.05)
    return saved(path, clock * t, orders[0] + offset, command, seed)


def found(path: Path, lab: Campaign) -> dict[str, Finding]:
    return {f.check: f for f in inspect(path, lab.path).findings}


@pytest.mark.parametrize(
    ("joint", "degrees"), [(1, 6.0), *(pytest.param(1, own, marks=pytest.mark.slow) for own in (-6.0, 12.0))]
)
def test_a_zero_that_is_off_is_asked_about_with_its_size(
    joint: int, degrees: float, lab: Campaign, tmp_path: Path
) -> None:
    path = log_of(tmp_path / "run.csv", lab, np.radians(degrees) * (np.arange(3) == joint))
    finding = found(path, lab)["zero"]
    assert (finding.light, finding.flag) == ("yellow", "zero")
    told, _, words = finding.sentence.partition(" reads ")[2].partition(" +- ")
    assert f"the position of {JOINTS[joint]}" in finding.sentence
    assert float(told) == pytest.approx(abs(degrees), abs=1.0)
    assert ("too much" in words) is (degrees > 0.0)
    with pytest.raises(DataError, match="reads"):
        tell(lab, path, foreign=True)


def multiplied(log: Path, column: int, factor: float) -> tuple[Path, str]:
    """A copy of a log with a column times a factor, and the name of that column."""
    header, rows = log.read_text().splitlines()[0], np.loadtxt(log, delimiter=",", skiprows=1)
    rows[:, column] *= factor
    path = log.with_name("multiplied.csv")
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path, header.split(",")[column]


@pytest.mark.parametrize(
    ("joint", "factor"),
    [(1, 0.5), *(pytest.param(*own, marks=pytest.mark.slow) for own in ((2, 2.0), (1, 1.4)))],
)
def test_positions_of_one_joint_that_are_a_multiple_are_asked_about_with_their_factor(
    joint: int, factor: float, lab: Campaign, tmp_path: Path
) -> None:
    """Its gear was not applied, or its counts for each turn are wrong; masses are not those of the file."""
    right = log_of(tmp_path / "right.csv", lab, masses=np.array([1.0, 1.2, 0.8]))
    path, name = multiplied(right, 1 + joint, factor)
    finding = found(path, lab)["gear"]
    assert (finding.light, finding.flag) == ("yellow", "gear")
    told = re.search(r"the positions of (\w+) are ([\d.]+) times the true ones", finding.sentence)
    assert told is not None
    assert told[1] == JOINTS[joint]
    assert float(told[2]) == pytest.approx(factor, rel=0.2)  # masses are 20 % off
    with pytest.raises(DataError, match="times the true ones"):
        tell(lab, path, foreign=True)
    shutil.copytree(lab.path, tmp_path / "mended")
    with (tmp_path / "mended" / "campaign.toml").open("a") as config:
        config.write(f'[log.columns]\n"{name}" = "{1.0 / factor:.6g} * {name}"\n')
    assert [f for f in inspect(path, tmp_path / "mended").findings if f.flag] == []


# by symmetry nothing tells either from the other at the first joint, about a vertical axis
@pytest.mark.parametrize("joint", [2, pytest.param(1, marks=pytest.mark.slow)])
def test_inverted_positions_are_no_inverted_commands(joint: int, lab: Campaign, tmp_path: Path) -> None:
    """The repair of the commands would turn the weight round."""
    right = log_of(tmp_path / "right.csv", lab)
    header, rows = right.read_text().splitlines()[0], np.loadtxt(right, delimiter=",", skiprows=1)
    for column, words in (
        (1 + joint, "positions of {} have the wrong sign, not their"),
        (4 + joint, "commands of {} is inverted"),
    ):
        signs = np.where(np.arange(7) == column, -1.0, 1.0)
        path = tmp_path / f"{column}.csv"
        np.savetxt(path, rows * signs, delimiter=",", header=header, comments="")
        (finding,) = [f for f in inspect(path, lab.path).findings if f.flag]
        assert words.format(JOINTS[joint]) in finding.sentence
        assert ("--repair sign" in finding.step) is (column > 3)


@pytest.mark.parametrize("masses", [pytest.param(1.0, marks=pytest.mark.slow), np.array([1.0, 1.3, 0.8])])
def test_a_joint_that_turns_the_other_way_is_named_and_its_columns_are_turned(
    masses: Array | float, lab: Campaign, tmp_path: Path
) -> None:
    """Positions and commands of lift are both inverted: only what couples them to others is wrong."""
    right = log_of(tmp_path / "right.csv", lab, masses=masses)
    header, rows = right.read_text().splitlines()[0], np.loadtxt(right, delimiter=",", skiprows=1)
    path = tmp_path / "run.csv"
    np.savetxt(path, rows * [1, 1, -1, 1, 1, -1, 1], delimiter=",", header=header, comments="")
    finding = found(path, lab)["reversed"]
    assert (finding.light, finding.flag) == ("yellow", "reversed")
    assert "lift turns in the opposite direction to the file" in finding.sentence
    with pytest.raises(DataError, match="lift turns in the opposite direction"):
        tell(lab, path, foreign=True)
    shutil.copytree(lab.path, tmp_path / "turned")
    lines = [f'"{name}" = "-1 * {name}"' for name in header.split(",")[2:6:3]]
    with (tmp_path / "turned" / "campaign.toml").open("a") as config:
        config.write("\n".join(["[log.columns]", *lines, ""]))
    assert [f for f in inspect(path, tmp_path / "turned").findings if f.flag] == []


def test_positions_of_one_joint_that_are_late_are_asked_about(lab: Campaign, tmp_path: Path) -> None:
    """By the file alone, whatever its own commands say."""
    path = log_of(tmp_path / "run.csv", lab, masses=np.array([1.0, 1.2, 0.8]))
    t, *rows = np.loadtxt(path, delimiter=",", skiprows=1).T
    q, command = np.column_stack(rows[:3]), np.column_stack(rows[3:])
    q[:, 1] = np.interp(t - 0.08, t, q[:, 1])
    channels = {c.name: c for c in lab.channels}
    log = Log(t, {}, {}, "run").put(channels["q"], q).put(channels["command"], command)
    (finding,) = file_findings_of(lab.kind, lab.spec, log, {})
    assert (finding.light, finding.flag) == ("yellow", "delay")
    told = re.search(r"the positions of lift are (\d+) ms behind the others", finding.sentence)
    assert told is not None
    assert float(told[1]) == pytest.approx(80, abs=25)


@pytest.mark.parametrize(
    ("clock", "said"),
    [pytest.param(2.0, "2 times too slow", marks=pytest.mark.slow), (0.5, "2 times too fast")],
)
def test_a_clock_that_is_off_is_seen_by_the_model_file(
    clock: float, said: str, lab: Campaign, tmp_path: Path
) -> None:
    """No velocities are logged; masses are not those of the file, friction is small beside inertia."""
    path = log_of(tmp_path / "run.csv", lab, masses=np.array([1.0, 1.3, 0.8]), friction=0.1, clock=clock)
    finding = found(path, lab)["time"]
    assert (finding.light, finding.flag) == ("yellow", "time")
    assert said in finding.sentence
    assert isinstance(finding, Mendable)  # what --repair divides the times by
    assert finding.by == (clock,)


@pytest.mark.parametrize(
    "masses",
    [
        1.0,
        pytest.param(np.array([1.0, 1.3, 0.8]), marks=pytest.mark.slow),
        np.array([0.7, 0.8, 1.25]),
    ],
)
@pytest.mark.parametrize("seed", [7, *(pytest.param(own, marks=pytest.mark.slow) for own in (8, 9))])
def test_a_right_log_is_not_asked_about(
    masses: Array | float, seed: int, lab: Campaign, tmp_path: Path
) -> None:
    path = log_of(tmp_path / "run.csv", lab, masses=masses, seed=seed, warm=0.75)
    checks = found(path, lab)
    assert "computed" not in checks
    assert [f for f in checks.values() if f.flag] == []


@pytest.mark.parametrize(
    ("joint", "factor"),
    [(1, 0.5), *(pytest.param(*own, marks=pytest.mark.slow) for own in ((2, 2.5), (1, 4.0)))],
)
def test_another_unit_of_one_command_is_asked_about_with_its_factor(
    joint: int, factor: float, lab: Campaign, tmp_path: Path
) -> None:
    right = log_of(tmp_path / "right.csv", lab, masses=np.array([1.0, 1.2, 0.8]))
    path, _ = multiplied(right, 4 + joint, factor)
    finding = found(path, lab)["scale"]
    assert (finding.light, finding.flag) == ("yellow", "scale")
    told = re.search(r"The commands of (\w+) are ([\d.]+) times the torque", finding.sentence)
    assert told is not None
    assert told[1] == JOINTS[joint]
    assert float(told[2]) == pytest.approx(factor, rel=0.25)  # masses are 20 % off
    with pytest.raises(DataError, match="times the torque"):
        tell(lab, path, foreign=True)
    path, _ = multiplied(path, 4 + joint, 1.0 / factor)  # as the message asks
    assert [f for f in inspect(path, lab.path).findings if f.flag] == []


def test_commands_that_are_all_half_of_the_files_are_learned_with_a_sentence(tmp_path: Path) -> None:
    """A torque constant that all drives share cannot be told from wrong masses; the user has to know."""
    (tmp_path / "own").mkdir()
    lab = arm(tmp_path / "own")
    right = log_of(tmp_path / "right.csv", lab, friction=0.05)
    header, rows = right.read_text().splitlines()[0], np.loadtxt(right, delimiter=",", skiprows=1)
    rows[:, 4 : 4 + len(JOINTS)] *= 0.5
    path = tmp_path / "run.csv"
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    taken = tell(lab, path, foreign=True).repairs
    assert any("all factors are alike" in sentence for sentence in taken), taken


@pytest.mark.parametrize(
    "masses", [np.array([1.0, 2.5, 1.0]), pytest.param(np.array([1.0, 1.0, 2.5]), marks=pytest.mark.slow)]
)
def test_one_link_of_another_mass_is_no_other_unit(masses: Array, lab: Campaign, tmp_path: Path) -> None:
    checks = found(log_of(tmp_path / "run.csv", lab, masses=masses), lab)
    assert checks["scale"].light != "yellow", checks["scale"].sentence


def test_commands_that_were_computed_are_said_and_taken(lab: Campaign, tmp_path: Path) -> None:
    path = log_of(tmp_path / "run.csv", lab, friction=0.0)
    finding = found(path, lab)["computed"]
    assert (finding.light, finding.flag) == ("yellow", "")
    assert "seem computed, not measured" in finding.sentence
    assert ARM.count("inertial") == 6  # the file has all masses, or nothing is told


@pytest.mark.slow
def test_logs_of_two_robots_told_together_contradict_each_other(lab: Campaign, tmp_path: Path) -> None:
    """The third arm has other masses than the two before; by no load at its last link."""
    logs = [log_of(tmp_path / f"{k}.csv", lab, seed=k) for k in (7, 8)]
    other = log_of(tmp_path / "other.csv", lab, masses=np.array([1.0, 0.2, 2.5]), seed=9)
    told = tell(lab, [*logs, other], foreign=True)
    assert [file.ingested for file in told.files] == [None] * 3
    assert "other.csv contradicts the other logs" in told.files[0].sentence
    assert told.files[0].refused is not None
    assert "--accept contradiction" in told.files[0].refused.next_step


def test_a_load_in_one_of_two_logs_is_what_they_differ_by(lab: Campaign, tmp_path: Path) -> None:
    plain = log_of(tmp_path / "plain.csv", lab, seed=7)
    loaded = written(tmp_path / "loaded.csv", lab, random_motion(lab, 7), kg=1.5)
    told = tell(lab, [loaded, plain], foreign=True)
    said = told.files[0].sentence
    assert "loaded.csv and plain.csv contradict each other" in said
    assert float(said.split(" kg more")[0].split()[-1]) == pytest.approx(1.5, rel=0.1)
    assert "in loaded.csv explains it" in said


@pytest.mark.slow
def test_logs_of_one_robot_do_not_contradict(lab: Campaign, tmp_path: Path) -> None:
    logs = [log_of(tmp_path / f"{k}.csv", lab, masses=np.array([0.8, 1.2, 0.9]), seed=k) for k in (7, 8)]
    survey = surveyed(lab, logs, {"foreign": True})
    assert survey is not None
    assert [step for path in logs for step in survey.of(path)] == []


def test_friction_that_differs_between_logs_is_named_and_warmth_is_not(lab: Campaign, tmp_path: Path) -> None:
    masses = np.array([0.8, 1.2, 0.9])
    logs = [log_of(tmp_path / f"{k}.csv", lab, masses=masses, seed=k) for k in (7, 8)]
    warm = log_of(tmp_path / "warm.csv", lab, masses=masses, friction=0.8, seed=9)
    assert steps_of(lab, [*logs, warm]) == [[], [], []]
    greased = log_of(tmp_path / "greased.csv", lab, masses=masses, friction=0.5, seed=9)
    survey = surveyed(lab, [*logs, greased], {"foreign": True})
    assert survey is not None
    ((step,),) = {tuple(survey.of(path)) for path in (*logs, greased)}
    said = re.search(r"Friction ([\d.]+) times as large in greased\.csv explains it", step.finding.sentence)
    assert said is not None
    assert float(said[1]) == pytest.approx(0.5, abs=0.05)


@pytest.fixture
def bare(tmp_path: Path) -> Campaign:
    """The same joints in a file without masses."""
    path = tmp_path / "bare.urdf"
    path.write_text(re.sub("<inertial>.*?</inertial>", "", ARM, flags=re.DOTALL))
    return create_campaign(tmp_path / "bare", str(path), seed=3)[0]


def steps_of(campaign: Campaign, logs: list[Path]) -> list[list[tuple[str, str]]]:
    """What is decided of each log, and how."""
    survey = surveyed(campaign, logs, {"foreign": True})
    assert survey is not None
    return [[(step.finding.check, step.what) for step in survey.of(path)] for path in logs]


def test_two_robots_without_a_model_file_contradict_each_other(
    lab: Campaign, bare: Campaign, tmp_path: Path
) -> None:
    logs = [log_of(tmp_path / f"{k}.csv", lab, seed=k) for k in (7, 8)]
    assert steps_of(bare, logs) == [[], []]
    other = log_of(tmp_path / "other.csv", lab, masses=np.array([1.0, 0.3, 3.0]), friction=2.0, seed=9)
    told = tell(bare, [*logs, other], foreign=True)
    assert [file.ingested for file in told.files] == [None] * 3
    assert "other.csv contradicts the other logs" in told.files[0].sentence


@pytest.mark.slow
def test_commands_that_are_late_in_one_log_alone_are_shifted(
    lab: Campaign, bare: Campaign, tmp_path: Path
) -> None:
    logs = [log_of(tmp_path / f"{k}.csv", lab, seed=k) for k in (7, 8)]
    late = tmp_path / "late.csv"
    rows = np.loadtxt(log_of(late, lab, seed=9), delimiter=",", skiprows=1)
    rows[:, 4:] = np.column_stack([np.interp(rows[:, 0] - 0.06, rows[:, 0], u) for u in rows[:, 4:].T])
    np.savetxt(late, rows, delimiter=",", header=late.read_text().splitlines()[0], comments="")
    assert steps_of(bare, [*logs, late]) == [[], [], [("delay", "note")]]


def halves(path: Path, first: Path, second: Path, signs: Array | float = 1.0) -> Path:
    """The first log up to its middle, then the second one with these signs of its commands."""
    tables = [np.loadtxt(one, delimiter=",", skiprows=1) for one in (first, second)]
    tables[1][:, 4:] *= signs
    rows = np.where(np.arange(len(tables[0]))[:, None] * 2 < len(tables[0]), *tables)
    np.savetxt(path, rows, delimiter=",", header=first.read_text().splitlines()[0], comments="")
    return path


def between(sentence: str) -> tuple[float, float]:
    """The times that a sentence names."""
    a, b = re.findall(r"between ([\d.]+) s and ([\d.]+) s", sentence)[0]
    return float(a), float(b)


@pytest.mark.parametrize("with_file", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_sign_that_turns_within_a_log_is_asked_about_with_joint_and_time(
    with_file: bool, lab: Campaign, bare: Campaign, tmp_path: Path
) -> None:
    right = log_of(tmp_path / "right.csv", lab)
    wrong = halves(tmp_path / "wrong.csv", right, right, np.array([1.0, -1.0, 1.0]))
    own = lab if with_file else bare
    assert "contradiction" not in found(right, own)
    sentence = found(wrong, own)["contradiction"].sentence
    assert "The sign of the commands of lift turns between" in sentence
    a, b = between(sentence)
    assert a < 0.5 * np.loadtxt(right, delimiter=",", skiprows=1)[-1, 0] < b
    with pytest.raises(DataError, match=r"wrong\.csv") as refused:
        tell(own, wrong, foreign=True)
    assert "--accept contradiction" in refused.value.next_step


@pytest.mark.parametrize("kg", [-0.2, *(pytest.param(own, marks=pytest.mark.slow) for own in (0.2, 1.5))])
def test_a_load_taken_up_within_a_log_is_weighed(kg: float, lab: Campaign, tmp_path: Path) -> None:
    motion = random_motion(lab, 7)
    plain = written(tmp_path / "plain.csv", lab, motion, times=4)
    loaded = written(tmp_path / "loaded.csv", lab, motion, kg=abs(kg), times=4)
    parts = (plain, loaded) if kg > 0.0 else (loaded, plain)
    sentence = found(halves(tmp_path / "both.csv", *parts), lab)["contradiction"].sentence
    said, word = re.findall(r"carries ([\d.]+) kg (more|less)", sentence)[0]
    assert float(said) == pytest.approx(abs(kg), rel=0.2)
    assert word == ("more" if kg > 0.0 else "less")
    a, b = between(sentence)
    assert a < 2.0 * motion.duration < b


@pytest.mark.parametrize("seed", [pytest.param(12, marks=pytest.mark.slow), 14])
def test_a_load_that_is_carried_all_the_time_does_not_change(
    seed: int, lab: Campaign, tmp_path: Path
) -> None:
    """It was put down in one of ten logs of 10 s: by its centre, and by what one joint alone said."""
    path = carrying(tmp_path / "run.csv", lab, random_motion(lab, seed), 1.5, lasting=10.0)
    assert "contradiction" not in found(path, lab)


@pytest.mark.parametrize("kg", [pytest.param(0.0, marks=pytest.mark.slow), 0.4])
def test_a_load_is_found_beside_friction_that_turns_round_over_a_distance(
    kg: float, lab: Campaign, tmp_path: Path
) -> None:
    """Gears that give way by 10 mrad (Dahl 1968) in a motion at half speed; a load from the middle on."""
    motion, body = random_motion(lab, 1), body_of(lab.kind, lab.spec)
    t = np.arange(0.0, 4.0 * motion.duration, 0.02)
    orders = [
        part / 2.0**i for i, part in enumerate(motion.motion((0.5 * t) % motion.duration, 3).orders[:3])
    ]
    states = Log(t, {}, {}, "states")
    for channel, values in zip(lab.channels, orders, strict=False):
        states = states.put(channel, values)
    bent = np.zeros_like(orders[0])
    for i, step in enumerate(np.diff(orders[0], axis=0), 1):
        bent[i] = np.sign(step) + (bent[i - 1] - np.sign(step)) * np.exp(-np.abs(step) / 0.01)
    load = kg * body.links(states)[:, :, -1, 0] * (t > 0.5 * t[-1])[:, None]  # type: ignore[union-attr]
    command = body.predict(states) + FRICTION * bent + load  # type: ignore[union-attr]
    checks = found(saved(tmp_path / "run.csv", t, orders[0], command, 1), lab)
    said = [f.sentence for f in checks.values() if f.flag]
    assert [float(re.findall(r"carries ([\d.]+) kg more", own)[0]) for own in said] == pytest.approx(
        [kg] * (kg > 0.0), abs=0.05
    )


@pytest.mark.slow
def test_two_robots_in_one_log_are_asked_about(lab: Campaign, bare: Campaign, tmp_path: Path) -> None:
    one = log_of(tmp_path / "one.csv", lab)
    two = log_of(tmp_path / "two.csv", lab, masses=np.array([1.0, 0.3, 3.0]), friction=2.0)
    both = halves(tmp_path / "both.csv", one, two)
    assert (
        "a model of another robot or load explains the commands of"
        in found(both, bare)["contradiction"].sentence
    )
    assert [len(own) for own in steps_of(bare, [one, both])] == [0, 1]  # one file does not stop the other


@pytest.mark.parametrize("fault", ["sign", pytest.param("swapped", marks=pytest.mark.slow)])
def test_positions_or_commands_are_named_by_the_weights_on_other_joints(
    fault: str, lab: Campaign, bare: Campaign, tmp_path: Path
) -> None:
    right = log_of(tmp_path / "right.csv", lab)
    header, rows = right.read_text().splitlines()[0], np.loadtxt(right, delimiter=",", skiprows=1)
    signs, order = (np.array([1, -1, 1]), [0, 1, 2]) if fault == "sign" else (np.ones(3), [0, 2, 1])
    said = {}
    for what, first in (("positions", 1), ("commands", 4)):
        wrong, columns = rows.copy(), np.arange(first, first + 3)
        wrong[:, columns] = rows[:, columns[order]] * signs
        path = tmp_path / f"{what}.csv"
        np.savetxt(path, wrong, delimiter=",", header=header, comments="")
        said[what] = found(path, lab)[fault]
        alone = found(path, bare)[fault]  # without masses nothing tells them apart
        assert "Wrong positions of lift" in alone.sentence
    assert said["positions"].sentence.startswith("The positions of lift")
    assert "not their commands" in said["positions"].sentence
    assert not isinstance(said["positions"], Mendable)
    assert "commands of lift" in said["commands"].sentence
    assert "positions" not in said["commands"].sentence
