"""What the screen says of a file is of the bytes on the disk, whatever was edited before.

A small arm with a log learned and a proposal open in all its forms; a random edit of robot.toml,
campaign.toml, a stored file or the journal; then one command. Where the command ends well, what it showed is
held against the disk: the certificate against certificate.json and against a proof made here of the motion's
bytes, under the two files as they lie there; and all that it rests on against the journal. Where it ends in a
refusal, it left no committed file otherwise than it was.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from etude import ask, cli, export, plugins, predict, promote, status, tell
from etude.campaign import Campaign, Proposal, create_campaign, open_campaign, read_events
from etude.campaign.propose.constraints import Constraints, constraints_then
from etude.campaign.record.journal import damaged_files
from etude.codes import Notice, OfFile
from etude.deploy import certify_played
from etude.errors import EtudeError, UnsafeTrajectoryError, UsageError
from etude.limits import Certificate, certify
from etude.protocols import Trajectory
from etude.report import build_report
from etude.trajectories import from_json

pytestmark = pytest.mark.as_logged

URDF = """<robot name="two">
<link name="base"/>
<link name="upper"><inertial><mass value="1"/><origin xyz="0 0 .1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 .1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></collision>
</link>
<link name="fore"><inertial><mass value="1.5"/><origin xyz="0.2 0 0"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 .3"/>
<axis xyz="0 0 1"/><limit lower="-1.2" upper="1.1" velocity="1.5" effort="50"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 .3"/>
<axis xyz="0 1 0"/><limit lower="-0.8" upper="0.9" velocity="1.2" effort="60"/></joint>
</robot>
"""
SHORT = {
    "candidates = 24": "candidates = 1",
    "refine = 2": "refine = 0",
    "duration = 60.0": "duration = 8.0",
    ', "standing", "slow", "ripple", "gip_lin", "all_lin"': "",
}
DAILY, ALL, LOT = 3, 1000, 50
"""Edits a day, and of all; these are lots of tests of their own, so that a run that was stopped goes on:
pytest -m slow -k 'lot7'."""
FORMAT = "ros2_csv"
ANSWERS = ("sign", "scale", "gravity")
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?(?![\w.])")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("screen_and_disk")
    (folder / "two.urdf").write_text(URDF)
    path = create_campaign(folder / "lab", str(folder / "two.urdf"))[0].path
    text = (path / "campaign.toml").read_text()
    for old, new in SHORT.items():
        assert old in text
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text + "\n")
    campaign = open_campaign(path)
    ask(campaign, go_on=True)
    tell(campaign, _log(campaign, folder, 1), accept=ANSWERS)
    promote(campaign, force=True, reason="something is in use")
    _whole(campaign)
    ask(campaign, go_on=True, speed=50)
    _log(campaign, folder, 2)
    assert not damaged_files(path, campaign.events())
    return path


def _log(campaign: Campaign, folder: Path, number: int) -> Path:
    """A CSV of a robot that follows the motion; the commands are smooth functions of it."""
    motion = from_json((campaign.proposal(number) / "trajectory.json").read_bytes())
    t = np.arange(0.0, motion.duration, 1.0 / campaign.spec.rate)
    q, qd, qdd = motion.motion(t, 3).orders[:3]
    noise = 0.05 * np.random.default_rng(number).standard_normal(q.shape)
    columns = np.column_stack([t, q, qd, 2.0 * qdd + 1.5 * qd + 3.0 * np.sin(q) + noise])
    names = [f"{what}_{axis}" for what in ("q", "qd", "tau") for axis in campaign.axes]
    pl.DataFrame(dict(zip(["time", *names], columns.T, strict=True))).write_csv(folder / f"log{number}.csv")
    return folder / f"log{number}.csv"


def _whole(campaign: Campaign) -> Proposal:
    return ask(campaign, go_on=True, start="home", formats=(FORMAT,))


# what an edit does


def _number(text: str, rng: np.random.Generator) -> str:
    """One number of the text, changed."""
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    one = found[rng.integers(len(found))]
    value = float(one[0]) * float(rng.choice([0.3, 0.9, 0.999, 1.02, 1.5, -1.0])) or 0.05
    new = repr(value) if "." in one[0] or "e" in one[0] else str(round(value))
    return text[: one.start()] + new + text[one.end() :]


def _toml(path: Path, rng: np.random.Generator) -> None:
    text = path.read_text()
    home = path.name == "robot.toml" and rng.random() < 0.3
    if home and "[search]" not in text:
        path.write_text(f"{text}\n[search]\nhome = {rng.uniform(-0.6, 0.6, 2).tolist()}\n")
    elif rng.random() < 0.1:
        path.write_text(f"# nothing else\n{text}")
    else:
        path.write_text(_number(text, rng))


def _stored(folder: Path, rng: np.random.Generator) -> None:
    """A file that nobody edits: a byte, a number, commands times three, an end cut off, or all of it."""
    own = sorted(name for event in read_events(folder) for name in event.files if name != "robot.toml")
    path = folder / own[rng.integers(len(own))]
    data, how = path.read_bytes(), rng.choice(["byte", "number", "cut", "gone", "other"])
    if how == "gone":
        path.unlink()
    elif how == "cut":
        path.write_bytes(data[: rng.integers(len(data))])
    elif how == "number" and path.suffix == ".parquet":
        facts = {k: v for k, v in pl.read_parquet_metadata(path).items() if k != "ARROW:schema"}
        frame = pl.read_parquet(path)
        commands = [pl.col(c) * 3.0 for c in frame.columns if c.startswith("command")]
        frame.with_columns(commands).write_parquet(path, metadata=facts)
    elif how == "number" and path.suffix in (".json", ".csv", ".xml", ".urdf", ".toml"):
        path.write_text(_number(path.read_text(), rng))
    elif how == "other":
        alike = [folder / name for name in own if name.endswith(path.suffix)]
        path.write_bytes(alike[rng.integers(len(alike))].read_bytes())
    else:
        place = int(rng.integers(len(data)))
        path.write_bytes(data[:place] + bytes([data[place] ^ (1 << rng.integers(8))]) + data[place + 1 :])


def _journal(folder: Path, rng: np.random.Generator) -> None:
    path = folder / "journal.jsonl"
    lines = path.read_text().splitlines()
    place, how = int(rng.integers(len(lines) - 1)), rng.choice(["stripped", "number", "gone"])
    if how == "stripped":
        lines = [re.sub(r', "previous": "\w+", "seal": "\w+"', "", line) for line in lines]
    elif how == "number":
        lines[place] = _number(lines[place], rng)
    else:
        del lines[place]
    path.write_text("".join(f"{line}\n" for line in lines))


# what a command shows, and what it rests on


def _asked(campaign: Campaign) -> list[str]:
    return _held(campaign, ask(campaign, go_on=True), 100)


def _slowly(campaign: Campaign) -> list[str]:
    return _held(campaign, ask(campaign, go_on=True, speed=50), 50)


def _with_all(campaign: Campaign) -> list[str]:
    return _held(campaign, _whole(campaign), 100)


def _held(campaign: Campaign, found: Proposal, speed: int) -> list[str]:
    """Names of the files that were shown; the certificates are those of the disk, and of a new proof."""
    fresh = open_campaign(campaign.path)
    kept = constraints_then(fresh.round(found.number).asked)
    shown = [("trajectory", found.folder, found.certificate)]
    if found.approach is not None:
        shown += [(stem, found.approach.folder, own) for stem, own in found.approach.certificates.items()]
    for stem, folder, certificate in shown:
        name = "certificate.json" if stem == "trajectory" else f"{stem}.certificate.json"
        _same(certificate, folder / name)
        motion = from_json((folder / f"{stem}.json").read_bytes())
        _proved(fresh, kept, motion, certificate, approach=stem != "trajectory")
    for one in found.exported:
        _same(one.certificate, one.files[-1])
        exporter = plugins.load("etude.exporters", one.format)
        files = {path.name: path.read_bytes() for path in one.files[:-1]}
        whole = found.folder if found.approach is None else found.approach.folder
        motion = from_json((whole / "trajectory.json").read_bytes())
        limits = kept.limits_as_played(fresh, motion)
        assert certify_played(exporter, files, limits, motion, kept.control).rows == one.certificate.rows
    folders = {folder for _, folder, _ in shown} | {one.files[-1].parent for one in found.exported}
    assert speed == 100 or found.folder.name == f"speed_{speed:03d}"
    return [path.relative_to(campaign.path).as_posix() for own in folders for path in own.iterdir()]


def _same(certificate: Certificate, path: Path) -> None:
    disk = json.loads(path.read_bytes())
    shown = json.loads(certificate.to_json())
    assert {name: disk[name] for name in shown} == shown


def _proved(
    fresh: Campaign, kept: Constraints, motion: Trajectory, shown: Certificate, *, approach: bool
) -> None:
    try:
        found = certify(motion, kept.limits(fresh), approach=approach, control=kept.control)
        assert found.ok or not kept.limits(fresh)
    except (UnsafeTrajectoryError, AssertionError):
        found = certify(motion, kept.limits(fresh, described=True), approach=approach, control=kept.control)
    assert found.rows == shown.rows


def _model(campaign: Campaign) -> list[str]:
    return [name for event in campaign.events() for name in event.files if name.startswith("models/")]


def _runs(campaign: Campaign) -> list[str]:
    return [name for e in campaign.events() for name in e.files if re.fullmatch(r"runs/\d+\.parquet", name)]


def _predicted(campaign: Campaign) -> list[str]:
    predict(campaign, campaign.proposal(1) / "trajectory.json")
    return [name for event in campaign.events() if event.event == "promoted" for name in event.files]


def _told(campaign: Campaign) -> list[str]:
    tell(campaign, campaign.path.parent / "log2.csv", accept=ANSWERS)
    return [*_runs(campaign), *_model(campaign)]


def _promoted(campaign: Campaign) -> list[str]:
    promote(campaign)
    return _model(campaign)


def _status(campaign: Campaign) -> list[str]:
    found = status(campaign)
    assert found["problems"] == [one.facts() for one in damaged_files(campaign.path, campaign.events())]
    return []


def _report(campaign: Campaign) -> list[str]:
    """A file that is not what was committed is named, and not drawn."""
    page = build_report(campaign.path).read_text(encoding="utf-8")
    for one in damaged_files(campaign.path, campaign.events()):
        name, drawn = one.fields["file"], r"proposals/\d+/(trajectory|certificate)\.json"
        if re.fullmatch(drawn, name) and one.code != OfFile.MISSING:
            assert f"{name} could not be read" in page
    return []


COMMANDS: Mapping[str, Callable[[Campaign], list[str]]] = {
    "ask": _asked,
    "ask --speed": _slowly,
    "ask --from --format": _with_all,
    "predict": _predicted,
    "tell": _told,
    "promote": _promoted,
    "status": _status,
    "report": _report,
}
EDITS: tuple[Callable[[Path, np.random.Generator], None], ...] = (
    lambda folder, rng: _toml(folder / "robot.toml", rng),
    lambda folder, rng: _toml(folder / "campaign.toml", rng),
    _stored,
    _stored,
    _journal,
)


def _tried(lab: Path, folder: Path, seed: int) -> str:
    """One edit and one command; what became of it, for people who count."""
    rng = np.random.default_rng([seed, 3])
    shutil.copytree(lab.parent, folder)
    path = folder / lab.name
    edit = EDITS[seed % len(EDITS)]
    name = list(COMMANDS)[seed // len(EDITS) % len(COMMANDS)]
    edit(path, rng)
    before = _contents(path)
    try:
        campaign = open_campaign(path)
        damaged = damaged_files(path, campaign.events())
        rests_on = COMMANDS[name](campaign)
    except EtudeError as error:
        refused: EtudeError | None = error
    else:
        refused = None
    if refused is not None:
        assert refused.fact
        assert refused.exit_code in (2, 3, 4, 5, 6)
        _unharmed(before, path)
        return "refused"
    journal = "journal.jsonl"
    assert edit is not _journal or before[journal] == (lab / journal).read_bytes(), "an edited one was read"
    after = damaged_files(path, campaign.events())
    wrong = [one for one in after if one.fields["file"] in rests_on]
    assert not wrong, f"{name} rested on {wrong}"
    left = [one for one in after if one.fields["file"] != "robot.toml"]
    assert all(one in damaged for one in left), "a command left files behind"
    return "shown"


def _contents(path: Path) -> dict[str, bytes]:
    return {p.relative_to(path).as_posix(): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def _unharmed(before: Mapping[str, bytes], path: Path) -> None:
    """Whatever changed since is committed as it is now."""
    after = _contents(path)
    changed = [name for name, data in after.items() if before.get(name) != data and name != ".lock"]
    if changed and "journal.jsonl" in changed:
        events = read_events(path)
        known = {name for event in events for name in event.files}
        broken = {one.fields["file"] for one in damaged_files(path, events)}
        changed = [name for name in changed if name in broken or name not in {*known, "journal.jsonl"}]
    assert not changed, f"a refusal left {changed} behind"


@pytest.mark.parametrize("seed", range(DAILY))
def test_after_a_random_edit(lab: Path, tmp_path: Path, seed: int) -> None:
    _tried(lab, tmp_path / "copy", 7 * seed + 3)


@pytest.mark.slow
@pytest.mark.parametrize("lot", range(ALL // LOT), ids="lot{}".format)
def test_after_a_thousand_random_edits(lab: Path, tmp_path: Path, lot: int) -> None:
    found = []
    for seed in range(1000 + lot * LOT, 1000 + (lot + 1) * LOT):
        try:
            found.append(_tried(lab, tmp_path / "copy", seed))
        except Exception as error:
            raise AssertionError(f"edit {seed}: {error}") from error
        shutil.rmtree(tmp_path / "copy")
    assert found.count("shown") > LOT // 10


@pytest.fixture
def copy(lab: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(lab.parent, tmp_path / "copy")) / lab.name


def test_the_way_from_another_home_is_written_anew(copy: Path) -> None:
    robot, approach = copy / "robot.toml", copy / "proposals/0002/from_home"
    before = {path.name: path.read_bytes() for path in approach.glob("*.*")}
    text, home = robot.read_text(), "home = [0.5, -0.3]"
    found = re.search(r"^home = .*$", text, re.MULTILINE)
    robot.write_text(text.replace(found[0], home) if found else f"{text}\n[search]\n{home}\n")
    assert any("proposals/0002/from_home was certified before" in one for one in _look(copy))
    shown = _whole(open_campaign(copy))
    assert shown.approach is not None
    assert "robot.toml changed" in shown.approach.renewed[0]
    assert all(path.read_bytes() != before[path.name] for path in approach.glob("approach*"))
    start = from_json((approach / "approach.json").read_bytes()).motion(np.zeros(1), 1).orders[0][0]
    np.testing.assert_allclose(start, [0.5, -0.3])
    assert not any("from_home" in one for one in _look(copy))
    assert _whole(open_campaign(copy)).approach.renewed == ()  # type: ignore[union-attr]


def test_following_what_status_prints_proves_every_folder_again(copy: Path) -> None:
    """Each form of the open motion has a folder: slower, from a pose, for a receiver."""
    ask(open_campaign(copy), go_on=True, speed=50, start="turn=0.1,lift=0.2", formats=(FORMAT,))
    robot = copy / "robot.toml"
    robot.write_text(re.sub(r"(?m)^acceleration = .*$", "acceleration = 4.5", robot.read_text()))
    notices = status(open_campaign(copy))["proved_otherwise"]
    assert len(notices) == 6
    for notice in notices:
        words = shlex.split(notice["step"].partition(": ")[2])
        assert cli.main(words[1:]) == 0, words
    assert not _look(copy)


def _look(path: Path) -> list[str]:
    return [f"{one['sentence']}. {one['step']}" for one in status(open_campaign(path))["proved_otherwise"]]


def _edit(path: Path, pattern: str, new: str) -> None:
    text = path.read_text()
    assert re.search(pattern, text, re.MULTILINE)
    path.write_text(re.sub(pattern, new, text, count=1, flags=re.MULTILINE))


def _asked_again(copy: Path) -> None:
    assert cli.main(["ask", str(copy), "--continue"]) == 0


def _told_again(copy: Path) -> None:
    words = [word for answer in ANSWERS for word in ("--accept", answer)]
    command = ["tell", str(copy), str(copy.parent / "log2.csv"), *words]
    assert cli.main(command) == 0


def test_an_edited_export_is_named_until_it_is_written_again(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")  # compiled, C would take longest of all exports; so it takes least
    for output, words in ((None, ""), (tmp_path / "elsewhere", f" --output {tmp_path / 'elsewhere'}")):
        folder = export(copy, "c", output).folder
        (folder / "main.c").write_text("int main(void) { return 0; }\n")
        assert status(open_campaign(copy))["edited"] == [], "a file of the user's own"
        written = folder / "two.h"
        _edit(written, r"\A", "by hand\n")
        (notice,) = status(open_campaign(copy))["edited"]
        assert notice["code"] == OfFile.EXPORT_EDITED
        assert notice["sentence"].startswith(f"{written} was changed")
        assert notice["step"] == f"Write it again: etude export {copy} --to c{words}"
        assert cli.main(["status", str(copy)]) == 0
        assert f"Edited: {notice['sentence']}" in capsys.readouterr().out
        export(copy, "c", output)
        _edit(folder / "etude-export.json", r'"files": \{', '"files": {"../main.c": "0",')
        (folder.parent / "main.c").write_text("outside of the export")
        assert status(open_campaign(copy))["edited"] == []


REMARK = ("robot.toml", r"\A", "# by hand\n")
PAYLOAD = (
    "robot.toml",
    r"(?s)(.*)\Z",
    '\\1\n[payload]\nlink = "fore"\nmass = 0.2\nshape = "sphere"\nsize = [0.02]\n',
)
SETTING = ("campaign.toml", "^candidates = 1", "candidates = 2")


@pytest.mark.parametrize(
    ("edit", "take_up"),
    [
        (REMARK, _asked_again),
        (PAYLOAD, _asked_again),
        pytest.param(PAYLOAD, _told_again, marks=pytest.mark.slow),
        (SETTING, _told_again),
    ],
)
def test_what_people_edit_is_no_problem_and_the_next_ask_or_tell_takes_it_up(
    copy: Path,
    edit: tuple[str, str, str],
    take_up: Callable[[Path], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert status(open_campaign(copy))["edited"] == []
    name = edit[0]
    _edit(copy / name, *edit[1:])
    found = status(open_campaign(copy))
    (notice,) = found["edited"]
    assert (notice["code"], notice["fields"]["file"]) == (OfFile.EDITED, name)
    assert notice["step"].endswith(f"etude ask {copy}")
    assert found["problems"] == []
    assert cli.main(["status", str(copy)]) == 0
    said = capsys.readouterr().out
    assert "Problem" not in said
    assert f"Edited: {notice['sentence']}. {notice['step']}" in said
    take_up(copy)
    found = status(open_campaign(copy))
    assert found["edited"] == found["problems"] == []
    _edit(copy / name, r"\A", "# and again\n")
    assert [one["fields"]["file"] for one in status(open_campaign(copy))["edited"]] == [name]
    assert status(open_campaign(copy))["problems"] == []


def test_another_command_leaves_an_edit_to_ask_and_tell(copy: Path) -> None:
    _edit(copy / "robot.toml", *REMARK[1:])
    assert cli.main(["abandon", str(copy), "2"]) == 0
    assert len(status(open_campaign(copy))["edited"]) == 1


def _exchanged(text: str) -> str:
    """robot.toml with its two [[axis]] tables the other way round, without [search], which goes by place."""
    tables = re.split(r"(?m)^(?=\[)", re.sub(r"(?ms)^\[search\].*?(?=^\[|\Z)", "", text))
    places = [i for i, table in enumerate(tables) if table.startswith("[[axis]]")]
    first, second = places
    tables[first], tables[second] = tables[second], tables[first]
    return "".join(table.rstrip() + "\n\n" for table in tables)


def test_joints_in_another_order_than_the_logs_are_refused_until_they_are_put_back(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Logs and models go by place: a command of one joint would go to the other."""
    robot = copy / "robot.toml"
    before = robot.read_text()
    robot.write_text(_exchanged(before))
    log = str(copy.parent / "log2.csv")
    for words in (["predict", str(copy), log], ["export", str(copy), "--to", "c"], ["status", str(copy)]):
        assert cli.main([*words]) == 2, words
        assert "lift, turn" in capsys.readouterr().err
    robot.write_text(before)
    assert cli.main(["status", str(copy)]) == 0


