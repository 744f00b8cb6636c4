"""Every word of the study, found again from the committed tables with own reader and own statistics."""

from __future__ import annotations

import itertools
import json
import math
import tomllib
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

THESIS = Path(__file__).parents[3] / "src" / "etude_studies" / "thesis"
CLAIMS = {own["id"]: own for own in tomllib.loads((THESIS / "claims.toml").read_text("utf-8"))["claim"]}
WORDS = json.loads((THESIS / "results" / "verdicts.json").read_text("utf-8"))
ORDER = ("cannot be tested here", "reversed", "not decided", "tie", "holds")
JOINTS = ("waist", "shoulder", "elbow", "wrist")
FLIPS = np.where(np.random.default_rng(99).random((20_000, 400)) < 0.5, -1.0, 1.0)
CLOSE = 3.5 * math.sqrt(0.05 * 0.95 / len(FLIPS))
"""Of two shares of random flips near 5 %: closer to the level, either word is right."""
Part = dict[str, Any]


@cache
def table(run: str) -> dict[tuple[Any, ...], dict[tuple[int, int], float]]:
    path = THESIS / "results" / f"{run}.parquet"
    if not path.exists():
        return {}
    keys = ["model", "measure", "test", "part"]
    parted = pl.read_parquet(path).partition_by(keys, as_dict=True)
    return {
        key: {(k, seed): value for k, seed, value in own.select("k", "seed", "value").iter_rows()}
        for key, own in parted.items()
    }


def numbers(part: Part, source: str, k: int, joint: str) -> dict[int, float]:
    run, _, model = source.partition(":")
    own = table(run).get((model, part["measure"], part.get("test", ""), joint), {})
    return {seed: value for (count, seed), value in own.items() if count == k}


def named(part: Part) -> list[str]:
    own = [part.get(name, "") for name in "abcd"] + list(part.get("among", ()))
    return [source for source in dict.fromkeys(own) if source]


def read(part: Part, most: int | None) -> tuple[np.ndarray, dict[tuple[str, int, str], np.ndarray], bool]:
    """Seeds; logs and plain numbers of each cell over them; whether every source has any."""
    joints = JOINTS if part["statistic"] in ("largest", "smallest") else (part.get("part", "mean"),)
    counts = sorted({*part["at"], *part.get("against", ())})
    cells = {
        (source, k, joint): numbers(part, source, k, joint)
        for source in named(part)
        for k in counts
        for joint in joints
    }
    by_source = [
        set().union(*(own for (name, _, _), own in cells.items() if name == source)) for source in named(part)
    ]
    seeds = sorted(set.intersection(*by_source))[:most]
    out = {key: np.array([own.get(seed, math.nan) for seed in seeds]) for key, own in cells.items()}
    return np.array(seeds), out, all(by_source)


def one_a_seed(part: Part, cells: dict[tuple[str, int, str], np.ndarray], at: Sequence[int]) -> np.ndarray:
    joint, kind, bound = part.get("part", "mean"), part["statistic"], part.get("bound")
    a, b, against = part.get("a", ""), part.get("b", ""), part.get("against", ())

    def log(source: str, k: int, name: str = joint) -> np.ndarray:
        value = cells[source, k, name]
        return np.log(np.where(value > 0.0, value, math.nan))

    def ratio(one: str, other: str, ks: Sequence[int]) -> np.ndarray:
        return np.mean([log(one, k) - log(other, k) for k in ks], axis=0)

    def size(x: np.ndarray, whole: np.ndarray) -> np.ndarray:
        return x * np.sign(x[whole].mean() or 1.0)

    if kind in ("ratio", "ratio_each"):
        return ratio(a, b, at)
    if kind == "value":
        plain = np.mean([log(a, k) if part.get("log") else cells[a, k, joint] for k in at], axis=0)
        return plain - (math.log(bound) if part.get("log") else bound or 0.0)
    if kind in ("gap", "shrinks"):
        first = ratio(a, b, at) if kind == "gap" else ratio(a, b, at[:1])
        if kind == "gap" and not part.get("c"):
            return size(first, np.isfinite(first)) - math.log(bound)
        other = ratio(part["c"], part["d"], at) if kind == "gap" else ratio(a, b, at[-1:])
        whole = np.isfinite(first + other)
        return size(first, whole) - size(other, whole)
    if kind == "spread":
        logs = np.array([np.mean([log(source, k) for k in at], axis=0) for source in part["among"]])
        means = logs[:, np.isfinite(logs).all(axis=0)].mean(axis=1)
        return logs[np.argmax(means)] - logs[np.argmin(means)] - math.log(bound)
    if kind == "rises":
        steps = [(k, after) for k, after in itertools.pairwise(at) if after == k + 1]

        def share(source: str) -> np.ndarray:
            rise = np.array([log(source, after) - log(source, k) for k, after in steps])
            return np.where(np.isfinite(rise), rise > math.log(1.02), math.nan).mean(axis=0)

        return share(a) - (share(b) if b else 0.0)
    if kind == "slope":

        def fall(source: str, ks: Sequence[int]) -> np.ndarray:
            return (log(source, ks[0]) - log(source, ks[-1])) / (ks[-1] - ks[0])

        return fall(a, at) - (fall(b or a, against or at) if b or against else 0.0)
    if kind == "rank":
        ranks = [stats.rankdata([cells[s, k, joint] for s in part["among"]], axis=0) for k in at]
        return np.mean([own[part["among"].index(a)] for own in ranks], axis=0) - bound
    if kind == "reach":
        return np.array(
            [
                reach([log(a, k)[i] for k in at], [log(b, k)[i] for k in at], at)
                for i in range(len(log(a, at[0])))
            ]
        )
    extreme = np.max if kind == "largest" else np.min

    def beside(k: int, name: str) -> np.ndarray:
        return log(a, k, name) - (log(b, k, name) if b else 0.0)

    others = [name for name in JOINTS if name != joint]
    return np.mean([beside(k, joint) - extreme([beside(k, n) for n in others], axis=0) for k in at], axis=0)


