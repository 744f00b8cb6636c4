"""Verdicts: one word by the fixed rule, families, combinations, aliases, what is missing, and the file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from made_up_values import MadeUp, drawn

from etude.errors import DataError, UsageError
from etude_studies.thesis import statistics
from etude_studies.thesis.ledger import Claim, Ledger, Part
from etude_studies.thesis.part_verdicts import WORDS
from etude_studies.thesis.readings import Reading, readings
from etude_studies.thesis.verdicts import Verdict, changed, from_json, judge, to_json

MARGIN = math.log(1.15)


def part(a: str = "A7", claim: str = "less", **given: Any) -> Part:
    return Part(**{"statistic": "ratio", "claim": claim, "measure": "error", "a": a, "b": "A1", "at": (6,),
                   "test": "fourier", **given})  # fmt: skip


def claim(id: str, *parts: Part, **given: Any) -> Claim:
    return Claim(**{"id": id, "section": "6", "quote": ("q",), "kind": "own", "rests_on": ("table-6.9",),
                    "parts": parts, **given})  # fmt: skip


def ledger(*claims: Claim) -> Ledger:
    return Ledger(claims=claims, entries=(), ambiguities=())


def arms(**x: np.ndarray) -> MadeUp:
    """A1 at 1, and each arm at exp(x_s) after 6 trajectories: its log ratio to A1 is x."""
    results = MadeUp().put("A1", {6: [1.0] * max(len(own) for own in x.values())})
    for name, own in x.items():
        results.put(name, {6: np.exp(own).tolist()})
    return results


def word(x: np.ndarray, direction: str = "less") -> str:
    return one(x, direction).word


def one(x: np.ndarray, direction: str = "less", **given: Any) -> Verdict:
    return judge(ledger(claim("C", part(claim=direction), seeds=len(x), **given)), arms(A7=x))["C"]


@pytest.mark.parametrize(
    ("mean", "sd", "less", "more", "equal"),
    [
        (-0.25, 0.3, "holds", "reversed", "not decided"),
        (0.25, 0.3, "reversed", "holds", "not decided"),
        (0.0, 0.15, "tie", "tie", "holds"),
        (0.0, 0.6, "not decided", "not decided", "not decided"),
        (-0.2, 0.6, "not decided", "not decided", "not decided"),
        # a difference found, and small: it is both less and equal
        (-0.05, 0.05, "holds", "reversed", "holds"),
        (0.3, 0.2, "reversed", "holds", "reversed"),
        (-0.3, 0.2, "holds", "reversed", "reversed"),
    ],
)
def test_the_word_follows_the_rule(mean: float, sd: float, less: str, more: str, equal: str) -> None:
    x = drawn(20, mean, sd)
    assert [word(x, direction) for direction in ("less", "more", "equal")] == [less, more, equal]


def test_the_edges_are_those_of_the_intervals() -> None:
    """Means just on either side of where the 95 % interval leaves 0 and the 90 % one leaves the margin."""
    n, sd = 20, 0.2
    t95, t90 = 2.0930241 * sd / math.sqrt(n), 1.7291328 * sd / math.sqrt(n)
    assert word(drawn(n, -1.06 * t95, sd)) == "holds"
    assert word(drawn(n, -0.94 * t95, sd)) != "holds"
    inside = MARGIN - t90
    for direction, within in (("less", "tie"), ("equal", "holds")):
        assert word(drawn(n, -0.95 * inside, sd), direction) == within
        assert word(drawn(n, -1.05 * inside, sd), direction) == "not decided"
    assert word(drawn(n, MARGIN + 1.1 * t95, sd), "equal") == "reversed"
    assert word(drawn(n, MARGIN + 0.9 * t95, sd), "equal") == "not decided"


def test_the_numbers_beside_the_word() -> None:
    x = drawn(20, -0.3, 0.3)
    (found,) = one(x).parts
    low, high = statistics.interval(x)
    assert found.estimate == pytest.approx(math.exp(-0.3), rel=1e-5)
    assert (found.low, found.high) == pytest.approx((math.exp(low), math.exp(high)), rel=1e-5)
    narrow = np.exp(statistics.interval(x, 0.9))
    assert (found.narrow_low, found.narrow_high) == pytest.approx(tuple(narrow), rel=1e-5)
    assert (found.bca_low, found.bca_high) == pytest.approx(tuple(np.exp(statistics.bca(x))), rel=1e-5)
    assert found.sd == pytest.approx(0.3)
    assert (found.wins, found.seeds, found.failed) == (int((x < 0).sum()), 20, 0)
    assert found.p == pytest.approx(statistics.paired_t(x), rel=1e-5)
    assert found.p_permutation == pytest.approx(statistics.sign_flip(x), rel=1e-5)
    assert found.margin == pytest.approx(1.15)
    assert found.needed is None
    assert found.log


def test_own_units_stay_as_they_are() -> None:
    x = drawn(20, -0.3, 0.3)
    results = MadeUp().put("A7", {6: x})
    own = part(statistic="value", b="")
    (found,) = judge(ledger(claim("C", own)), results)["C"].parts
    assert found.estimate == pytest.approx(-0.3)
    assert found.margin == pytest.approx(0.1)
    assert not found.log


def test_wins_are_on_the_claimed_side() -> None:
    x = np.array([-0.5, -0.1, 0.05, 0.3, -0.2])
    assert [one(x, direction).parts[0].wins for direction in ("less", "more", "equal")] == [3, 2, 2]


def test_where_the_two_tests_disagree_the_weaker_counts() -> None:
    # four seeds all on one side: t is certain, 2 of 16 signs are as far out
    (found,) = one(drawn(4, -1.0, 0.05)).parts
    assert found.p_adjusted < 0.05 < found.p_permutation_adjusted
    assert (found.word, found.agree) == ("not decided", False)
    assert found.needed == 7, "as a second look"
    (found,) = one(drawn(4, 0.0, 0.01), "equal").parts
    assert (found.word, found.agree, found.needed) == ("not decided", False, 6)
    (found,) = one(drawn(4, 0.0, 0.01)).parts
    assert (found.word, found.agree) == ("not decided", False), "a tie by the interval alone"
    (found,) = one(drawn(4, 0.5, 0.01), "equal").parts
    assert (found.word, found.agree) == ("not decided", False)
    # one seed far out: t sees nothing, the signs do
    x = np.array([-0.2, -0.21, -0.19, -0.2, -0.22, -0.2, -0.19, -0.2, -0.21, -6.0])
    (found,) = one(x).parts
    assert found.p_permutation_adjusted < 0.05 < found.p_adjusted
    assert (found.word, found.agree) == ("not decided", False)
    assert one(drawn(20, -0.3, 0.3)).parts[0].agree


@pytest.mark.parametrize(
    ("x", "smaller"),
    [
        # 2 of 256 signs; and one seed far out, which a t test takes for spread
        (drawn(8, -1.0, 0.05), "p"),
        (np.array([-0.2, -0.21, -0.19, -0.2, -0.22, -0.2, -0.19, -0.2, -0.21, -1.2]), "p_permutation"),
    ],
)
def test_both_tests_are_adjusted(x: np.ndarray, smaller: str) -> None:
    """One claim with something behind it among eight: each test by itself is below 5 %, adjusted only one."""
    n = len(x)
    none = {f"S{i}": drawn(n, 0.0, 0.3, seed=i) for i in range(7)}
    own = [claim(name, part(name), seeds=n) for name in ("A7", *none)]
    (found,) = judge(ledger(*own), arms(A7=x, **none))["A7"].parts
    assert max(found.p, found.p_permutation) < 0.05
    assert {"p": found.p_adjusted, "p_permutation": found.p_permutation_adjusted}[smaller] < 0.05
    assert max(found.p_adjusted, found.p_permutation_adjusted) > 0.05
    assert (found.word, found.agree) == ("not decided", False)


def test_no_spread() -> None:
    assert word(np.zeros(20)) == "tie"
    assert word(np.zeros(20), "equal") == "holds"
    assert word(np.full(20, -0.01)) == "holds"
    assert word(np.full(20, 0.01)) == "reversed"
    assert word(np.full(20, 0.5), "equal") == "reversed"
    (found,) = one(np.full(3, -0.5)).parts
    assert (found.word, found.needed) == ("not decided", 7)


def test_the_seeds_that_would_settle_a_part_do() -> None:
    (found,) = one(drawn(20, -0.15, 0.5)).parts
    assert found.word == "not decided"
    assert found.needed is not None
    rng = np.random.default_rng(4)
    more = [statistics.paired_t(rng.normal(-0.15, 0.5, found.needed)) < 0.025 for _ in range(500)]
    assert 0.72 < np.mean(more) < 0.88
    verdict = one(drawn(20, -0.15, 0.5))
    assert verdict.reason.endswith(f"{found.needed} seeds would decide at this spread")
    assert verdict.asks == found.needed


def test_the_power_is_the_share_of_studies_that_find_a_difference_of_the_margin() -> None:
    (found,) = one(drawn(20, 0.0, 0.3)).parts
    rng = np.random.default_rng(7)
    share = np.mean([statistics.paired_t(rng.normal(MARGIN, 0.3, 20)) < 0.05 for _ in range(2000)])
    assert found.power == pytest.approx(share, abs=0.03)
    (equal,) = one(drawn(20, 0.0, 0.2), "equal").parts
    share = np.mean([statistics.equivalence(rng.normal(0.0, 0.2, 20), MARGIN) < 0.05 for _ in range(2000)])
    assert equal.power == pytest.approx(share, abs=0.03)
    assert one(drawn(4, 0.0, 0.01)).parts[0].power == 0.0, "sign flips of four seeds never reach 5 %"


def test_a_tie_needs_a_test_that_could_have_found_the_margin() -> None:
    """Alike by the interval, in a family of twelve where the level leaves a power below one half."""
    x = drawn(20, 0.0, 0.2)
    assert one(x).word == "tie"
    own = [claim(f"C{i}", part()) for i in range(12)]
    found = judge(ledger(*own), arms(A7=x))["C0"]
    assert found.parts[0].level == pytest.approx(0.05 / 12)
    assert 0.3 < found.parts[0].power < 0.5
    assert found.word == "not decided"
    assert found.reason.startswith(f"cannot tell at this n (power {found.parts[0].power:.2f}); ")
    again = judge(
        ledger(*own), arms(A7=drawn(found.asks, 0.0, 0.2)), planned={"A7": found.asks, "A1": found.asks}
    )
    assert again["C0"].word == "tie"


def spread(equal: bool) -> float:
    """Share of studies in which three arms, all alike or one 1.15 above, differ by more than 1.15."""
    own = part("", "more", statistic="spread", b="", among=("S1", "S2", "S3"), bound=1.15)
    asked, found, trials = ledger(claim("C", own)), 0, 150
    for trial in range(trials):
        x = np.random.default_rng((2, trial)).normal(0.0, 0.156, (3, 20))
        x[0] += 0.0 if equal else MARGIN
        results = arms(S1=x[0], S2=x[1], S3=x[2])
        found += judge(asked, results)["C"].word == "holds"
    return found / trials


def test_a_spread_of_equal_arms_hardly_ever_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The range of three equal arms, seed by seed, was above 1.15 in half of all studies."""
    monkeypatch.setattr(statistics, "RESAMPLES", 99)
    assert spread(equal=True) == 0.0
    assert spread(equal=False) <= 0.05
    x = {f"S{i}": drawn(20, 0.2 * i, 0.3, seed=i) for i in range(3)}
    own = part("", "more", statistic="spread", b="", among=tuple(x), bound=1.15)
    (found,) = judge(ledger(claim("C", own)), arms(**x))["C"].parts
    alone = statistics.paired_t(x["S2"] - x["S0"] - MARGIN)
    assert found.p == pytest.approx(3.0 * alone, rel=1e-4), "the pair is one of three"


