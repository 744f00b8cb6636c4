from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import FAMILIES, Model, assert_same, differences, model, robot

from etude.design.criteria import CRITERIA, Output
from etude.design.mask import stick_gains
from etude.design.objective import Objective
from etude.design.refine import Search, Variables, refine
from etude.trajectories.certificate import certify
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.gauge import certified_rows
from etude.trajectories.random import random_trajectory


def objective(criterion: str, family: TrajectoryFamily, known: Model) -> Objective:
    rng = np.random.default_rng(9)
    samples = random_trajectory(rng, robot(), family).sample(np.linspace(3.0, 27.0, 9))
    reference = known.features.transform(samples.q, samples.qd, samples.qdd)
    outputs = tuple(Output.of(posterior, reference) for posterior in known.posteriors)
    times = family.duration * (np.arange(12) + 0.5) / 12
    return Objective(CRITERIA[criterion], outputs, known.features, known.stick_velocity, family, times)


EVERY = pytest.mark.parametrize("criterion", CRITERIA)
FAMILY = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())


@EVERY
@FAMILY
@pytest.mark.parametrize("stick", [0.0, 0.03])
def test_gradient_in_coefficients_and_omega0(criterion: str, family: TrajectoryFamily, stick: float) -> None:
    aim = objective(criterion, family, model(stick=stick))
    motion = random_trajectory(np.random.default_rng(1), robot(), family)
    table, omega0 = motion.coefficients, motion.omega0
    value, gradient, slope = aim.value_and_gradient(table, omega0, with_omega0=True)
    assert value == pytest.approx(aim.value(table, omega0), rel=1e-10)
    assert_same(gradient, differences(lambda x: aim.value(x, omega0), table, 1e-5))
    by_omega0 = differences(lambda w: aim.value(table, float(w[0])), np.array([omega0]), 1e-6)[0]
    assert slope == pytest.approx(by_omega0, rel=1e-6)
    assert aim.value_and_gradient(table, omega0, with_omega0=False)[2] == 0.0


@EVERY
@FAMILY
@pytest.mark.parametrize("stretch", [0.5, 1.0, 3.0])
def test_gradient_of_the_search_inside_and_outside_the_limits(
    criterion: str, family: TrajectoryFamily, stretch: float
) -> None:
    rows = certified_rows(robot(), family)
    motion = random_trajectory(np.random.default_rng(2), robot(), family)
    search = Search(objective(criterion, family, model()), rows, Variables.of(robot(), family, motion.omega0))
    y = search.variables.pack(motion.coefficients, motion.omega0)
    y[:-1] *= stretch
    value, gradient = search.value_and_gradient(y)
    assert value == pytest.approx(search.value_and_gradient(y)[0])
    approximate = differences(lambda z: search.value_and_gradient(z)[0], y, 1e-6)
    assert_same(gradient, approximate, 1e-5)
    assert certify(family.trajectory(*search.certified(y)), robot()).ok


@FAMILY
def test_the_variables_keep_the_trajectory(family: TrajectoryFamily) -> None:
    motion = random_trajectory(np.random.default_rng(3), robot(), family)
    variables = Variables.of(robot(), family, motion.omega0)
    table, omega0 = variables.unpack(variables.pack(motion.coefficients, motion.omega0))
    table[0] += variables.middle
    np.testing.assert_allclose(table, motion.coefficients, atol=1e-12)
    assert omega0 == pytest.approx(motion.omega0)


@FAMILY
def test_any_variables_at_all_are_a_certified_trajectory(family: TrajectoryFamily) -> None:
    rng, rows = np.random.default_rng(4), certified_rows(robot(), family)
    variables = Variables.of(robot(), family, family.draw_omega0(rng))
    search = Search(objective("ivr", family, model()), rows, variables)
    size = variables.free.shape[0] * variables.free.shape[2]
    for _ in range(20):
        y = np.append(rng.standard_normal(size) * 10.0 ** rng.uniform(-1, 2), rng.uniform())
        assert certify(family.trajectory(*search.certified(y)), robot()).ok


def test_stick_gains() -> None:
    qd = np.linspace(-0.1, 0.1, 21)[:, None] * np.ones(2)
    gain, slope = stick_gains(qd, np.array([0.02, 0.0]))
    np.testing.assert_allclose(1.0 / gain[qd[:, 0] != 0, 0] ** 2, 1.0 + (0.02 / qd[qd[:, 0] != 0, 0]) ** 2)
    assert gain[10, 0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(gain[:, 1] == 1.0)
    h = 1e-6
    ahead, behind = (stick_gains(qd + s, np.array([0.02, 0.0]))[0] for s in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), slope, atol=1e-5)


def test_slow_motion_teaches_less_where_slow_samples_are_masked() -> None:
    family = FAMILIES["nullspace"]
    known = model(stick=0.0)
    masked = replace(known, stick_velocity=np.full(2, 0.1))
    motion = random_trajectory(np.random.default_rng(5), robot(), family)
    plain = objective("ivr", family, known).value(motion.coefficients, motion.omega0)
    assert objective("ivr", family, masked).value(motion.coefficients, motion.omega0) < plain


@FAMILY
def test_refinement_ends_on_the_exact_edge_where_more_motion_is_better(family: TrajectoryFamily) -> None:
    aim, rows = objective("mean_variance", family, model()), certified_rows(robot(), family)
    start = random_trajectory(np.random.default_rng(6), robot(), family)
    found, value, _ = refine(aim, rows, robot(), family, start, 15)
    np.testing.assert_allclose(rows.gauge(found.coefficients, found.omega0), 1.0, atol=1e-9)
    assert value == pytest.approx(aim.value(found.coefficients, found.omega0), rel=1e-12)
