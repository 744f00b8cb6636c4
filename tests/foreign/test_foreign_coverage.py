"""Proposals sweep where an arm can be, by a ruler of others: pinocchio and coal.

Every day one arm with a short search; -m slow six arms and three seeds, three proposals each, with the speed
that is left of motions without collisions, and what links take.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="pinocchio has no wheel for this Python or system: pip install pin")
pytest.importorskip("coal", reason="coal comes with pinocchio: pip install pin")

from coverage_ruler import Ruler, ruler_of_campaign, swept
from measure_coverage import file_of, measured, packages_of, robots

from etude import ask
from etude.campaign import RobotPart, create_campaign, open_campaign, stored_trajectory
from etude.protocols import Trajectory

QUICK = 'kind = "arm"\n[design]\nrefine = 1\nsteps = 2\npoints = 15\nreference_points = 20\n'
FIRST, THIRD = (0.35, 0.6), (0.6, 0.8)
"""Least share of the clear range on any joint, and median over joints, after one and after three."""
APART = 0.02
"""s between poses that are looked at."""
SIX = ("ur5", "panda", "xarm7", "z1", "kinova", "so100")


@pytest.fixture(autouse=True)
def _installed() -> None:
    try:
        robots()
    except ModuleNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")


@cache
def first_of(arm: str, folder: Path, candidates: int = 24, seconds: float = 60.0) -> tuple[Trajectory, Ruler]:
    """A first proposal of that duration, the best of so many motions, and the ruler of its arm."""
    path = create_campaign(
        folder / f"of_{candidates}", str(file_of(arm)), seed=5, part=RobotPart((), {}, ())
    )[0].path
    length = f"[trajectory]\nduration = {seconds}\n"
    (path / "campaign.toml").write_text(f"{QUICK}candidates = {candidates}\n{length}")
    campaign = open_campaign(path)
    ask(campaign)
    return stored_trajectory(campaign, 1), ruler_of_campaign(path, file_of(arm), packages_of(arm))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arms")


@pytest.mark.slow
def test_a_first_motion_sweeps_most_of_the_clear_range(folder: Path) -> None:
    motion, ruler = first_of("ur5", folder)
    found = swept([motion], *ruler.clear_range(np.random.default_rng(1)))
    assert found.share.min() >= FIRST[0]
    assert np.median(found.share) >= FIRST[1]
    assert found.links <= 0.25


@pytest.mark.slow
def test_it_keeps_clear_by_distances_of_others_links_and_all(folder: Path) -> None:
    # the best of few sweeps less, and so does a short one; both are as clear
    motion, ruler = first_of("ur5", folder, candidates=4, seconds=24.0)
    poses = motion.motion(np.arange(0.0, motion.duration, APART), 1).orders[0]
    assert [t for t, pose in enumerate(poses) if not ruler.clear(pose)] == []
    inside = ruler.home.copy()
    inside[1] = 0.5 * np.pi  # the upper arm points into the floor
    assert not ruler.clear(inside)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("arm", SIX)
def test_three_proposals_of_six_arms(arm: str, seed: int) -> None:
    row = measured(arm, seed, logs=False)
    assert min(row["first"]) >= FIRST[0]
    assert np.median(row["first"]) >= FIRST[1]
    assert min(row["third"]) >= THIRD[0]
    assert np.median(row["third"]) >= THIRD[1]
    assert row["speed"] >= 0.5
    assert row["slowest"] >= 0.25
    assert row["links"] <= 0.25
