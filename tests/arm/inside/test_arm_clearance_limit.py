"""Clearance as a limit: its rows, tracking, the certificate, the robot file, and motions that keep it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from clearance_examples import NAMES, PLANAR, clearance, planar, planar_spec

from etude.codes import Warn
from etude.design import NonconvexLimits, Source
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import certify, in_words, place_of, require_certified, slack, utilization
from etude.trajectories import FourierConfig, FourierTrajectory, PointToPoint
from etude.types import Motion
from etude_arm import KIND
from etude_arm.clearance.clearance_limit import TAKEN
from etude_arm.clearance.distances import TOLERANCE
from etude_arm.clearance.robot_clearance import clearance_of, search_of
from etude_arm.clearance.surroundings import Box, Collision, Column, Floor, Room, Search, Surroundings, Wall
from etude_arm.description import describe
from etude_arm.motions import family, limits
from etude_arm.motions import tests as motions_of_tests
from etude_arm.robot_file import parse_robot, robot_to_toml

FLOOR = Surroundings(floor=Floor(0.0))
LIMIT = clearance(planar(FLOOR))
PERIOD = 2.0 * math.pi


def swing(size: float, joint: int = 0) -> FourierTrajectory:
    table = np.zeros((3, 3))
    table[1, joint] = size
    return FourierTrajectory(table, 1.0, PERIOD)


def test_one_row_for_each_pair_of_parts_and_each_thing() -> None:
    rows = LIMIT.prove(swing(0.5))
    own = ["fore and base", "hand and base", "hand and upper"]
    assert [row.axis for row in rows] == [*own, "upper and floor", "fore and floor", "hand and floor"]
    assert {(row.quantity, row.status, row.lower, row.upper) for row in rows} == {
        ("clearance", "proved", 0.01, np.inf)
    }
    measured = LIMIT.of_motion(swing(0.5).motion(np.linspace(0.0, PERIOD, 50), 3))
    assert measured.shape == (50, 6)
    gaps = LIMIT.gaps.of_poses(swing(0.5).motion(np.linspace(0.0, PERIOD, 50), 1).orders[0])
    for row, values in zip(LIMIT.rows, measured.T, strict=True):
        own = [i for i, gap in enumerate(LIMIT.gaps.list) if gap.row == row]
        np.testing.assert_array_equal(values, gaps[:, own].min(axis=1))


def test_a_pair_that_is_near_at_home_keeps_half_of_that() -> None:
    near = clearance(planar(Surroundings(floor=Floor(0.25))))  # 10 mm below the upper arm
    rows = {row.axis: row for row in near.prove(swing(0.01, joint=2))}
    assert rows["upper and floor"].lower == pytest.approx(0.005)
    assert rows["hand and floor"].lower == 0.01


def test_it_says_first_of_all_where_next_to_no_motion_is_left() -> None:
    near = clearance(planar(Surroundings(floor=Floor(0.25))))  # 10 mm below the upper arm
    (said,) = certify(swing(0.01), [near]).warnings
    assert said.code == Warn.HARDLY_MOVES
    assert "no joint moves through more than 0.36 % of its range" in said.sentence
    assert "the distance of upper and floor is 10 mm" in said.sentence
    way = PointToPoint(np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]), 1.0)
    for limit, motion in ((near, swing(0.3)), (LIMIT, swing(0.01)), (near, way)):
        assert not limit.warned(motion)


def test_tracking_that_leaves_no_room_is_counted_in_part_and_only_assumed() -> None:
    near = clearance(planar(Surroundings(floor=Floor(0.25))))  # 10 mm below the upper arm
    error = np.vstack([np.full(3, 0.25), np.full((2, 3), np.nan)])  # would take more than that at home
    tracked = replace(near, margins={"fourier": (error, 0.95)}, _proofs={}, _verdicts={}, _shares={})
    still = {row.axis: row for row in tracked.prove(swing(0.0))}
    assert all(slack(row) > 0.0 for row in still.values()), "home is kept, whatever the margin"
    narrow, wide = still["upper and floor"], still["hand and upper"]
    assert narrow.confidence == 0.0
    assert "no room for more" in narrow.note
    assert narrow.tracking_margin == pytest.approx(TAKEN * (0.01 - TOLERANCE - 1.5 * 0.005), rel=1e-6)
    assert wide.confidence == 0.95
    assert "no room" not in wide.note


@pytest.mark.parametrize("error", [0.001, 0.003, 0.01, 0.25])
def test_a_search_finds_home_however_poor_the_tracking(error: float) -> None:
    near = clearance(planar(Surroundings(floor=Floor(0.25))))
    table = np.vstack([np.full(3, error), np.full((2, 3), np.nan)])
    assert replace(near, margins={"fourier": (table, 0.95)}, _verdicts={}, _shares={}).keeps(swing(0.0))


def test_tracking_takes_its_part_and_says_so() -> None:
    error = np.vstack([np.full(3, 0.02), np.full((2, 3), np.nan)])
    tracked = replace(LIMIT, margins={"fourier": (error, 0.95)}, _proofs={}, _verdicts={})
    motion = swing(1.3)  # the hand comes down to about 0.5 m
    plain, kept = LIMIT.prove(motion), tracked.prove(motion)
    for one, other in zip(plain, kept, strict=True):
        assert other.confidence == 0.95
        assert one.tracking_margin == 0.0
        assert 0.0 < other.tracking_margin < 0.08
        assert other.proved_lower <= one.proved_lower
        assert in_words(other) == (
            f"at least {other.proved_lower:.4g} with tracking of {other.tracking_margin:.3g} "
            "with 95 % confidence, limit 0.01"
        )
    refused = [
        size for size in np.arange(1.3, 1.9, 0.02) if min(map(slack, tracked.prove(swing(size)))) < 0.0
    ]
    allowed = [size for size in np.arange(1.3, 1.9, 0.02) if min(map(slack, LIMIT.prove(swing(size)))) >= 0.0]
    assert min(refused) <= max(allowed), "tracking errors cost some room"
    assert min(refused) > max(allowed) - 0.06, "but not much more than themselves"
    other_form = replace(tracked, margins={"moves": (error, 0.95)}, _proofs={}, _verdicts={})
    assert other_form.prove(motion) == plain


def test_the_certificate_names_pair_and_time_and_says_what_is_left_out() -> None:
    limit = replace(LIMIT, not_verified=("Cables.",), _proofs={}, _verdicts={})
    certificate = certify(swing(0.5), [limit])
    assert "Cables." in certificate.not_verified
    assert not any("Collisions" in sentence for sentence in certificate.not_verified)
    assert any("Collisions" in sentence for sentence in certify(swing(0.5), []).not_verified)
    assert 0.0 < utilization(certificate.rows[0]) < 1.0
    rows = json.loads(certificate.to_json(), parse_constant=pytest.fail)["rows"]
    assert {row["upper"] for row in rows} == {None}
    with pytest.raises(
        UnsafeTrajectoryError, match=r"clearance of 'hand and floor' .* \(hand and floor at 1\.\d+ s\)"
    ):
        require_certified(swing(1.95), [limit])


def test_the_search_box_is_not_a_proof_and_motions_may_grow_beyond_it(tmp_path) -> None:
    spec = planar_spec(tmp_path, FLOOR)
    found = family(spec, FourierConfig(3, 20.0))
    strong = replace(spec, axes=tuple(replace(axis, command=200.0) for axis in spec.axes))
    own, rng = limits(strong, {}), np.random.default_rng(0)
    home, low, high = search_of(spec)
    source = Source(found, own, home, "scaled")
    drawn = source.typical(rng, 4)
    expanded = source.typical(np.random.default_rng(0), 4, expanded=True)
    beyond = 0
    for one, other in zip(drawn, expanded, strict=True):
        assert certify(one.trajectory, own).ok
        assert certify(other.trajectory, own).ok
        t = np.linspace(0.0, 20.0, 2001)
        one_q, other_q = (d.trajectory.motion(t, 1).orders[0] for d in (one, other))
        assert np.all((low - 1e-9 <= one_q) & (one_q <= high + 1e-9))
        assert np.all(np.ptp(other_q, axis=0) >= np.ptp(one_q, axis=0) - 1e-9)
        beyond += bool(np.any((other_q < low) | (other_q > high)))
    assert beyond


def test_growing_heeds_worth(tmp_path) -> None:
    spec = planar_spec(tmp_path, FLOOR)
    own = limits(spec, {})
    drawn = Source(family(spec, FourierConfig(3, 20.0)), own, search_of(spec)[0], "scaled").typical(
        np.random.default_rng(1), 1
    )[0]
    kept = NonconvexLimits.of(own, drawn.family, drawn.p)
    half = drawn.feasible.centre + 0.5 * (drawn.p - drawn.feasible.centre)
    home = drawn.feasible.centre
    assert np.array_equal(
        kept.expand(drawn.family, home, half, lambda p: -float(np.abs(p - half).sum())), half
    )
    assert not np.array_equal(kept.expand(drawn.family, home, half), half)


def test_the_robot_file_holds_what_stands_around(tmp_path) -> None:
    around = Surroundings(
        collision=Collision(0.02, (("hand", "upper"),)),
        floor=Floor(-0.1),
        box=(Box("table", (0.5, 0.0, 0.1), (0.2, 0.4, 0.2), 0.3),),
        wall=(Wall("fence", (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),),
        room=Room((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0)),
        column=Column(0.8, (0.1, 0.0)),
        search=Search((0.0, 0.1, 0.2), (-1.0,) * 3, (1.0,) * 3),
    )
    spec = planar_spec(tmp_path, around)
    text = robot_to_toml(spec, folder=tmp_path)
    assert parse_robot(text, where="robot.toml", folder=tmp_path) == spec
    plain = planar_spec(tmp_path)
    for table in ("collision", "floor", "box", "search"):
        assert f"[{table}" not in robot_to_toml(plain, folder=tmp_path)
    for old, new, fact in (
        ("home = [0.0, 0.1, 0.2]", "home = [0.0, 0.1]", "home has 2 numbers"),
        ("home = [0.0, 0.1, 0.2]", "home = [0.0, 3.1, 0.2]", "home 3.1, box -1 to 1, limits"),
        ("margin = 0.02", "margin = nan", "margin needs a finite number, not nan"),
        ("height = -0.1", "height = inf", "height needs a finite number, not inf"),
        (
            "[0.5, 0.0, 0.1]",
            "[0.5, nan, 0.1]",
            "centre of box 'table' needs finite numbers, not 0.5, nan, 0.1",
        ),
        ("[0.2, 0.4, 0.2]", "[0.2, 0.0, 0.2]", "box 'table' needs edges above 0 m, not 0"),
        ("[1.0, 0.0, 0.0]", "[inf, 0.0, 0.0]", "point of wall 'fence' needs finite numbers"),
        ("[-1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "wall 'fence' needs a normal that is not zero"),
        ("radius = 0.8", "radius = 0.0", "column needs a radius above 0 m, not 0"),
        ("centre = [0.1, 0.0]", "centre = [nan, 0.0]", "centre of column needs finite numbers, not nan, 0"),
        ("margin = 0.02", "margin = -0.02", "margin must be above 0 m, not -0.02.*robot file"),
    ):
        with pytest.raises(UsageError, match=fact):
            parse_robot(text.replace(old, new), where="robot.toml", folder=tmp_path)


def test_a_description_is_completed_and_says_what_it_assumed(tmp_path) -> None:
    spec = planar_spec(tmp_path)
    path = tmp_path / "given.toml"
    path.write_text(robot_to_toml(spec, folder=tmp_path))
    described = describe(path)
    for name, data in described.files.items():
        (tmp_path / name).write_bytes(data)
    again = KIND.spec(tmp_path / "robot.toml")
    assert again.around.search is not None
    assert again.around.floor is None, "a robot file says itself what stands around"
    assert clearance_of(again, {}).lower == pytest.approx(again.around.search.lower)  # type: ignore[union-attr]
    np.testing.assert_array_equal(KIND.home(again), again.around.search.home)


@pytest.mark.parametrize(("height", "assumed"), [(0.1, True), (0.0, False)])
def test_a_floor_is_assumed_where_the_base_can_stand_on_one(tmp_path, height: float, assumed: bool) -> None:
    path = tmp_path / "arm.xml"
    actuators = "".join(f'<motor joint="{n}" ctrlrange="-1 1" ctrllimited="true" gear="50"/>' for n in NAMES)
    text = PLANAR.replace('pos="0 0 .1"', f'pos="0 0 {height}"')
    path.write_text(text.replace("</mujoco>", f"<actuator>{actuators}</actuator></mujoco>"))
    spec = planar_spec(tmp_path, xml=path.read_text())
    from etude_arm.clearance.robot_clearance import completed
    from etude_arm.loading.load import load_arm

    around, confirm = completed(spec, load_arm(spec), whole_file=True)
    assert (around.floor == Floor(0.0)) == assumed
    assert ("A floor is assumed" in confirm[0]) == assumed
    assert ("No floor is assumed" in confirm[0]) != assumed


def test_without_shapes_there_is_nothing_to_keep(tmp_path) -> None:
    bare = re.sub('<geom name="base.*?/>', "", PLANAR)
    bare = re.sub("<geom .*?/>", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>', bare)
    spec = planar_spec(tmp_path, xml=bare)
    assert clearance_of(spec, {}) is None
    np.testing.assert_array_equal(search_of(spec)[0], np.zeros(3))
    assert [limit.name for limit in limits(spec, {})] == ["position", "velocity", "acceleration", "torque"]
    not_wanted = planar_spec(tmp_path, Surroundings(collision=Collision(look=False), floor=Floor(0.0)))
    assert clearance_of(not_wanted, {}) is None
    without = replace(spec, model_file=None)
    assert clearance_of(without, {}) is None
    assert len(KIND.limits(without, None, None, {})) == 3


def test_test_motions_stay_where_nearly_all_is_clear(tmp_path) -> None:
    spec = planar_spec(tmp_path, FLOOR)
    _, low, high = search_of(spec)
    for motion in motions_of_tests(spec, np.random.default_rng(0)).values():
        q = motion.motion(np.linspace(0.0, motion.duration, 1001), 1).orders[0]
        assert np.all((low - 1e-9 <= q) & (q <= high + 1e-9))


def test_no_penalty_pushes() -> None:
    value, gradient = LIMIT.penalty(Motion(np.zeros(2), np.zeros((3, 2, 3))))
    assert value == 0.0
    assert not gradient.any()


def test_what_is_far_as_planned_names_no_place_and_no_part_of_an_error_is_rounded_up_to_all_of_it() -> None:
    error = np.vstack([np.full(3, 0.136), np.full((2, 3), np.nan)])
    tracked = replace(LIMIT, margins={"fourier": (error, 0.95)}, _proofs={}, _verdicts={}, _shares={})
    rows = {row.axis: row for row in certify(swing(0.0), [tracked]).rows}
    assert rows["hand and upper"].where == "upper and hand at 0 s"
    assert place_of(rows["fore and floor"]) == "planned distance 0.3 m or more"
    beyond = "planned distance 0.3 m or more; tracking errors counted at 99%: no room for more"
    assert place_of(rows["hand and floor"]) == beyond


def test_a_place_within_a_piece_comes_before_what_is_said_of_it() -> None:
    rows = certify(swing(0.0), [LIMIT]).rows
    row = replace(rows[0], where="a and b at 2 s of the link at 7 s", note="so and so")
    assert place_of(row) == "a and b at 2 s of the link at 7 s; so and so"
    assert (place_of(replace(row, where="")), place_of(replace(row, note=""))) == ("so and so", row.where)
