"""Kernels, costs, traces and related controllers: laws that do not depend on the machine's speed."""

from __future__ import annotations

import math
from copy import copy
from typing import Any

import numpy as np
import pytest

from etude.errors import UsageError
from etude_studies.measured import Measured, comparable, measured_table
from etude_studies.spec import run_one
from etude_studies.thesis import arm_motions, arm_traces, costs, ilc_runs, kernel_figure
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.ilc import learned_command

QUICK_COSTS = {
    "exact": [20, 40],
    "sloped": 20,
    "points": [3, 6],
    "points_sloped": 3,
    "samples": 30,
    "taught": [20, 40],
    "basis": 3,
    "members": 10,
    "offered": 60,
    "block": 4,
    "searches": 2,
    "counted": 30,
    "beyond": [80],
    "least_s": 0.0,
}


def values(found: list[Measured], **keys: Any) -> dict[int, float]:
    """By k."""
    return {row.k: row.value for row in found if all(getattr(row, n) == v for n, v in keys.items())}


def mean_squares(inputs: int, count: int, draws: int) -> np.ndarray:
    """(n,) mean square error over draws at each pair of inputs."""
    lags = kernel_figure.lags_within(inputs, np.random.default_rng(0))[::10]
    errors = []
    for seed in range(draws):
        features = kernel_figure.drawn(count, inputs, np.random.default_rng([1, seed, count]))
        errors.append(kernel_figure.covariances(features, lags) - kernel_figure.exact(lags))
    return np.mean(np.square(errors), axis=0)


@pytest.mark.parametrize("inputs", [1, 12])
def test_spectral_points_err_as_the_variance_of_a_cosine(inputs: int) -> None:
    """cos(w r) with w ~ N(0, 1) has the variance (1 - exp(-r^2))^2 / 2."""
    r = np.linspace(0.0, kernel_figure.REACH, kernel_figure.PAIRS)[::10]
    expected = (1.0 - np.exp(-(r**2))) ** 2 / 2.0
    found = 20 * mean_squares(inputs, 20, 200)
    np.testing.assert_allclose(found.mean(), expected.mean(), rtol=0.15)
    np.testing.assert_allclose(found[::20], expected[::20], rtol=0.5, atol=1e-12)


@pytest.mark.parametrize("inputs", [1, 12])
def test_the_error_falls_as_one_over_the_root_of_the_points(inputs: int) -> None:
    counts = (5, 20, 80)
    rms = [math.sqrt(mean_squares(inputs, count, 60).mean()) for count in counts]
    assert np.polyfit(np.log(counts), np.log(rms), 1)[0] == pytest.approx(-0.5, abs=0.1)


def test_spectral_points_are_unbiased() -> None:
    lags = np.linspace(0.0, 5.0, 11)[:, None]
    draws = [
        kernel_figure.covariances(kernel_figure.drawn(50, 1, np.random.default_rng(seed)), lags)
        for seed in range(400)
    ]
    deviation = np.sqrt((1.0 - np.exp(-(lags[:, 0] ** 2))) ** 2 / (2 * 50 * 400))
    assert np.all(np.abs(np.mean(draws, axis=0) - np.exp(-0.5 * lags[:, 0] ** 2)) <= 4.5 * deviation + 1e-12)


def test_the_figure_has_its_curves_and_an_error_for_each_number_of_points() -> None:
    found = kernel_figure.run({"points": [5, 50]}, 2, {})
    measured_table(found, "K1")
    for part in ("D1", "D12"):
        assert list(values(found, measure="kernel_rms", part=part)) == [5, 50]
    lag = np.array(list(values(found, measure="lag").values()))
    exact, ten = (np.array(list(values(found, model=m).values())) for m in ("exact", "m10"))
    np.testing.assert_allclose(exact, np.exp(-0.5 * lag**2))
    np.testing.assert_allclose(ten, ten[::-1], atol=1e-12)
    assert ten[40] == pytest.approx(1.0)
    assert len(ten) == kernel_figure.CURVE


@pytest.fixture(scope="module")
def found_costs() -> list[Measured]:
    """Of processes as small as possible."""
    return costs.run(QUICK_COSTS, 0, {})


def test_costs_are_times_and_all_of_them_are_there(found_costs: list[Measured]) -> None:
    """No figure of them is compared between two computations; every size has its rows."""
    found = found_costs
    assert not len(comparable(measured_table(found, "T1")))
    for model, sizes in {"exact": [20, 40], "spectrum": [3, 6], "spectrum_n": [20, 40]}.items():
        assert list(values(found, model=model, measure="cpu_train")) == sizes
        assert list(values(found, model=model, measure="cpu_predict_each")) == sizes
        assert math.isfinite(values(found, model=model, measure="cpu_slope_train")[0])
    assert values(found, measure="cpu_swap")[10] > 0.0
    own = [row.value for row in found if "slope" not in row.measure]
    assert min(own) > 0.0


