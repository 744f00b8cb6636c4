"""The robot in motion: in space, and the figure of sticks that paper shows."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_campaign import write_campaign

from chromium import chromium, complaints, open_page, overhang
from etude.report import build_report
from etude.report.record import read_record
from etude.report.scene import beyond, camera_of, clipped_polygon, room_around
from etude.report.sections.motion import SIZE, motion, stage
from etude.types import Figure, Thing
from etude_arm import KIND

AROUND = """
[mounting]
position = [0.0, 0.0, 0.3]
[tool]
mass = 0.2
centre = [0.1, 0.0, 0.0]
shape = "cylinder"
size = [0.04, 0.2]
[floor]
height = 0.0
[[box]]
name = "table <left>"
centre = [0.0, 0.9, 0.1]
size = [0.6, 0.4, 0.2]
[[box]]
name = "shelf"
centre = [0.1, 0.9, 0.15]
size = [0.6, 0.4, 0.2]
[[box]]
name = "hall"
centre = [90.0, 0.0, 0.1]
size = [0.6, 0.4, 0.2]
[[wall]]
name = "fence"
point = [0.0, 0.95, 0.0]
normal = [0.0, -1.0, 0.0]
"""


NAMES = {"floor", "fence", "table <left>", "shelf", "base, 0.3 m up"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose robot has a model file."""
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, 1)
    shutil.copy(KIND.built_in()["arm4"].parent / "arm4.xml", folder / "arm.xml")
    robot = folder / "robot.toml"
    robot.write_text('model_file = "arm.xml"\n' + robot.read_text() + AROUND)
    return folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


def test_sticks_are_where_the_camera_sees_the_robot() -> None:
    rng = np.random.default_rng(0)
    figure = Figure(rng.uniform(-1.0, 1.0, (4, 3, 3)), np.array([[0, 1], [1, 2]]), (2,))
    page = stage("made", figure)
    drawn = page.split('class="limb c1" d="')[1].split('"')[0]
    found = [[float(x) for x in part.split()] for part in drawn.replace("L", "M").split("M")[1:]]
    camera, height = camera_of(room_around(figure), SIZE)
    pixels = camera(figure.points[0])
    np.testing.assert_allclose(found, pixels[[0, 1, 1, 2]], atol=0.06)
    assert np.all((pixels > 0.0) & (pixels < [SIZE[0], height]))


def test_a_robot_with_a_model_file_is_drawn_and_one_without_is_not(folder: Path, tmp_path: Path) -> None:
    record = read_record(folder)
    page = motion(record)
    assert "Trajectory 2" in page
    assert "http" not in page
    assert page.count('class="ghost"') == 6
    assert "from robot.toml: floor, fence, table &lt;left&gt;, shelf, the tool that it carries." in page
    assert "Too far away to be drawn: hall." in page
    write_campaign(tmp_path, 1)
    assert motion(read_record(tmp_path)) == ""


def test_a_robot_that_cannot_be_loaded_is_said(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "lab")
    (tmp_path / "lab" / "arm.xml").write_text("<mujoco/>")
    assert "The robot cannot be drawn" in motion(read_record(tmp_path / "lab"))


def made(*things: Thing) -> Figure:
    """A figure of two sticks in a cube of 1 m about the origin."""
    points = np.array([[[-0.5, -0.5, -0.5], [0.0, 0.0, 0.0], [0.5, 0.5, 0.5]]] * 2)
    return Figure(points, np.array([[0, 1], [1, 2]]), (2,), things)


def square(name: str, kind: Any, z: float, half: float, x: float = 0.0) -> Thing:
    corners = [[x - half, -half, z], [x + half, -half, z], [x + half, half, z], [x - half, half, z]]
    return Thing(name, kind, np.array([corners]), ((0, 1, 2, 3),))


def test_faces_are_cut_to_what_is_drawn() -> None:
    face = square("floor", "plane", 0.0, 50.0).points[0]
    one = np.ones(3)
    np.testing.assert_allclose(
        sorted(clipped_polygon(face, -one, one).tolist()), [[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]]
    )
    corner = clipped_polygon(np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]), -one, one)
    assert sorted(corner.tolist()) == [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]
    assert len(clipped_polygon(face + 2.0, -one, one)) == 0
    assert set(clipped_polygon(np.array([[0.0, 0, 0], [0, 0, -3]]), -one, one)[:, 2].tolist()) == {0.0, -1.0}