def block(seeds: int, mean: float) -> Verdict:
    x = np.concatenate([drawn(20, mean, 0.5), drawn(90, 1.5 * mean, 0.5, seed=1), np.zeros(290)])[:seeds]
    return judge(ledger(claim("C", part())), arms(A7=x), planned={"A7": 20, "A1": 20}, blocks={"C": 110})["C"]


def test_extra_seeds_count_as_one_block_of_the_size_asked_for() -> None:
    first = block(20, -0.15)
    assert (first.word, first.asks, first.block) == ("not decided", 109, 0)
    early = block(109, -0.15)
    assert early.parts[0].seeds == 20, "a block that is not complete is not looked into"
    (late,) = block(400, -0.15).parts
    assert (late.seeds, late.planned, late.word) == (110, 110, "holds")
    x = np.concatenate([drawn(20, -0.15, 0.5), drawn(90, -0.225, 0.5, seed=1)])
    assert late.p == pytest.approx(2.0 * statistics.paired_t(x), rel=1e-4), "a second look"


def test_a_claim_asks_for_a_block_once() -> None:
    found = block(110, 0.0)
    assert found.block == 110
    weak = judge(ledger(claim("C", part())), arms(A7=drawn(40, -0.15, 0.5)), blocks={"C": 40})["C"]
    assert (weak.word, weak.asks, weak.block, weak.parts[0].needed) == ("not decided", None, 40, None)
    assert weak.reason.endswith("its block of 40 seeds is used")


