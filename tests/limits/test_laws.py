"""Laws of every limit: what cones admit is proved, 3 % beyond is refused, proofs hold what is measured."""

from __future__ import annotations

import numpy as np
import pytest
from limit_examples import ARM_CONFIGS, FLIGHTS, GRAVITY, ROOMS, arm, flights, middle, room

from etude.limits import (
    AxisLimit,
    FeasibleSet,
    NormLimit,
    TiltLimit,
    boundary,
    certify,
    certify_bytes,
    scaled,
    slack,
    uniform,
    utilization,
)
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory
from etude.types import Motion

EVERY_ARM = pytest.mark.parametrize("config", ARM_CONFIGS.values(), ids=ARM_CONFIGS.keys())
EVERY_ROOM = pytest.mark.parametrize("limits", ROOMS.values(), ids=ROOMS.keys())
EVERY_FLIGHT = pytest.mark.parametrize("family", FLIGHTS.values(), ids=FLIGHTS.keys())


@pytest.mark.thinned
@EVERY_ARM
@pytest.mark.parametrize("jerk", [None, 0.5])
def test_what_an_arms_cones_admit_is_proved_and_touches_a_limit(config, jerk) -> None:
    rng = np.random.default_rng(3)
    for seed in range(8):
        limits = arm(seed, jerk=jerk)
        family = FourierFamily.of(config, 3).drawn(rng)
        feasible = FeasibleSet.of(limits, family, middle(limits))
        assert len(feasible.blocks) == 3
        for p in (*scaled(rng, feasible, 2), *boundary(rng, feasible, 2), *uniform(rng, feasible, 2, 20)):
            assert feasible.contains(p)
            assert certify_bytes(family.trajectory(p).to_json(), limits).ok
        edge = certify(family.trajectory(boundary(rng, feasible)[0]), limits)
        for name in limits[0].names:
            most = max(utilization(row) for row in edge.rows if row.axis == name)
            assert most > 0.995 if jerk is None else 0.9


@pytest.mark.thinned
@EVERY_ROOM
@EVERY_FLIGHT
def test_what_the_cones_of_flights_admit_is_proved(limits, family) -> None:
    rng = np.random.default_rng(0)
    feasible = FeasibleSet.of(limits, family, middle(limits))
    assert len(feasible.blocks) == 1
    tilts = any(isinstance(limit, TiltLimit) for limit in limits)
    for p in uniform(rng, feasible, 3):
        assert certify(family.trajectory(p), limits).ok
    for p in boundary(rng, feasible, 3):
        assert feasible.contains(p)
        certificate = certify(family.trajectory(p), limits)
        assert certificate.ok
        # no more than the samples' share is given away, but for tilt: there, climbing counts as falling
        assert utilization(certificate.worst) > (0.6 if tilts else 0.99)
        assert not feasible.contains(feasible.centre + 1.001 * (p - feasible.centre))


LONELY = {
    "position": AxisLimit("position", 0, ("x", "y", "z"), np.full(3, -2.0), np.array([1.0, 2.0, 3.0])),
    "velocity": AxisLimit("velocity", 1, ("x", "y", "z"), -np.ones(3), np.array([1.0, 2.0, 3.0])),
    "jerk": AxisLimit("jerk", 3, ("x", "y", "z"), -np.ones(3), np.ones(3)),
    "lift": AxisLimit("lift", 2, ("v",), np.array([5.0]), np.array([14.0]), axes=(2,), shift=GRAVITY),
    "speed": NormLimit("speed", 1, (0, 1, 2), 1.5),
    "radius": NormLimit("radius", 0, (0, 1), 1.0),
    "thrust": NormLimit("thrust", 2, (0, 1, 2), 12.0, 8.0, (0.0, 0.0, GRAVITY)),
    "sideways thrust": NormLimit("thrust", 2, (0, 1, 2), 12.0, 8.0, (6.0, 0.0, GRAVITY)),
    "tilt": TiltLimit(0.3, GRAVITY),
}
WIDE = (AxisLimit("box", 0, ("x", "y", "z"), np.full(3, -50.0), np.full(3, 50.0)),)
PERIODIC = {
    "none": FourierFamily.of(FourierConfig(3, 2.0 * np.pi / 0.9, 0.9, "none"), 3),
    "coarse": FourierFamily.of(FourierConfig(3, 2.0 * np.pi / 0.9, 0.9, "none"), 3, samples=24),
}


