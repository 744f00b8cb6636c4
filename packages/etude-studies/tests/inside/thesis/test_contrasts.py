"""One number a seed from a part: each statistic by hand, its laws, and what becomes of missing numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from made_up_values import MadeUp

from etude.errors import UsageError
from etude_studies.thesis import statistics
from etude_studies.thesis.contrasts import contrasts
from etude_studies.thesis.ledger import Part
from etude_studies.thesis.parts import NEEDS, exchanged, in_logs, margin_of, read_so, sources

LOG2 = math.log(2.0)


def part(statistic: str, **given: Any) -> Part:
    own = {"claim": "less", "measure": "error", "a": "A1", "at": (1, 2), "test": "fourier", **given}
    return Part(statistic=statistic, **own)


def x_of(own: Part, results: MadeUp, **more: Any) -> dict[int, float]:
    (found,) = contrasts(own, results, **more)
    return dict(found.x)


def two_curves() -> MadeUp:
    """Seeds 0 and 1 of A1 and A7 after 1, 2, 3 trajectories."""
    return (
        MadeUp()
        .put("A1", {1: [8.0, 2.0], 2: [4.0, 4.0], 3: [2.0, 1.0]})
        .put("A7", {1: [4.0, 2.0], 2: [1.0, 8.0], 3: [2.0, 2.0]})
    )


def test_ratio_is_averaged_in_logs() -> None:
    found = x_of(part("ratio", a="A7", b="A1", at=(1, 2, 3)), two_curves())
    # 1/2, 1/4, 1 and 1, 2, 2
    assert found == pytest.approx({0: -LOG2, 1: 2 * LOG2 / 3})


def test_ratio_each_is_the_ratio_at_each_count() -> None:
    own = part("ratio_each", a="A7", b="A1", at=(1, 2, 3))
    found = contrasts(own, two_curves())
    assert [one.k for one in found] == [1, 2, 3]
    for one in found:
        alone = x_of(part("ratio", a="A7", b="A1", at=(one.k,)), two_curves())
        assert dict(one.x) == pytest.approx(alone)


def test_rises_counts_steps_by_more_than_two_percent() -> None:
    results = (
        MadeUp()
        .put("A1", {1: [1.0], 2: [1.03], 3: [1.045], 4: [1.0], 6: [9.0]})
        .put("A7", {1: [1.0], 2: [1.5], 3: [2.0], 4: [3.0]})
    )
    # 3 to 6 is no step
    assert x_of(part("rises", at=(1, 2, 3, 4, 6)), results) == pytest.approx({0: 1 / 3})
    assert x_of(part("rises", b="A7", at=(1, 2, 3, 4)), results) == pytest.approx({0: 1 / 3 - 1})


def test_slope_is_the_decrease_per_trajectory() -> None:
    results = (
        MadeUp()
        .put("A1", {1: [16.0], 3: [4.0], 4: [4.0], 6: [2.0]})
        .put("A7", {1: [8.0], 3: [1.0], 4: [4.0], 6: [1.0]})
    )
    assert x_of(part("slope", at=(1, 3)), results) == pytest.approx({0: LOG2})
    assert x_of(part("slope", at=(1, 3), against=(4, 6)), results) == pytest.approx({0: 0.5 * LOG2})
    assert x_of(part("slope", at=(1, 3), b="A7"), results) == pytest.approx({0: -0.5 * LOG2})
    assert x_of(part("slope", at=(1, 3), b="A7", against=(4, 6)), results) == pytest.approx({0: 0.0})


def test_value_less_its_bound() -> None:
    results = MadeUp().put("A1", {1: [1.0, 2.0], 2: [4.0, 2.0]})
    assert x_of(part("value", bound=2.0), results) == pytest.approx({0: 0.5, 1: 0.0})
    assert x_of(part("value"), results) == pytest.approx({0: 2.5, 1: 2.0})
    assert x_of(part("value", bound=4.0, log=True), results) == pytest.approx({0: -LOG2, 1: -LOG2})


def test_gap_compares_sizes_whatever_their_signs() -> None:
    results = two_curves().put("S1", {1: [1.0, 1.0], 2: [1.0, 1.0]}).put("S2", {1: [8.0, 8.0], 2: [8.0, 8.0]})
    own = part("gap", a="S1", b="S2", c="A7", d="A1")
    # log 8 less the mean of log 2, 4; and less that of log 1, 1/2, as A7 is the lower one in the mean of both
    assert x_of(own, results) == pytest.approx({0: 1.5 * LOG2, 1: 3.5 * LOG2})
    assert x_of(part("gap", a="S2", b="S1", c="A1", d="A7"), results) == pytest.approx(x_of(own, results))
    assert x_of(part("gap", a="S1", b="S2", bound=2.0), results) == pytest.approx({0: 2 * LOG2, 1: 2 * LOG2})


def test_the_size_of_an_effect_is_that_of_its_mean() -> None:
    """Effects that change their sign from seed to seed are none, however large they are."""
    noise = np.random.default_rng(3).normal(0.0, 0.5, 40)
    results = MadeUp().put("A1", {1: np.ones(80)}).put("A7", {1: np.exp(np.concatenate([noise, -noise]))})
    own = part("gap", a="A7", b="A1", at=(1,), bound=1.15)
    assert np.mean(list(x_of(own, results).values())) == pytest.approx(-math.log(1.15))
    shrinks = part("shrinks", a="A7", b="A1", at=(1, 2))
    results.put("A1", {2: np.ones(80)}).put("A7", {2: np.full(80, 0.5)})
    assert np.mean(list(x_of(shrinks, results).values())) == pytest.approx(-LOG2)


def test_a_gap_between_effects_is_found_where_there_is_one() -> None:
    """An effect of 1.18 against none, with the spreads seen: sizes of single seeds found it in 2 %."""
    rng, found, trials = np.random.default_rng(5), 0, 200
    own = part("gap", claim="more", a="S2", b="S1", c="A4", d="A1", at=(1,))
    for _ in range(trials):
        results = MadeUp().put("S1", {1: np.ones(20)}).put("A1", {1: np.ones(20)})
        results.put("S2", {1: np.exp(rng.normal(-0.164, 0.151, 20))})
        results.put("A4", {1: np.exp(rng.normal(0.0, 0.24, 20))})
        x = list(x_of(own, results).values())
        found += np.mean(x) > 0.0 and statistics.paired_t(x) < 0.05
    assert found / trials > 0.35


def test_shrinks_is_the_first_gap_less_the_last() -> None:
    found = x_of(part("shrinks", a="A7", b="A1", at=(1, 2, 3)), two_curves())
    # -log 2, 0 and 0, log 2: A7 is the lower one after 1, the higher one after 3
    assert found == pytest.approx({0: LOG2, 1: -LOG2})


def test_rank_shares_places_between_equals() -> None:
    results = (
        MadeUp()
        .put("A1", {1: [2.0, 1.0, 3.0]})
        .put("A2", {1: [3.0, 1.0, 2.0]})
        .put("A3", {1: [1.0, 5.0, 1.0]})
    )
    own = part("rank", at=(1,), among=("A1", "A2", "A3"), bound=1.5)
    assert x_of(own, results) == pytest.approx({0: 0.5, 1: 0.0, 2: 1.5})


def test_reach_interpolates_and_stops_at_the_last_count() -> None:
    results = (
        MadeUp()
        .put("A1", {1: [8.0], 2: [4.0], 3: [2.0]})
        .put("A7", {1: [8.0], 2: [1.0], 3: [0.5]})
        .put("A8", {1: [1.0], 2: [1.0], 3: [1.0]})
    )
    # from 8 to 1 passes 2 at two thirds of the step; A1 never comes to 0.5, so it needs all 3
    found = x_of(part("reach", a="A7", b="A1", at=(1, 2, 3)), results)
    assert found == pytest.approx({0: math.log((5 / 3) / 3)})
    assert x_of(part("reach", a="A8", b="A1", at=(1, 2, 3)), results) == pytest.approx({0: math.log(1 / 3)})


def test_reach_of_equals_leans_to_neither_side() -> None:
    """Two arms of one distribution, errors that go up and down: found to differ in 5 % of cases, no more."""
    rng, own, found, trials = (
        np.random.default_rng(12),
        part("reach", a="A7", b="A1", at=(1, 2, 3, 4)),
        0,
        300,
    )
    for _ in range(trials):
        results = MadeUp()
        for arm in ("A1", "A7"):
            curves = np.exp(rng.normal(0.0, 0.4, (20, 4)) - 0.2 * np.arange(4))
            results.put(arm, {k + 1: curves[:, k] for k in range(4)})
        found += statistics.paired_t(list(x_of(own, results).values())) < 0.05
    assert found / trials < 0.05 + 3.5 * math.sqrt(0.05 * 0.95 / trials)


def test_spread_is_the_largest_mean_over_the_smallest() -> None:
    results = MadeUp().put("A1", {1: [2.0, 4.0]}).put("A2", {1: [8.0, 2.0]}).put("A3", {1: [1.0, 4.0]})
    own = part("spread", a="", at=(1,), among=("A1", "A2", "A3"), bound=2.0)
    # A2 is the largest in the mean and A3 the smallest, also of the seed in which it is not
    assert x_of(own, results) == pytest.approx({0: 2 * LOG2, 1: -2 * LOG2})


def test_seeds_beyond_the_plan_do_not_count_but_those_of_a_block_do() -> None:
    results = MadeUp().put("A1", {1: np.arange(1.0, 31.0)})
    own = part("value", at=(1,))
    for given, seeds in (({"planned": {"A1": 20}}, 20), ({"planned": {"A1": 20}, "block": 25}, 25), ({}, 30)):
        (found,) = contrasts(own, results, seeds=5, **given)
        assert set(found.x) == set(range(seeds))
        assert dict(found.stored) == {"A1": 30}


def test_largest_and_smallest_look_at_the_other_joints() -> None:
    results = MadeUp()
    for name, own in {"waist": 1.0, "shoulder": 2.0, "elbow": 4.0, "wrist": 8.0, "mean": 99.0}.items():
        results.put("A1", {1: [own]}, part=name).put("A7", {1: [8.0]}, part=name)
    assert x_of(part("largest", at=(1,), part="wrist"), results) == pytest.approx({0: LOG2})
    assert x_of(part("largest", at=(1,), part="elbow"), results) == pytest.approx({0: -LOG2})
    assert x_of(part("smallest", at=(1,), part="waist"), results) == pytest.approx({0: -LOG2})
    assert x_of(part("smallest", at=(1,), part="elbow"), results) == pytest.approx({0: 2 * LOG2})
    # of the ratio: A7 / A1 falls from waist to wrist
    assert x_of(part("smallest", a="A7", b="A1", at=(1,), part="wrist"), results) == pytest.approx({0: -LOG2})


@pytest.mark.parametrize("statistic", ["ratio", "rises", "slope", "reach"])
def test_exchanging_the_arms_turns_the_sign(statistic: str) -> None:
    forth = x_of(part(statistic, a="A7", b="A1", at=(1, 2, 3)), two_curves())
    back = x_of(part(statistic, a="A1", b="A7", at=(1, 2, 3)), two_curves())
    assert back == pytest.approx({seed: -x for seed, x in forth.items()})
    assert any(abs(x) > 0.1 for x in forth.values())


@pytest.mark.parametrize("statistic", ["ratio", "rises", "slope", "gap", "shrinks", "reach"])
def test_units_change_nothing(statistic: str) -> None:
    own = part(statistic, a="A7", b="A1", at=(1, 2, 3), bound=1.1)
    scaled = MadeUp({key: {s: 57.3 * v for s, v in by.items()} for key, by in two_curves().numbers.items()})
    assert x_of(own, scaled) == pytest.approx(x_of(own, two_curves()))


def test_measure_test_and_joint_are_the_parts_own() -> None:
    results = two_curves()
    for source in ("A1", "A7"):
        results.put(source, {1: [3.0, 5.0]}, measure="z2").put(source, {1: [3.0, 5.0]}, test="common")
        results.put(source, {1: [3.0, 5.0]}, part="wrist")
    for other in ({"measure": "z2"}, {"test": "common"}, {"part": "wrist"}):
        assert x_of(part("value", at=(1,), **other), results) == {0: 3.0, 1: 5.0}
    assert x_of(part("value", at=(1,)), results) == {0: 8.0, 1: 2.0}


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_a_seed_without_a_logarithm_has_failed(bad: float) -> None:
    results = two_curves().put("A7", {2: [bad, 8.0]})
    (found,) = contrasts(part("ratio", a="A7", b="A1"), results)
    assert set(found.x) == {1}
    assert (found.failed, found.planned) == (1, 2)


def test_what_needs_no_logarithm_takes_any_finite_number() -> None:
    results = MadeUp().put("A1", {1: [0.0, -1.0, math.nan, math.inf]})
    assert x_of(part("value", at=(1,)), results) == {0: 0.0, 1: -1.0}


def test_every_statistic_drops_a_seed_with_a_hole_and_keeps_the_other() -> None:
    """Seed 0 has no number of A1 after two trajectories, in no joint."""
    results = MadeUp()
    for name in ("mean", "waist", "shoulder", "elbow", "wrist"):
        for source in ("A1", "A7"):
            hole = math.nan if source == "A1" else 2.0
            results.put(source, {1: [3.0, 4.0], 2: [hole, 3.0], 3: [1.0, 2.0]}, part=name)
    given = {"a": "A1", "b": "A7", "at": (1, 2), "among": ("A1", "A7"), "bound": 1.5, "part": "wrist"}
    for statistic in NEEDS:
        for found in contrasts(part(statistic, **given), results):
            assert set(found.x) == ({0, 1} if found.k == 1 else {1}), statistic


def test_seeds_are_paired_by_number_not_by_place() -> None:
    results = MadeUp().put("A1", {1: {3: 1.0, 1: 2.0}}).put("A7", {1: {1: 4.0, 3: 4.0, 9: 1.0}})
    (found,) = contrasts(part("ratio", a="A7", b="A1", at=(1,)), results, seeds=2)
    assert dict(found.x) == pytest.approx({1: LOG2, 3: 2 * LOG2})
    assert found.failed == 0
    assert dict(found.stored) == {"A7": 3, "A1": 2}


def test_the_plan_is_the_smaller_runs() -> None:
    own = part("ratio", a="A7", b="A1", at=(1,))
    assert contrasts(own, two_curves(), seeds=20)[0].planned == 20
    assert contrasts(own, two_curves(), seeds=20, planned={"A7": 10})[0].planned == 10
    assert contrasts(own, two_curves(), seeds=20, planned={"A7": 10, "A1": 5})[0].planned == 5


def test_a_crash_in_the_middle_is_a_failed_seed() -> None:
    results = two_curves().put("A1", {3: {1: 1.0}})
    (found,) = contrasts(part("ratio", a="A7", b="A1", at=(1, 2, 3)), results)
    assert set(found.x) == {1}
    assert found.failed == 1


def test_runs_are_exchanged_with_their_models() -> None:
    assert exchanged("A1:linear", {"A1": "X5a"}) == "X5a:linear"
    assert exchanged("A1:linear", {"A1:linear": "B3", "A1": "X5a"}) == "B3"
    assert exchanged("A1:linear", {"A1": "A1:faded"}) == "A1:linear", "what does not fade stays"
    assert exchanged("A10", {"A1": "X5a"}) == "A10"


def test_a_part_is_read_otherwise_on_every_side() -> None:
    own = part("gap", a="A1", b="A2", c="A1:linear", d="B0", among=("A1",))
    read = read_so(own, {"A1": "X1", "A2": "X2"}, {"fourier": "moves"})
    assert (read.a, read.b, read.c, read.d, read.among) == ("X1", "X2", "X1:linear", "B0", ("X1",))
    assert read.test == "moves"
    window = part("value", a="A1t", measure="after_reversal")
    read = read_so(window, {"A1t": "A1"}, measures={"after_reversal": "reversal_share"})
    assert (read.a, read.measure, read.test) == ("A1", "reversal_share", "fourier")
    assert read_so(own, {"A7": "X8"}, {"uniform": "extreme"}) == own
    assert read_so(part("ratio", a="Q4", b="Q7"), {"Q4": "Q7"}, {}).a == "Q4", "nothing is left to compare"
    cost = part("value", test="", measure="cpu_train")
    assert read_so(cost, {"A1": "A1:faded"}, {}) == cost, "costs are of no test"


def test_margins_are_in_the_unit_of_x() -> None:
    assert margin_of(part("ratio", b="A7")) == pytest.approx(math.log(1.15))
    assert margin_of(part("ratio", b="A7", margin=1.3)) == pytest.approx(math.log(1.3))
    # a rate: 15 % over three trajectories
    assert margin_of(part("slope", at=(1, 4))) == pytest.approx(math.log(1.15) / 3)
    assert margin_of(part("rises")) == pytest.approx(0.1)
    assert margin_of(part("rank", among=("A1",), bound=1.5)) == pytest.approx(0.5)
    assert margin_of(part("value", bound=-3.0)) == pytest.approx(0.3)
    assert margin_of(part("value")) == pytest.approx(0.1)
    assert margin_of(part("value", margin=0.02)) == pytest.approx(0.02)
    assert margin_of(part("value", bound=2.0, log=True)) == pytest.approx(math.log(1.15))
    assert not in_logs(part("value"))


@pytest.mark.parametrize(
    ("statistic", "margin"), [("ratio", 1.0), ("ratio", 0.9), ("rises", 0.0), ("rank", -1.0)]
)
def test_a_margin_without_width_is_refused(statistic: str, margin: float) -> None:
    with pytest.raises(UsageError, match="margin"):
        margin_of(part(statistic, b="A7", margin=margin))


@pytest.mark.parametrize(
    ("statistic", "given", "words"),
    [
        ("median", {}, "no statistic"),
        ("ratio", {"b": "A7", "claim": "smaller"}, "less, more or equal"),
        ("ratio", {}, "b missing"),
        ("ratio", {"b": "A7", "at": ()}, "at missing"),
        ("ratio", {"b": "A7", "at": (2, 1)}, "do not rise"),
        ("rises", {"at": (1, 3)}, "no step"),
        ("slope", {"at": (1,)}, "two counts"),
        ("slope", {"against": (4,)}, "two counts"),
        ("shrinks", {"b": "A7", "at": (1,)}, "two counts"),
        ("reach", {"b": "A7", "at": (0, 1)}, "after one trajectory"),
        ("rank", {"among": ("A2", "A3"), "bound": 1.5}, "not among"),
        ("spread", {"among": ("A2",), "bound": 1.5}, "two sources"),
        ("spread", {"among": ("A2", "A3")}, "bound above 0"),
        ("gap", {"b": "A7"}, "bound above 0"),
        ("gap", {"b": "A7", "c": "A2"}, "come together"),
        ("value", {"log": True}, "bound above 0"),
        ("largest", {"part": "mean"}, "neither a joint"),
    ],
)
def test_a_part_that_says_too_little_is_refused(statistic: str, given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        contrasts(part(statistic, **given), two_curves())


def test_sources_are_named_once() -> None:
    own = part("gap", a="A1", b="A7", c="A1:linear", d="A7", among=("A1", "S1"))
    assert sources(own) == ("A1", "A7", "A1:linear", "S1")
