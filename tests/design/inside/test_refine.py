from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_home,
    arm_limits,
    arm_model,
    assert_same,
    flight_family,
    flight_home,
    flight_limits,
    flight_model,
    flight_spec,
)
from scipy.optimize import linprog

from etude import plugins
from etude.design import Objective, Output, Source, criterion_named, latents_of, refine
from etude.design.candidates import SampledPoint
from etude.design.config import GROUP
from etude.design.latents import planned
from etude.design.objective import instants
from etude.design.solve import Search
from etude.limits import FeasibleSet, boundary, certify, uniform
from etude.testing import central

EVERY = pytest.mark.parametrize("criterion", [n for n in plugins.BUILT_IN[GROUP] if n != "d_opt"])
KINDS = pytest.mark.parametrize("kind", ["nullspace", "ramp, omega0 drawn", "flight", "flight at rest"])


def source(kind: str) -> Source:
    if not kind.startswith("flight"):
        return Source(arm_family(kind), arm_limits(), arm_home(), "scaled")
    spec = flight_spec(tilt=0.5, radius=9.0)
    family = flight_family(rest=kind == "flight at rest")
    return Source(family, flight_limits(spec), flight_home(spec), "uniform")


@cache
def drawn(kind: str, seed: int) -> tuple[SampledPoint, SampledPoint, Source]:
    """Two random candidates, and where they are from; nothing changes them."""
    given = source(kind)
    start, other = given.typical(np.random.default_rng(seed), 2)
    return start, other, given


def search(kind: str, criterion: str = "ivr", seed: int = 2) -> tuple[Search, np.ndarray, Source]:
    """The search from a random candidate, and the candidate."""
    start, other, given = drawn(kind, seed)
    model = flight_model() if kind.startswith("flight") else arm_model()
    latents = planned(latents_of(model), 0.1, 0)
    t = np.linspace(3.0, 27.0, 9)
    reference = model.inputs.plan(other.trajectory.motion(t, model.inputs.orders)).X
    outputs = tuple(Output.of(latent.posterior, reference) for latent in latents)
    commands = tuple(latent.commands for latent in latents)
    times, _ = instants(30.0, 12, 0.0)
    aim = Objective(criterion_named(criterion), outputs, commands, model.inputs, start.family, times)
    return Search(aim, start.feasible), start.p, given


@pytest.mark.thinned
@EVERY
@KINDS
def test_gradient_outside_the_limits(criterion: str, kind: str) -> None:
    check_gradient(criterion, kind, 3.0)


@pytest.mark.thinned
@KINDS
@pytest.mark.parametrize("stretch", [0.5, 1.0])
def test_gradient_inside_and_near_the_limits(kind: str, stretch: float) -> None:
    check_gradient("ivr", kind, stretch)


def check_gradient(criterion: str, kind: str, stretch: float) -> None:
    found, start, given = search(kind, criterion)
    y = stretch * found.variables(start)
    value, gradient = found.value_and_gradient(y)
    assert value == pytest.approx(found.objective.value(found.inside(y)), rel=1e-9)
    assert_same(gradient, central(lambda z: found.value_and_gradient(z)[0], y, 1e-4), 2e-5)
    assert certify(found.objective.family.trajectory(found.inside(y)), given.limits).ok


@KINDS
def test_the_variables_of_a_point_inside_are_nearly_that_point(kind: str) -> None:
    found, start, _ = search(kind)
    centre = found.feasible.centre
    half = centre + 0.5 * (start - centre)
    np.testing.assert_allclose(found.inside(found.variables(half)), half, rtol=1e-6, atol=1e-6)


@KINDS
def test_any_variables_at_all_are_a_certified_trajectory(kind: str) -> None:
    found, start, given = search(kind)
    rng = np.random.default_rng(4)
    for _ in range(20):
        p = found.inside(rng.standard_normal(len(start)) * 10.0 ** rng.uniform(-1, 2))
        assert found.feasible.contains(p)
        assert certify(found.objective.family.trajectory(p), given.limits).ok