def test_a_mean_on_the_edge_of_the_margin_is_settled_by_no_number() -> None:
    # +-: the mean is the margin but for rounding of exp and log
    x = np.concatenate([np.full(10, MARGIN - 0.2), np.full(10, MARGIN + 0.2)])
    found = one(x, "equal")
    assert found.word == "not decided"
    assert found.reason == "no number of seeds would decide at this spread"


def family(n: int, step: float = 0.05, **given: Any) -> tuple[Ledger, MadeUp]:
    """n claims C0.. on arms S0.. with ever larger effects."""
    x = {f"S{i}": drawn(20, -step * i, 0.25, seed=i) for i in range(n)}
    return ledger(*(claim(f"C{i}", part(f"S{i}"), **given) for i in range(n))), arms(**x)


def test_own_claims_on_one_table_are_adjusted_together_by_holm() -> None:
    found = judge(*family(8))
    p = [found[f"C{i}"].parts[0].p for i in range(8)]
    wanted = statistics.holm(p)
    assert [found[f"C{i}"].parts[0].p_adjusted for i in range(8)] == pytest.approx(list(wanted), rel=1e-4)
    assert [found[f"C{i}"].word == "holds" for i in range(8)] == [bool(own < 0.05) for own in wanted]
    assert any(own < 0.05 < adjusted for own, adjusted in zip(p, wanted, strict=True)), "Holm costs something"