@pytest.mark.thinned
@pytest.mark.parametrize("name", LONELY)
@pytest.mark.parametrize("family", PERIODIC.values(), ids=PERIODIC.keys())
def test_each_limit_alone(name: str, family) -> None:
    """Its edge is proved; 3 % beyond the edge of its cones is refused; the proof is what is measured."""
    limit, rng = LONELY[name], np.random.default_rng(7)
    home = np.array([-0.4, 0.0, 0.3]) if name in ("position", "radius") else np.zeros(3)
    feasible = FeasibleSet.of((limit, *WIDE), family, home)
    for p in boundary(rng, feasible, 4):
        step = p - feasible.centre
        step = step / np.max([FeasibleSet.of((limit, *WIDE), family, home).gauge(p)])
        edge = family.trajectory(feasible.centre + 0.999999 * step)
        assert min(slack(row) for row in limit.prove(edge)) >= 0.0
        if utilization(certify(edge, WIDE).worst) < 0.9 and "t" not in (name[-1], name[-2]):
            beyond = family.trajectory(feasible.centre + 1.03 * step)
            assert min(slack(row) for row in limit.prove(beyond)) < 0.0
        assert_measured(limit, edge, name)


def assert_measured(limit, motion, name: str) -> None:
    """At 20,001 instants the proof holds what is measured, and exceeds it by at most 3 %."""
    values = limit.of_motion(motion.motion(np.linspace(0.0, motion.duration, 20_001), 4))
    rows = limit.prove(motion)
    assert values.shape == (20_001, len(rows))
    for row, found in zip(rows, values.T, strict=True):
        size = 1e-9 * max(abs(row.lower), abs(row.upper))
        room_ = 0.03 * (row.upper - row.lower)
        assert row.proved_lower <= found.min() + size
        assert found.max() <= row.proved_upper + size
        assert row.proved_upper <= found.max() + room_, row
        two_sided = isinstance(limit, AxisLimit) or (limit.order == 2 and name.endswith("thrust"))
        if two_sided:
            assert row.proved_lower >= found.min() - 3.0 * room_, row


@EVERY_ARM
def test_three_per_cent_beyond_an_arms_limits_is_refused(config) -> None:
    rng, limits = np.random.default_rng(5), arm(2)
    family = FourierFamily.of(config, 3).drawn(rng)
    feasible = FeasibleSet.of(limits, family, middle(limits))
    for p in boundary(rng, feasible, 10):
        for block in feasible.blocks:
            beyond = feasible.centre.copy()
            beyond[block.members] += 1.03 * (p - feasible.centre)[block.members]
            failed = certify(family.trajectory(beyond), limits).failed
            assert {row.axis for row in failed} == {f"j{feasible.blocks.index(block)}"}


@pytest.mark.parametrize("harmonics", [1, 2, 6, 10])
def test_ramped_series_of_any_kind_are_bounded(harmonics: int) -> None:
    """Jerk too, whose ramp has a second derivative, and asymmetric sizes of vectors."""
    rng, limits = np.random.default_rng(harmonics), (*arm(1, jerk=1.0), LONELY["thrust"], LONELY["tilt"])
    for _ in range(10):
        omega0, ramp = 10.0 ** rng.uniform(-1, 0.5), rng.uniform(0.1, 5.0)
        motion = FourierTrajectory(rng.standard_normal((2 * harmonics + 1, 3)), omega0, 20.0, ramp)
        samples = motion.motion(np.linspace(0.0, 20.0, 20_000), 4)
        for limit in limits:
            for row, found in zip(limit.prove(motion), limit.of_motion(samples).T, strict=True):
                assert found.max() <= row.proved_upper + 1e-9
                assert row.proved_lower <= found.min() + 1e-9


def test_a_ramp_takes_room_from_accelerations() -> None:
    """With a shorter ramp the same parameters use more of an acceleration limit."""
    names, wide = ("a", "b"), np.full(2, 1e3)
    limits = AxisLimit("position", 0, names, -wide, wide), AxisLimit("acceleration", 2, names, -wide, wide)
    uses = []
    for ramp in (0.5, 1.0, 2.0):
        family = FourierFamily.of(FourierConfig(3, 20.0, 0.9, "ramp", ramp), 2)
        feasible = FeasibleSet.of(limits, family, np.zeros(2))
        step = np.random.default_rng(0).standard_normal(family.size)
        uses.append(feasible.gauge(feasible.centre + step).max())
    assert uses[0] > 1.2 * uses[1] > 1.3 * uses[2]


