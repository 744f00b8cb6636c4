"""The figure of sticks: what is drawn without a script, and what the script does with it."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_campaign import write_campaign

from chromium import chromium, complaints, open_page, overhang
from etude.contracts import Figure
from etude.report.build import build_report
from etude.report.record import read_record
from etude.report.scene import project
from etude.report.sections.motion import frames, motion, stage
from etude.robots.arm.kind import KIND


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose robot has a model file."""
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, 1)
    shutil.copy(KIND.built_in()["arm4"].parent / "arm4.xml", folder / "arm.xml")
    robot = folder / "robot.toml"
    robot.write_text('model_file = "arm.xml"\n' + robot.read_text())
    return folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


def data_of(html: str) -> dict[str, Any]:
    return dict(json.loads(unescape(html.split('data-motion="')[1].split('"')[0])))


def test_every_frame_is_where_the_camera_sees_the_robot() -> None:
    rng = np.random.default_rng(0)
    figure = Figure(rng.uniform(-1.0, 1.0, (4, 3, 3)), np.array([[0, 1], [1, 2]]), (2,))
    facts = data_of(stage("made", np.linspace(0.0, 3.0, 4), figure))
    assert facts["step"] == 1.0
    assert facts["sticks"] == [0, 1, 1, 2]
    pixels = np.array(facts["pixels"]).reshape(12, 2) / 10.0
    seen = project(figure.points.reshape(-1, 3)) * [1.0, -1.0]
    # the same picture, but for its place and size: 2 of the 4 numbers that fix it are one scale
    slope = np.polyfit(seen[:, 0], pixels[:, 0], 1)[0]
    np.testing.assert_allclose(pixels - pixels[0], slope * (seen - seen[0]), atol=0.2)
    assert pixels.min() > 0.0
    assert pixels.max() < 430.0


def test_a_robot_with_a_model_file_is_drawn_and_one_without_is_not(folder: Path, tmp_path: Path) -> None:
    record = read_record(folder)
    page = motion(record)
    trajectory = record.trajectory(2)
    assert "Trajectory 2" in page
    assert "http" not in page
    assert len(data_of(page)["pixels"]) == len(frames(trajectory)) * 6 * 2  # base, four joints, tip
    assert page.count('class="ghost"') == 6
    write_campaign(tmp_path, 1)
    assert motion(read_record(tmp_path)) == ""


def test_a_robot_that_cannot_be_loaded_is_said(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "lab")
    (tmp_path / "lab" / "arm.xml").write_text("<mujoco/>")
    assert "The robot cannot be drawn" in motion(read_record(tmp_path / "lab"))


@pytest.mark.browser
def test_it_plays_stands_where_less_motion_is_asked_for_and_follows_the_slider(
    browser: Any, folder: Path
) -> None:
    page = build_report(folder)
    seen = {}
    for wish in ("reduce", "no-preference"):
        media = {"features": [{"name": "prefers-reduced-motion", "value": wish}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        open_page(browser, page, 400)
        browser.execute_script("document.querySelector('.stage').scrollIntoView({block: 'center'})")
        time.sleep(0.6)
        seen[wish] = browser.execute_script(
            "const s = document.querySelector('.stage'); return [s.querySelector('button').textContent,"
            " Number(s.querySelector('input').value) > 0, s.querySelector('.robot path').getAttribute('d')]"
        )
    assert seen["reduce"][:2] == ["Play", False]
    assert seen["no-preference"][:2] == ["Pause", True]
    assert seen["reduce"][2] != seen["no-preference"][2]
    facts = data_of(page.read_text(encoding="utf-8"))
    drawn = browser.execute_script(
        "const s = document.querySelector('.stage'), r = s.querySelector('input'); r.value = arguments[0];"
        "r.dispatchEvent(new Event('input')); return s.querySelector('.robot path').getAttribute('d')",
        7 * facts["step"],
    )
    pixels = np.array(facts["pixels"]).reshape(-1, 6, 2)[7] / 10.0
    first = [float(x) for x in drawn.split("M")[1].replace("L", " ").split()]
    np.testing.assert_allclose(first, [*pixels[0], *pixels[1]], atol=0.06)
    assert overhang(browser) == 0
    assert complaints(browser) == []
