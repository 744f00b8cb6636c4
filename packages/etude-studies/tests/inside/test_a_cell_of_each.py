"""One cell of every study that docs name, at its full size: does it still run, and are its figures figures?

What the cells say is what studies are for; here only that no robot, part or rule of theirs was left behind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etude_studies import (
    arm,
    changed_robot,
    closed_loops,
    collecting,
    confirm,
    design_gain,
    flight_loop,
    more_joints,
    online,
    online_faults,
    watch,
)
from etude_studies.design_parts import PARTS

pytestmark = pytest.mark.slow
SEED = 7700


def numbers(found: Any) -> Iterable[float]:
    """Every number in nested cells; a word counts as one."""
    if is_dataclass(found) and not isinstance(found, type):
        found = asdict(found)
    if isinstance(found, msgspec.Struct):
        found = msgspec.structs.asdict(found)
    if isinstance(found, Mapping):
        found = list(found.values())
    if found is None:
        return
    if isinstance(found, str):
        yield float(len(found))
        return
    if isinstance(found, Iterable):
        for own in found:
            yield from numbers(own)
    else:
        yield float(found)


def cells() -> dict[str, Callable[[Path], Any]]:
    """A cell by the study's name and what is special about it."""
    found: dict[str, Callable[[Path], Any]] = {
        f"closed_loops {case.robot} {case.form} {case.control}": lambda _, case=case: closed_loops.run_row(
            case
        )
        for case in closed_loops.cases(12)
    }
    for part, (measure, arms) in PARTS.items():
        for own in arms:
            found[f"design {part} {own}"] = lambda _, m=measure, own=own: m(own, SEED)
    for robot in changed_robot.ROBOTS:
        found[f"changed_robot {robot}"] = lambda _, robot=robot: changed_robot.measured(robot, SEED)
    for robot in confirm.ROBOTS:
        found[f"confirm {robot}"] = lambda _, robot=robot: confirm.measured(robot, SEED)
    for robot in design_gain.ROBOTS:
        found[f"design_gain {robot}"] = lambda f, robot=robot: design_gain.cell(robot, SEED, f)
    for robot in watch.ROBOTS:
        found[f"watch {robot}"] = lambda _, robot=robot: watch.measured(robot, SEED)
        found[f"watch, several runs, {robot}"] = lambda _, robot=robot: watch.several_runs(robot, SEED)
    for joints in more_joints.JOINTS[:2]:
        found[f"more_joints {joints}"] = lambda f, joints=joints: more_joints.cell(joints, SEED, f)
    for place in online.PLACES:
        found[f"online {' '.join(place)}"] = lambda f, p=place: online.run_cell(online.Cell(*p, SEED), f)
    for place in online_faults.PLACES:
        found[f"online_faults {place.name}"] = lambda f, p=place: online_faults.run_cell(
            p, SEED, f, online_faults.KINDS[:2]
        )
    return found


@pytest.mark.parametrize("name", cells())
def test_a_cell_runs(name: str, tmp_path: Path) -> None:
    found = list(numbers(cells()[name](tmp_path)))
    assert found
    assert sum(math.isfinite(own) for own in found) >= 0.5 * len(found)


def test_campaigns_of_the_arm_studies_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm, "ROUNDS", 2)
    for robot, rung in arm.ARMS:
        arm.run_one(arm.Cell(robot, rung, SEED), tmp_path)
    for manner in collecting.MANNERS:
        collecting.run_one(collecting.Cell("arm4_rough", manner, SEED), tmp_path)
    assert len(list(tmp_path.iterdir())) == len(arm.ARMS) + len(collecting.MANNERS)


def test_a_loop_of_flights_runs(tmp_path: Path) -> None:
    for setting in flight_loop.SETTINGS:
        _, errors = flight_loop.run_one(flight_loop.Cell(*setting, SEED), tmp_path)
        assert all(map(math.isfinite, errors.values()))
