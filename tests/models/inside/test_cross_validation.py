"""What is held out, linear regression, and which samples are learned from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import LIMIT, NAMES, SMALL, Inputs, commanded, samples_of, trajectories, trajectory

from etude.errors import DataError, UsageError
from etude.models import (
    Folds,
    LinearPhysics,
    block_masks,
    contiguous_blocks,
    fold_numbers,
    in_order,
    rows_of,
    split_blocks,
)
from etude.models.data.cross_validation import held_out_blocks
from etude.models.data.fit_data import seconds_of, spread_points
from etude.models.selection.linear import at_rest
from etude.types import Samples


def samples(n: int, seed: int = 0) -> Samples:
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.standard_normal((3, n, 2))
    command = q @ [[1.0, 2.0], [0.0, 1.0]] + 3.0 * qd - 0.5 * qdd + [4.0, -1.0]
    return samples_of(np.linspace(5.0, 25.0, n), q, qd, qdd, command, 0)


def test_every_fifth_block_is_held_out() -> None:
    assert held_out_blocks() == (3, 8, 13, 18)
    data = samples(2000)
    train, test = split_blocks(data)
    assert len(train) + len(test) == len(data)
    middles = [run.mean() for run in np.split(test.t, np.flatnonzero(np.diff(test.t) > 1.0) + 1)]
    np.testing.assert_allclose(middles, [8.5, 13.5, 18.5, 23.5], atol=0.02)  # 1 s a block, from 5 s on
    assert len(test) == 400


def test_no_training_sample_is_within_the_gap() -> None:
    data = samples(2000)
    train, test = split_blocks(data, gap_s=0.25)
    assert np.abs(train.t[:, None] - test.t).min() >= 0.25 - 1e-9
    assert len(train) < 1600


def test_a_part_can_be_split_again() -> None:
    train, _ = split_blocks(samples(2000))
    inner, held = split_blocks(train)
    assert len(held) == 320
    assert set(held.t) < set(train.t)
    assert not set(held.t) & set(inner.t)


def test_the_order_of_samples_does_not_matter() -> None:
    data = samples(500)
    shuffled = data.take(np.random.default_rng(0).permutation(500))
    assert set(split_blocks(shuffled)[1].t) == set(split_blocks(data)[1].t)


def test_too_short_a_log_is_refused() -> None:
    with pytest.raises(DataError, match="too short"):
        split_blocks(samples(1))
    assert block_masks(np.arange(20.0))[1].sum() == 4


def test_folds_are_trajectories_or_stretches_of_a_single_one() -> None:
    np.testing.assert_array_equal(fold_numbers(trajectories(2), 8.0), trajectories(2).group)
    many = fold_numbers(trajectories(30), 8.0)
    assert len(np.unique(many)) == 12  # whatever their number
    assert all(len(np.unique(many[trajectories(30).group == number])) == 1 for number in range(30))
    assert len(np.unique(fold_numbers(trajectory(0, seconds=6.0), 8.0))) == 4  # a short one too
    assert len(np.unique(fold_numbers(trajectory(0, seconds=80.0), 8.0))) == 10


def test_blocks_are_contiguous_within_trajectories() -> None:
    t = np.concatenate([np.arange(0, 20, 0.5), np.arange(0, 9, 0.5)])
    group = np.repeat([4, 7], [40, 18])
    blocks = contiguous_blocks(t, group, 5.0)
    assert len(np.unique(blocks)) == 6
    assert set(blocks[:40]).isdisjoint(blocks[40:])
    for part in (blocks[:40], blocks[40:]):
        assert np.all(np.diff(part) >= 0)
    with pytest.raises(UsageError, match="positive length"):
        contiguous_blocks(t, group, 0.0)


def test_linear_regression_is_exact_on_linear_data_and_hears_the_mask() -> None:
    train, test = split_blocks(samples(300))
    linear = LinearPhysics(Inputs())
    np.testing.assert_allclose(linear(train).predict(test.log), test.command, atol=1e-10)
    usable = np.ones_like(train.usable)
    usable[::4, 1] = False
    spoiled = replace(commanded(train, np.where(usable, train.command, 1e3)), usable=usable)
    mean = linear(spoiled)
    np.testing.assert_allclose(mean.predict(test.log), test.command, atol=1e-9)
    np.testing.assert_array_equal(linear.restore(mean.arrays()).predict(test.log), mean.predict(test.log))
    np.testing.assert_allclose(mean.static(test.log), test.log["q"] @ [[1, 2], [0, 1]] + [4, -1], atol=1e-9)


def test_at_rest_only_rates_are_zero() -> None:
    log = at_rest(trajectory(0).log)
    assert not log["qd"].any()
    assert not log["qdd"].any()
    np.testing.assert_array_equal(log["q"], trajectory(0).log["q"])


def test_points_are_spread_apart_and_over_all_trajectories() -> None:
    data, rng = trajectories(3), np.random.default_rng(0)
    use = data.moving[:, 0]
    index = spread_points(data.t, data.group, use, 30, 1.0, rng)
    assert len(index) <= 30
    assert np.all(use[index])
    assert set(data.group[index]) == {0, 1, 2}
    index = spread_points(data.t, data.group, use, 10**6, 1.0, rng)
    same = np.diff(data.group[index]) == 0
    assert np.all(np.diff(data.t[index])[same] >= 1.0 - 1e-9)
    assert len(spread_points(data.t, data.group, use, 10**6, 0.0, rng)) == np.count_nonzero(use)
    assert seconds_of(data) == pytest.approx(3 * 24.875)


def test_in_order_sorts_and_drops_repetitions() -> None:
    data = trajectories(3)
    shuffled = data.take(np.random.default_rng(1).permutation(np.tile(np.arange(len(data)), 2)))
    restored = in_order(shuffled)
    for name in ("q", "qd", "qdd", "command"):
        np.testing.assert_array_equal(restored.log[name], data.log[name])
    np.testing.assert_array_equal(restored.group, data.group)
    np.testing.assert_array_equal(restored.moving, data.moving)


@pytest.mark.parametrize("dense", [1, 3])
def test_samples_for_hyperparameters_are_as_far_apart_however_densely_a_log_is_sampled(dense: int) -> None:
    data, config = samples(160 * dense + 1), replace(SMALL, kernel="structured", fit_points=300, points=600)
    inputs = Inputs()
    fold = fold_numbers(data, config.stretch_s)
    folds = Folds(data, inputs, inputs.of_log(data.log), fold, LIMIT, config, NAMES)
    rows = rows_of(folds, (0,), np.random.default_rng(0))
    assert len(rows.kept) == len(rows.moving)  # all teach
    apart = np.diff(data.t[rows.chosen])  # of 20 s, an eightieth; more where a joint stands
    assert apart.min() == pytest.approx(0.25)
    assert np.median(apart) == pytest.approx(0.25, abs=0.05)