def test_what_is_observed_or_cited_is_exploratory_at_ten_percent() -> None:
    found = judge(*family(8, 0.024, kind="obs"))
    p = [found[f"C{i}"].parts[0].p for i in range(8)]
    wanted = statistics.benjamini_hochberg(p)
    assert [found[f"C{i}"].parts[0].p_adjusted for i in range(8)] == pytest.approx(list(wanted), rel=1e-4)
    assert [found[f"C{i}"].word == "holds" for i in range(8)] == [bool(own < 0.10) for own in wanted]
    assert any(0.05 < own < 0.10 for own in wanted), "the level matters here"
    assert all(own.exploratory for own in found.values())


def test_families_do_not_touch_each_other() -> None:
    own, results = family(8)
    others = [
        moved_to(c, rests_on=("figure-5.1",)) if i == 4
        else moved_to(c, kind="mech") if i == 5 else c
        for i, c in enumerate(own.claims)
    ]  # fmt: skip
    found = judge(ledger(*others), results)
    for alone in ("C4", "C5"):
        assert found[alone].parts[0].p_adjusted == found[alone].parts[0].p
    rest = [found[f"C{i}"].parts[0] for i in (0, 1, 2, 3, 6, 7)]
    assert [one.p_adjusted for one in rest] == pytest.approx(statistics.holm([o.p for o in rest]), rel=1e-4)
    assert [found[name].exploratory for name in ("C3", "C4", "C5")] == [False, False, True]


def test_more_seeds_are_needed_than_there_are() -> None:
    """Found alone, and not among twelve alike: all of them have to meet the first one's level."""
    x = drawn(20, -3.2 * 0.3 / math.sqrt(20), 0.3)
    assert one(x).word == "holds"
    own = [claim(f"C{i}", part()) for i in range(12)]
    found = judge(ledger(*own), arms(A7=x))
    assert {one.word for one in found.values()} == {"not decided"}
    assert len({one.parts[0].needed for one in found.values()}) == 1
    assert found["C0"].asks > 21


def moved_to(own: Claim, **given: Any) -> Claim:
    return claim(**{"id": own.id, **given}, parts=own.parts)


def test_claims_of_equality_are_in_no_family() -> None:
    own, results = family(4)
    equals = [claim(f"E{i}", part(f"S{i}", "equal")) for i in range(4)]
    before, after = judge(own, results), judge(ledger(*own.claims, *equals), results)
    assert all(after[id] == before[id] for id in before)
    assert after["E0"].parts[0].p_adjusted == after["E0"].parts[0].p


