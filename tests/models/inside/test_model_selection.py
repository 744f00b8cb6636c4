"""Model selection: structures, what is held out, what is chosen; order and repetition do not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import (
    LIMIT,
    NOISE,
    PHYSICS,
    SMALL,
    TOGETHER,
    Inputs,
    commanded,
    posteriors,
    selection,
    train,
    trajectories,
    trajectory,
)

from etude.errors import DataError, UsageError
from etude.models import ExactGP, ModelConfig, prediction_score
from etude.models.config import STRUCTURES
from etude.models.gp.shared_exact import condition_shared
from etude.models.selection.ensemble import CANDIDATES
from etude.models.selection.model_selection import OFFERED, prequential
from etude.types import TARGET, Samples, joined_samples

AUTO = replace(SMALL, rung="auto")
BOTH = pytest.mark.parametrize("config", [SMALL, TOGETHER], ids=["separate", "together"])


@pytest.fixture(scope="module")
def data() -> Samples:
    return trajectories(3)


@pytest.fixture(scope="module")
def full(data):
    return selection(data, AUTO)


def same(mine, theirs) -> None:
    for one, other in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(one, other)


@BOTH
def test_a_new_motion_is_predicted_with_honest_variances(config: ModelConfig, data) -> None:
    new = trajectory(9)
    result = prediction_score(new, *train(data, config).predict(new.log))
    assert np.all(result.nmse < 0.12)
    assert np.all((result.z2 > 0.3) & (result.z2 < 2.5))
    assert np.all(result.coverage > 0.85)


@pytest.mark.parametrize("structure", STRUCTURES)
@BOTH
def test_every_rung_can_be_asked_for_by_name(structure: str, config: ModelConfig, data) -> None:
    model = train(data, replace(config, rung=structure))
    mean, variance = model.posterior(trajectory(9).log)
    told, seen = model.predict(data.log).mean, model.posterior(data.log)[0]
    np.testing.assert_allclose(told, seen, atol=0.01 * np.ptp(data.command))  # trusted where it was trained
    assert model.chosen == (structure, structure)
    assert np.isfinite(mean).all()
    assert (variance > 0.0).all()
    assert (model.prior_deviation > 0.0).all()
    np.testing.assert_allclose(model.mean(trajectory(9).log), mean, rtol=1e-12, atol=1e-12)
    assert sorted(j for _, own in model.latents() for j in own) == [0, 1]  # a design sees both


def test_physics_helps_and_the_process_learns_what_it_lacks(full) -> None:
    new = trajectory(9)
    means = {structure: full.model.of_structure(structure).mean(new.log) for structure in full.errors}
    error = {structure: np.mean((mean - new.command)[new.moving] ** 2) for structure, mean in means.items()}
    ripple = 0.5**2 / 2 + NOISE**2
    assert error["identified"] < 2.0 * ripple
    assert error["identified+gp"] < ripple
    assert error["identified+gp"] < error["gp"]
    assert error["linear"] > 5.0 * error["identified"]
    assert full.chosen == ("identified+gp", "identified+gp")


def test_without_physics_process_and_linear_regression_compete(data) -> None:
    found = selection(data, AUTO, physics={})
    assert set(found.errors) == {"gp", "linear"}
    assert found.chosen == ("gp", "gp")
    assert found.model.warnings == ()
    assert set(OFFERED) < set(STRUCTURES)
    with pytest.raises(UsageError, match="no identified physics"):
        selection(data, replace(SMALL, rung="identified"), physics={})


@pytest.mark.parametrize("structure", ["gp", "identified+gp"])
@BOTH
def test_held_out_is_conditioning_without_the_fold_and_its_physics(structure, config, data) -> None:
    found = selection(data, replace(config, rung=structure, replace="chance"))
    held, model = found.held_out[structure], found.model
    own, rest = data.group == 1, data.group != 1
    mean = (
        PHYSICS["identified"](data.take(rest)).predict(data.log) if structure != "gp" else 0.0 * data.command
    )
    X = Inputs().of_log(data.log)
    for candidate in [c for c in model.candidates if c.weights.any()]:
        group = list(candidate.commands)
        first = candidate.process.own[0]
        kept = np.isfinite(held.error[:, group[0]])
        Y = (data.command[:, group] - mean[:, group] - candidate.units[0]) / candidate.units[1]
        gp = ExactGP(first.kernel, first.theta, 0.5 * np.log(first.noise_variance))
        expected, latent = condition_shared(gp, X[kept & rest], Y[kept & rest]).predict(X[kept & own])
        error = candidate.units[1] * (Y[kept & own] - expected)
        np.testing.assert_allclose(held.error[kept & own][:, group], error, atol=1e-8)
        scale = candidate.calibration * candidate.units[1] ** 2
        spread = np.outer(latent + first.noise_variance, scale)
        np.testing.assert_allclose(held.variance[kept & own][:, group], spread, rtol=1e-6)


def test_linear_regression_and_physics_never_see_what_they_are_scored_on(data, full) -> None:
    spoiled = commanded(data, data.command + 100.0 * (data.group == 1)[:, None])
    again = selection(spoiled, AUTO)
    own = data.group == 1
    for structure in ("linear", "identified"):
        before, after = full.held_out[structure].error[own], again.held_out[structure].error[own]
        kept = np.isfinite(before) & np.isfinite(after)
        np.testing.assert_allclose(after[kept], before[kept] + 100.0, rtol=1e-9)


@BOTH
def test_variances_are_multiplied_by_what_held_out_motion_shows_and_never_shrunk(config) -> None:
    """Outputs that jump between trajectories: nothing learned from the others can foresee them."""
    data = trajectories(4)
    jump = commanded(data, data.command + np.where(data.group % 2 == 0, 6.0, -6.0)[:, None])
    for own in (data, jump):
        found = selection(own, replace(config, replace="chance"))
        held = found.held_out["gp"]
        kept = np.isfinite(held.error)
        scale = np.concatenate([c.calibration for c in found.model.candidates])
        uncalibrated = held.variance / scale
        z2 = [np.mean(held.error[k, j] ** 2 / uncalibrated[k, j]) for j, k in enumerate(kept.T)]
        np.testing.assert_allclose(scale, np.maximum(1.0, z2), rtol=1e-9)
        plain = train(own, replace(config, calibrate=False))
        assert all((c.calibration == 1.0).all() for c in plain.candidates)
        assert not plain.calibrated
        assert found.model.calibrated
    assert (scale > 1.0).all()
    assert train(trajectories(2), config).calibrated
    assert not train(trajectories(1), config).calibrated
    assert not train(trajectories(3), replace(config, replace="chance")).calibrated


def test_what_the_masks_hide_changes_nothing(data) -> None:
    hidden = ~data.moving
    assert hidden.any(axis=0).all()
    spoiled = commanded(data, np.where(hidden, 50.0, data.command))
    new = trajectory(9).log
    for config in (SMALL, replace(SMALL, rung="identified+gp"), TOGETHER):
        same(train(spoiled, config).mean(new), train(data, config).mean(new))
    unusable = replace(spoiled, usable=data.moving)
    for structure in ("linear", "linear+gp"):
        once = train(replace(data, usable=data.moving), replace(SMALL, rung=structure)).predict(new)
        same(train(unusable, replace(SMALL, rung=structure)).predict(new), once)


@BOTH
def test_what_is_left_out_is_judged_by_one_target_where_joints_stand_too(config, data) -> None:
    asked = data.moving.any(axis=1, keepdims=True)
    target = np.where(asked, data.command + 1.0, np.nan)
    channel = replace(data.log.channels["command"], name=TARGET)
    told, found = (
        selection(replace(data, log=log), config).left_out
        for log in (data.log, data.log.put(channel, target))
    )
    assert (np.isfinite(found.error) == asked).all()
    np.testing.assert_allclose(found.error, told.error + 1.0, atol=1e-9)
    spread = found.variance / told.variance
    assert np.nanmin(spread) > 1.2, "errors against the target widen"


@BOTH
def test_order_of_telling_and_telling_twice_change_nothing(config, data) -> None:
    parts = [data.take(data.group == number) for number in (2, 0, 1)]
    twice = replace(parts[0], group=np.full(len(parts[0]), 5))
    new, once = trajectory(9).log, train(data, config)
    for told in (joined_samples(parts), joined_samples([*parts, parts[1]]), joined_samples([*parts, twice])):
        same(train(told, config).predict(new), once.predict(new))
    shuffled = data.take(np.random.default_rng(1).permutation(len(data)))
    same(train(shuffled, config).predict(new), once.predict(new))


@BOTH
def test_the_unit_of_the_command_does_not_matter(config, data) -> None:
    found = selection(commanded(data, 1000.0 * data.command), config, limit=1000.0 * LIMIT).model
    new, model = trajectory(9).log, train(data, config)
    (mean, variance), (scaled, spread) = model.predict(new), found.predict(new)
    np.testing.assert_allclose(scaled / 1000.0, mean, rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(spread / 1e6, variance, rtol=2e-2)


def test_prequential_scores_are_of_motion_that_no_rung_has_seen(full) -> None:
    new = trajectory(3)
    scores = prequential(full.model, new, trajectories(3))
    assert set(scores) == set(full.model.structures)
    expected = prediction_score(new, *full.model.of_structure("gp").predict(new.log), trajectories(3))
    np.testing.assert_array_equal(scores["gp"].nmse, expected.nmse)
    assert (scores["gp"].msll < -1.0).all()
    with pytest.raises(UsageError, match="no structure 'nothing'"):
        full.model.of_structure("nothing")


def test_training_goes_on_from_the_rungs_of_the_last_model(data, full) -> None:
    again = selection(trajectories(4), replace(AUTO, steps=0), full.model)
    for structure in ("gp", "identified+gp"):
        pairs = zip(
            posteriors(full.model.of_structure(structure)),
            posteriors(again.model.of_structure(structure)),
            strict=True,
        )
        for old, new in pairs:
            np.testing.assert_array_equal(new.theta, old.theta)
            assert new.noise_variance == pytest.approx(old.noise_variance, rel=1e-3)
    other = selection(trajectories(4), replace(AUTO, steps=0, kernel="ard_se"), full.model)
    assert (
        posteriors(other.model.of_structure("gp"))[0].kernel
        != posteriors(full.model.of_structure("gp"))[0].kernel
    )


def test_one_trajectory_keeps_physics_where_a_process_is_not_surely_better(full) -> None:
    one = selection(trajectory(0), replace(AUTO, process_from=2))
    assert set(one.chosen) == {"identified"}
    assert not one.model.calibrated
    loose = selection(trajectory(0), AUTO)
    assert set(loose.chosen) <= {"identified", "identified+gp", "gp"}
    tiny = selection(trajectory(0, seconds=3.0), AUTO)
    assert np.isfinite(tiny.model.predict(full.model.inputs and trajectory(9).log)[0]).all()


def test_floors_are_tried_and_the_noise_never_falls_below_them(data) -> None:
    for config, least in ((TOGETHER, 0.15), (replace(TOGETHER, noise_floor="auto"), 0.15)):
        model = train(data, config)
        assert all(p.noise_variance > least**2 for p in posteriors(model))
    floor = 0.5
    limited = train(data, replace(SMALL, noise_floor=floor / 40.0))  # of the limit; capped by the deviation
    for j, posterior in enumerate(posteriors(limited)):
        cap = 0.1 * data.command[data.moving[:, j], j].std()
        assert posterior.noise_variance > min(floor, cap) ** 2
    # a joint that uses a small part of its limit still learns: half of the limit is far above its deviation
    for j, posterior in enumerate(posteriors(train(data, replace(SMALL, noise_floor=0.5)))):
        cap = 0.1 * data.command[data.moving[:, j], j].std()
        assert cap**2 < posterior.noise_variance < 4.0 * cap**2
    assert np.isfinite(train(data, replace(SMALL, noise_floor="auto", steps=4)).predict(data.log)[0]).all()


def test_several_starts_are_no_less_likely(data) -> None:
    values = []
    for starts in (1, 3):
        model = train(data, replace(TOGETHER, starts=starts, prior="none", steps=40, noise_floor=0.0))
        first = posteriors(model)[0]
        gp = ExactGP(first.kernel, first.theta, 0.5 * np.log(first.noise_variance))
        chosen = slice(None)
        values.append(sum(gp.log_marginal_likelihood(p.X[chosen], p.y[chosen])[0] for p in posteriors(model)))
    assert values[1] > values[0] - 5.0


def test_student_t_is_fitted_to_the_held_out_errors(data) -> None:
    found = selection(data, replace(TOGETHER, student_t=True))
    assert found.model.student is not None
    assert 0.3 < found.model.student.scale < 2.0
    assert train(data).student is None


@BOTH
def test_a_command_that_never_changes_stays(config, data) -> None:
    command = data.command.copy()
    command[:, 1] = 0.25
    for structure in ("auto", "gp"):
        model = train(commanded(data, command), replace(config, rung=structure))
        mean, variance = model.predict(trajectory(9).log)
        np.testing.assert_allclose(mean[:, 1], 0.25, atol=1e-9)
        assert (variance > 0.0).all()


def test_static_is_the_part_at_rest_and_safe_the_part_of_physics(full) -> None:
    new = trajectory(9).log
    still = replace(new, values={**new.values, "qd": 0.0 * new["qd"], "qdd": 0.0 * new["qdd"]})
    physics = PHYSICS["identified"](trajectories(3))
    model = full.model.of_structure("identified")
    np.testing.assert_allclose(model.static(new), physics.predict(still), rtol=1e-9)
    np.testing.assert_allclose(model.safe(new), physics.predict(new), rtol=1e-9)
    gp = full.model.of_structure("gp")
    np.testing.assert_allclose(gp.static(new), gp.mean(still), rtol=1e-9)
    np.testing.assert_allclose(gp.safe(new), physics.predict(new), rtol=1e-9)  # those learned beside it
    gp = replace(gp, candidates=tuple(c for c in gp.candidates if c.structure == "gp"))
    levels = gp.safe(new)
    assert np.all(levels == levels[0])  # without physics a level, between 0 and the mean of training
    offset = np.concatenate([c.units[0] for c in gp.candidates if c.structure == "gp"])
    assert np.all((levels[0] / offset > 0.0) & (levels[0] / offset < 1.0))
    np.testing.assert_allclose(
        full.model.of_structure("identified+gp").safe(new), physics.predict(new), rtol=1e-9
    )


def test_an_axis_that_moved_in_one_trajectory_only_cannot_be_held_out(data) -> None:
    moving = data.moving.copy()
    moving[data.group != 1, 1] = False
    found = selection(replace(data, moving=moving), replace(AUTO, replace="chance"))
    assert np.isnan(found.errors["gp"][1])
    assert np.isfinite(found.errors["gp"][0])
    assert np.isfinite(found.model.predict(trajectory(9).log)[1]).all()
    assert found.chosen[0] == "identified+gp"


def test_what_cannot_be_trained_is_refused(data) -> None:
    with pytest.raises(DataError, match="hardly moves"):
        selection(replace(data, moving=np.zeros_like(data.moving)))
    with pytest.raises(UsageError, match="2 commands, the robot's limits"):
        selection(data, limit=np.ones(3))
    with pytest.raises(DataError, match="no sample"):
        selection(data.take(np.zeros(len(data), dtype=bool)))
    with pytest.raises(DataError, match="NaN"):
        selection(commanded(data, data.command * np.nan))
    with pytest.raises(DataError, match="lack an input"):
        selection(replace(data, log=data.log.without("qdd")))
    with pytest.raises(UsageError, match="needs the command's own position and its friction"):
        selection(data, inputs=Inputs(v0=0.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rung": "magic"}, "rung must be one of"),
        ({"choose_by": "luck"}, "choose_by must be one of"),
        ({"kernel": "rbf"}, "there is no kernel 'rbf'"),
        ({"process": "magic"}, "there is no member of the model family 'magic'.*exact, fitc"),
        ({"sharing": "some"}, "sharing must be one of"),
        ({"floor_of": "luck"}, "floor_of must be one of"),
        ({"prior": "strong"}, "prior must be one of"),
        ({"schedule": "sometimes"}, "schedule must be one of update, constant, reinitialise, first"),
        ({"points": 1}, "points must be at least 2"),
        ({"basis": 0}, "basis must be at least 1"),
        ({"starts": 0}, "starts must be at least 1"),
        ({"noise_floor": -1.0}, "noise_floor must be a number >= 0"),
        ({"fit_spacing_s": float("nan")}, "fit_spacing_s must be a number >= 0"),
        ({"stretch_s": 0.0}, "stretch_s must be above 0"),
        ({"sharing": "shared"}, "structured kernel is for one command"),
        ({"process": "ssgp_fixed"}, "squared exponential"),
        ({"steps": -3}, "negative steps are evaluations"),
    ],
)
def test_impossible_configurations_are_refused(change, message) -> None:
    with pytest.raises(UsageError, match=message):
        replace(SMALL, **change)


def test_more_commands_have_more_samples_for_their_hyperparameters(data, monkeypatch) -> None:
    usual = replace(SMALL, fit_points=300)
    assert [usual.for_commands(n).fit_points for n in (1, 4, 6, 7, 14)] == [300, 300, 450, 525, 1050]
    assert CANDIDATES["gip_lin"].config(usual.for_commands(7)) == CANDIDATES["gip_lin"].config(usual)
    few = replace(SMALL, fit_points=10, fit_spacing_s=0.0)
    four, twice = train(data, few), train(data, replace(few, fit_points=20))
    monkeypatch.setattr("etude.models.config.USUAL_COMMANDS", 1)  # of the two that these data have
    more = train(data, few)
    same([p.theta for p in posteriors(more)], [p.theta for p in posteriors(twice)])
    assert any((a.theta != b.theta).any() for a, b in zip(posteriors(more), posteriors(four), strict=True))
