"""The ladder: what it offers, how it chooses, and that the choice is made on motion not yet learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from etude.models.inverse_dynamics import train_model
from learning_examples import SMALL, pendulum, trajectories, trajectory

from etude.models.ladder import prequential, train_ladder

AUTO = replace(SMALL, kind="auto")


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    spec = pendulum(tmp_path_factory.mktemp("robot"))
    return spec, train_ladder(trajectories(3), spec, AUTO, np.random.default_rng(0))


def test_without_a_model_file_only_the_process_is_offered() -> None:
    ladder = train_ladder(trajectories(2), pendulum(), AUTO, np.random.default_rng(0))
    assert list(ladder.models) == ["gp"]
    assert ladder.chosen == "gp"


def test_all_kinds_are_trained_scored_and_the_best_is_chosen(full) -> None:
    _, ladder = full
    assert set(ladder.models) == {"gp", "identified", "identified+gp"}
    kinds = [kind for kind in ladder.scores if kind in ladder.models]
    assert set(kinds) == set(ladder.models)
    assert ladder.chosen == min(kinds, key=lambda kind: ladder.scores[kind].nmse.mean())
    assert ladder.model is ladder.models[ladder.chosen]
    assert ladder.chosen != "identified"  # the ripple is nothing a rigid body has


def test_scores_come_from_models_that_had_not_seen_the_newest(full) -> None:
    spec, ladder = full
    data = trajectories(3)
    newest = data.group == 2
    own = replace(SMALL, kind="identified")
    blind = train_model(data.take(~newest), spec, own, np.random.default_rng(0))
    expected = prequential({"identified": blind}, data.take(newest))["identified"]
    np.testing.assert_allclose(ladder.scores["identified"].nmse, expected.nmse, rtol=1e-9)


def test_earlier_models_are_scored_if_there_are_any(full) -> None:
    spec, ladder = full
    data = trajectories(4)
    again = train_ladder(data, spec, AUTO, np.random.default_rng(0), ladder.models)
    expected = prequential(ladder.models, data.take(data.group == 3))
    for kind in ladder.models:
        np.testing.assert_array_equal(again.scores[kind].nmse, expected[kind].nmse)


def test_a_single_trajectory_is_scored_on_held_out_blocks(full) -> None:
    spec, _ = full
    ladder = train_ladder(trajectory(0), spec, AUTO, np.random.default_rng(0))
    assert set(ladder.models) <= set(ladder.scores)
    assert np.all(np.isfinite(ladder.scores["gp"].nmse))
