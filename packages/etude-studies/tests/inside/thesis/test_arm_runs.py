"""The runs of chapter 6 as computations: repeatable, shared where they say so, all of them possible."""

from __future__ import annotations

from json import JSONDecoder
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal as same

from etude.models import linear_inputs
from etude.protocols import Family
from etude.testing import FamilySuite
from etude.trajectories import from_json
from etude.types import Array, Log
from etude_studies.measured import comparable
from etude_studies.spec import Spec, run_one
from etude_studies.thesis import arm_lines
from etude_studies.thesis.arm import stages
from etude_studies.thesis.arm_motions import draws, recorded, training_motions
from etude_studies.thesis.arm_motions import tests_of as motions_of
from etude_studies.thesis.arm_runs import ARM_RUNS, CONTROLLERS, DOWNSAMPLED, arm_spec, baseline_spec
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.beyond_runs import BEYOND_RUNS
from etude_studies.thesis.own_omega0 import JointByJoint

QUICK = {"points": 30, "fit_points": 30, "steps": 2}


def quick(name: str, rounds: int = 1) -> dict[str, Any]:
    """A run of the chapter on few points, for a round or two."""
    own = dict(ARM_RUNS[name][1])
    cheap = {
        "rounds": rounds,
        "again": 0,
        "beside": False,
        "data": DOWNSAMPLED,
        "design": {"candidates": 2, "refine": 0},
    }
    return {**own, **cheap, "model": {**own["model"], **QUICK}}


def needed(spec: Spec) -> dict[str, pl.DataFrame]:
    return {own.hash: run_one(own, {}) for own in spec.needs}


@pytest.fixture(scope="module")
def drawn() -> pl.DataFrame:
    """The random motions of seed 3."""
    return draws({}, 3, {})


def test_one_spec_gives_the_same_figures_twice() -> None:
    spec = arm_spec(quick("A1"), 3)
    needs = needed(spec)
    once, again = (comparable(run_one(spec, needs)) for _ in range(2))
    assert once.equals(again)
    other = arm_spec(quick("A1"), 4)
    assert not once.equals(comparable(run_one(other, needed(other))))


def test_designed_and_random_runs_share_their_first_trajectory(drawn: pl.DataFrame) -> None:
    """To the bit; the second is another."""
    motions = training_motions(drawn)
    pairs = zip(*(stages(ArmSettings(**quick(name, 2)), 3, motions) for name in ("A1", "A7")), strict=True)
    (one, other), (later, designed) = pairs
    same(one.logs[0]["q"], other.logs[0]["q"], "first log")
    plan = one.model.inputs.states(planned(motions[5]))
    same(one.model.mean(plan), other.model.mean(plan), "first model")
    assert np.abs(later.logs[1]["q_des"] - designed.logs[1]["q_des"]).max() > 0.01


def planned(motion: Any) -> Any:
    robot: Any = ArmSettings().world.robot
    return robot.planned(motion)


@pytest.mark.parametrize("own_omega0", [False, True])
def test_draws_are_the_same_motions_to_the_bit(own_omega0: bool) -> None:
    settings = {"own_omega0": own_omega0}
    one, other = (training_motions(draws(settings, seed, {})) for seed in (3, 3))
    t = np.linspace(0.0, 60.0, 77)
    for a, b in zip(one, other, strict=True):
        same(a.motion(t).orders, b.motion(t).orders, "a motion read back")
    assert all(isinstance(motion, JointByJoint) == own_omega0 for motion in one)
    bases = {series.omega0 for series in getattr(one[0], "series", (one[0],))}
    assert len(bases) == (4 if own_omega0 else 1)


def test_a_second_draw_keeps_the_tests_and_changes_the_motions(drawn: pl.DataFrame) -> None:
    other = training_motions(draws({"draw": 1}, 3, {}))
    t = np.linspace(0.0, 60.0, 77)
    for a, b in zip(training_motions(drawn), other, strict=True):
        assert np.abs(a.motion(t).orders - b.motion(t).orders).max() > 0.01


def test_random_amplitudes_share_the_first_motion_and_are_smaller_after(drawn: pl.DataFrame) -> None:
    other = training_motions(draws({"motions": "amplitude"}, 3, {}))
    t = np.linspace(0.0, 60.0, 500)
    own = [motion.motion(t).orders for motion in training_motions(drawn)]
    small = [motion.motion(t).orders for motion in other]
    same(own[0], small[0], "the first motion")
    assert np.mean([np.abs(o[1]).max() for o in small[1:]]) < np.mean([np.abs(o[1]).max() for o in own[1:]])


def test_seeds_share_one_test_and_no_other() -> None:
    one, other = motions_of("arm4", 3), motions_of("arm4", 4)
    t = np.linspace(0.0, 60.0, 77)
    assert tuple(one) == ("fourier", "moves", "common")
    same(one["common"].motion(t).orders, other["common"].motion(t).orders, "the common test")
    assert np.abs(one["fourier"].motion(t).orders - other["fourier"].motion(t).orders).max() > 0.01


