"""Candidates averaged for each command: the weights, the variance, and a model that keeps them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import (
    LIMIT,
    NAMES,
    PHYSICS,
    SMALL,
    Identified,
    Inputs,
    selection,
    trajectories,
    trajectory,
)

from etude.errors import UsageError
from etude.models import ExactPosterior, Folds, ModelConfig, select_structures
from etude.models.gp import inducing
from etude.models.process_abilities import share_of
from etude.models.selection import ensemble
from etude.models.selection.ensemble import (
    EXPONENT,
    INVERTED,
    LEAST_WEIGHT,
    REST_S,
    mixed,
    resting,
    weighed,
    work_sign,
)
from etude.models.selection.structures import LearnedStructure
from etude.models.store import model_bytes, model_of
from etude.types import Samples

BOTH = replace(SMALL, candidates=("default", "gip_lin"))


@pytest.fixture(scope="module")
def averaged():
    return selection(trajectories(2), BOTH)


def test_weights_go_with_the_density_of_what_all_predicted() -> None:
    error = np.array([[1.0, 2.0, np.nan], [0.5, 1.0, 9.0], [np.nan] * 3])
    variance = np.array([[1.0, 1.0, np.nan], [0.5, 2.0, 1.0], [np.nan] * 3])
    density = [-0.5 * (1.0 + 4.0) / 2.0, -0.5 * (np.log(0.5) + 0.5 + np.log(2.0) + 0.5) / 2.0]
    expected = np.exp(EXPONENT * np.array(density))
    np.testing.assert_allclose(weighed(error, variance), [*(expected / expected.sum()), 0.0])
    nothing = np.full((2, 3), np.nan)
    apart = np.array([[1.0, np.nan, np.nan], [np.nan, 1.0, np.nan]])
    np.testing.assert_array_equal(weighed(nothing, nothing), [0.0, 0.0])
    np.testing.assert_array_equal(weighed(apart, apart), [1.0, 0.0])


def test_the_variance_holds_the_disagreement() -> None:
    errors, variances = np.array([[[1.0]], [[3.0]]]), np.array([[[2.0]], [[4.0]]])
    error, variance = mixed(errors, variances, np.array([[0.25], [0.75]]))
    assert error[0, 0] == 2.5
    assert variance[0, 0] == pytest.approx(0.25 * (2.0 + 1.5**2) + 0.75 * (4.0 + 0.5**2))


def test_the_model_predicts_the_average_and_every_weight_is_worth_keeping(averaged) -> None:
    model, new = averaged.model, trajectory(9)
    use = [c for c in model.candidates if c.structure == "gp"]
    assert {c.name for c in use} == {"default", "gip_lin"}
    for j in range(2):
        assert sum(c.weights[0] for c in use if c.commands == (j,)) == pytest.approx(1.0)
    assert all(c.weights.max() >= LEAST_WEIGHT for c in use if c.name != "default")
    mean, variance = model.predict(new.log)
    X, parts = model.inputs.of_log(new.log), []
    for c in (c for c in use if c.commands == (1,)):
        output, latent = c.process.predict(X)
        spread = c.calibration * c.units[1] ** 2 * (latent + c.process.noise_variance)
        parts.append((c.weights[0], (c.units[0] + c.units[1] * output)[:, 0], spread[:, 0]))
    average = sum(w * m for w, m, _ in parts)
    np.testing.assert_allclose(mean[:, 1], average, rtol=1e-10)
    np.testing.assert_allclose(
        variance[:, 1] / model.width[1], sum(w * (v + (m - average) ** 2) for w, m, v in parts), rtol=1e-9
    )


def test_where_no_candidate_predicted_anything_the_default_stays_in_use() -> None:
    """Of two logs one in which nothing moves: neither can be predicted from the other."""
    data = trajectories(2)
    still = replace(data, moving=data.moving & (data.group == data.group[0])[:, None])
    model = selection(still, BOTH).model
    assert set(model.chosen) == {"gp"}
    assert (model.prior_deviation > 0.0).all()


def test_designs_see_the_default_alone(averaged) -> None:
    found = averaged.model.latents()
    assert sorted(j for _, own in found for j in own) == [0, 1]
    own = [c.process.latents()[0][0] for c in averaged.model.candidates if c.name == "default"]
    assert all(any(posterior is one for one in own) for posterior, _ in found)


def test_a_rung_that_was_not_chosen_keeps_its_shares_and_is_stored(averaged) -> None:
    model = averaged.model
    again = model_of(model_bytes(model), Inputs().restore, PHYSICS)
    new = trajectory(9).log
    for mine, theirs in zip(model.predict(new), again.predict(new), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert [c.name for c in again.candidates] == [c.name for c in model.candidates]
    every = model.of_structure("gp")
    for one, other in zip(every.candidates, model.candidates, strict=True):
        np.testing.assert_array_equal(one.weights, share_of(other))


def test_the_default_alone_is_what_it_was() -> None:
    data, new = trajectories(2), trajectory(9).log
    default = selection(data, SMALL).model
    plain = default.predict(new)
    found = selection(data, BOTH).model
    alone = replace(
        found,
        width=default.width,
        candidates=tuple(
            replace(c, weights=np.full(1, float(c.name == "default"))) for c in found.candidates
        ),
    )
    for mine, theirs in zip(alone.predict(new), plain, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_many_samples_need_no_prior_of_mechanics() -> None:
    found = selection(
        trajectories(2), replace(BOTH, fit_points=250, points=250, fit_spacing_s=0.0, steps=1)
    ).model
    assert {c.name for c in found.candidates} == {"default"}


def test_the_sign_of_work() -> None:
    data = trajectories(2)
    inputs = Inputs()
    folds = Folds(data, inputs, inputs.of_log(data.log), data.group, np.ones(2), SMALL, ("a", "b"))
    right = work_sign(folds)
    assert (right > 0.3).any()
    turned = data.log.put(data.log.channels["command"], -data.command)
    wrong = work_sign(replace(folds, samples=replace(data, log=turned)))
    np.testing.assert_allclose(wrong, -right)
    assert (wrong < INVERTED).any()


@pytest.mark.parametrize("candidates", [("gip_lin",), ("default", "best")])
def test_impossible_candidates_are_refused(candidates: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match="candidate"):
        ModelConfig(candidates=candidates)


class Resting(Inputs):
    """With a column for each joint that says how much it rests, and what friction remembers."""

    @property
    def columns(self):
        more = [("qd", part, "1", op) for op in ("memory", "rest") for part in NAMES]
        return (*super().columns, *more)

    def of_log(self, log):
        rest = np.exp(-np.abs(log["qd"]) / 0.02)
        return np.hstack([super().of_log(log), 0.0 * rest, rest])


def test_of_one_rest_few_samples_teach_and_those_in_between_none() -> None:
    data, inputs = trajectories(1), Resting()
    t, qd = data.t, np.column_stack([np.full(len(data), 0.5), np.full(len(data), 0.4)])
    qd[40:80, 1], qd[100:120, 1] = 0.0, 0.02  # rests for 5 s; creeps
    log = data.log.put(data.log.channels["qd"], qd)
    data = replace(data, log=log, moving=np.abs(qd) > 0.03)
    folds = Folds(data, inputs, inputs.of_log(log), data.group, np.ones(2), SMALL, NAMES)
    found = resting(folds)
    assert not found[:, 0].any()
    np.testing.assert_allclose(t[found[:, 1]], t[40] + REST_S * np.arange(3))


@pytest.mark.parametrize("name", ["gip_lin", "standing"])
@pytest.mark.parametrize("rule", ["stack", "chance"])
def test_candidates_are_compared_on_the_same_samples(
    rule: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of many samples each is conditioned on others, and hardly any are held out by all."""
    seen: list[tuple[LearnedStructure, LearnedStructure, np.ndarray]] = []
    whole = ensemble.everywhere

    def spy(folds, part, compared):
        error, variance = whole(folds, part, compared)
        seen.append((part, compared, np.isfinite(error) & np.isfinite(variance)))
        return error, variance

    monkeypatch.setattr(ensemble, "everywhere", spy)
    data, inputs = trajectories(3), Resting() if name == "standing" else Inputs()
    if name == "standing":
        qd = np.where((np.arange(len(data))[:, None] + [0, 20]) % 40 < 5, 0.0, data.log["qd"])
        data = replace(data, log=data.log.put(data.log.channels["qd"], qd), moving=qd != 0.0)
    config = replace(SMALL, candidates=("default", name), points=40, fit_points=30, steps=2, replace=rule)
    select_structures(data, inputs, {}, LIMIT, config, np.random.default_rng(0))
    assert {part.candidate.name for part, _, _ in seen} == {"default", name}
    asked = {"stack": data.moving.any(axis=1).sum(), "chance": 40}[rule]
    for part, compared, told in seen:
        (j,) = part.candidate.commands
        assert compared[:, j].sum() == asked
        assert told[compared[:, j], 0].all()
        if part.candidate.name == name and rule == "chance":
            assert len(np.setdiff1d(part.rows.kept, np.flatnonzero(compared[:, j]))) > 5, "they use others"