def swung(across: float, up: float) -> tuple[FeasibleSet, FourierTrajectory, np.ndarray]:
    """A flight that leans to both sides by `across` m/s^2 while it climbs by `up`, under a limit of tilt."""
    family = FourierFamily.of(FourierConfig(2, 2.0 * np.pi, 1.0, "none"), 3)
    table = np.zeros((5, 3))
    table[3, 0], table[4, 2] = across, 0.5 * up  # across cos t, up cos 2t
    p = family.parameters(table)
    return FeasibleSet.of((LONELY["tilt"], *WIDE), family, np.zeros(3)), family.trajectory(p), p


def test_climbing_hard_and_leaning_far_at_once_is_left_out_although_it_may_be() -> None:
    across = np.tan(0.3) * GRAVITY
    feasible, motion, p = swung(1.1 * across, 0.3 * GRAVITY)
    assert slack(LONELY["tilt"].prove(motion)[0]) > 0.0
    assert not feasible.contains(p)
    for share, up in ((0.6, 0.3), (0.6, -0.3), (0.95, 0.0)):
        feasible, motion, p = swung(share * across, up * GRAVITY)
        assert feasible.contains(p)
        assert slack(LONELY["tilt"].prove(motion)[0]) > 0.0


def test_tilt_alone_keeps_the_vehicle_from_falling() -> None:
    assert swung(0.0, 0.65 * GRAVITY)[0].contains(swung(0.0, 0.65 * GRAVITY)[2])
    feasible, _, p = swung(0.0, 0.75 * GRAVITY)
    assert not feasible.contains(p)


def test_margins_learned_by_form_are_kept_off() -> None:
    table = np.array([[0.1, np.nan], [0.2, 0.3]])
    margins = {"fourier": (table, 0.95)}
    limit = AxisLimit("position", 0, ("a", "b"), -np.ones(2), np.ones(2), margin=0.05, margins=margins)
    still = FourierTrajectory(np.zeros((3, 2)), 1.0, 10.0)
    rows = limit.prove(still)
    assert [(row.lower, row.upper, row.tracking_margin, row.confidence) for row in rows] == [
        (-0.9, 0.9, 0.1, 0.95),
        (-0.95, 0.95, 0.05, 0.0),  # what its owner keeps: no log shows that it is enough
    ]
    speed = NormLimit("speed", 1, (0, 1), 1.0, margins=margins)
    row = speed.prove(still)[0]
    assert row.upper == pytest.approx(1.0 - np.hypot(0.2, 0.3))
    narrow = FeasibleSet.of((limit, speed), FourierFamily.of(FourierConfig(2, 10.0), 2), np.zeros(2))
    wide = FeasibleSet.of(
        (
            AxisLimit("position", 0, ("a", "b"), -np.ones(2), np.ones(2)),
            NormLimit("speed", 1, (0, 1), 1.0),
        ),
        FourierFamily.of(FourierConfig(2, 10.0), 2),
        np.zeros(2),
    )
    assert np.all(narrow.widths() < wide.widths())


def test_what_is_measured() -> None:
    t = np.zeros(2)
    orders = np.arange(18.0).reshape(3, 2, 3)
    motion = Motion(t, orders)
    np.testing.assert_array_equal(LONELY["velocity"].of_motion(motion), orders[1])
    np.testing.assert_allclose(LONELY["lift"].of_motion(motion)[:, 0], orders[2][:, 2] + GRAVITY)
    np.testing.assert_allclose(LONELY["radius"].of_motion(motion)[:, 0], np.hypot(*orders[0][:, :2].T))
    force = orders[2][1] + np.array([0.0, 0.0, GRAVITY])
    tilt = np.arctan2(np.hypot(force[0], force[1]), force[2])
    assert LONELY["tilt"].of_motion(motion)[1, 0] == pytest.approx(tilt)
    assert LONELY["thrust"].of_motion(motion)[1, 0] == pytest.approx(np.linalg.norm(force))
    assert all(limit.penalty(motion) is None for limit in LONELY.values())


def test_tighter_limits_make_a_smaller_set() -> None:
    family = flights()
    narrow = FeasibleSet.of(room(margin=1.0, speed=3.0), family, middle(room(margin=1.0)))
    wide = FeasibleSet.of(room(), family, middle(room()))
    for p in uniform(np.random.default_rng(2), narrow, 5):
        assert wide.contains(p)
        assert certify(family.trajectory(p), room()).ok