@pytest.mark.parametrize("name", ARM_RUNS)
def test_every_run_is_possible(name: str) -> None:
    settings = ArmSettings(**ARM_RUNS[name][1])
    config = settings.config
    assert config.model.process
    assert 1 <= settings.rounds <= 10
    spec = arm_spec(ARM_RUNS[name][1], 3)
    assert spec.needs[0].settings["motions"] in ("scaled", "amplitude")
    ArmSettings(**spec.settings)


@pytest.mark.parametrize(
    "name", [own if own == "DA_kernel" else pytest.param(own, marks=pytest.mark.slow) for own in BEYOND_RUNS]
)
def test_every_run_beyond_the_thesis_can_be_computed(name: str) -> None:
    """With its kernel and inputs: those that do not go together fail after a round."""
    own = dict(BEYOND_RUNS[name][1])
    cheap = {"rounds": 1, "model": {**own["model"], **QUICK}}
    spec = arm_spec({**own, **cheap}, 3)
    assert run_one(spec, needed(spec)).height > 0


def test_runs_differ() -> None:
    hashes = {name: arm_spec(settings, 3).hash for name, (_, settings) in ARM_RUNS.items()}
    assert len(set(hashes.values())) == len(hashes)
    assert len({baseline_spec(own, 3).hash for _, own in CONTROLLERS.values()}) == len(CONTROLLERS)


def test_every_twelfth_sample_counts_from_the_first(drawn: pl.DataFrame) -> None:
    settings = ArmSettings(data=DOWNSAMPLED)
    logs = [recorded(settings, motion, 3, i) for i, motion in enumerate(training_motions(drawn)[:2], 1)]
    samples = settings.world.samples(*logs)
    for place, log in enumerate(logs):
        moving = log.t[log.t >= 0.0]
        np.testing.assert_allclose(samples.log.t[samples.group == place], moving[::12], atol=1e-9)


def test_steps_that_grow_are_those_of_all_rounds_before() -> None:
    grown = ArmSettings(**ARM_RUNS["X7"][1])
    assert [grown.model_of(k).steps for k in (1, 2, 6)] == [25, 50, 150]
    assert [ArmSettings(**ARM_RUNS["A1"][1]).model_of(k).steps for k in (1, 6)] == [25, 25]


def test_the_linear_line_is_least_squares_without_its_ridge(monkeypatch: pytest.MonkeyPatch) -> None:
    world = ArmSettings().world
    inputs = world.kind.inputs(world.spec, world.config)
    rng = np.random.default_rng(0)
    command = rng.standard_normal((200, 4))
    log = states(rng.standard_normal((200, 12)))
    Z = np.column_stack([linear_inputs(inputs, inputs.of_log(log))[:, :-1], np.ones(200)])
    best = Z @ np.linalg.lstsq(Z, command, rcond=None)[0]
    ridged = arm_lines.Linear.of(inputs, log, command).predict(log)
    assert ((ridged - command) ** 2).sum() > ((best - command) ** 2).sum() * 1.0001
    monkeypatch.setattr(arm_lines, "RIDGE", 1e-12)
    np.testing.assert_allclose(arm_lines.Linear.of(inputs, log, command).predict(log), best, atol=1e-8)


def states(values: Array) -> Log:
    """A log whose desired motion is the rows (n, 12)."""
    found = planned(motions_of("arm4", 3)["fourier"])
    world = ArmSettings().world
    log = world.kind.inputs(world.spec, world.config).states(found).take(slice(0, len(values)))
    parts = dict(zip(("q_des", "qd_des", "qdd_des"), np.split(values, 3, axis=1), strict=True))
    for name, rows in parts.items():
        log = log.put(log.channels[name], rows)
    return log


def test_a_given_command_is_clipped_and_answers_the_nearest_tick() -> None:
    given = arm_lines.Given(np.array([[1.0], [2.0], [9.0]]), 10.0, np.array([5.0]))
    np.testing.assert_array_equal(given.commands.shape, (3, 1))
    assert [given.command(t, {})[0][0] for t in (-2.0, 0.04, 0.11, 0.3)] == [1.0, 1.0, 2.0, 5.0]


class TestJointByJoint(FamilySuite):
    """Every joint of a base frequency of its own."""

    family: Family = ArmSettings(own_omega0=True).family
    instants = 20_000

    def test_text_gives_it_back_to_the_bit(self) -> None:
        """One after the other: no file of a campaign holds such a trajectory."""
        trajectory: Any = self._trajectory(7)
        text, t = trajectory.to_json(), self.times(trajectory, 99)
        for joint, series in enumerate(trajectory.series):
            _, end = JSONDecoder().raw_decode(text)
            same(from_json(text[:end]).motion(t).orders, series.motion(t).orders, f"joint {joint} read back")
            text = text[end:].lstrip()
        assert not text

    def test_a_joint_moves_with_its_own_series(self) -> None:
        trajectory: Any = self._trajectory(9)
        t = self.times(trajectory, 50)
        assert len({series.omega0 for series in trajectory.series}) == 4
        for joint, series in enumerate(trajectory.series):
            same(trajectory.motion(t).orders[:, :, joint], series.motion(t).orders[:, :, joint], "joint")
