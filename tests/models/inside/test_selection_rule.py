"""Where a process would lose to linear regression on unseen motion, the ladder does not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from learning_examples import PHYSICS, SMALL, commanded, selection, trajectories, trajectory

from etude.codes import Warn
from etude.models import ModelSelection, linear_inputs
from etude.models.selection.linear import linear_weights
from etude.models.selection.selection_rule import _choice, _reference
from etude.types import Samples, joined_samples

AUTO = replace(SMALL, rung="auto", replace="chance")


def moved(samples: Samples, q: np.ndarray, command: np.ndarray) -> Samples:
    own = commanded(samples, command)
    every = np.ones_like(own.moving)
    return replace(own, log=own.log.put(own.log.channels["q"], q), moving=every)


def drifting(count: int = 3, beyond: float = 0.0, size: float = 1.0) -> Samples:
    """Each trajectory around a posture of its own; command 0 is linear in it, 1 is that of the robot."""
    parts = []
    for g in range(count):
        own = trajectory(g)
        q = 0.3 * own.log["q"] + 0.7 * g + beyond
        noise = 0.05 * np.random.default_rng(g).normal(size=len(q))
        first = size * (10.0 * q[:, 0] - 4.0 * own.log["qdd"][:, 1] + noise)
        parts.append(moved(own, q, np.column_stack([first, own.command[:, 1]])))
    return joined_samples(parts)


def chosen(data: Samples, config=AUTO) -> ModelSelection:
    return selection(data, config, physics={})


def ratios(found: ModelSelection, data: Samples, test: Samples) -> np.ndarray:
    """Squared error over that of linear regression, per command."""
    inputs = found.model.inputs
    L, at = (linear_inputs(inputs, inputs.of_log(own.log)) for own in (data, test))
    linear = at @ linear_weights(L, data.command, data.usable)
    mean = found.model.mean(test.log)
    return ((mean - test.command) ** 2).mean(axis=0) / ((linear - test.command) ** 2).mean(axis=0)


@pytest.mark.parametrize("size", [1.0, 1e-7, 1e7], ids=["plain", "tiny", "huge"])
def test_a_trend_beyond_the_data_is_where_a_process_loses_and_the_ladder_does_not(size: float) -> None:
    data, test = drifting(size=size), drifting(1, beyond=3.0, size=size)
    assert ratios(chosen(data, SMALL), data, test)[0] > 100.0
    found = chosen(data)
    assert found.chosen[0].startswith("linear")
    assert ratios(found, data, test)[0] < 1.1
    assert found.errors["gp"][0] > found.errors["linear"][0]
    (said,) = [one for one in found.model.warnings if one.fields["command"] == "a"]
    assert said.code in (Warn.LINEAR_ALONE, Warn.LINEAR_BELOW)
    assert said.sentence.startswith("a: the held-out error of the process is")


def test_a_linear_command_under_noise_as_large_as_itself_is_linear_too() -> None:
    data, test = drifting(4), drifting(1, beyond=3.0)
    rng = np.random.default_rng(3)
    size = np.array([8.0, 0.0])
    noisy, measured = (
        commanded(d, d.command + size * rng.normal(size=d.command.shape)) for d in (data, test)
    )
    assert ratios(chosen(noisy, SMALL), noisy, measured)[0] > 1.5
    assert ratios(chosen(noisy), noisy, measured)[0] < 1.1


def test_linear_alone_has_an_honest_variance() -> None:
    data, far = drifting(), drifting(1, beyond=300.0)
    found = chosen(data, replace(SMALL, rung="linear"))
    _, near = found.model.predict(data.log)
    mean, variance = found.model.predict(far.log)
    held = np.nanmax(found.held_out["linear"].variance, axis=0)
    assert (near >= held).all()
    assert (variance >= held).all()
    assert np.isfinite(mean).all()
    assert (found.model.prior_deviation >= data.command.std(axis=0) * (1 - 1e-12)).all()


def test_every_member_competes() -> None:
    data, test = drifting(), drifting(1, beyond=3.0)
    for process in ("vfe", "sogp"):  # a dictionary takes the same way, and seconds to compile
        found = chosen(data, replace(AUTO, process=process, points=60, basis=30, steps=6))
        assert found.chosen[0].startswith("linear"), process
        assert ratios(found, data, test)[0] < 1.1, process


def test_one_trajectory_is_warned_of_and_keeps_its_process() -> None:
    """Stretches of one motion say little of the next, on which linear regression may err without bound."""
    t = np.arange(0.0, 60.0, 0.125)
    one = trajectory(0, seconds=60.0)
    q = np.column_stack([0.1 * t, one.log["q"][:, 1]])
    data = moved(one, q, np.column_stack([10.0 * q[:, 0], one.command[:, 1]]))
    found, bare = chosen(data), chosen(data, SMALL)
    assert found.chosen == ("gp", "gp")
    assert found.model.warnings[0].code == Warn.ONE_TRAJECTORY
    assert str(found.model.warnings[0]).endswith("; ingest another one.")
    np.testing.assert_array_equal(found.model.mean(data.log), bare.model.mean(data.log))


def test_each_command_has_the_rung_that_is_best_for_it() -> None:
    """Command 0 as the physics say; 1 with a ripple that only a process learns."""
    data = trajectories(4)
    exact = PHYSICS["identified"](data).predict(data.log)
    noise = 0.2 * np.random.default_rng(0).normal(size=len(data))
    mixed = commanded(data, np.column_stack([exact[:, 0] + noise, data.command[:, 1]]))
    found = selection(mixed, AUTO)
    assert found.chosen == ("identified", "identified+gp")
    new = trajectory(9)
    for j, structure in enumerate(found.chosen):
        expected = found.model.of_structure(structure).predict(new.log)
        for mine, theirs in zip(found.model.predict(new.log), expected, strict=True):
            np.testing.assert_array_equal(mine[:, j], theirs[:, j])


def test_the_choice_is_no_worse_than_the_best_for_all_commands_together() -> None:
    found = selection(trajectories(3), AUTO)
    chosen_error = sum(found.errors[structure][j] for j, structure in enumerate(found.chosen))
    spread = trajectories(3).command.var(axis=0)
    best = min(float(np.mean(error / spread)) for error in found.errors.values())
    own = np.mean([found.errors[structure][j] / spread[j] for j, structure in enumerate(found.chosen)])
    assert own <= best + 1e-12
    assert np.isfinite(chosen_error)


def test_every_asks_for_a_win_on_each_held_out_motion() -> None:
    physics = np.array([1.0, 1.0, 1.0])
    for own, chance, every in (
        ([0.5, 0.5, 0.9], "gp", "gp"),
        ([0.1, 0.1, 1.01], "gp", "identified"),
        ([0.1, 0.1, np.nan], "gp", "gp"),
        ([1.1, 1.1, 1.1], "identified", "identified"),
        ([0.1, np.nan, np.nan], "identified", "identified"),
    ):
        votes = {"identified": physics, "gp": np.array(own)}
        assert _choice(votes, "identified", 0.0, "chance") == chance
        assert _choice(votes, "identified", 0.0, "every") == every


def test_physics_stand_until_a_rung_wins_everywhere() -> None:
    trained = [["identified", "identified+gp", "gp"]] * 2
    for worst, structure in ((0.9, "identified+gp"), (1.1, "identified")):
        votes = {
            "identified": np.ones((3, 2)),
            "identified+gp": np.array([[0.2, 0.3], [0.2, 0.3], [worst, worst]]),
            "gp": np.array([[0.1, 0.1], [0.1, 0.1], [3.0, 3.0]]),
        }
        config = replace(AUTO, replace="every")
        assert _reference(SimpleNamespace(config=config, trajectories=3), trained, votes) == structure  # type: ignore[arg-type]
    best = _reference(SimpleNamespace(config=AUTO, trajectories=3), trained, votes)  # type: ignore[arg-type]
    assert best == "identified+gp"