@KINDS
def test_it_ends_on_the_exact_edge_where_more_motion_is_better(kind: str) -> None:
    found, start, given = search(kind, "mean_variance", 6)
    end = refine(found.objective, found.feasible, start, 15)
    np.testing.assert_allclose(found.feasible.gauge(end.p), 1.0, atol=1e-8)
    assert end.value == found.objective.value(end.p)
    assert end.value > found.objective.value(start)
    assert certify(found.objective.family.trajectory(end.p), given.limits).ok


@KINDS
def test_a_search_from_outside_ends_inside(kind: str) -> None:
    found, start, _ = search(kind)
    outside = found.feasible.centre + 3.0 * (start - found.feasible.centre)
    assert not found.feasible.contains(outside)
    for steps in (0, 1, 8):
        end = refine(found.objective, found.feasible, outside, steps)
        assert found.feasible.contains(end.p)
        assert end.value == pytest.approx(found.objective.value(end.p), rel=1e-12)


class Slope:
    """A linear function of the parameters instead of a criterion."""

    def __init__(self, gradient: np.ndarray) -> None:
        self.gradient = gradient

    def value(self, p: np.ndarray) -> float:
        return float(self.gradient @ p)

    def value_and_gradient(self, p: np.ndarray) -> tuple[float, np.ndarray]:
        return self.value(p), self.gradient


def test_it_finds_the_optimum_where_that_is_known() -> None:
    """Linear programming on an arm's joints; a vehicle's speed limit leaves no better flight."""
    rng, family = np.random.default_rng(4), arm_family()
    joints = FeasibleSet.of(arm_limits(), family, arm_home())
    for seed in range(3):
        slope = Slope(np.random.default_rng(seed).standard_normal(family.size))
        # a linear function is nowhere flat, and its corners are what the smooth gauge rounds off
        best = joints.centre @ slope.gradient
        for block in joints.blocks:
            rows = np.concatenate([block.slabs, -block.slabs])
            ends = np.concatenate([1.0 + block.middle, 1.0 - block.middle])
            own = slope.gradient[block.members]
            best -= joints.centre[block.members] @ own
            best += -linprog(-own, A_ub=rows, b_ub=ends, bounds=(None, None)).fun
        end = refine(slope, joints, uniform(rng, joints, 1, 50)[0], 200)
        start_gap = abs(best - slope.value(joints.centre))
        assert best - end.value < 0.02 * start_gap
        assert end.value <= best + 1e-6 * start_gap
        spec = flight_spec(speed=1.0)
        slow = FeasibleSet.of(flight_limits(spec), flight_family(), flight_home(spec))
        slope = Slope(np.random.default_rng(seed).standard_normal(slow.size))
        end = refine(slope, slow, uniform(rng, slow, 1, 50)[0], 200)
        # at an optimum every feasible direction leads down
        others = boundary(rng, slow, 400) - end.p
        size = abs(end.value - slope.value(slow.centre))
        assert (others @ slope.gradient).max() < 0.01 * size
        assert slope.value(slow.shrink(end.p + 0.1 * slope.gradient)) <= end.value + 0.01 * size


def test_candidates_of_one_family_share_their_set_and_others_have_their_own() -> None:
    rng = np.random.default_rng(0)
    fixed = source("nullspace").candidates(rng, 8)
    assert len({id(drawn.feasible) for drawn in fixed}) == 1
    free = source("ramp, omega0 drawn").candidates(rng, 8)
    assert len({drawn.family.omega0 for drawn in free}) == 8
    for drawn in (*fixed, *free):
        assert drawn.feasible.contains(drawn.p)


def test_some_candidates_are_small_or_on_the_edge() -> None:
    rng = np.random.default_rng(0)
    scaled = source("nullspace").candidates(rng, 8)
    sizes = [drawn.feasible.gauge(drawn.p).min() for drawn in scaled]
    assert min(sizes[6:]) < 0.8 < min(sizes[:6])
    flights = source("flight").candidates(rng, 7)
    use = [drawn.feasible.gauge(drawn.p).max() for drawn in flights]
    assert max(use[:4]) < 0.9999
    assert min(use[4:]) > 0.9999
    assert [len(source(kind).candidates(rng, 1)) for kind in ("flight", "nullspace")] == [1, 1]
