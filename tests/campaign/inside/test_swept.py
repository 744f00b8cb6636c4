"""What a motion sweeps of each joint's range: on the certificate, on the screen and in the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign

from certificate_schema import valid
from etude import ask
from etude.campaign import stored_trajectory
from etude.campaign.propose.proposal import (
    NO_TIME,
    Swept,
    as_facts,
    reachable,
    swept,
    teaches_little,
    visited_by,
)
from etude.cli import main
from etude.codes import Warn
from etude.design import NonconvexLimits
from etude.protocols import Family, Trajectory
from etude.report import build_report
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory
from etude.types import Array, Cone, Motion, Proof

QUICK = "[design]\ncandidates = 4\nrefine = 1\nsteps = 3\npoints = 20\nreference_points = 30\n"
CONFIG = "[trajectory]\nduration = 30.0\n" + QUICK


def still(axes: int, size: float) -> Trajectory:
    table = np.zeros((11, axes))
    table[1] = size
    return FourierTrajectory(table, 2.0 * np.pi / 30.0, 30.0)


def test_shares_are_counted_from_the_bytes_and_stand_on_the_certificate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG)
    found = ask(campaign)
    rows = valid((found.folder / "certificate.json").read_bytes())["swept"]
    assert rows == as_facts(found.swept)
    motion, reach = stored_trajectory(campaign, 1), reachable(campaign)
    assert reach is not None
    own = [p for _, label, p in motion.pieces() if label == "segment"]
    poses = np.concatenate([p.motion(np.linspace(0.0, p.duration, 4000), 1).orders[0] for p in own])
    for j, row in enumerate(rows):
        counts, _ = np.histogram(poses[:, j], np.linspace(reach.lower[j], reach.upper[j], 21))
        assert row["of_range"] == pytest.approx(np.mean(counts >= 0.005 * len(poses)), abs=0.051)
        assert row["of_range"] == row["of_clear"], "without shapes every pose is clear"
        assert row["held"]
    assert main(["ask", str(campaign.path)]) == 0
    text = capsys.readouterr().out
    assert "of the collision-free range" in text
    assert f"{100 * rows[0]['of_range']:.0f} %" in text
    assert "share of the range swept" in build_report(campaign.path).read_text()


def test_what_stands_in_the_way_is_named(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG)
    limits, axes = campaign.limits(), len(campaign.axes)
    (first, *_) = swept(campaign, still(axes, 0.05), limits)
    assert first.held in (NO_TIME, f"the torque of {campaign.axes[0]}")

    wide = [
        replace(one, margin=0.05 * np.ones(axes)) if getattr(one, "order", 1) == 0 else one for one in limits
    ]
    assert swept(campaign, still(axes, 0.05), wide)[0].held == first.held, "the end of a range is far away"

    class Wall:
        def blocked(self, form: str, pose: np.ndarray) -> str:
            return f"a wall in {form}" if abs(pose[0]) > 0.5 else ""

    (first, *_) = swept(campaign, still(axes, 0.05), [Wall()])  # type: ignore[list-item]
    assert first.held == "a wall in fourier"


def test_a_motion_that_goes_nowhere_says_so_first(tmp_path: Path) -> None:
    small = (Swept("a", 0.05, 0.06, "hand and floor"), Swept("b", 0.1, 0.1, NO_TIME))
    (said,) = teaches_little(small)
    assert said.code == Warn.TEACHES_LITTLE_HELD
    assert "no joint sweeps more than 10 % of its range" in said.sentence
    assert str(said).endswith("Blocked by: hand and floor.")
    assert teaches_little(small[1:])[0].code == Warn.TEACHES_LITTLE
    assert teaches_little((*small, Swept("c", 0.15, 0.2, ""))) == ()
    assert teaches_little(()) == ()


def test_what_waits_for_its_log_is_not_among_what_was_visited(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG)
    ask(campaign)
    reach = reachable(campaign)
    assert reach is not None
    assert visited_by(campaign, reach).total == 0.0


class Energy:
    """Of the whole robot, with neither cones nor a penalty: it only judges."""

    name = "energy"

    def __init__(self, most: float, axis: str = "robot") -> None:
        self.most, self.axis = most, axis

    def cones(self, family: Family) -> Sequence[Cone]:
        return ()

    def penalty(self, motion: Motion) -> None:
        return None

    def of_motion(self, motion: Motion) -> Array:
        return np.asarray((motion.orders[1] ** 2).sum(axis=1, keepdims=True))

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        t = np.linspace(0.0, piece.duration, 400)
        found = self.of_motion(piece.motion(t, 2))
        ends = float(found.min()), float(found.max())
        return [Proof(self.axis, "energy", -np.inf, self.most, *ends, "samples", "sampled")]


def test_a_limit_that_only_judges_shrinks_the_motion_and_is_named(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG)
    motion = stored_trajectory(campaign, ask(campaign).number)
    pieces = [piece for _, label, piece in motion.pieces() if label == "segment"]
    whole = max(Energy(1.0).prove(piece)[0].proved_upper for piece in pieces)
    rows = swept(campaign, motion, [Energy(whole)])
    assert {row.held for row in rows if row.held} == {"the limit of energy of robot"}
    # a shrunk motion may end some per cent below the limit; one of a joint holds that joint alone
    first, *others = swept(campaign, motion, [Energy(whole / 0.94, campaign.axes[0])])
    assert first.held == f"the limit of energy of {campaign.axes[0]}"
    assert {row.held for row in others if row.held} <= {NO_TIME}
    assert {row.held for row in swept(campaign, motion, [Energy(2.0 * whole)]) if row.held} == {NO_TIME}
    family = FourierFamily.of(FourierConfig(), axes=3)
    p = np.full(family.size, 0.1)
    kept = NonconvexLimits.of([Energy(0.01)], family, p)
    small = kept.shrink_to_home(family, np.zeros(family.size), p)
    assert 0.0 < np.abs(small).max() < 0.1
    assert kept.proved(family, small)