def test_a_family_is_as_large_as_planned_whatever_has_been_run() -> None:
    own, results = family(8)
    full = judge(own, results)
    for key in [key for key in results.numbers if key[0] in ("S0", "S1")]:
        del results.numbers[key]
    found = judge(own, results)
    assert found["C0"].word == "cannot be tested here"
    # S0 and S1 have the largest p: without them the others keep theirs
    for i in range(2, 8):
        assert found[f"C{i}"].parts[0].p_adjusted == full[f"C{i}"].parts[0].p_adjusted


def test_the_seeds_needed_are_for_the_level_at_the_parts_place() -> None:
    own, results = family(8)
    in_family = judge(own, results)["C2"].parts[0]
    alone = judge(ledger(own.claims[2]), results)["C2"].parts[0]
    assert in_family.word == alone.word == "not decided"
    assert in_family.needed > alone.needed > 20


def results_of_all_words() -> MadeUp:
    return arms(
        H=drawn(20, -0.5, 0.1), T=drawn(20, 0.0, 0.1), N=drawn(20, 0.0, 0.8), R=drawn(20, 0.5, 0.1)
    )  # fmt: skip


@pytest.mark.parametrize(
    ("own", "every", "some"),
    [
        ("HH", "holds", "holds"),
        ("HT", "tie", "holds"),
        ("TN", "not decided", "tie"),
        ("HTN", "not decided", "holds"),
        ("NR", "reversed", "not decided"),
        ("HTNR", "reversed", "holds"),
        ("RR", "reversed", "reversed"),
    ],
)
def test_a_conjunction_is_its_worst_part_and_a_choice_its_best(own: str, every: str, some: str) -> None:
    parts = [part(name) for name in own]
    for combine, wanted in (("all", every), ("any", some)):
        found = judge(ledger(claim("C", *parts, combine=combine)), results_of_all_words())["C"]
        assert found.word == wanted
        assert [one.part for one in found.parts] == list(range(len(own)))


@pytest.mark.parametrize("combine", ["all", "any"])
def test_a_claim_with_a_part_not_run_has_no_verdict(combine: str) -> None:
    own = claim("C", part("H"), part("Z9"), combine=combine)
    found = judge(ledger(own), results_of_all_words())["C"]
    assert (found.word, found.reason) == ("cannot be tested here", "not run yet: runs Z9")
    assert [one.word for one in found.parts] == ["holds", "cannot be tested here"]


def each(*by_k: np.ndarray, a: str = "A7") -> MadeUp:
    results = MadeUp()
    for k, x in enumerate(by_k, 1):
        results.put("A1", {k: [1.0] * 20}).put(a, {k: np.exp(x)})
    return results


def test_each_count_has_to_hold_by_itself() -> None:
    good, none = drawn(20, -0.5, 0.2), drawn(20, 0.0, 0.9)
    own = part(statistic="ratio_each", at=(1, 2, 3))
    found = judge(ledger(claim("C", own)), each(good, good, good))["C"]
    assert found.word == "holds"
    assert [(one.part, one.k) for one in found.parts] == [(0, 1), (0, 2), (0, 3)]
    assert found.parts[0].p_adjusted == pytest.approx(3 * found.parts[0].p, rel=1e-4), "Holm over the counts"
    assert judge(ledger(claim("C", own)), each(good, none, good))["C"].word == "not decided"
    assert judge(ledger(claim("C", own)), each(good, -good, good))["C"].word == "reversed"


def test_a_choice_takes_a_part_of_several_counts_as_one() -> None:
    good, none = drawn(20, -0.5, 0.2), drawn(20, 0.0, 0.9)
    several = part(statistic="ratio_each", at=(1, 2))
    own = claim("C", several, part("N"), combine="any")
    results = each(good, none)
    results.numbers.update(results_of_all_words().numbers)
    assert judge(ledger(own), results)["C"].word == "not decided"


def test_an_alias_takes_over_the_verdict_and_enters_no_family() -> None:
    own, results = family(8)
    again = claim("D", kind="alias", alias_of=("C7",))
    further = claim("E", kind="alias", alias_of=("D",), simulated=True)
    # before what it repeats
    found = judge(ledger(further, again, *own.claims), results)
    alone = judge(own, results)
    assert {id: found[id] for id in alone} == alone
    assert (found["D"].word, found["D"].parts) == (alone["C7"].word, alone["C7"].parts)
    assert found["D"].same_as == ("C7",)
    assert found["E"].word == alone["C7"].word
    assert (found["D"].simulated, found["E"].simulated) == (False, True)
    assert list(found) == ["E", "D", *(f"C{i}" for i in range(8))]


