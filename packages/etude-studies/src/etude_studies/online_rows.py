"""The rows `online_pass3_*` of `etude bench models`: the third pass of a repeated motion, learned on line."""

from __future__ import annotations

import numpy as np

from etude_studies.online import RULES, Cell, Outcome, outcomes_of
from etude_studies.rows import Row, mean_rows

ROBOT = "arm4"
SEEDS, QUICK_SEEDS = 6, 1
QUICK_RULES = ("none", "variance", "ssgp")


def online_rows(rng: np.random.Generator, quick: bool = False) -> list[Row]:
    """Tracking error of the third pass, mean over the joints: `online_pass3_deg` for the variance rule.

    The others' are `online_pass3_<rule>_deg`; all beside that without updates on the same motions. `quick`
    leaves out the two rules that tell least: another dictionary, and the other process with basis points.
    """
    rules = {name: config for name, config in RULES.items() if not quick or name in QUICK_RULES}
    seeds = rng.integers(2**31, size=QUICK_SEEDS if quick else SEEDS).tolist()
    outcomes = [outcomes_of(Cell(ROBOT, "same", seed), rules) for seed in seeds]
    without = [_third_pass(by_rule["none"]) for by_rule in outcomes]
    rows = []
    for rule in rules:
        if rule != "none":
            name = "online_pass3_deg" if rule == "variance" else f"online_pass3_{rule}_deg"
            named = f"without updates, {len(seeds)} seeds"
            rows += mean_rows(
                name, [_third_pass(by_rule[rule]) for by_rule in outcomes], "deg", named, without
            )
    return rows


def _third_pass(outcome: Outcome) -> float:
    return float(np.mean(outcome.errors[-1]))