def test_a_robot_toml_that_is_gone_is_a_problem(copy: Path) -> None:
    (copy / "robot.toml").unlink()
    assert damaged_files(copy, read_events(copy)) == [Notice(OfFile.MISSING, {"file": "robot.toml"})]


def test_an_open_motion_that_leaves_the_new_limits_names_what_helps(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _edit(copy / "robot.toml", r"^velocity = .*$", "velocity = 0.4")
    with pytest.raises(UnsafeTrajectoryError, match=r"since robot\.toml changed") as refused:
        ask(open_campaign(copy), go_on=True)
    assert f"etude ask {copy} --new." in refused.value.next_step
    assert "restore robot.toml" in refused.value.next_step
    assert cli.main(["ask", str(copy), "--new", "--continue"]) == 0
    # the older one is not proved again by asking: what helps there is named too
    said = _look(copy)
    assert said
    assert all(one.endswith(f"etude abandon {copy} 2") for one in said)
    assert cli.main(["abandon", str(copy), "2"]) == 0
    assert _look(copy) == []


@pytest.mark.parametrize(
    ("name", "gone"),
    [
        pytest.param("from_home/approach.csv", False, marks=pytest.mark.slow),
        pytest.param("from_home/certificate.json", True, marks=pytest.mark.slow),
        ("from_home/ros2_csv/points.csv", False),
        ("ros2_csv/play.py", True),
    ],
)
def test_the_advice_for_a_changed_file_mends_it_to_the_letter(copy: Path, name: str, gone: bool) -> None:
    """The files and the command that are printed, in a shell."""
    approach = ["--from", "home"] if name.startswith("from_home") else []
    command = ["ask", str(copy), "--continue", *approach, "--format", FORMAT]
    assert cli.main(command) == 0
    path = copy / "proposals/0002" / name
    before = path.read_bytes()
    if gone:
        path.unlink()
    else:
        path.write_bytes(before.replace(b"0", b"1"))
    with pytest.raises(UsageError, match=re.escape(name)) as refused:
        ask(open_campaign(copy), go_on=True, start=approach[1] if approach else "", formats=(FORMAT,))
    files = refused.value.next_step.partition("run the same command again: ")[2]
    subprocess.run(files, shell=True, check=True)
    assert cli.main(command) == 0
    assert path.read_bytes() == before
    assert damaged_files(copy, read_events(copy)) == []


def test_a_changed_run_is_not_learned_and_the_advice_mends_it(copy: Path) -> None:
    path = copy / "runs/0001.parquet"
    facts = {k: v for k, v in pl.read_parquet_metadata(path).items() if k != "ARROW:schema"}
    frame = pl.read_parquet(path)
    commands = [pl.col(c) * 3.0 for c in frame.columns if c.startswith("command")]
    frame.with_columns(commands).write_parquet(path, metadata=facts)
    log = copy.parent / "log2.csv"
    with pytest.raises(UsageError, match=r"runs/0001\.parquet was changed") as refused:
        tell(open_campaign(copy), log, accept=ANSWERS)
    assert f"etude untell {copy} 1" in refused.value.next_step
    assert cli.main(["untell", str(copy), "1"]) == 0
    command = ["tell", str(copy), str(copy.parent / "log1.csv"), "--accept", "sign"]
    assert cli.main(command) == 0
    assert not damaged_files(copy, read_events(copy))


def test_a_journal_without_any_hash_is_named(copy: Path) -> None:
    path = copy / "journal.jsonl"
    path.write_text(re.sub(r', "previous": "\w+", "seal": "\w+"', "", path.read_text()))
    with pytest.raises(UsageError, match="this journal has no hashes"):
        open_campaign(copy)


def test_a_changed_model_file_of_the_robot_moves_nothing(copy: Path) -> None:
    path = copy / "robot_model.urdf"
    path.write_text(path.read_text().replace('mass value="1.5"', 'mass value="15"'))
    for command in (_asked, _predicted, _told):
        with pytest.raises(UsageError, match=r"robot_model\.urdf was changed"):
            command(open_campaign(copy))