def test_the_drawing_holds_what_is_near_and_says_what_is_not() -> None:
    alone = room_around(made())
    near = made(square("shelf", "solid", 0.9, 0.1), square("floor", "plane", -0.8, 50.0))
    room = room_around(near)
    assert (room.lower[2], room.upper[2]) == (-0.8, 0.9)
    on_it = made(square("floor", "plane", -0.5, 50.0), square("pit", "solid", -0.7, 0.1))
    assert room_around(on_it).lower[2] == -0.5, "no strip below the floor that looks like another"
    deep = made(square("floor", "plane", -2.0, 50.0))
    assert (room_around(deep).lower[2], beyond(deep)) == (-2.0, [])
    assert room.upper[:2] == alone.upper[:2]
    assert beyond(near) == []
    far = made(square("hall", "solid", 0.0, 0.1, x=9.0), square("floor", "plane", -5.0, 50.0))
    assert room_around(far).upper == alone.upper
    assert beyond(far) == ["hall", "floor"]
    page = stage("made", far)
    assert "hall" not in page


def test_a_box_is_where_the_camera_sees_it_in_front_of_its_own_back() -> None:
    cube = np.array([[x, y, z] for x in (0.6, 0.8) for y in (0.6, 0.8) for z in (0.6, 0.8)])
    faces = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    figure = made(Thing("cube", "solid", cube[None], faces))
    page = stage("made", figure)
    behind, front = (
        page.split(f'class="thing solid c5{style}" d="')[1].split('"')[0] for style in (" behind", "")
    )
    assert (behind.count("Z"), front.count("Z")) == (3, 3)
    camera, _ = camera_of(room_around(figure), SIZE)
    # the eye looks from -y, and from above: the faces at y = 0.6, z = 0.8 and x = 0.8 are in front
    for face, path in ((2, front), (5, front), (1, front), (0, behind), (3, behind), (4, behind)):
        x, y = camera(cube[list(faces[face])])[0]
        assert f"{x:.1f},{y:.1f}" in path.replace("M", " ").replace("L", " ").split("Z")[0] + path
    names = page.split('class="thing-name"')
    assert len(names) == 2


@pytest.mark.slow
@pytest.mark.browser
def test_it_stands_where_less_motion_is_asked_for_and_sticks_are_for_paper(
    browser: Any, folder: Path
) -> None:
    page = build_report(folder)
    seen = {}
    for wish in ("reduce", "no-preference"):
        media = {"features": [{"name": "prefers-reduced-motion", "value": wish}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        open_page(browser, page, 400, 500)
        seen[wish] = browser.execute_script("return document.querySelector('.space .play').textContent")
    assert seen == {"reduce": "Play", "no-preference": "Pause"}
    sizes = "return ['.space', '.sticks'].map((s) => document.querySelector(s).offsetHeight > 0)"
    assert browser.execute_script(sizes) == [True, False]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert browser.execute_script(sizes) == [False, True]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert overhang(browser) == 0
    assert complaints(browser) == []


@pytest.mark.browser
@pytest.mark.parametrize("width", [400, pytest.param(1280, marks=pytest.mark.slow)])
def test_what_stands_around_is_drawn_with_names_that_can_be_read(
    browser: Any, folder: Path, width: int
) -> None:
    open_page(browser, build_report(folder), width)
    browser.execute_script("document.querySelector('.space').classList.remove('drawn')")
    shapes, names, drawing = browser.execute_script(
        "const box = (e) => { const b = e.getBoundingClientRect();"
        " return [b.left, b.top, b.right, b.bottom]; };"
        "const all = (what) => [...document.querySelectorAll('.stage ' + what)]"
        ".map((e) => [e.textContent, ...box(e)]);"
        "return [all('g:has(> .thing)'), all('.thing-name'), box(document.querySelector('.stage svg'))]"
    )
    assert {name for name, *_ in shapes} == NAMES
    assert {name for name, *_ in names} == {name for name, *_ in shapes}
    for name, left, top, right, bottom in [*shapes, *names]:
        assert right - left + bottom - top > 8.0, name
        assert left >= drawing[0] - 1.0, name
        assert top >= drawing[1] - 1.0, name
        assert right <= drawing[2] + 1.0, name
        assert bottom <= drawing[3] + 1.0, name
    for k, (name, left, top, right, bottom) in enumerate(names):
        for other, a, b, c, d in names[k + 1 :]:
            assert right <= a or c <= left or bottom <= b + 3.0 or d <= top + 3.0, (name, other)
    assert overhang(browser) == 0
    assert complaints(browser) == []


def test_what_is_carried_is_drawn(folder: Path) -> None:
    drawn = motion(read_record(folder)).split('class="carried c3" d="M')[1:]
    assert [path.split('"')[0].count("Z") for path in drawn if "Z" in path.split('"')[0]] == [18]
