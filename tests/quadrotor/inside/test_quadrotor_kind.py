"""The quadrotor as a kind: its laws, its room and its families, presets, and how light it is to load."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import FeasibleSet, boundary, certify
from etude.testing import InputsSuite, KindSuite, PhysicsSuite, RobotSuite
from etude.trajectories import FourierTrajectory
from etude_quadrotor import KIND, FlightConfig, QuadrotorInputs, QuadrotorSpec, flight_family
from etude_quadrotor.preprocessing import FlightData

SPEC: QuadrotorSpec = KIND.spec(KIND.built_in()["quadrotor"])
PELICAN: QuadrotorSpec = KIND.spec(KIND.built_in()["pelican"])
FULL = replace(SPEC, radius=6.0, tilt=0.5, thrust=(5.0, 14.0))


class TestQuadrotor(KindSuite):
    kind = KIND
    robot = "quadrotor"
    loose = frozenset({"tilt"})  # asked of both signs
    rounds = 1  # two are simulated in `test_quadrotor_campaign`


class TestPelican(InputsSuite, PhysicsSuite, RobotSuite):
    """Commanded by attitude and thrust, in a cylinder."""

    kind = KIND
    robot = "pelican"


def config(**trajectory) -> SimpleNamespace:
    return SimpleNamespace(trajectory=FlightConfig(**trajectory), data=FlightData())


def feasible(spec: QuadrotorSpec, own: SimpleNamespace) -> FeasibleSet:
    return FeasibleSet.of(KIND.limits(spec, own, None, {}), KIND.family(spec, own), KIND.home(spec))


PROVED = {
    ("x", "position"): (-9.0, 9.0, -4.346531781161, 5.995558201334),
    ("y", "position"): (-9.0, 9.0, -4.112837621777, 6.174509256324),
    ("z", "position"): (0.3, 4.7, 0.667068643296, 4.454967658981),
    ("vehicle", "speed"): (-6.0, 6.0, -2.113564763238, 2.113564763238),
    ("vehicle", "radius"): (-5.0, 5.0, -7.094077966784, 7.094077966784),
    ("vehicle", "lift"): (5.0, 14.62, 9.672869862239, 9.93845126431),
    ("vehicle", "thrust"): (5.0, 14.0, 9.673755463376, 9.944790683173),
    ("vehicle", "tilt"): (-0.5, 0.5, -0.06335065991, 0.06335065991),
}


def test_the_proofs_are_those_of_version_0_1() -> None:
    table = np.array(
        [[0.0, 0.0, 2.5], [1.0, -0.5, 0.2], [-0.3, 0.8, 0.1], [0.4, 0.6, -0.3], [0.2, -0.7, 0.15]]
    )
    flight = FourierTrajectory(table, 2.0 * np.pi / 30.0, 30.0)
    certificate = certify(flight, KIND.limits(FULL, config(), None, {}))
    found = {
        (r.axis, r.quantity): (r.lower, r.upper, r.proved_lower, r.proved_upper) for r in certificate.rows
    }
    assert list(found) == list(PROVED)
    np.testing.assert_allclose(list(found.values()), list(PROVED.values()), rtol=0, atol=2e-12)
    assert not certificate.rest_needed
    assert not certificate.ok
    at_rest = certify(flight, KIND.limits(FULL, config(rest=True), None, {}))
    assert at_rest.rest_needed


@pytest.mark.parametrize("spec", [SPEC, FULL, PELICAN, replace(PELICAN, tilt=0.3, thrust=(6.0, 13.0))])
@pytest.mark.parametrize(
    "own", [{}, {"free_centre": True}, {"rest": True, "harmonics": 4}, {"centre": (0.3, -0.2)}], ids=str
)
def test_flights_on_the_edge_are_proved(spec: QuadrotorSpec, own: dict[str, object]) -> None:
    drawn = config(**own)
    room, family = feasible(spec, drawn), KIND.family(spec, drawn)
    for p in boundary(np.random.default_rng(5), room, 10):
        certificate = certify(family.trajectory(p), KIND.limits(spec, drawn, None, {}))
        assert certificate.ok, certificate.worst
        assert certificate.rest_needed == drawn.trajectory.rest


def test_learned_margins_narrow_the_room() -> None:
    margins = {"fourier": (np.array([[2.0, 2.0, 0.5], [1.0, 1.0, 1.0]]), 0.95)}
    rows = {
        (row.axis, row.quantity): row
        for limit in KIND.limits(SPEC, config(), None, margins)
        for row in limit.prove(KIND.tests(SPEC, config(), np.random.default_rng(0))["uniform"])
    }
    assert (rows["x", "position"].upper, rows["x", "position"].confidence) == (8.0, 0.95)
    assert rows["z", "position"].upper == 4.5
    assert rows["vehicle", "speed"].upper == pytest.approx(6.0 - np.sqrt(3.0))
    smaller = {"fourier": (np.array([[0.1, 0.1, 0.1]]), 0.95)}
    (box, *_) = KIND.limits(SPEC, config(), None, smaller)
    assert box.prove(KIND.tests(SPEC, config(), np.random.default_rng(0))["uniform"])[0].upper == 9.0


def test_a_centre_outside_the_room_has_no_flights() -> None:
    with pytest.raises(UnsafeTrajectoryError):
        feasible(SPEC, config(centre=(9.5, 0.0)))
    with pytest.raises(UnsafeTrajectoryError):
        feasible(PELICAN, config(centre=(1.0, 1.0)))


def test_home_is_inside_box_and_cylinder() -> None:
    np.testing.assert_allclose(KIND.home(SPEC), [0.0, 0.0, 2.5])
    aside = replace(SPEC, lower=(-2.0, 3.0, 0.0), upper=(8.0, 12.0, 5.0), radius=9.0)
    x, y, _ = KIND.home(aside)
    assert np.hypot(x, y) < 8.0
    assert -1.0 < x < 7.0
    assert 4.0 < y < 11.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"start": "flying"},
        {"duration": -1.0},
        {"harmonics": 0},
        {"omega0": 0.0},
        {"centre": (np.nan, 0.0)},
        {"rest": True, "harmonics": 1},
        {"rest": True, "omega0": 0.3},
    ],
    ids=str,
)
def test_families_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        FlightConfig(**wrong)  # type: ignore[arg-type]


def test_the_family_of_the_thesis() -> None:
    family = flight_family(FlightConfig(centre=(0.5, -0.25)))
    assert family.size == 4 + 4 + 5
    table = family.coefficients(np.arange(13.0))
    np.testing.assert_array_equal(table[0, :2], [0.5, -0.25])
    np.testing.assert_allclose(family.parameters(family.trajectory(np.arange(13.0))), np.arange(13.0))
    assert flight_family(FlightConfig(free_centre=True)).size == 15
    still = flight_family(FlightConfig(rest=True)).trajectory(np.ones(2 + 2 + 3))
    np.testing.assert_allclose(still.motion(np.array([0.0, 30.0]), 2).orders[1], 0.0, atol=1e-12)


def test_presets_lay_known_keys_over_the_defaults() -> None:
    from etude.campaign import preset_config

    default, thesis = (preset_config(KIND, name) for name in ("default", "thesis"))
    assert default.trajectory.start == "moving"
    assert KIND.inputs(SPEC, default) == QuadrotorInputs()
    assert KIND.inputs(SPEC, thesis) == QuadrotorInputs(True, "kinematic", False, battery_voltage=False)
    assert (default.model.sharing, thesis.model.schedule) == ("shared", "first")
    assert thesis.design.criterion == "mean_variance"
    for table, cls in KIND.tables.items():
        assert set(KIND.comments[table]) == set(cls.__dataclass_fields__)


def test_physics_need_motors_that_are_described_in_volts() -> None:
    assert list(KIND.physics(SPEC, config())) == ["nominal", "identified"]
    for unknown in (PELICAN, replace(SPEC, vehicle=None)):
        assert list(KIND.physics(unknown, config())) == ["identified"]
        assert KIND.baselines(unknown, config())["analytic"].voltages is None
    assert list(KIND.baselines(SPEC, config())) == ["pid", "analytic", "exact_drag"]
    assert KIND.baselines(SPEC, config())["pid"] is None
    assert list(KIND.baselines(replace(SPEC, plant=None), config())) == ["pid", "analytic"]


def test_the_kind_is_light_to_load() -> None:
    code = (
        "from etude_quadrotor.kind import KIND; KIND.built_in(); import sys;"
        "print(' '.join(sorted({'numba', 'scipy', 'polars', 'msgspec'} & set(sys.modules))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
