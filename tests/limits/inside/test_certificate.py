from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from limit_examples import ARM_CONFIGS, arm, feasible_arm, flights, middle, room

from certificate_schema import valid
from etude.codes import Notice, Warn
from etude.errors import UnsafeTrajectoryError
from etude.limits import (
    AxisLimit,
    Certificate,
    NormLimit,
    certify,
    certify_bytes,
    in_words,
    require_certified,
    scaled,
    slack,
    utilization,
)
from etude.limits.certificate import ALL, VERSION, facts_of
from etude.trajectories import FourierTrajectory, PointToPoint, random_moves
from etude.types import Proof


def example(name: str = "null space"):
    family, feasible = feasible_arm(arm(), ARM_CONFIGS[name])
    return family.trajectory(scaled(np.random.default_rng(0), feasible)[0])


def flight(speed: float = 1.0) -> FourierTrajectory:
    table = np.zeros((5, 3))
    table[0, 2], table[1, 0] = 2.0, speed
    return FourierTrajectory(table, 2.0 * np.pi / 30.0, 30.0)


def test_the_bytes_that_were_written_are_what_is_certified() -> None:
    motion = example()
    assert certify_bytes(motion.to_json().encode(), arm()) == certify(motion, arm())
    content = json.loads(motion.to_json())
    content["coefficients"][0][1] += 10.0
    assert not certify_bytes(json.dumps(content), arm()).ok


def test_rows_come_axis_by_axis() -> None:
    quantities = ("position", "velocity", "acceleration")
    assert [(r.axis, r.quantity) for r in certify(example(), arm()).rows] == [
        (name, quantity) for name in ("j0", "j1", "j2") for quantity in quantities
    ]
    rows = certify(flight(), room(radius=9.0, tilt=0.5, thrust=(5.0, 14.0))).rows
    assert [row.quantity for row in rows[3:]] == ["speed", "radius", "lift", "thrust", "tilt"]


def test_certificate_as_json() -> None:
    content = valid(certify(example("ramp, omega0 free"), arm()).to_json())
    assert content["version"] == VERSION
    assert content["ok"] is True
    assert content["at_rest"] is True
    assert content["end_speed"] == 0.0
    assert content["not_verified"] == list(ALL)
    for row in content["rows"]:
        assert row["tracking_margin"] == 0.0
        assert row["method"] == "Riesz bound from 64 samples per harmonic"
        left = min(row["upper"] - row["proved_upper"], row["proved_lower"] - row["lower"])
        assert row["slack"] == left >= 0.0
    moves = valid(certify(PointToPoint(np.zeros((2, 3)), 1.0), arm()).to_json())
    assert moves["rows"][0]["method"] == "values that the motion stays between"
    rows = valid(certify(flight(), room(radius=9.0)).to_json())["rows"]
    assert "twice the degree" in rows[3]["method"]


def test_a_limit_that_is_not_met_is_named() -> None:
    motion = example()
    faster = FourierTrajectory(motion.coefficients, 3.0 * motion.omega0, motion.duration / 3.0)
    limits = list(arm())
    speed = limits[1].upper.copy()
    speed[1] = 1e-3
    limits[1] = replace(limits[1], lower=-speed, upper=speed)
    with pytest.raises(UnsafeTrajectoryError, match=r"velocity of 'j1' may reach .*0\.001") as caught:
        require_certified(faster, limits)
    assert caught.value.exit_code == 4
    assert caught.value.where == "j1, velocity"


def test_the_limit_that_a_flight_misses_is_named() -> None:
    for changes, message in (
        ({"speed": 0.9}, r"speed of 'vehicle' may reach 1\.\d+, outside its limit -0\.9\.\.0\.9"),
        ({"upper": (3.0, 10.0, 5.0)}, r"position of 'x' may reach 4\.7\d+, outside its limit -9\.5\.\.2\.5"),
        ({"margin": 1.8}, r"position of 'z' may reach 2, outside its limit 2\.1\.\.3\.2"),
        ({"radius": 5.0}, r"radius of 'vehicle' may reach 4\.7"),
        ({"tilt": 0.02}, r"tilt of 'vehicle' may reach 0\.021"),
        ({"thrust": (7.0, 9.812)}, r"thrust of 'vehicle' may reach 9\.812"),
    ):
        with pytest.raises(UnsafeTrajectoryError, match=message):
            require_certified(flight(), room(**changes))


