"""Meshes by the name of their package: where it lies, and what is never taken for it in silence."""

from __future__ import annotations

from pathlib import Path

import pytest
from loading_examples import CUBE, example_robot, joint, link, robot
from test_loading_arms import ARMS, Arm

from etude.cli import main
from etude_arm.loading.load import load
from etude_arm.loading.mesh_paths import MeshPaths

BASE = "meshes/base.obj"
LONG = CUBE.replace("v 0.2", "v 0.7")
"""A mesh of another size, so that the two are told apart."""


def package(folder: Path, name: str = "", text: str = CUBE) -> Path:
    """A package with a mesh; its package.xml says `name`, if there is one."""
    (folder / "meshes").mkdir(parents=True)
    (folder / BASE).write_text(text)
    if name:
        (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
    return folder / BASE


def two(folder: Path, tool: str) -> Path:
    """A model of package arm whose tool's mesh has the same path in package `tool`."""
    mesh = '<mesh filename="package://{}/meshes/base.obj"/>'
    parts = link("base", shape=mesh.format("arm")) + link("one", 1.0, mesh.format("arm"))
    parts += link("two", 1.0, mesh.format(tool)) + joint("a", "base", "one") + joint("b", "one", "two")
    path = folder / "arm/urdf/arm.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(robot(parts))
    return path


def lengths(path: Path, *roots: Path) -> tuple[list[float], str]:
    """Of the shapes of base, one and two along x, m; and what is said."""
    loaded = load(path, mesh_roots=roots)
    model = loaded.model()
    found = {model.geom(g).name: 2.0 * float(max(model.geom_aabb[g, 3:])) for g in range(model.ngeom)}
    return [round(found.get(f"{name}#0", 0.0), 6) for name in ("base", "one", "two")], " ".join(
        (*loaded.notes, *loaded.unverified)
    )


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("tool", "tool"),  # beside it
        ("tool", ""),  # by the name of its folder alone
        ("tool-main", "tool"),  # cloned under another name: what package.xml says counts
    ],
)
def test_a_package_beside_the_models_own_is_found_by_its_name(tmp_path: Path, place: str, name: str) -> None:
    model = two(tmp_path, "tool")
    package(tmp_path / "arm", "arm")
    package(tmp_path / place, name, LONG)
    found, said = lengths(model)
    assert found == [0.2, 0.2, 0.7]
    assert "is not found" not in said
    assert "missing" not in said


def test_a_package_in_another_repository_of_the_workspace_is_found(tmp_path: Path) -> None:
    src = tmp_path / "ws/src"
    model = two(src / "robots", "tool")
    package(src / "robots/arm", "arm")
    package(src / "grippers/tool_v2", "tool", LONG)
    assert lengths(model)[0] == [0.2, 0.2, 0.7]


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"])
def test_installed_packages_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str) -> None:
    model = two(tmp_path / "here", "tool")
    package(tmp_path / "here/arm", "arm")
    package(tmp_path / "there/share/tool", "tool", LONG)
    monkeypatch.setenv(variable, f"{tmp_path / 'nowhere'}:{tmp_path / 'there'}")
    assert lengths(model)[0] == [0.2, 0.2, 0.7]


def test_another_packages_mesh_of_the_same_path_is_not_taken(tmp_path: Path) -> None:
    """The model's own package has such a mesh and uses it: the tool's is missing, and is named."""
    model = two(tmp_path, "tool")
    package(tmp_path / "arm", "arm")
    found, said = lengths(model)
    assert found[:2] == [0.2, 0.2]
    assert "Meshes are missing: package://tool/meshes/base.obj." in said
    assert "the shape of link 'two': its mesh is missing" in said


def test_a_folder_of_that_name_is_the_package_whatever_it_declares(tmp_path: Path) -> None:
    model = two(tmp_path, "tool")
    package(tmp_path / "arm", "arm")
    package(tmp_path / "tool", "tool_of_others", LONG)
    found, said = lengths(model)
    assert found == [0.2, 0.2, 0.7]
    assert "is not found" not in said


def test_the_one_file_that_it_may_be_is_taken_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = two(tmp_path, "arm")
    model.write_text(model.read_text().replace("package://arm/", "package://arm_description/"))
    package(tmp_path / "arm")
    found, said = lengths(model)
    assert found == [0.2, 0.2, 0.2]
    sentence = (
        f"package://arm_description is not found: for its {BASE} the files below {tmp_path / 'arm'} are"
    )
    assert said.count(sentence) == 1
    assert main(["init", str(tmp_path / "lab"), "--robot", str(model)]) == 0
    assert sentence in capsys.readouterr().out
    mesh = (tmp_path / "lab/robot_meshes/0_base.obj").read_text()
    assert "0.2" in mesh, "what was said is what was packed"


