"""The test plants themselves: closed forms, and what their documentation says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from trajectory_controller import Message, Parameters, Point, RejectedError, between, play, validate

pytestmark = pytest.mark.filterwarnings("error")

JOINTS = Parameters(("a", "b"))


def point(seconds: float, *rows: tuple[float, float]) -> Point:
    return Point(round(seconds * 1e9), *rows)


def test_a_quintic_through_its_own_ends_is_itself() -> None:
    numbers = np.array([[0.3, -1.0], [0.5, 0.2], [-0.7, 0.4], [1.1, 0.1], [-0.2, 0.3], [0.05, -0.1]])

    def at(t: float) -> Point:
        rows = [
            tuple((np.polynomial.polynomial.polyder(numbers, k) if k else numbers).T @ t ** np.arange(6 - k))
            for k in range(3)
        ]
        return point(t, *rows)

    found = between(at(0.0), at(0.8), 0.3)
    want = at(0.3)
    for row, other in zip(
        (found.positions, found.velocities, found.accelerations),
        (want.positions, want.velocities, want.accelerations),
        strict=True,
    ):
        np.testing.assert_allclose(row, other, atol=1e-12)


def test_without_accelerations_it_is_a_cubic_and_without_velocities_a_line() -> None:
    ends = point(0.0, (0.0, 0.0), (0.0, 0.0)), point(1.0, (1.0, 2.0), (0.0, 0.0))
    np.testing.assert_allclose(between(*ends, 0.25).positions, np.array([1.0, 2.0]) * (3 / 16 - 2 / 64))
    lines = point(0.0, (0.0, 0.0)), point(1.0, (1.0, 2.0))
    np.testing.assert_allclose(between(*lines, 0.25).velocities, [1.0, 2.0])


def test_the_last_point_is_repeated_with_its_acceleration() -> None:
    points = point(0.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), point(1.0, (1.0, 2.0), (0.0, 0.0), (3.0, 0.0))
    found = play(Message(("a", "b"), points), JOINTS, rate=100.0)
    late = found.t > 1.5
    assert found.t[0] == -10.0
    assert found.t[-1] == 11.0
    assert np.all(found.q[late] == [1.0, 2.0])
    assert np.all(found.qdd[late] == [3.0, 0.0])


def test_a_first_point_in_the_future_is_reached_from_where_the_robot_is() -> None:
    points = point(1.0, (1.0, 1.0), (0.0, 0.0)), point(2.0, (1.0, 1.0), (0.0, 0.0))
    found = play(Message(("b", "a"), points), JOINTS, np.array([0.0, -1.0]), rate=100.0)
    assert np.abs(np.diff(found.q, axis=0)).max() < 0.04


REFUSED = {
    "not zero": [point(0.0, (0.0, 0.0), (0.0, 0.0)), point(1.0, (1.0, 2.0), (0.0, 1e-6))],
    "strictly increasing": [point(0.0, (0.0, 0.0)), point(0.0, (1.0, 2.0))],
    "Mismatch": [point(0.0, (0.0, 0.0)), Point(1, (1.0,))],
    "Empty trajectory": [],
    "effort": [point(0.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (1.0, 1.0))],
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_is_refused(word: str) -> None:
    with pytest.raises(RejectedError, match=word):
        validate(Message(("a", "b"), tuple(REFUSED[word])), JOINTS)


def test_another_joint_and_too_few_are_refused() -> None:
    points = (point(0.0, (0.0, 0.0)),)
    with pytest.raises(RejectedError, match=r"Incoming joint c"):
        validate(Message(("a", "c"), points), JOINTS)
    with pytest.raises(RejectedError, match=r"don't match"):
        validate(Message(("a",), points), JOINTS)
    validate(Message(("a",), (Point(0, (0.0,)),)), replace(JOINTS, allow_partial_joints_goal=True))


PENDULUM = """<robot name="pendulum"><link name="base"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="5" effort="20"/></joint>
<link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def test_the_arm_holds_a_pendulum_within_its_friction() -> None:
    from pinocchio_arm import Reference, arm_of_urdf, run

    arm = arm_of_urdf(PENDULUM, wrong=1.0)
    t = np.arange(4001) / 1000.0
    still = np.zeros((len(t), 1))
    found = run(arm, Reference(t, still + 0.5, still, still), "pd_gravity")
    gravity = 2.0 * 9.81 * 0.4 * np.sin(0.5)  # m g l sin q
    cogging = arm.drives.ripple(np.array([0.5]))[0]
    friction = arm.drives.coulomb[0] + arm.drives.stiction[0]  # a joint may stand anywhere within it
    assert found.command[-1, 0] == pytest.approx(gravity + cogging, abs=friction)
    assert np.abs(found.qd[-100:]).max() < 2e-3
    assert np.abs(found.q - 0.5).max() < 0.02
    assert found.saturated == 0.0
    assert found.log().decode().startswith("time_s,q1_rad,dq1_rad_s,tau1_Nm\n")