def test_rest_is_asked_only_where_it_is_wanted() -> None:
    certificate = certify(flight(), room())
    assert certificate.ok
    assert not certificate.at_rest
    assert not certificate.rest_needed
    assert certificate.end_speed == pytest.approx(1.0 / 6.0)
    assert not certify(flight(), room(rest=True)).ok
    with pytest.raises(UnsafeTrajectoryError, match=r"ends at 0\.167 of a velocity limit, not at rest"):
        require_certified(flight(), room(rest=True))
    require_certified(flights(4, rest=True).trajectory(np.eye(19)[12]), room(rest=True))


def test_a_velocity_step_at_the_start_is_not_certified() -> None:
    table = np.zeros((3, 3))
    table[0], table[1] = middle(arm()), 1e-4
    motion = FourierTrajectory(table, 1.0, 2.0 * np.pi)
    assert not certify(motion, arm()).failed
    assert not certify(motion, arm()).ok
    with pytest.raises(UnsafeTrajectoryError, match="not at rest"):
        require_certified(motion, arm())
    require_certified(FourierTrajectory(table, 1.0, 2.0 * np.pi, 1.0), arm())


def test_part_of_a_period_does_not_end_at_rest() -> None:
    motion = example()
    with pytest.raises(UnsafeTrajectoryError, match="not at rest"):
        require_certified(FourierTrajectory(motion.coefficients, motion.omega0, 45.0), arm())


def test_without_a_limit_of_speed_rest_is_relative_to_the_motion() -> None:
    position = arm()[:1]
    assert certify(example(), position).at_rest
    table = np.zeros((3, 3))
    table[0], table[1] = middle(arm()), 1e-4
    assert certify(FourierTrajectory(table, 1.0, 2.0 * np.pi), position).end_speed == pytest.approx(1.0)


def test_use_and_active_limits() -> None:
    limits = arm()
    points = np.array([middle(limits), limits[0].upper])
    motion = PointToPoint(points, 0.1 * limits[1].upper, 0.5, limits[2].upper)
    certificate = certify(motion, limits)
    assert certificate.ok, "a limit that is touched is met"
    assert {("j0", "position"), ("j1", "position"), ("j2", "position")} <= set(certificate.active())
    assert utilization(certificate.worst) == pytest.approx(1.0)


def test_random_moves_are_certified() -> None:
    rng = np.random.default_rng(0)
    for seed in range(20):
        position, velocity, acceleration = arm(seed)
        box = position.lower, position.upper, velocity.upper, acceleration.upper
        motion = random_moves(rng, *box, 5)
        assert certify_bytes(motion.to_json(), arm(seed)).ok


def test_a_tighter_box_is_one_more_limit() -> None:
    motion, limits = example(), arm()
    whole = replace(limits[0], quantity="box")
    assert [row.quantity for row in require_certified(motion, (*limits, whole)).rows[:4]] == [
        "position",
        "velocity",
        "acceleration",
        "box",
    ]
    half = replace(whole, upper=middle(limits))
    with pytest.raises(UnsafeTrajectoryError, match="box of 'j"):
        require_certified(motion, (*limits, half))


@dataclass(frozen=True)
class Tour:
    """Two pieces, one after the other."""

    first: PointToPoint
    second: PointToPoint
    form: str = "tour"

    @property
    def duration(self) -> float:
        return self.first.duration + self.second.duration

    def pieces(self):
        return ((0.0, "segment", self.first), (self.first.duration, "link", self.second))


def test_pieces_are_proved_one_by_one_and_named() -> None:
    limits = (
        AxisLimit("position", 0, ("a",), -np.ones(1), np.ones(1)),
        AxisLimit("velocity", 1, ("a",), -np.ones(1), np.ones(1), rest=True),
    )
    one = PointToPoint(np.array([[0.0], [0.5]]), 0.2)
    tour = Tour(one, PointToPoint(np.array([[0.5], [1.2], [-0.4]]), 0.3))
    certificate = certify(tour, limits)
    position, velocity = certificate.rows
    assert (position.proved_lower, position.proved_upper) == (-0.4, 1.2)
    assert velocity.proved_upper == pytest.approx(0.3)
    assert position.where == f"link at {one.duration:g} s"
    with pytest.raises(UnsafeTrajectoryError, match=r"may reach 1\.2 \(link at .* s\), outside"):
        require_certified(tour, limits)