def test_of_two_files_that_it_may_be_none_is_taken(tmp_path: Path) -> None:
    model = two(tmp_path, "tool")
    package(tmp_path / "arm", "arm")
    model.write_text(model.read_text().replace("package://arm/", "package://gone/"))
    package(tmp_path, "", LONG)
    found, said = lengths(model)
    assert 0.2 not in found, "guessed capsules stand in"
    assert 0.7 not in found
    both = f"package://gone/{BASE} ({tmp_path / 'arm' / BASE} or {tmp_path / BASE})"
    assert f"Meshes are missing: {both}" in said


def test_a_mesh_that_its_package_lacks_is_missing(tmp_path: Path) -> None:
    package(tmp_path / "arm", "arm")
    package(tmp_path / "tool", "tool")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/other.obj").write_text(LONG)
    paths = MeshPaths(tmp_path / "arm/arm.urdf")
    assert paths.find("package://tool/meshes/other.obj") is None
    assert paths.find("package://tools/meshes/other.obj") == tmp_path / "meshes/other.obj"


def test_a_root_that_is_another_package_is_said_too(tmp_path: Path) -> None:
    model = two(tmp_path, "tool")
    package(tmp_path / "arm", "arm")
    package(tmp_path / "far/gripper", "gripper", LONG)
    found, said = lengths(model, tmp_path / "far/gripper")
    assert found == [0.2, 0.2, 0.7]
    assert "package://tool is not found" in said
    (tmp_path / "far/gripper/package.xml").unlink()
    found, said = lengths(model, tmp_path / "far" / "gripper")
    assert found == [0.2, 0.2, 0.7]


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.file)
def test_no_mesh_of_others_arms_is_guessed(arm: Arm) -> None:
    assert not any("is not found" in note for note in load(arm.path(), arm.joints).notes)


def test_a_file_of_a_package_is_found_in_its_share(tmp_path: Path) -> None:
    panda = example_robot("panda_description/urdf/panda.urdf")
    name = "package://example-robot-data/robots/panda_description/meshes/collision/hand.stl"
    found = MeshPaths(panda).find(name)
    assert found is not None
    assert found.is_file()
    assert MeshPaths(tmp_path / "panda.urdf").find(name) is None


def relative(folder: Path, name: str = BASE) -> Path:
    """A model whose meshes are named without a package, in a folder of its own."""
    model = two(folder, "arm")
    model.write_text(model.read_text().replace(f"package://arm/{BASE}", name))
    return model


@pytest.mark.parametrize("name", [BASE, f"./{BASE}"])
def test_a_relative_name_is_meant_from_the_model_file_and_else_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    model = relative(tmp_path, name)
    package(tmp_path / "arm", "", LONG)  # in the folder above
    found, said = lengths(model)
    assert found == [0.7, 0.7, 0.7]
    sentence = (
        f"Not found from arm.urdf itself: for {name} the files below {tmp_path / 'arm'} are used. If they"
    )
    assert said.count(sentence) == 1
    assert main(["init", str(tmp_path / "lab"), "--robot", str(model)]) == 0
    assert sentence in capsys.readouterr().out
    package(tmp_path / "arm/urdf")  # where it is meant
    assert lengths(model) == ([0.2, 0.2, 0.2], lengths(model)[1])
    assert "Not found" not in lengths(model)[1]


def test_of_two_files_that_a_relative_name_may_be_none_is_taken(tmp_path: Path) -> None:
    model = relative(tmp_path)
    package(tmp_path / "arm", "")
    package(tmp_path, "", LONG)
    found, said = lengths(model)
    assert not {0.2, 0.7} & set(found)
    assert f"Meshes are missing: {BASE} ({tmp_path / 'arm' / BASE} or {tmp_path / BASE})" in said
    assert "--mesh-root" in said
    assert lengths(model, tmp_path / "arm")[0] == [0.2, 0.2, 0.2]
    assert "Meshes are missing" not in lengths(model, tmp_path / "arm")[1]


def test_names_that_go_up_are_where_they_say(tmp_path: Path) -> None:
    model = relative(tmp_path, f"../{BASE}")
    package(tmp_path / "arm", "", LONG)
    found, said = lengths(model)
    assert found == [0.7, 0.7, 0.7]
    assert "Not found" not in said


def test_many_names_are_one_sentence(tmp_path: Path) -> None:
    for k in range(8):
        (tmp_path / f"m{k}.obj").write_text(CUBE)
    (tmp_path / "deep").mkdir()
    paths = MeshPaths(tmp_path / "deep/arm.urdf")
    assert all(paths.find(f"m{k}.obj") for k in range(8))
    (sentence,) = paths.notes
    assert "m0.obj, m1.obj, m2.obj, m3.obj, m4.obj and 3 more" in sentence
