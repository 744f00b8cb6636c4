from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_home,
    arm_inputs,
    arm_limits,
    arm_model,
    arm_spec,
    flight_family,
    flight_home,
    flight_limits,
    flight_model,
    flight_spec,
    moves,
)

from etude import plugins
from etude.design import Design, DesignConfig, Score, design, latents_of
from etude.design.config import GROUP
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import certify_bytes
from etude.models import ExactGP
from etude.trajectories import PointToPoint

ARM = DesignConfig(candidates=4, refine=2, steps=6, points=25, reference_points=30, random_share=0.0)
FLIGHT = DesignConfig(
    sampler="uniform",
    candidates=6,
    refine=2,
    steps=12,
    points=20,
    planned_noise=True,
    reference_points=40,
    inducing=40,
    random_share=0.0,
)
FAMILIES = ("nullspace", "ramp, omega0 drawn")
CRITERIA = tuple(name for name in plugins.BUILT_IN[GROUP] if name != "d_opt")


def arm(family: str = "nullspace", seed: int = 0, *, tasks=(), known=None, spec=None, **change) -> Design:
    model = known or arm_model(seed)
    config, rng = replace(ARM, **change), np.random.default_rng(seed)
    return design(
        arm_family(family), arm_limits(spec), arm_home(), model.inputs, model, config, rng, tasks, rate=100.0
    )


def flight(seed: int = 0, *, known=None, limits=None, rest: bool = False, **change) -> Design:
    model, spec = known or flight_model(), flight_spec(**(limits or {}))
    config, rng = replace(FLIGHT, **change), np.random.default_rng(seed)
    return design(
        flight_family(rest=rest),
        flight_limits(spec),
        flight_home(spec),
        model.inputs,
        model,
        config,
        rng,
        rate=spec.rate,
    )


@pytest.mark.thinned
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_design_for_an_arm_is_certified_and_never_worse_than_its_candidates(criterion, family) -> None:
    for seed in range(2):
        found = arm(family, seed, tasks=[moves()], criterion=criterion)
        assert certify_bytes(found.trajectory.to_json(), arm_limits()).ok
        assert found.value > found.baseline
        low, high = arm_family(family).config.omega0_range
        assert low <= found.trajectory.omega0 <= high
        assert found.evaluations > ARM.candidates
        assert found.status.startswith(criterion)
        assert found.status.endswith(".")
        np.testing.assert_array_equal(
            found.family.trajectory(found.parameters).coefficients, found.trajectory.coefficients
        )


@pytest.mark.thinned
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("shared", [False, True])
def test_a_design_for_a_vehicle_is_certified_and_better_than_its_candidates(criterion, shared) -> None:
    found = flight(known=flight_model(shared=shared), criterion=criterion)
    assert certify_bytes(found.trajectory.to_json(), flight_limits(flight_spec())).ok
    assert found.value > found.baseline
    assert found.deviation_after.shape == (4,)
    assert np.all(found.deviation_after < found.deviation_before)
    assert 0.0 < found.variance_removed < 1.0


def test_under_tilt_thrust_and_cylinder() -> None:
    limits = {"tilt": 0.08, "thrust": (9.0, 10.5), "radius": 6.0}
    found = flight(criterion="mean_variance", limits=limits)
    certificate = certify_bytes(found.trajectory.to_json(), flight_limits(flight_spec(**limits)))
    assert certificate.ok
    assert found.value > found.baseline
    # more motion is more variance
    assert max((row.proved_upper - row.upper) / row.upper for row in certificate.rows) > -0.1


def test_the_result_is_inside_the_set_to_the_last_bit() -> None:
    from etude.limits import FeasibleSet

    for found, limits, home in (
        (arm("ramp, omega0 drawn"), arm_limits(), arm_home()),
        (flight(), flight_limits(flight_spec()), flight_home(flight_spec())),
    ):
        feasible = FeasibleSet.of(limits, found.family, home)
        assert feasible.contains(found.parameters)
        assert feasible.gauge(found.parameters).max() <= 1.0


@pytest.mark.parametrize("family", FAMILIES)
def test_a_refinement_that_loses_is_thrown_away(family: str) -> None:
    """Without a step the search only draws the start a little inwards, which is worse."""
    for seed in range(6):
        found = arm(family, seed, criterion="ivr", steps=0, candidates=3)
        assert found.value >= found.baseline


def test_without_refinement_the_best_candidate_is_proposed() -> None:
    for found in (arm(refine=0), flight(refine=0)):
        assert found.value == found.baseline
        assert "not improved by refinement" in found.status


def test_more_steps_never_lower_the_value() -> None:
    values = [arm(steps=steps).value for steps in (0, 3, 10, 30)]
    assert values == sorted(values)
    assert values[-1] > values[0]


def test_the_same_seed_gives_the_same_design_and_another_seed_another() -> None:
    for run in (lambda seed: arm("ramp, omega0 drawn", seed, known=arm_model()), flight):
        one, two, other = run(3), run(3), run(4)
        assert one.trajectory.to_json() == two.trajectory.to_json()
        assert one.trajectory.to_json() != other.trajectory.to_json()


def test_the_choice_is_what_the_best_saves_of_the_median_candidates_variance() -> None:
    known = arm_model()
    found = arm(known=known, criterion="log_ivr")
    assert found.typical <= found.baseline <= found.value
    assert found.outputs == len(latents_of(known)) == 2
    assert found.choice == pytest.approx(1.0 - np.exp(-(found.value - found.typical) / 2.0))
    assert arm(known=known, criterion="ivr").choice is None


