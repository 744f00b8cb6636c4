"""A folder that somebody sends reads nothing outside itself: paths in its files, and links."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from etude import cli
from etude.campaign import chained, create_campaign, open_campaign
from etude.errors import UsageError
from etude.storage import read_lines

URDF = """<robot name="one"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="MESH"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 1 0"/><origin xyz="0 0 2"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint></robot>
"""
MJCF = """<mujoco><compiler COMPILER/><asset><mesh name="hull" file="FILE"/></asset><worldbody>
<body name="arm"><joint name="turn" axis="0 1 0" range="-1 1" actuatorfrcrange="-9 9"/>
<geom type="mesh" mesh="hull" mass="1"/></body></worldbody></mujoco>
"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A campaign of this user's, and beside it what nobody else is to read."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "one.urdf").write_text(URDF.replace("MESH", "own.obj"))
    for name in ("own.obj", "private.obj"):
        (tmp_path / name).write_text(OBJ)
    (tmp_path / "private.urdf").write_text(URDF.replace("MESH", "private.obj"))
    return create_campaign(tmp_path / "mine", str(tmp_path / "one.urdf"))[0].path


def _name_model(folder: Path, name: str) -> None:
    robot = folder / "robot.toml"
    robot.write_text(robot.read_text().replace('"robot_model.urdf"', json.dumps(name)))


def _absolute(folder: Path) -> None:
    _name_model(folder, str(folder.parent / "private.urdf"))


def _above(folder: Path) -> None:
    _name_model(folder, "meshes/../../private.urdf")


def _mesh(name: str) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        named = name.replace("HERE", str(folder.parent))
        (folder / "robot_model.urdf").write_text(URDF.replace("MESH", named))

    return edit


def _mjcf(file: str, compiler: str = "") -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        model = MJCF.replace("FILE", file).replace("COMPILER", compiler)
        (folder / "inner.xml").write_text(model.replace("HERE", str(folder.parent)))
        (folder / "robot_model.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
        _name_model(folder, "robot_model.xml")

    return edit


def _linked(folder: Path) -> None:
    (folder / "robot_model.urdf").unlink()
    (folder / "robot_model.urdf").symlink_to(folder.parent / "private.urdf")


def _linked_folder(folder: Path) -> None:
    (folder / "models").symlink_to(folder.parent, target_is_directory=True)


EDITS = {
    "model_file, absolute": _absolute,
    "model_file, above": _above,
    "mesh, above": _mesh("../private.obj"),
    "mesh, absolute": _mesh("HERE/private.obj"),
    "mesh, of a package above": _mesh("package://somewhere/private.obj"),
    "included mesh": _mjcf("../private.obj"),
    "included folder of meshes": _mjcf("private.obj", 'meshdir="HERE"'),
    "link": _linked,
    "link of a folder": _linked_folder,
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_a_strangers_file_leads_nowhere_until_the_folder_is_trusted(
    mine: Path, tmp_path: Path, edit: Callable[[Path], None]
) -> None:
    strange = Path(shutil.copytree(mine, tmp_path / "strange"))
    assert open_campaign(strange).axes == ("turn",)
    edit(strange)
    with pytest.raises(UsageError, match=r"this leads out of its folder, to .*") as refused:
        open_campaign(strange)
    assert f"etude status {strange} --trust" in refused.value.next_step
    assert cli.main(["status", str(strange), "--trust"]) == 0
    assert open_campaign(strange).axes == ("turn",)


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_a_campaign_of_ones_own_goes_on_with_files_elsewhere(
    mine: Path, edit: Callable[[Path], None]
) -> None:
    edit(mine)
    assert open_campaign(mine).axes == ("turn",)


def test_a_robot_file_that_is_typed_names_what_it_likes(mine: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    robot = (mine / "robot.toml").read_text().replace('"robot_model.urdf"', '"../one.urdf"')
    (elsewhere / "robot.toml").write_text(robot)
    assert create_campaign(tmp_path / "lab", str(elsewhere / "robot.toml"))[0].axes == ("turn",)


def test_no_line_of_the_journal_names_a_file_outside(mine: Path, tmp_path: Path) -> None:
    """Étude writes no such line, and superseded files are deleted by name."""
    journal = mine / "journal.jsonl"
    lines = read_lines(journal)
    event = {**json.loads(lines[0]), "event": "abandoned", "number": 1}
    text = json.dumps({**event, "files": {"models/../../private.obj": "0" * 64}})
    journal.write_text("\n".join([*lines, chained(text, lines)]) + "\n")
    with pytest.raises(UsageError, match="this line of the journal is not an event"):
        open_campaign(mine)


def test_a_driver_in_a_strangers_file_has_its_model_inside(
    mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strange = Path(shutil.copytree(mine, tmp_path / "strange"))
    model = json.dumps(str(tmp_path / "private.urdf"))
    for driver in (f'on = "mujoco"\nmodel = {model}', f'on = "mujoco:{json.loads(model)},virtual"'):
        (strange / "run.toml").write_text(f"[driver]\n{driver}\n")
        assert cli.main(["run", str(strange)]) == 2
        words = capsys.readouterr().err
        assert "private.urdf" in words
        assert "--trust" in words
