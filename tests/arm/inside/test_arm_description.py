"""A robot's model comes along, includes and all."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.errors import UsageError
from etude_arm.description import describe
from etude_arm.loading.pack import packed
from etude_arm.robot_file import read_robot


def test_a_model_without_includes_is_copied_byte_by_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_bytes(b"<robot name='a'/>\r\n<!-- as it is -->")
    assert packed(path) == (path.read_bytes(), {})


def test_includes_take_their_places(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "a.xml").write_text("<mujoco><a/><include file='parts/b.xml'/><d/></mujoco>")
    (tmp_path / "parts" / "b.xml").write_text(
        "<mujocoinclude><b><include file='parts/c.xml'/></b></mujocoinclude>"
    )
    (tmp_path / "parts" / "c.xml").write_text("<mujoco><c/></mujoco>")
    assert packed(tmp_path / "a.xml")[0].endswith(b"<mujoco><a /><b><c /></b><d /></mujoco>")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><include file='a.xml'/></mujoco>", "circle"),
        ("<mujoco><include file='missing.xml'/></mujoco>", "cannot be read"),
        ("<mujoco><include/></mujoco>", "cannot be read"),
        ("<mujoco><include", "not a readable"),
    ],
)
def test_includes_that_lead_nowhere(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        packed(path)


BOXED = """<robot name='pendulum'><link name='base'/>
{}</robot>"""
LINK = """<link name='l{0}'><inertial><origin xyz='0 0 0.2'/><mass value='1'/>
<inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>
<collision><origin xyz='0 0 0.2'/><geometry><box size='.05 .05 .3'/></geometry></collision></link>
<joint name='j{0}' type='revolute'><parent link='{1}'/><child link='l{0}'/><origin xyz='0 0 0.45'/>
<axis xyz='0 1 0'/><limit lower='-1' upper='1' velocity='2' effort='60' acceleration='4'/></joint>"""


def test_a_floor_that_its_owner_gives_needs_no_confirming(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.urdf"
    path.write_text(BOXED.format(LINK.format(1, "base") + LINK.format(2, "l1")))
    assumed, given = describe(path), describe(path, floor=-0.1)
    assert any("floor is assumed" in line for line in assumed.confirm)
    assert not any("floor" in line for line in given.confirm)
    (tmp_path / "lab").mkdir()
    for name, data in given.files.items():
        (tmp_path / "lab" / name).write_bytes(data)
    floor = read_robot(tmp_path / "lab" / "robot.toml").around.floor
    assert floor is not None
    assert floor.height == -0.1
    with pytest.raises(UsageError, match="already states the floor"):
        describe(tmp_path / "lab" / "robot.toml", floor=0.0)
    with pytest.raises(UsageError, match="needs a finite number"):
        describe(path, floor=float("nan"))
