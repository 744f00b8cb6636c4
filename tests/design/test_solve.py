from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import FAMILIES, model, robot
from etude.trajectories.certificate import certify_bytes

from etude.design.config import DesignConfig
from etude.design.criteria import CRITERIA
from etude.design.solve import Design, design
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.models.gp.exact import ExactGP
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.moves import random_moves

QUICK = DesignConfig(candidates=6, refine=2, steps=10, points=25, reference_points=30)


def run(criterion: str, family: TrajectoryFamily, seed: int = 0, *, tasks: bool = True, **change) -> Design:
    rng = np.random.default_rng(seed)
    motions = [random_moves(np.random.default_rng(100), robot(), 5)] if tasks else None
    config = replace(QUICK, criterion=criterion, **change)
    return design(model(seed), robot(), family, config, rng, motions)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
def test_a_design_is_certified_and_never_worse_than_its_candidates(criterion, family) -> None:
    for seed in range(3):
        found = run(criterion, family, seed)
        assert certify_bytes(found.trajectory.to_json().encode(), robot()).ok
        assert found.value >= found.baseline
        low, high = family.omega0_range
        assert low <= found.trajectory.omega0 <= high
        assert (found.trajectory.duration, found.trajectory.ramp) == (family.duration, family.phase_ramp)
        assert found.evaluations > QUICK.candidates
        assert found.certificate.active() == found.active_limits
        assert found.status.startswith(criterion)
        assert found.status.endswith(".")


@pytest.mark.parametrize("criterion", CRITERIA)
def test_refinement_improves(criterion: str) -> None:
    family = FAMILIES["nullspace"]
    gains = [(found := run(criterion, family, s)).value - found.baseline for s in range(3)]
    assert min(gains) > 0.0
    assert run(criterion, family, refine=0).value == run(criterion, family, refine=0).baseline


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
def test_a_refinement_that_loses_is_thrown_away(family: TrajectoryFamily) -> None:
    """Without a step the search only draws the start a little inwards, which is worse."""
    for seed in range(6):
        found = run("ivr", family, seed, steps=0, candidates=3)
        assert found.value >= found.baseline


def test_more_candidates_never_lower_the_baseline() -> None:
    values = [run("ivr", FAMILIES["nullspace"], candidates=k, refine=0).baseline for k in (1, 2, 4, 8)]
    assert values == sorted(values)
    assert values[-1] > values[0]


def test_the_same_seed_gives_the_same_design() -> None:
    one, two = (run("log_ivr", FAMILIES["ramp, omega0 free"]) for _ in range(2))
    assert one.trajectory == two.trajectory


def test_the_forecast_is_what_a_refit_gives() -> None:
    """deviation_after against refitting with the planned samples, where no sample is masked."""
    known, family = replace(model(), stick_velocity=np.zeros(2)), FAMILIES["nullspace"]
    tasks = [random_moves(np.random.default_rng(100), robot(), 5)]
    found = design(known, robot(), family, replace(QUICK, criterion="ivr"), np.random.default_rng(0), tasks)
    times = 30.0 * (np.arange(25) + 0.5) / 25
    samples = found.trajectory.sample(times)
    new = known.features.transform(samples.q, samples.qd, samples.qdd)
    t = tasks[0].duration * (np.arange(1000) + 0.5) / 1000
    task = tasks[0].sample(t)
    picked = np.linspace(0, 999, 30).round().astype(int)
    R = known.features.transform(task.q, task.qd, task.qdd)[picked]
    for j, posterior in enumerate(known.posteriors):
        gp = ExactGP(posterior.kernel, posterior.theta, 0.5 * np.log(posterior.noise_variance))
        X = np.concatenate([posterior.X, new])
        after = gp.condition(X, np.zeros(len(X))).predict(R)[1]
        assert found.deviation_before[j] == pytest.approx(np.sqrt(posterior.predict(R)[1].mean()), rel=1e-9)
        assert found.deviation_after[j] == pytest.approx(np.sqrt(after.mean()), rel=1e-5)
    assert 0.0 < found.variance_removed < 1.0


def test_tasks_change_the_design() -> None:
    family = FAMILIES["nullspace"]
    with_tasks, without = run("ivr", family), run("ivr", family, tasks=False)
    assert with_tasks.trajectory != without.trajectory
    assert run("ivr", family, random_share=0.5).value not in (with_tasks.value, without.value)
    all_random = run("ivr", family, random_share=1.0)
    assert all_random.deviation_before == pytest.approx(without.deviation_before)


def test_raw_units_add_the_variances_as_they_are() -> None:
    family = FAMILIES["nullspace"]
    scaled, raw = (run("mean_variance", family, raw_units=r, refine=0) for r in (False, True))
    assert raw.value > 10.0 * scaled.value


def test_limits_without_room_are_refused() -> None:
    narrow = replace(robot(), axes=(robot().axes[0], replace(robot().axes[1], upper=0.2)))
    with pytest.raises(UnsafeTrajectoryError, match="joint 'tip' leaves no room"):
        design(model(), narrow, FAMILIES["nullspace"], QUICK, np.random.default_rng(0))


def test_tiny_and_huge_limits_are_designed_for() -> None:
    for factor in (1e-3, 1e3):
        axes = [
            replace(a, velocity=a.velocity * factor, acceleration=a.acceleration * factor**2)
            for a in robot().axes
        ]
        found = design(
            model(),
            replace(robot(), axes=tuple(axes)),
            FAMILIES["nullspace"],
            QUICK,
            np.random.default_rng(0),
        )
        assert found.certificate.ok


def test_a_model_of_another_robot() -> None:
    one = replace(robot(), axes=robot().axes[:1])
    with pytest.raises(UsageError, match="2 joints, the robot 'pair' has 1"):
        design(model(), one, FAMILIES["nullspace"], QUICK, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "entropy"}, "no criterion 'entropy'; known: d_opt, info_gain, ivr, log_ivr"),
        ({"candidates": 0}, "must be >= 1"),
        ({"steps": -1}, "refine and steps >= 0"),
        ({"random_share": 1.5}, "random_share"),
    ],
)
def test_bad_options(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        DesignConfig(**options)
