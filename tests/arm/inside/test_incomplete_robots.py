"""Descriptions that lack something: masses, inertias that anybody measured, meshes, or where these lie."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from etude import open_campaign
from etude.cli import main
from etude.errors import UsageError
from etude_arm.loading.load import load

LIMIT = '<limit lower="-1.2" upper="1.2" velocity="1" effort="50"/>'
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
EMPTY_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit/><up_axis>Y_UP</up_axis></asset><library_geometries/><library_visual_scenes>
<visual_scene id="S"><node id="J"/></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#S"/></scene></COLLADA>"""


def inertial(mass: float, moment: float, centre: float = 0.1) -> str:
    moments = " ".join(f'i{a}{a}="{moment}"' for a in "xyz")
    return (
        f'<inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>'
        f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def shape(text: str, at: float = 0.1) -> str:
    return f'<collision><origin xyz="0 0 {at}"/><geometry>{text}</geometry></collision>'


def arm(*links: str, kinds: tuple[str, ...] = ("revolute",) * 3) -> str:
    """Links on top of one another, 0.3 m apart, with what each is made of; the first is fixed."""
    parts = [f'<link name="l{k}">{own}</link>' for k, own in enumerate(links)]
    parts += [
        f'<joint name="j{k}" type="{kinds[k - 1]}"><parent link="l{k - 1}"/><child link="l{k}"/>'
        f'<origin xyz="0 0 0.3"/><axis xyz="{"0 1 0" if k % 2 else "0 0 1"}"/>{LIMIT}</joint>'
        for k in range(1, len(links))
    ]
    return f'<robot name="tower">{"".join(parts)}</robot>'


ROD = shape('<cylinder radius="0.03" length="0.16"/>', 0.15)
BARE = arm(shape('<box size="0.2 0.2 0.05"/>', 0.0), ROD, ROD, ROD)


def made(folder: Path, text: str, *more: str) -> tuple[Path, list[str]]:
    """The campaign of a URDF, and what is to be confirmed."""
    (folder / "arm.urdf").write_text(text)
    lab = folder / "lab"
    assert main(["init", str(lab), "--robot", str(folder / "arm.urdf"), *more]) == 0
    return lab, list(open_campaign(lab).spec.confirm)


@pytest.mark.slow
def test_a_robot_without_masses_keeps_clear_is_asked_and_learns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lab, confirm = made(tmp_path, BARE)
    assert sum("gives no masses" in line for line in confirm) == 1
    assert main(["ask", str(lab)]) == 0
    said = capsys.readouterr().out
    assert re.search(r"l\d and \w+ +\d", said), "distances are proved"
    assert "Whether the drives can deliver the forces" in said
    rows = [
        line for line in (lab / "proposals/0001/trajectory.csv").read_text().splitlines() if line[0] != "#"
    ]
    names, data = rows[0].split(","), np.array([row.split(",") for row in rows[1:]], dtype=float)
    t, q, qd = data[:, 0], *(data[:, [names.index(f"{p}_j{k}") for k in (1, 2, 3)]] for p in ("q", "qd"))
    rng = np.random.default_rng(0)
    command = [5.0, 3.0, 2.0] * np.sin(q) + 0.5 * np.tanh(qd / 0.02) + 0.02 * rng.standard_normal(q.shape)
    log = np.column_stack([t, q + 1e-5 * rng.standard_normal(q.shape), command])
    head = ",".join(["t", *(f"j{k}.position" for k in (1, 2, 3)), *(f"j{k}.effort" for k in (1, 2, 3))])
    np.savetxt(tmp_path / "log.csv", log, delimiter=",", header=head, comments="")
    assert main(["tell", str(lab), str(tmp_path / "log.csv")]) == 0
    assert main(["status", str(lab)]) == 0
    assert "learned" in capsys.readouterr().out
    assert main(["simulate", str(lab)]) == 2
    assert "with masses" in capsys.readouterr().err
    assert main(["export", str(lab), "--to", "urdf"]) == 2
    assert "no model file with inertias" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (arm("", *[inertial(1.0, 0.1) + ROD] * 3), "l1, l2, l3 are the same"),
        (
            arm("", *(inertial(m, i) + ROD for m, i in ((3, 0.02), (2, 0.9), (1, 0.005)))),
            r"l2 \(0.67 m of .*larger than these links",
        ),
        (arm("", *(inertial(m, i) + ROD for m, i in ((3, 0.02), (2, 0.01), (1, 0.005)))), ""),
    ],
    ids=["alike", "large", "sound"],
)
def test_placeholder_inertias_are_one_line_to_confirm(text: str, said: str, tmp_path: Path) -> None:
    lines = [line for line in made(tmp_path, text)[1] if "look like placeholders" in line]
    assert len(lines) == bool(said)
    assert all(re.search(said, line) for line in lines)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("e.dae", EMPTY_DAE.encode()),
        ("e.stl", bytes(84)),
        ("e.stl", b"solid e\nendsolid e\n"),
        ("e.obj", b"o e\n"),
    ],
)
def test_an_empty_mesh_is_a_warning_and_its_link_is_not_looked_at(
    name: str, data: bytes, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(data)
    links = [
        inertial(2, 0.01) + ROD,
        inertial(1, 0.02) + ROD,
        inertial(1, 0.004) + shape(f'<mesh filename="{name}"/>'),
    ]
    lab, confirm = made(tmp_path, arm("", *links))
    assert sum(f"Meshes are empty: {name}" in line for line in confirm) == 1
    assert not any("missing" in line for line in confirm)
    for file in (tmp_path / "arm.urdf", lab / "robot_model.urdf"):
        assert (
            "the shape of link 'l3': its mesh is empty, and there is no replacement" in load(file).unverified
        )


WANTED = '<mesh filename="package://tower_description/meshes/a.obj"/>'
MESHED = arm("", *(inertial(m, i) + shape(WANTED) for m, i in ((3, 0.02), (2, 0.01), (1, 0.005))))


def package(folder: Path, name: str = "tower_description", *, size: float = 1.0) -> None:
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes/a.obj").write_text(CUBE.replace("0.1", str(0.1 * size)))
    (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")


def shapes_of(folder: Path) -> float:
    """Edge of the cube that was found, m; 0 if there is none."""
    (folder / "arm").mkdir()
    (folder / "arm/arm.urdf").write_text(MESHED)
    model = load(folder / "arm/arm.urdf", mesh_roots=[folder / "ws"]).model()
    return round(2.0 * float(model.geom_aabb[:, 3].max(initial=0.0)), 6)


def test_a_package_is_found_at_any_depth_of_a_workspace(tmp_path: Path) -> None:
    package(tmp_path / "ws/src/group/vendor/repo/descriptions/renamed_on_disk")
    package(tmp_path / "ws/src/group/tower_description", "another_of_that_folder_name", size=2.0)
    (tmp_path / "ws/src/group/circle").symlink_to(tmp_path / "ws")
    (tmp_path / "ws/src/again").symlink_to(tmp_path / "ws/src/group/vendor")
    assert shapes_of(tmp_path) == 0.1


def test_sources_go_before_what_a_workspace_has_installed(tmp_path: Path) -> None:
    package(tmp_path / "ws/src/a/b/tower_description")
    for built in ("build/tower_description", "install/tower_description/share/tower_description"):
        package(tmp_path / "ws" / built, size=2.0)
        (tmp_path / "ws" / built.partition("/")[0] / "COLCON_IGNORE").touch()
    assert shapes_of(tmp_path) == 0.1


def test_what_is_installed_alone_is_taken(tmp_path: Path) -> None:
    package(tmp_path / "ws/install/tower_description/share/tower_description", size=2.0)
    package(tmp_path / "ws/build/tower_description")
    (tmp_path / "ws/src").mkdir()
    assert shapes_of(tmp_path) == 0.2


def test_several_packages_of_one_name_are_refused_and_both_named(tmp_path: Path) -> None:
    package(tmp_path / "ws/src/one/tower_description")
    package(tmp_path / "ws/src/other/fork", size=2.0)
    with pytest.raises(UsageError, match="several packages") as refused:
        shapes_of(tmp_path)
    for folder in ("one/tower_description", "other/fork"):
        assert str(tmp_path / "ws/src" / folder) in refused.value.fact
    root = tmp_path / "ws/src/other/fork"
    assert f"--mesh-root {root}" in refused.value.next_step or "one/tower" in refused.value.next_step
    model = load(tmp_path / "arm/arm.urdf", mesh_roots=[root]).model()
    assert round(2.0 * float(model.geom_aabb[:, 3].max()), 6) == 0.2


@pytest.mark.slow
def test_the_force_of_a_slide_is_in_newton(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kinds = ("revolute", "prismatic", "revolute")
    text = arm("", *(inertial(m, i) + ROD for m, i in ((3, 0.02), (2, 0.01), (1, 0.005))), kinds=kinds)
    lab, _ = made(tmp_path, text.replace('lower="-1.2" upper="1.2"', 'lower="-0.2" upper="0.2"'))
    spec = open_campaign(lab).spec
    assert spec.command_units == ("N m", "N", "N m")
    assert main(["ask", str(lab)]) == 0
    capsys.readouterr()
    proof = (lab / "proposals/0001/certificate.json").read_text()
    methods = dict(
        re.findall(r'"axis": "(j\d)",\s*"quantity": "torque".*?"method": "([^"]*)"', proof, re.DOTALL)
    )
    assert " N more" in methods["j2"]
    assert " N m more" in methods["j1"]
