"""The animated picture: which poses it shows when, and that each error appears after its motion."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from synthetic_campaign import write_campaign

from etude.errors import UsageError
from etude.report.animation import FRAMES, HOLD, SECONDS, main, of_campaign
from etude.report.record import read_record
from etude_arm import KIND

ROUNDS = 3
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of three logs whose robot has a model file."""
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, ROUNDS)
    shutil.copy(KIND.built_in()["arm4"].parent / "arm4.xml", folder / "arm.xml")
    robot = folder / "robot.toml"
    robot.write_text('model_file = "arm.xml"\n' + robot.read_text())
    return folder


def animations(picture: str, attribute: str) -> list[tuple[list[str], list[float]]]:
    """Values and times, as parts of the whole, of each animation of that attribute."""
    found = ElementTree.fromstring(picture).iter(f"{SVG}animate")
    return [
        (one.attrib["values"].split(";"), [float(time) for time in one.attrib["keyTimes"].split(";")])
        for one in found
        if one.attrib["attributeName"] == attribute
    ]


def test_the_robot_follows_every_motion_in_turn(folder: Path) -> None:
    record = read_record(folder)
    ((poses, times),) = animations(of_campaign(record), "d")
    assert len(poses) == len(times) == ROUNDS * FRAMES + 1
    assert times[0] == 0.0
    assert times[-1] == 1.0
    assert np.all(np.diff(times) >= 0.0)
    total = SECONDS * ROUNDS + HOLD
    np.testing.assert_allclose(times[-2] * total, SECONDS * ROUNDS, atol=0.01)
    lengths = {len(re.findall(r"[ML]", pose)) for pose in poses}
    assert len(lengths) == 1  # a path between poses of other shape would jump
    first, second = (np.array(re.findall(r"-?[\d.]+", pose), dtype=float) for pose in poses[:2])
    assert np.abs(first - second).max() > 0.1


def test_one_state_is_seen_at_any_time_and_each_error_after_its_log(folder: Path) -> None:
    picture = of_campaign(read_record(folder))
    shown = animations(picture, "visibility")
    titles, curves = shown[:ROUNDS], shown[ROUNDS:]
    for group, states in ((titles, ROUNDS), (curves, ROUNDS + 1)):
        seen = np.array([[word == "visible" for word in values] for values, _ in group])
        np.testing.assert_array_equal(seen, np.eye(states, dtype=bool))
    learned = re.findall(r'aria-label="Mean tracking error.*?</svg>', picture, re.DOTALL)
    dots = [len(re.findall(r"<title>learned", panel)) for panel in learned]
    assert dots == [0, 1, 2, 3]
    scales = {re.findall(r'data-scale="([^"]*)"', panel)[0] for panel in learned}
    assert len(scales) == 1  # axes do not move


def test_a_file_is_written_and_what_cannot_be_drawn_is_refused(folder: Path, tmp_path: Path) -> None:
    main([str(folder), str(tmp_path / "out.svg")])
    written = (tmp_path / "out.svg").read_text(encoding="utf-8")
    assert "http" not in written.replace("http://www.w3.org/2000/svg", "")
    assert len(written) < 1_500_000
    with pytest.raises(UsageError, match="two arguments"):
        main([str(folder)])
    write_campaign(tmp_path / "sticks", 1)
    with pytest.raises(UsageError, match="cannot be drawn"):
        of_campaign(read_record(tmp_path / "sticks"))
    write_campaign(tmp_path / "real", 1, evaluated=False)
    with pytest.raises(UsageError, match="no evaluation"):
        of_campaign(read_record(tmp_path / "real"))
