"""ask --from: where the robot stands, the way to the start, and back."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from small_robot import ALONE, make_campaign, stub_learner, write_log

from etude import ask, tell
from etude.campaign import Campaign, stored_trajectory
from etude.campaign.propose.approach import pose_of
from etude.cli import main
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import APPROACH, AxisLimit, certify
from etude.plugins import load
from etude.protocols import Trajectory
from etude.trajectories import FourierTrajectory, from_json
from etude.types import Array

RANDOM = '[trajectory]\nduration = 8.0\n[data]\ncutoff_hz = 5.0\n[design]\nfirst = "random"\n' + ALONE


@pytest.fixture
def lab(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path, config=RANDOM)


def ends(motion: Trajectory) -> Array:
    return motion.motion(np.array([0.0, motion.duration]), 3).orders[:, :]


def test_the_way_leads_from_the_pose_to_the_start_and_back_at_rest(lab: Campaign) -> None:
    found = ask(lab, start="hip=0.5,knee=-1.0")
    assert found.approach is not None
    assert [path.name for path in found.approach.files[:3]] == [
        "approach.json",
        "approach.csv",
        "approach.certificate.json",
    ]
    approach, back = (
        from_json((found.approach.folder / f"{name}.json").read_bytes()) for name in ("approach", "return")
    )
    start, end = ends(stored_trajectory(lab, 1))[0]
    np.testing.assert_allclose(ends(approach)[0], [[0.5, -1.0], start], atol=1e-12)
    np.testing.assert_allclose(ends(back)[0], [end, [0.5, -1.0]], atol=1e-12)
    for motion in (approach, back):
        assert not ends(motion)[1:].any()
        assert certify(motion, lab.limits()).ok
    whole = from_json((found.approach.folder / "trajectory.json").read_bytes())
    assert [label for _, label, _ in whole.pieces()] == ["approach", "segment", "return"]
    assert APPROACH not in found.approach.certificates["trajectory"].not_verified
    assert APPROACH in found.certificate.not_verified


def test_a_flight_asked_for_again_is_shown_with_the_rows_of_its_certificate_and_its_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "sky")
    assert main(["init", folder, "--robot", "quadrotor_rough"]) == 0
    said = []
    for more in ([], [], ["--from", "ground"]):
        capsys.readouterr()
        assert main(["ask", folder, "--json", *more]) == 0
        said.append(json.loads(capsys.readouterr().out))
    assert "vehicle tilt" in said[0]["slack"]
    assert said[0]["slack"] == said[1]["slack"] == said[2]["slack"]
    assert APPROACH in said[0]["not_verified"]
    assert [one for one in said[0]["not_verified"] if one != APPROACH] == said[2]["not_verified"]
    config = tmp_path / "sky" / "campaign.toml"
    text = config.read_text(encoding="utf-8")
    assert "tilt = 0.4363" in text
    config.write_text(re.sub("tilt = 0.4363\\d*", "tilt = 0.01", text), encoding="utf-8")
    assert main(["ask", folder, "--json"]) == 0  # less is allowed by now: the vehicle's own limits hold still
    assert "vehicle tilt" not in json.loads(capsys.readouterr().out)["slack"]


def test_each_pose_has_files_of_its_own_written_once(lab: Campaign) -> None:
    first = ask(lab, start="home").approach
    other = ask(lab, start="hip=0.5,knee=-1.0").approach
    assert first is not None
    assert other is not None
    assert first.folder.name == "from_home"
    assert other.folder != first.folder
    events = len(lab.events())
    again = ask(lab, start="home").approach
    assert again is not None
    assert len(lab.events()) == events
    path = first.folder / "approach.json"
    path.write_bytes(path.read_bytes().replace(b"moves", b"Moves"))
    with pytest.raises(UsageError, match=r"approach\.json"):
        ask(lab, start="home")


def test_a_log_of_the_whole_answers_the_proposal(lab: Campaign, tmp_path: Path) -> None:
    approach = ask(lab, start="hip=0.5,knee=-1.0").approach
    assert approach is not None
    assert approach.whole is not None
    log = write_log(tmp_path / "whole.csv", approach.whole)
    told = tell(lab, log, learner=stub_learner)
    assert (told.number, told.foreign) == (1, False)
    errors = np.array(lab.state().rounds[1].ingested.tracked["fourier"])
    assert errors[0].max() < 0.01


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ("hip=1.5,knee=0", "hip is at 1.5, outside its limits -1..1"),
        ("hip=0", "the pose lacks knee"),
        ("hip=0,knee=0,toe=1", "the robot has no joint toe"),
        ("hip=a,knee=0", "does not have the form joint=value"),
        ("hip=nan,knee=0", "hip is at nan"),
        ("nowhere.csv", "there is no pose 'nowhere.csv', and no such file"),
        ("hom", "Did you mean home"),
    ],
)
def test_a_pose_that_is_none_is_refused(lab: Campaign, start: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        ask(lab, start=start)
    assert not list(lab.proposal(1).glob("from_*"))


def test_the_last_row_of_a_table_is_a_pose(lab: Campaign, tmp_path: Path) -> None:
    path = tmp_path / "now.csv"
    path.write_text("time,q_knee,q_hip\n0,0,0\n1,-0.5,0.25\n")
    np.testing.assert_array_equal(pose_of(lab, str(path)), [0.25, -0.5])
    path.write_text("time,q_knee\n0,0\n")
    with pytest.raises(UsageError, match="no column q_hip"):
        pose_of(lab, str(path))


def test_where_the_straight_way_is_barred_it_goes_by_home_or_not_at_all() -> None:
    """What is barred: the middle of x while y is low; home is above it."""
    from etude.campaign import there_and_back
    from etude_arm import KIND, ArmSpec, Axis

    spec = ArmSpec("pair", tuple(Axis(n, -1.0, 1.0, 1.0, 2.0, 1.0) for n in "xy"), "N m", 50.0)
    motion = FourierTrajectory(np.array([[0.8, -0.8], [0.0, 0.0], [0.0, 0.0]]), 1.0, 5.0)
    pose = np.array([-0.8, -0.8])

    class Barred(AxisLimit):
        def prove(self, piece: Trajectory):  # type: ignore[no-untyped-def]
            path = piece.motion(np.linspace(0.0, piece.duration, 101), 1).orders[0]
            through = np.any((np.abs(path[:, 0]) < 0.2) & (path[:, 1] < -0.3))
            rows = super().prove(piece)
            from dataclasses import replace

            return [replace(row, proved_upper=9.0) if through else row for row in rows]

    def limit(kind: type[AxisLimit]) -> AxisLimit:
        return kind("position", 0, ("x", "y"), -np.ones(2), np.ones(2))

    def approach(m: Trajectory, p: Array) -> tuple[Trajectory, Trajectory] | None:
        return KIND.approaches(spec, m, p)

    free = there_and_back(motion, pose, approach, [limit(AxisLimit)], np.array([0.0, 0.8]))
    barred = there_and_back(motion, pose, approach, [limit(Barred)], np.array([0.0, 0.8]))
    assert free is not None
    assert barred is not None
    assert len(free.approach.pieces()) == 1
    assert [label for _, label, _ in barred.approach.pieces()] == ["approach", "approach"]
    assert barred.whole is not None
    assert len(barred.whole.pieces()) == 5
    slow = AxisLimit("velocity", 1, ("x", "y"), -np.full(2, 0.016), np.full(2, 0.016))
    slowed = there_and_back(motion, pose, approach, [limit(AxisLimit), slow], np.array([0.0, 0.8]))
    assert slowed is not None
    assert slowed.approach.duration == pytest.approx(32.0 * free.approach.duration)
    half = there_and_back(motion, pose, approach, [limit(AxisLimit)], np.array([0.0, 0.8]), speed=50.0)
    assert half is not None
    assert half.approach.duration == pytest.approx(2.0 * free.approach.duration)
    assert half.back.duration == pytest.approx(2.0 * free.back.duration)
    with pytest.raises(UnsafeTrajectoryError, match="'x' may reach 9"):
        there_and_back(motion, pose, approach, [limit(Barred)], np.array([0.0, -0.8]))
    home, clear = np.array([-0.8, -0.8]), np.array([[-0.8, -0.8], [0.0, 0.9]])
    by_clear = there_and_back(motion, home, approach, [limit(Barred)], home, clear)
    assert by_clear is not None, "home itself has no straight path to the motion's ends"
    for way, end in ((by_clear.approach, 0), (by_clear.back, -1)):
        np.testing.assert_allclose(way.motion(np.array([0.0, way.duration]), 1).orders[0, end], home)
        first = way.pieces()[0][2]
        np.testing.assert_allclose(first.motion(np.array([first.duration]), 1).orders[0, 0], clear[1])


def test_a_flight_goes_from_hover_into_its_plan_and_out_of_it() -> None:
    kind = load("etude.robots", "quadrotor")
    spec = kind.spec(kind.built_in()["quadrotor"])
    flight = FourierTrajectory(np.array([[0.0, 0.0, 2.0], *(0.3 * np.ones((4, 3)))]), 0.5, 12.0)
    still = FourierTrajectory(np.array([[3.0, 1.0, 2.0], *np.zeros((4, 3))]), 0.5, 12.0)
    pose = np.array([2.0, -1.0, 1.5])
    out, back = kind.approaches(spec, flight, pose)
    plan = flight.motion(np.array([0.0, 12.0]), 4).orders
    for approach, at_rest, joined in ((out, 0, 0), (back, 1, 1)):
        orders = approach.motion(np.array([0.0, approach.duration]), 4).orders
        np.testing.assert_allclose(orders[:, at_rest], [pose, *np.zeros((3, 3))], atol=1e-9)
        np.testing.assert_allclose(orders[:, 1 - at_rest], plan[:, joined], atol=1e-9)
    out = kind.approaches(spec, still, pose)[0]
    t = np.linspace(0.0, out.duration, 2001)
    rates = np.linalg.norm(out.motion(t, 4).orders, axis=2)
    assert rates[1].max() < 0.31 * spec.speed
    assert rates[2].max() < 0.51
    assert rates[1:, [0, -1]].max() < 1e-9