def reach(a: list[float], b: list[float], at: Sequence[int]) -> float:
    def need(curve: list[float], level: float) -> float:
        below = [i for i, value in enumerate(curve) if value <= level]
        if not below:
            return at[-1]
        i = below[0]
        return at[0] if i == 0 else float(np.interp(-level, [-curve[i - 1], -curve[i]], [at[i - 1], at[i]]))

    return math.log(need(a, b[-1])) - math.log(need(b, a[-1]))


def margin(part: Part) -> float:
    given, kind = part.get("margin", 1.15), part["statistic"]
    if kind in ("rises", "rank") or (kind == "value" and not part.get("log")):
        plain = {"rises": 0.1, "rank": 0.5}.get(kind, 0.1 * (abs(part.get("bound") or 0.0) or 1.0))
        return plain if given == 1.15 else given
    return math.log(given) / (part["at"][-1] - part["at"][0] if kind == "slope" else 1)


def flips(x: np.ndarray, two_sided: bool = True) -> float:
    sums, own = FLIPS[:, : len(x)] @ x, x.sum()
    sums, own = (abs(sums), abs(own)) if two_sided else (sums, own)
    return (1 + np.count_nonzero(sums >= own - 1e-12 * abs(x).sum())) / (1 + len(FLIPS))


def t_below(x: np.ndarray, bound: float) -> float:
    """p of the one-sided t test of a mean below the bound."""
    sd = x.std(ddof=1)
    if sd <= 1e-12 * abs(x).max():
        return 0.0 if x.mean() < bound else 1.0
    return float(stats.t.cdf((x.mean() - bound) / sd * math.sqrt(len(x)), len(x) - 1))


def alike(x: np.ndarray, size: float) -> tuple[float, float]:
    return max(t_below(x, size), t_below(-x, size)), max(flips(x + size, False), flips(size - x, False))


def power(x: np.ndarray, size: float, level: float) -> float:
    n, sd = len(x), x.std(ddof=1)
    if 0.5 ** (n - 1) > level:
        return 0.0
    return float(stats.nct.sf(stats.t.isf(level / 2, n - 1), n - 1, size / sd * math.sqrt(n))) if sd else 1.0