def test_costs_are_extrapolated_by_the_cube_and_the_square(found_costs: list[Measured]) -> None:
    found = found_costs
    beyond = {row.measure: row.value for row in found if row.k == 80}
    train = values(found, model="exact", measure="cpu_train")[40]
    assert beyond["cpu_train"] == pytest.approx(8.0 * train)
    count = values(found, measure="cpu_evaluations")[0]
    assert 2 <= count <= 40
    assert beyond["cpu_train_hours"] == pytest.approx(count * 8.0 * train / 3600.0)
    predict = values(found, model="exact", measure="cpu_predict")[40]
    assert beyond["cpu_predict"] == pytest.approx(4.0 * predict)
    assert beyond["cpu_gram_gb"] == pytest.approx(80**2 * 8 / 1e9)


def test_growth_is_the_power() -> None:
    sizes = np.array([10.0, 30.0, 200.0])
    assert costs.growth(sizes, 3.0 * sizes**2.5) == pytest.approx(2.5)
    assert math.isnan(costs.growth([10.0], [1.0]))


def test_a_trace_is_the_test_run_thinned() -> None:
    settings = {"rounds": 1, "after": [1], "data": {"rate_hz": 1.0}}
    settings["model"] = {"points": 20, "fit_points": 20, "steps": 1}
    needs = arm_traces.trace_spec("A1t", 3).needs
    tables = {own.hash: run_one(own, {}) for own in needs}
    found = arm_traces.traces(settings, 3, tables)
    measured_table(found, "A1t")
    t = np.array(list(values(found, measure="t").values()))
    np.testing.assert_allclose(np.diff(t), 0.1, atol=1e-6)
    assert t[0] == 0.0
    assert t[-1] >= 59.9
    assert {row.test for row in found} == {"after 1", "fourier"}
    (share,) = (row.value for row in found if row.measure == "after_reversal" and row.part == "mean")
    assert 0.0 < share < 1.0
    world = ArmSettings().world
    for joint, limit in zip(world.spec.names, world.kind.limit(world.spec), strict=True):
        wanted, actual = (
            np.array(list(values(found, part=joint, measure=m).values())) for m in ("q_des", "q")
        )
        assert np.ptp(wanted) > 1.0
        assert np.abs(wanted - actual).max() < np.ptp(wanted)
        assert np.abs(list(values(found, part=joint, measure="u_ff").values())).max() <= limit


@pytest.mark.parametrize("name", arm_traces.TRACED)
def test_a_trace_runs_as_far_as_it_is_drawn(name: str) -> None:
    settings = arm_traces.trace_spec(name, 0).settings
    assert settings.pop("rounds") == max(settings.pop("after"))
    ArmSettings(**settings)


def test_repetitions_teach_one_motion_and_no_other() -> None:
    """Feedback alone before the first; then the error falls on the test, and elsewhere it does not."""
    spec = ilc_runs.repeated_spec(3)
    found = ilc_runs.repeated({**spec.settings, "rounds": 2}, 3, {})
    measured_table(found, "Y1")
    own, common = (values(found, measure="error", part="mean", test=test) for test in ("fourier", "common"))
    assert own[1] < 0.5 * own[0]
    assert own[2] < own[1]
    assert common[2] > 0.9 * common[0]


def test_a_signal_is_cut_off_or_followed_by_zeros() -> None:
    world = ArmSettings().world
    motion = arm_motions.tests_of("arm4", 3)["fourier"]
    log = world.robot.run(motion, None, np.random.default_rng(0))
    signal = learned_command(log).values
    robot: Any = world.robot
    count = len(robot.planned(motion).t)
    for given in (ilc_runs.given_on(world, motion, signal[:-7]), ilc_runs.given_on(world, motion, signal)):
        assert given.commands.shape == (count, 4)
        np.testing.assert_array_equal(given.commands[:-7], signal[: count - 7])
    assert not ilc_runs.given_on(world, motion, signal[:-7]).commands[-7:].any()
    with pytest.raises(UsageError):
        learned_command(log).planned(robot.planned(motion.slowed(1.5)))


@pytest.mark.parametrize("law", ilc_runs.LAWS.values(), ids=["slotine_li", "craig"])
def test_a_frozen_law_keeps_its_estimates_and_touches_no_other(law: Any) -> None:
    own = ArmSettings()
    controller = law(own.world.kind.physics(own.world.spec, own.config)["identified"])
    start = controller.weights.copy()
    adapting, frozen = copy(controller), ilc_runs.Frozen.of(controller)
    home = 0.5 * (own.world.spec.lower + own.world.spec.upper)
    commands = []
    for one in (adapting, frozen):
        for k in range(3):
            row = {"q_des": home, "qd_des": np.full(4, 0.1), "qdd_des": np.zeros(4), "q": home - 0.01 * k}
            command, _ = one.command(0.01 * k, row)
            one.observe(0.01 * k, {**row, "command": command})
        commands.append(command)
    assert np.abs(adapting.weights - start).max() > 0.0
    np.testing.assert_array_equal(frozen.controller.weights, start)
    np.testing.assert_array_equal(controller.weights, start)
    assert np.abs(commands[0] - commands[1]).max() > 0.0