@dataclass(frozen=True)
class Unseen:
    """A limit that nobody can look at here, and one that is only sampled."""

    name: str = "current"

    def prove(self, piece):
        nan = float("nan")
        return (
            Proof("motor", "current", nan, 3.0, nan, nan, "no model", "not verified"),
            Proof("motor", "heat", -1.0, 1.0, -0.2, 0.4, "9 samples", "sampled"),
        )


def test_what_is_not_looked_at_is_a_row_and_no_failure() -> None:
    certificate = certify(example(), (*arm(), Unseen()))
    assert certificate.ok
    assert [row.status for row in certificate.rows[-2:]] == ["not verified", "sampled"]
    assert np.isnan(slack(certificate.rows[-2]))
    assert "The current of motor: no model." in certificate.not_verified
    assert in_words(certificate.rows[-2]) == "not verified: no model"
    assert certificate.worst.quantity != "current"
    sampled = replace(certificate.rows[-1], proved_upper=2.0)
    assert Certificate((*certificate.rows[:-1], sampled), 0.0).failed == (sampled,)


class Warned:
    """A limit that says something first: one sentence, and one notice."""

    name: str = "warned"

    def prove(self, piece):
        free = Proof("arm", "turns", -np.inf, np.inf, 0.2, 0.5, "9 samples", "sampled")
        return (Proof("arm", "distance", 0.1, np.inf, 0.2, 0.5, "9 samples", "sampled", note="far"), free)

    def warned(self, trajectory):
        return ("Mind the step.", Notice(Warn.TEACHES_LITTLE, {"part": 0.01}))


def test_a_file_says_what_its_certificate_does() -> None:
    """Infinite ends and numbers of what was not verified are null in the file, and come back."""
    found = certify(example(), (*arm(), Unseen(), Warned()))
    content = valid(found.to_json())
    assert [one["code"] for one in content["warnings"]] == ["stated", "teaches_little"]
    assert content["warnings"][0]["sentence"] == "Mind the step"
    read = facts_of(found.to_json())["rows"]
    for row, own in zip(found.rows, read, strict=True):
        names = ("lower", "upper", "proved_lower", "proved_upper", "tracking_margin", "note")
        np.testing.assert_equal([own.get(name, "") for name in names], [getattr(row, name) for name in names])
        np.testing.assert_equal(own["slack"], slack(row))


def test_a_certificate_of_version_1_is_read_with_the_keys_of_this_one() -> None:
    row = {"axis": "a", "quantity": "position", "lower": -1.0, "upper": None, "method": "Riesz bound"}
    row |= {"proved_lower": 0.2, "proved_upper": 0.4, "margin": 0.3}
    (read,) = facts_of(json.dumps({"ok": True, "rows": [row]}))["rows"]
    assert (read["slack"], read["tracking_margin"], read["upper"]) == (0.3, 0.0, np.inf)
    assert "margin" not in read
    for none in ("[]", "{}", '{"rows": [3]}', '{"version": 3, "rows": []}'):
        with pytest.raises(ValueError, match="certificate"):
            facts_of(none)


def test_a_number_that_is_none_is_a_failure() -> None:
    row = certify(example(), arm()).rows[0]
    broken = replace(row, proved_upper=float("nan"))
    assert Certificate((broken,), 0.0).failed == (broken,)


def test_the_speed_at_the_ends_counts_each_limit_of_order_one() -> None:
    limits = room(speed=4.0)
    slower = NormLimit("climb", 1, (2,), 0.5)
    table = np.zeros((3, 3))
    table[0, 2], table[1, 2] = 2.0, 0.25
    motion = FourierTrajectory(table, 1.0, 2.0 * np.pi)
    assert certify(motion, (*limits, slower)).end_speed == pytest.approx(0.5)
    assert certify(motion, limits).end_speed == pytest.approx(0.25 / 4.0)
