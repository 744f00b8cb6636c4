"""Candidates are averaged with the weights that predict logs left out, and widths hold on the next log."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from learning_examples import PHYSICS, SMALL, Inputs, commanded, selection, trajectory

from etude.models import load_model, save_model
from etude.models.selection.candidate_errors import CandidateErrors
from etude.models.selection.stacking import PRUNED, Moments, combined, pruned, stacked
from etude.models.selection.width import coverage_factor, widths
from etude.types import Array, Samples, joined_samples

AUTO = replace(SMALL, rung="auto")


def half_right(count: int, first: int = 0) -> Samples:
    """Command 0 as physics say; 1 with a ripple that a process learns, half of it beside those physics."""
    data = joined_samples([trajectory(first + g) for g in range(count)])
    exact = PHYSICS["identified"](data).predict(data.log)
    noise = 0.2 * np.random.default_rng(first).normal(size=len(data))
    return commanded(data, np.column_stack([exact[:, 0] + noise, data.command[:, 1]]))


def squared(mean: Array, data: Samples) -> Array:
    """(J,) mean squared error over the variance of the command."""
    error = (mean - data.command)[data.moving.all(axis=1)]
    return np.asarray(np.mean(error**2, axis=0) / data.command.var(axis=0))


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1.0, 1e-4), (1e3, 1.0)], ids=["plain", "weak", "strong"])
def test_the_stack_is_as_good_as_the_best_structure_on_new_motion(scale: tuple[float, float]) -> None:
    data, new = (commanded(d, d.command * scale) for d in (half_right(4), half_right(3, first=20)))
    found = selection(data, AUTO)
    own = squared(found.model.mean(new.log), new)
    single = {
        name: squared(found.model.of_structure(name).mean(new.log), new) for name in found.model.structures
    }
    assert own.mean() <= 1.05 * min(error.mean() for error in single.values())
    assert (own <= 1.2 * np.min(list(single.values()), axis=0)).all()


def test_weights_add_up_and_none_is_small() -> None:
    model = selection(half_right(4), AUTO).model
    weights = np.zeros((len(model.candidates), 2))
    for k, candidate in enumerate(model.candidates):
        weights[k, list(candidate.commands)] = candidate.weights
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    used = weights[weights > 0.0]
    assert used.min() >= PRUNED
    assert max((weights > 0.0).sum(axis=0)) > 1


def test_one_log_leaves_the_choice() -> None:
    data = half_right(1)
    stacked, chosen = (selection(data, replace(AUTO, replace=rule)).model for rule in ("stack", "chance"))
    assert stacked.chosen == chosen.chosen
    assert all(set(candidate.weights.tolist()) <= {0.0, 1.0} for candidate in stacked.candidates)
    np.testing.assert_array_equal(stacked.mean(data.log), chosen.mean(data.log))


def test_several_structures_are_stored_and_read_as_they_are(tmp_path) -> None:
    model, new = selection(half_right(4), AUTO).model, trajectory(9).log
    assert len(model.in_use) > 1
    save_model(tmp_path / "model.npz", model)
    again = load_model(tmp_path / "model.npz", Inputs().restore, PHYSICS)
    for mine, theirs in zip(again.predict(new), model.predict(new), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert again.in_use == model.in_use


def test_each_log_has_its_own_noise_level() -> None:
    """Nine quiet logs favour the first candidate tenfold, one loud log the second by a little more in sum."""
    quiet, loud = np.diag([1.0, 10.0]), np.diag([2000.0, 1000.0])
    grams = np.stack([*[quiet] * 9, loud])
    weights = combined(grams, np.full(10, 100.0))
    assert weights[0] > 0.8
    plain = np.diagonal(grams.mean(axis=0))
    assert plain[1] < plain[0]  # pooled squares would have it the other way


def test_far_worse_candidates_take_no_part() -> None:
    """Errors that cancel in the logs there are would give a wild candidate weight."""
    e = np.array([[1.0, -1.0, 1.0, -1.0], [-9.0, 9.0, -9.0, 9.0]])
    gram = e @ e.T / 4.0
    np.testing.assert_array_equal(combined(np.stack([gram, gram]), np.ones(2)), [1.0, 0.0])


def test_pruned_weights_add_up() -> None:
    np.testing.assert_allclose(pruned(np.array([0.7, 0.27, 0.03])), [0.7 / 0.97, 0.27 / 0.97, 0.0])
    np.testing.assert_allclose(pruned(np.full(30, 1 / 30)).sum(), 1.0)


def test_intervals_hold_on_the_next_log() -> None:
    """Logs whose z2 differ by e^0.9: a width from three of them holds on others, pooled z2 alone does not."""
    rng = np.random.default_rng(3)
    inside, pooled = [], []
    for _ in range(300):
        levels = np.exp(0.45 * rng.normal(size=4))
        error = levels.repeat(200) * rng.normal(size=800)
        fold = np.arange(4).repeat(200)
        past, next_ = fold < 3, fold == 3
        (width,) = widths(error[past, None], np.ones((600, 1)), fold[past], 3)
        inside.append(np.mean(np.abs(error[next_]) <= 1.96 * np.sqrt(width)))
        pooled.append(np.mean(np.abs(error[next_]) <= 1.96 * np.sqrt(np.mean(error[past] ** 2))))
    assert 0.935 < np.mean(inside) < 0.975
    assert np.mean(pooled) < 0.93


def test_a_single_log_widens_more_than_its_blocks_say() -> None:
    rng = np.random.default_rng(4)
    error, fold = rng.normal(size=(800, 1)), np.arange(8).repeat(100)
    (one,), (several,) = (widths(error, np.ones_like(error), fold, count) for count in (1, 8))
    assert one > 2.8
    assert 1.0 < several < 2.0


def test_a_spread_of_nothing_needs_no_width() -> None:
    np.testing.assert_allclose(coverage_factor(0.0), 1.0, atol=1e-3)
    assert coverage_factor(0.5) < coverage_factor(1.0) < coverage_factor(1.5)


def test_samples_at_which_all_err_do_not_decide() -> None:
    """One law in twenty samples is a little less wrong, everywhere else three times as wrong."""
    rng, n = np.random.default_rng(4), 800
    hard, fold = np.arange(n) % 20 == 0, np.arange(n) * 4 // n
    noise = rng.normal(size=(2, n))
    errors = np.where(hard, [[3.0], [2.5]] * np.sign(noise[:1]), [[0.1], [0.3]] * noise)
    parts = [SimpleNamespace(candidate=SimpleNamespace(structure=s, name="", commands=(0,))) for s in "ab"]
    every: Any = [
        CandidateErrors(part, error[:, None], np.ones((n, 1)))
        for part, error in zip(parts, errors, strict=True)
    ]
    moments = Moments.of(every, 0, fold)
    assert moments is not None
    assert stacked(moments, [], 2).weights[0] > 0.8
