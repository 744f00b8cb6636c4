"""Millimetres for metres, and a floor that the arm would be in: seen when a campaign begins."""

from __future__ import annotations

from pathlib import Path

import pytest
from loading_examples import MESH, joint, link, robot, write

from etude.errors import UsageError
from etude_arm.description import describe
from etude_arm.loading.load import load

TWO = (
    link("base", shape='<box size="0.2 0.2 0.2"/>')
    + link("upper", 3.0, '<sphere radius="0.07"/>')
    + link("fore", 1.5, '<sphere radius="0.07"/>')
    + joint("shoulder", "base", "upper")
    + joint("elbow", "upper", "fore")
)


def test_a_mesh_in_mm_is_refused_and_its_scale_mends_it(tmp_path: Path) -> None:
    path = write(tmp_path)
    text, mesh = robot(), tmp_path / "arm" / "meshes" / "cube.obj"
    wide = [[str(1000 * float(x)) for x in line.split()[1:]] for line in mesh.read_text().splitlines()]
    mesh.write_text("".join(f"v {' '.join(row)}\n" for row in wide))
    limits = {"*": {"velocity": 1.0}}
    with pytest.raises(UsageError, match=r"a shape of 'upper' is \d+ m across.*mm.*0\.001"):
        describe(path, limits=limits)
    path.write_text(text.replace(MESH, MESH.replace("1 1 2", "0.001 0.001 0.001")))
    assert describe(path, limits=limits).files


def test_links_in_mm_are_refused_but_a_robot_file_may_vouch_for_them(tmp_path: Path) -> None:
    path = write(tmp_path, TWO.replace('xyz="0.3 0.05 -0.02"', 'xyz="300 50 -20"'))
    with pytest.raises(UsageError, match=r"'fore' lies 305 m from the part that carries it.*mm"):
        describe(path)
    axes = "".join(
        f'[[axis]]\nname = "{name}"\nlower = -1.0\nupper = 1.0\nvelocity = 1.0\nacceleration = 1.0\n'
        "command = 9.0\n"
        for name in ("shoulder", "elbow")
    )
    toml = tmp_path / "mine.toml"
    toml.write_text(f'name = "crane"\ncommand_unit = "N m"\nrate = 100.0\nmodel_file = "{path}"\n{axes}')
    assert describe(toml).files


def test_an_inertia_in_kg_mm2_is_refused(tmp_path: Path) -> None:
    moments = 'ixx="0.011" iyy="0.02" izz="0.021" ixy="0.001" ixz="0" iyz="0.002"'
    assert moments in TWO
    in_mm = 'ixx="11000" iyy="20000" izz="21000" ixy="1000" ixz="0" iyz="2000"'
    with pytest.raises(UsageError, match=r"the inertia of 'upper' is that of 3 kg .* m apart.*kg mm\^2"):
        describe(write(tmp_path, TWO.replace(moments, in_mm, 1)))


def test_no_floor_is_assumed_where_the_arm_hangs(tmp_path: Path) -> None:
    low = TWO.replace('xyz="0.3 0.05 -0.02"', 'xyz="0.3 0.05 -2"', 1).replace(
        '<origin xyz="0.1 0 0"/><geometry><box', '<origin xyz="0 0 0.1"/><geometry><box'
    )
    hanging = describe(write(tmp_path, low))
    assert b"\n[floor]\n" not in hanging.files["robot.toml"]
    assert any("would always be below it: add [floor]" in sentence for sentence in hanging.confirm)
    standing = describe(write(tmp_path / "other", low.replace("0.05 -2", "0.05 0.8")))
    assert b"\n[floor]\n" in standing.files["robot.toml"]


def test_a_last_link_without_its_mesh_is_not_said_to_have_a_shape(tmp_path: Path) -> None:
    text = TWO.replace('<sphere radius="0.07"/>', '<mesh filename="gone.stl"/>')
    loaded = load(write(tmp_path, text))
    assert "the shape of link 'upper': its mesh is missing, so a capsule is assumed" in loaded.unverified
    assert "the shape of link 'fore': its mesh is missing, and there is no replacement" in loaded.unverified
    assert loaded.model().ngeom == 2