def test_an_alias_of_several_is_the_worst_of_them() -> None:
    own = [claim(f"C{name}", part(name)) for name in "HTNR"]
    again = claim("D", kind="alias", alias_of=("CH", "CN", "CT"))
    assert judge(ledger(*own, again), results_of_all_words())["D"].word == "not decided"


def test_aliases_of_nothing_and_of_themselves_are_refused() -> None:
    with pytest.raises(UsageError, match="'Z' is no claim"):
        judge(ledger(claim("D", kind="alias", alias_of=("Z",))), MadeUp())
    circle = [claim("D", kind="alias", alias_of=("E",)), claim("E", kind="alias", alias_of=("D",))]
    with pytest.raises(UsageError, match="says again itself") as error:
        judge(ledger(*circle), MadeUp())
    assert error.value.where == "D -> E -> D"


def test_a_claim_that_cannot_be_tested_says_why() -> None:
    own = claim("C", kind="cited", untestable="novelty is no statistic", simulated=True)
    found = judge(ledger(own), MadeUp())["C"]
    assert found == Verdict("C", "cannot be tested here", (), True, True, "novelty is no statistic")
    with pytest.raises(UsageError, match="without parts") as error:
        judge(ledger(claim("C")), MadeUp())
    assert error.value.where == "C"


def test_runs_not_there_or_not_complete_are_named() -> None:
    own = ledger(claim("C", part("A7")))
    assert judge(own, MadeUp())["C"].reason == "not run yet: runs A7, A1"
    both = ledger(claim("C", part("A7"), part("A5")))
    assert judge(both, MadeUp())["C"].reason == "not run yet: runs A7, A1, A5"
    half = arms(A7=drawn(10, -1.0, 0.1))
    assert judge(own, half)["C"].reason == "not run yet: runs A7 (10 of 20 seeds), A1 (10 of 20 seeds)"
    assert judge(own, half, planned={"A7": 10})["C"].word == "holds"


@pytest.mark.parametrize(("failed", "wanted"), [(2, "holds"), (3, "cannot be tested here")])
def test_more_than_a_tenth_of_failed_seeds_leaves_no_verdict(failed: int, wanted: str) -> None:
    x = drawn(20, -1.0, 0.1)
    x[:failed] = math.nan
    found = judge(ledger(claim("C", part())), arms(A7=x))["C"]
    assert found.word == wanted
    assert (found.parts[0].failed, found.parts[0].seeds) == (failed, 20 - failed)
    assert ("3 of 20 seeds have no number" in found.reason) == (failed == 3)


def test_a_single_seed_has_no_verdict() -> None:
    found = one(np.array([-1.0]))
    assert (found.word, found.reason) == ("cannot be tested here", "fewer than two seeds have a number")
    assert found.parts[0].p is None


def test_the_thesis_is_an_ordinary_draw_or_not() -> None:
    x = drawn(20, -0.1, 0.3)
    low, high = np.exp(statistics.prediction_interval(x))
    for printed, ordinary in ((0.88, True), (1.01 * low, True), (0.99 * low, False), (1.01 * high, False)):
        own = claim("C", part(printed=printed))
        (found,) = judge(ledger(own), arms(A7=x))["C"].parts
        assert (found.printed, found.ordinary) == (printed, ordinary)
    assert one(x).parts[0].ordinary is None
    several = part(statistic="ratio_each", at=(1, 2), printed=0.9)
    found = judge(ledger(claim("C", several)), each(x, x))["C"].parts
    assert [one.ordinary for one in found] == [None, True], "tables are printed after the last count"


def whole() -> dict[str, Verdict]:
    own = [claim(f"C{name}", part(name, printed=0.9)) for name in "HTNR"]
    more = (
        claim("D", kind="alias", alias_of=("CH",)),
        claim("E", kind="cited", untestable="no such plant"),
        claim("F", part("Z9")),
    )
    return judge(ledger(*own, *more), results_of_all_words())


def test_the_file_gives_back_what_was_written() -> None:
    found = whole()
    assert {one.word for one in found.values()} == set(WORDS)
    text = to_json(found)
    assert from_json(text) == found
    assert text == to_json(from_json(text)) == to_json(whole())
    assert text.endswith("}\n")
    assert "NaN" not in text
    with pytest.raises(DataError, match="no file of verdicts"):
        from_json('{"C": {"word": 3}}')


