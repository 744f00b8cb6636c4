"""A load that was weighed, in the robot file: what it carried before counts, and what it says else stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loading_examples import write
from test_identified_files import spec_of

from etude.errors import UsageError
from etude_arm.loading.attachments import Attached
from etude_arm.payload_table import with_payload
from etude_arm.robot_file import parse_robot, robot_to_toml

OLD = Attached(mass=1.0, centre=(0.0, 0.0, 0.1), shape="sphere", size=(0.03,))


def added(
    path: Path, old: Attached | None, mass: float, centre: tuple[float, float, float]
) -> Attached | None:
    spec = replace(spec_of(path), payload=old, held={"left_joint": 0.0})
    text = robot_to_toml(spec, folder=path.parent) + "\n[floor]\nheight = -1.0\n"
    again = parse_robot(
        with_payload(text, spec, mass, np.array(centre)), where="robot.toml", folder=path.parent
    )
    assert again.axes == spec.axes
    assert again.held == spec.held
    assert again.around.floor is not None
    return again.payload


def test_the_first_load_is_a_ball(tmp_path: Path) -> None:
    found = added(write(tmp_path), None, 0.5, (0.01, 0.0, 0.06))
    assert found is not None
    assert (found.mass, found.centre, found.shape) == (0.5, (0.01, 0.0, 0.06), "none")
    np.testing.assert_allclose(found.moments(), 0.4 * 0.5 * 0.05**2 * np.eye(3))


def test_a_second_one_is_added_as_bodies_are(tmp_path: Path) -> None:
    found = added(write(tmp_path), OLD, 1.0, (0.0, 0.2, 0.1))
    assert found is not None
    assert found.mass == 2.0
    assert found.centre == pytest.approx((0.0, 0.1, 0.1))
    # two balls 20 cm apart along y
    own = 0.4 * (0.05**2 + 0.03**2)
    np.testing.assert_allclose(np.diag(found.moments()), [own + 0.02, own, own + 0.02])
    assert (found.shape, found.size, found.shape_centre) == ("sphere", (0.03,), OLD.centre)


def test_what_is_put_down_goes_out_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert added(path, OLD, -0.98, (0.0, 0.0, 0.1)) is None
    half = added(path, OLD, -0.5, (0.0, 0.0, 0.1))
    assert half is not None
    assert half.mass == 0.5
    with pytest.raises(UsageError, match=r"2 kg were removed, but the robot file states only 1 kg"):
        added(path, OLD, -2.0, (0.0, 0.0, 0.1))
    with pytest.raises(UsageError, match="the payload is at link 'fore'"):
        added(path, replace(OLD, link="fore"), 0.5, (0.0, 0.0, 0.1))