def adjusted(p: np.ndarray, exploratory: bool) -> np.ndarray:
    if exploratory:
        return stats.false_discovery_control(p)
    order, out = np.argsort(p), np.empty(len(p))
    out[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return out


class Asked:
    """One judged part: its x, and after the families its acceptable words."""

    def __init__(self, part: Part, at: Sequence[int], told: dict[str, Any], block: int) -> None:
        self.part, self.told = part, told
        self.most = block or told["seeds"] + told["failed"] or None
        seeds, cells, there = read({**part, "at": at}, self.most)
        x = one_a_seed(part, cells, at) if there and len(seeds) else np.empty(0)
        self.x = x[np.isfinite(x)]
        planned = told["planned"]
        self.untested = not there or len(self.x) < max(2, 0.9 * planned - 1e-9)
        self.times = (2 if block else 1) * (
            math.comb(len(part.get("among", ())), 2) if part["statistic"] == "spread" else 1
        )
        self.looks = 2 if block else 1
        self.p = self.signs = 1.0
        if not self.untested:
            sign = min(t_below(self.x, 0.0), t_below(-self.x, 0.0))
            self.p, self.signs = min(1.0, 2 * sign * self.times), min(1.0, flips(self.x) * self.times)
            if self.x.mean() == 0.0:
                self.p = 1.0

    def words(self, level: float, p: float, signs: float, meet: float) -> set[str]:
        """Those that the rule allows; two where a share of random flips is as good as at the level."""
        if self.untested:
            return {ORDER[0]}
        size, claimed = margin(self.part), self.part["claim"]
        if claimed == "equal":
            return self._equal(size)
        within = max(alike(self.x, size)) < 0.05 / self.looks
        else_ = "tie" if within and power(self.x, size, meet / self.times) >= 0.5 else "not decided"
        side = "holds" if (self.x.mean() < 0) == (claimed == "less") else "reversed"
        found = {side if max(p, signs) < level else else_}
        return found | ({side, else_} if p < level and abs(signs - level) < CLOSE else set())

    def _equal(self, size: float) -> set[str]:
        beyond = np.sign(self.x.mean()) * self.x - size
        outside = 2 * t_below(-beyond, 0.0) < 0.05 / self.times and flips(beyond) < 0.05 / self.times
        if max(alike(self.x, size)) < 0.05 / self.looks:
            return {"holds"}
        return {"reversed" if outside and beyond.mean() > 0 else "not decided"}


@cache
def found() -> dict[str, list[set[str]]]:
    """Acceptable words of every judged part, by claim."""
    asked: dict[str, list[Asked]] = {}
    families = defaultdict(list)
    for label, claim in CLAIMS.items():
        told, asked[label] = iter(WORDS[label]["parts"]), []
        for part in claim.get("part", ()):
            for at in [[k] for k in part["at"]] if part["statistic"] == "ratio_each" else [part["at"]]:
                asked[label].append(Asked(part, at, next(told), WORDS[label].get("block", 0)))
        own = claim["kind"] == "own"
        name = (claim["rests_on"] or [label])[0] if own else "exploratory"
        families[name] += [one for one in asked[label] if one.part["claim"] != "equal"]
    words: dict[int, set[str]] = {}
    for name, members in families.items():
        if not members:
            continue
        loose = name == "exploratory"
        level = 0.1 if loose else 0.05
        p, signs = (adjusted(np.array([getattr(m, key) for m in members]), loose) for key in ("p", "signs"))
        rejected, m = p < level, len(members)
        others = rejected.sum() - rejected
        meet = level * (others + 1) / m if loose else level / (m - others)
        for place, one in enumerate(members):
            words[id(one)] = one.words(level, p[place], signs[place], meet[place])
    return {
        label: [words.get(id(one)) or one.words(0.05, one.p, one.signs, 0.05) for one in parts]
        for label, parts in asked.items()
    }


def test_every_part_has_the_word_that_the_tables_give() -> None:
    wrong = {
        f"{name}, part {place + 1}": (told["word"], sorted(own))
        for name, parts in found().items()
        for place, (told, own) in enumerate(zip(WORDS[name]["parts"], parts, strict=False))
        if not CLAIMS[name].get("alias_of") and told["word"] not in own
    }
    assert not wrong
    assert sum(len(parts) for parts in found().values()) > 200


@pytest.mark.parametrize("combine", ["all", "any"])
def test_every_claim_has_the_worst_or_the_best_word_of_its_parts(combine: str) -> None:
    for name, claim in CLAIMS.items():
        told = WORDS[name]
        words = [part["word"] for part in told["parts"]]
        if told["word"] == "depends on the reading":
            assert words
            assert f"line searches: {min(words, key=ORDER.index)};" in told["reason"]
        elif claim.get("alias_of"):
            assert told["word"] == min((WORDS[other]["word"] for other in claim["alias_of"]), key=ORDER.index)
        elif words and claim.get("combine", "all") == combine:
            pick = min if combine == "all" or ORDER[0] in words else max
            assert told["word"] == pick(words, key=ORDER.index), name


def test_estimates_are_those_of_the_tables() -> None:
    for name, claim in CLAIMS.items():
        for part, told in zip(claim.get("part", ()), WORDS[name]["parts"], strict=False):
            if part["statistic"] == "ratio" and told.get("estimate") is not None:
                x = Asked(part, part["at"], told, WORDS[name].get("block", 0)).x
                assert math.exp(x.mean()) == pytest.approx(told["estimate"], rel=1e-4), name
                assert np.count_nonzero(x < 0) == told["wins"] or part["claim"] != "less", name


def test_rows_that_the_thesis_does_not_have_get_the_words_that_the_tables_give() -> None:
    from etude_studies.method_comparison import compared_rows
    from etude_studies.thesis.kept import kept_results
    from etude_studies.thesis.ledger import load_ledger

    counted = 0
    for entry in (own for own in load_ledger().entries if own.against):
        told = compared_rows(entry, kept_results())
        ratio = {"statistic": "ratio", "measure": entry.measure, "test": entry.test, "claim": "less"}
        own = {
            run: Asked({**ratio, "a": run, "b": entry.against, "at": entry.at}, entry.at, _shown(part), 0)
            for run, part in told.items()
        }
        p, signs = (
            adjusted(np.array([getattr(m, key) for m in own.values()]), False) for key in ("p", "signs")
        )
        others = (p < 0.05).sum() - (p < 0.05)
        meet = 0.05 / (len(own) - others)
        for place, (run, one) in enumerate(own.items()):
            assert told[run].word in one.words(0.05, p[place], signs[place], meet[place]), run
            assert told[run].estimate == pytest.approx(math.exp(one.x.mean()), rel=1e-4)
            counted += 1
    assert counted


def _shown(part: Any) -> dict[str, Any]:
    return {"seeds": part.seeds, "failed": part.failed, "planned": part.seeds}