def test_nothing_changed() -> None:
    assert changed(whole(), from_json(to_json(whole()))) == []


def test_what_changed_is_said() -> None:
    def found(**x: np.ndarray) -> dict[str, Verdict]:
        return judge(ledger(*(claim(f"C{name}", part(name)) for name in x)), arms(**x))

    before = found(H=drawn(20, -0.5, 0.2), T=drawn(20, 0.0, 0.1))
    assert changed(before, found(H=drawn(20, -0.55, 0.2), T=drawn(20, 0.0, 0.1))) == []
    # still "holds", and far outside .55 .. .67
    moved = changed(before, found(H=drawn(20, -0.8, 0.2), T=drawn(20, 0.0, 0.1)))
    assert moved == ["CH, part 1: 0.449, outside 0.552 .. 0.666 before"]
    back = changed(before, found(H=drawn(20, -0.3, 0.2), T=drawn(20, 0.0, 0.1)))
    assert back == ["CH, part 1: 0.741, outside 0.552 .. 0.666 before"]
    words = changed(before, found(H=drawn(20, -0.5, 0.2), T=drawn(20, -0.5, 0.1)))
    assert words == ["CT: tie before, now holds", "CT, part 1: tie before, now holds"]
    less = found(H=drawn(20, -0.5, 0.2))
    assert changed(before, less) == ["CT: tie before, now there is no verdict"]
    assert changed(less, before) == ["CT: there was no verdict before, now tie"]


def test_the_rule_keeps_the_family_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six claims without anything behind them: hardly ever does one hold or turn out reversed."""
    monkeypatch.setattr(statistics, "RESAMPLES", 99)
    own, errors, trials = ledger(*(claim(f"C{i}", part(f"S{i}"), seeds=8) for i in range(6))), 0, 100
    for trial in range(trials):
        rng = np.random.default_rng((13, trial))
        results = arms(**{f"S{i}": rng.normal(0.0, 0.8, 8) for i in range(6)})
        errors += any(one.word in ("holds", "reversed") for one in judge(own, results).values())
    assert errors / trials < 0.05 + 3.0 * math.sqrt(0.05 * 0.95 / trials)


def read_so(**replace: str) -> tuple[Verdict, Verdict]:
    """Of two claims of one table, about P and Q: the second is clear of chance by little."""
    x = {"P": drawn(20, -0.3, 0.25), "Q": drawn(20, -0.135, 0.26), "Q2": drawn(20, -0.135, 0.26)}
    own, found = ledger(claim("first", part("P")), claim("second", part("Q"))), arms(**x)
    usual = judge(own, found)
    assert [usual[id].word for id in ("first", "second")] == ["holds", "holds"]
    alone = judge(ledger(claim("first", part("NONE")), claim("second", part("Q"))), found)
    assert alone["second"].word == "not decided", "the other's p matters"
    (reading,) = readings(own, found, among=[Reading("so", "", replace)])
    return reading.verdicts.get("first", usual["first"]), reading.verdicts.get("second", usual["second"])


def test_what_has_not_been_run_so_costs_the_others_nothing() -> None:
    """The second claim's numbers are the same under the reading, whatever the first one lacks."""
    first, second = read_so(P="P (so read)", Q="Q2")
    assert first.reason.startswith("not run yet")
    assert second.word == "holds"


def test_a_part_without_what_is_read_otherwise_keeps_its_word() -> None:
    x = {"P": drawn(20, -0.3, 0.25), "Q": drawn(20, -0.135, 0.26), "P2": drawn(20, 0.0, 0.25)}
    own = ledger(claim("both", part("P"), part("Q")))
    found = arms(**x)
    usual = judge(own, found)["both"]
    (reading,) = readings(own, found, among=[Reading("so", "", {"P": "P2"})])
    moved, kept = reading.verdicts["both"].parts
    assert [own.word for own in usual.parts] == ["holds", "holds"]
    assert moved.word != "holds"
    assert kept == usual.parts[1]


def test_the_test_of_what_has_learned_it_is_no_other_motion() -> None:
    own = ledger(claim("C", part("Y1"), part("A7")))
    results = MadeUp()
    (reading,) = readings(own, results, among=[Reading("so", "", {}, {"fourier": "common"})])
    assert "C" in reading.verdicts
    alone = ledger(claim("C", part("Y1")))
    assert not readings(alone, results, among=[Reading("so", "", {}, {"fourier": "common"})])[0].verdicts