def test_each_process_through_inducing_inputs_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also for the samples of standing joints, and for those that the default held out."""
    made: list[object] = []
    whole = inducing.FixedInducing.__init__

    def counting(self, *args, **kwargs):
        whole(self, *args, **kwargs)
        made.append(self)

    monkeypatch.setattr(inducing.FixedInducing, "__init__", counting)
    data, inputs = trajectories(3), Resting()
    qd = np.where((np.arange(len(data))[:, None] + [0, 20]) % 40 < 5, 0.0, data.log["qd"])
    data = replace(data, log=data.log.put(data.log.channels["qd"], qd), moving=qd != 0.0)
    config = replace(
        SMALL, candidates=("default", "standing"), inducing=40, points=40, fit_points=30, steps=2
    )
    found = select_structures(data, inputs, {}, LIMIT, config, np.random.default_rng(0))
    processes = {id(one.process) for one in found.model.candidates}
    assert len(found.model.candidates) == 4
    assert len(made) == len(processes)


class Waves(Identified):
    """Physics that say nothing of slow samples, and have waves of nothing."""

    def rippled(self, samples: Samples) -> tuple[Samples, Waves]:
        return samples, self


@pytest.mark.parametrize("logs", [1, 2])
def test_from_two_logs_on_defaults_beside_others_with_samples_of_their_own_learn_from_points(
    logs: int,
) -> None:
    config = replace(
        SMALL,
        rung="identified+gp",
        candidates=("default", "ripple"),
        inducing=40,
        points=30,
        fit_points=30,
        steps=2,
    )
    for physics, exact in ((Waves(), logs > 1), (Identified(), False)):
        physics_of = {"identified": physics}
        found = selection(trajectories(logs), config, physics=physics_of).model.candidates
        defaults = [c for c in found if c.name == "default"]
        assert all(isinstance(p, ExactPosterior) == exact for c in defaults for p in c.process.own)
        assert all(len(c.process.conditioned_on) == 30 for c in defaults if exact)