def test_the_forecast_is_what_a_refit_gives() -> None:
    """deviation_after against refitting with the planned samples, where no sample is masked."""
    known, task = arm_model(stick=0.0), moves()
    found = arm(known=known, tasks=[task], criterion="ivr")
    times = 30.0 * (np.arange(25) + 0.5) / 25
    new = known.inputs.plan(found.trajectory.motion(times, 3)).X
    t = task.duration * (np.arange(1000) + 0.5) / 1000
    R = known.inputs.plan(task.motion(t, 3)).X[np.linspace(0, 999, 30).round().astype(int)]
    for j, latent in enumerate(latents_of(known)):
        posterior = latent.posterior
        gp = ExactGP(posterior.kernel, posterior.theta, 0.5 * np.log(posterior.noise_variance))
        X = np.concatenate([posterior.X, new])
        after = gp.condition(X, np.zeros(len(X))).predict(R)[1]
        assert found.deviation_before[j] == pytest.approx(np.sqrt(posterior.predict(R)[1].mean()), rel=1e-9)
        assert found.deviation_after[j] == pytest.approx(np.sqrt(after.mean()), rel=1e-5)


def test_a_shared_process_forecasts_every_command_in_its_unit() -> None:
    found = flight(known=flight_model(shared=True))
    np.testing.assert_allclose(found.deviation_before / found.deviation_before[0], [1.0, 2.0, 4.0, 8.0])


def test_planned_noise_teaches_more() -> None:
    known = arm_model()
    plain, planned = (arm(known=known, planned_noise=p, criterion="info_gain", refine=0) for p in (0, 1))
    assert planned.value > plain.value
    with pytest.raises(UsageError, match="rate of the logs"):
        design(
            arm_family(),
            arm_limits(),
            arm_home(),
            known.inputs,
            known,
            replace(ARM, planned_noise=True),
            np.random.default_rng(0),
        )


def test_tasks_change_the_design() -> None:
    with_tasks, without = arm(tasks=[moves()], criterion="ivr"), arm(criterion="ivr")
    assert with_tasks.trajectory.to_json() != without.trajectory.to_json()
    mixed = arm(tasks=[moves()], criterion="ivr", random_share=0.5)
    assert mixed.value not in (with_tasks.value, without.value)
    all_random = arm(tasks=[moves()], criterion="ivr", random_share=1.0)
    assert all_random.deviation_before == pytest.approx(without.deviation_before)


def test_a_task_of_another_robot_is_refused() -> None:
    with pytest.raises(UsageError, match="a task has 1 coordinates, the robot has 2"):
        arm(tasks=[PointToPoint(np.array([[0.0], [1.0]]), 1.0)])


def test_raw_units_add_the_variances_as_they_are() -> None:
    scaled, raw = (arm(criterion="mean_variance", raw_units=r, refine=0) for r in (False, True))
    assert raw.value > 10.0 * scaled.value


@pytest.mark.parametrize("raw_units", [False, True])
def test_it_does_not_matter_how_outputs_are_standardised(raw_units: bool) -> None:
    one, ten = (arm(known=arm_model(unit=unit), raw_units=raw_units) for unit in (1.0, 10.0))
    assert one.value == pytest.approx(ten.value, rel=1e-6)
    np.testing.assert_allclose(one.deviation_before, ten.deviation_before, rtol=1e-6)
    np.testing.assert_allclose(one.deviation_after, ten.deviation_after, rtol=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"margin": 3.0}, "room"), ({"speed": 0.0}, "speed"), ({"radius": 0.4}, "radius")],
)
def test_limits_without_room_are_refused(changes, message: str) -> None:
    with pytest.raises(UnsafeTrajectoryError, match=message):
        flight(limits=changes)


def test_tiny_and_huge_limits_are_designed_for() -> None:
    for factor in (1e-3, 1e3):
        axes = [
            replace(a, velocity=a.velocity * factor, acceleration=a.acceleration * factor**2)
            for a in arm_spec().axes
        ]
        spec = replace(arm_spec(), axes=tuple(axes))
        found = arm(spec=spec)
        assert certify_bytes(found.trajectory.to_json(), arm_limits(spec)).ok


def test_a_known_model_removes_nothing_and_divides_by_nothing() -> None:
    found = arm()
    still = replace(found, deviation_before=np.zeros(2), deviation_after=np.zeros(2))
    assert still.variance_removed == 0.0


@dataclass(frozen=True)
class Plugin:
    """A criterion of somebody else, broken after a number of calls."""

    whole: int
    __name__ = "theirs"

    def __call__(self, output, batch, gain) -> Score:
        calls.append(1)
        variance = batch.variance()
        value = float(gain**2 @ variance) if len(calls) <= self.whole else np.nan
        return Score(value, 2.0 * gain * variance, variance=gain**2)


calls: list[int] = []
theirs, late = Plugin(10**9), Plugin(30)


@pytest.mark.filterwarnings("ignore")
def test_a_criterion_of_somebody_else_is_searched_and_named_when_it_breaks(monkeypatch) -> None:
    calls.clear()
    found = arm(criterion=f"{__name__}:theirs")
    assert found.value > found.baseline
    calls.clear()
    with pytest.raises(UsageError, match="criterion 'theirs' returns the value nan"):
        arm(criterion=f"{__name__}:late")


def test_a_model_that_does_not_know_a_command_is_refused() -> None:
    known = arm_model()
    lacking = replace(known.candidates[1], process=None)
    with pytest.raises(UsageError, match="command 1 has no process"):
        arm(known=replace(known, candidates=(known.candidates[0], lacking)))


def test_inputs_of_another_width_say_so() -> None:
    known = replace(arm_model(), inputs=replace(arm_inputs(), friction_velocity=None))
    with pytest.raises(UsageError, match=r"inputs of shape \(T, 8\)"):
        arm(known=known)
