"""Choices are compared on the training part alone, and figures are those defined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.models import structured
from etude_arm import filter_cutoff
from etude_studies import real_choices
from etude_studies.real_choices import Choice, choice_rows, folds, left_out, predicted, stacked_errors
from etude_studies.real_logs import REAL_LOGS, arm_log

FEW = {"steps": 3, "fit_points": 40}
QUICK = Choice(FEW)


@pytest.fixture(scope="module")
def tx40():
    (real,) = (real for real in REAL_LOGS if real.name == "tx40")
    return real, real.find(), arm_log("tx40", real.find())


def test_no_fold_holds_a_test_sample_or_one_near_it(tx40) -> None:
    real, path, (log, world) = tx40
    test, gap = real.load(path).test.t, 1.0 / filter_cutoff(log, world.config.data)
    seen = set()
    for train, held in folds(log, world, QUICK):
        for part in (train, held):
            assert np.abs(part.t[:, None] - test).min() >= gap - 1e-9
        assert np.abs(train.t[:, None] - held.t).min() >= gap - 1e-9
        assert train.t.min() < held.t.min()
        assert train.t.max() > held.t.max()
        assert not seen & set(held.t)
        seen |= set(held.t)
    known = real.load(path).train.t
    inner = known[(known > known.min() + 0.05 * 9) & (known < known.max() - 0.05 * 9)]
    assert set(inner) <= seen | set(known[np.abs(known[:, None] - test).min(axis=1) < gap])


def test_a_disturbance_of_the_test_blocks_changes_no_choice(tx40) -> None:
    _, _, (log, world) = tx40
    blow = log["command"].copy()
    blow[(log.t > 1.5) & (log.t < 1.6)] += 20.0  # in the middle of block 3
    hurt = log.put(log.channels["command"], blow)
    parts = zip(folds(log, world, QUICK), folds(hurt, world, QUICK), strict=True)
    for plain, hit in parts:
        for mine, theirs in zip(plain, hit, strict=True):
            np.testing.assert_array_equal(mine.log["q"], theirs.log["q"])
            assert np.abs(mine.command - theirs.command).max() < 0.3  # what the filter's tail carries


def test_stacking_takes_its_weight_from_the_other_folds() -> None:
    rng = np.random.default_rng(0)
    process, linear = ([rng.normal(size=(50, 2)) for _ in range(3)] for _ in range(2))
    same = stacked_errors(process, process)
    np.testing.assert_allclose(same, [(e**2).sum(axis=0) for e in process])
    right = [np.zeros_like(e) for e in linear]
    np.testing.assert_allclose(stacked_errors(process, right), 0.0, atol=1e-20)
    wild = [e if k else 1e3 * e for k, e in enumerate(linear)]  # fold 0 alone is wild: others do not know
    weights = []
    for j in range(2):
        mine = np.concatenate([process[1][:, j], process[2][:, j]])
        step = mine - np.concatenate([wild[1][:, j], wild[2][:, j]])
        weights.append(np.linalg.lstsq(step[:, None], mine, rcond=None)[0][0])
    expected = ((process[0] + np.array(weights) * (wild[0] - process[0])) ** 2).sum(axis=0)
    np.testing.assert_allclose(stacked_errors(process, wild)[0], expected)


def test_a_choice_is_what_its_keys_say(tx40) -> None:
    _, _, (log, world) = tx40
    one = left_out(QUICK, log, world)
    other = left_out(Choice({**FEW, "kernel": "ard_se"}), log, world)
    assert other.nmse(other.process).mean() > 1.5 * one.nmse(one.process).mean()
    np.testing.assert_array_equal(one.linear, other.linear)
    assert np.all(one.nmse(one.linear) < 1.0)


@pytest.mark.parametrize("kernel", ["inertia", "rigid_body"])
def test_a_kernel_of_this_study_is_the_structured_one_and_more(tx40, kernel: str) -> None:
    _, _, (_, world) = tx40
    columns = world.inputs(world.alone).columns
    own = getattr(real_choices, kernel)(columns, (world.spec.names[1],))
    plain = structured(columns, (world.spec.names[1],))
    assert own.names()[: len(plain.names())] == plain.names()
    X = np.random.default_rng(0).normal(size=(5, len(columns)))
    theta = own.initial(np.ones(len(columns)), 1.0)
    assert (own.diagonal(theta, X) > plain.diagonal(theta[: plain.size], X)).all()


def test_of_two_kernels_each_output_takes_the_better_one(tx40) -> None:
    _, _, (log, world) = tx40
    enough = {"steps": 10, "fit_points": 80}  # with fewer it is chance which errs less
    train, test = next(folds(log, world, Choice(enough)))
    plain = Choice({**enough, "kernel": "ard_se"})
    both = predicted(replace(plain, other="structured"), world, train, test)
    one, other = (predicted(choice, world, train, test) for choice in (plain, Choice(enough)))
    better = (both == other).all(axis=0)
    assert np.where(better, other, one) == pytest.approx(both, abs=0.0)
    assert better.all()


def test_rows_are_beside_the_default(monkeypatch) -> None:
    choices = {"default": QUICK, "brief": Choice({**FEW, "steps": 0})}
    monkeypatch.setattr(real_choices, "CHOICES", choices)
    rows = {row.metric: row for row in choice_rows(only=("tx40",))}
    assert set(rows) == {
        "stacked_tx40",
        "held_default_tx40",
        "gain_default",
        "held_brief_tx40",
        "gain_brief",
    }
    assert rows["gain_default"].value == pytest.approx(1.0)
    assert rows["gain_brief"].value > 1.2
    assert rows["held_brief_tx40"].reference_value == rows["held_default_tx40"].value
