"""Runs of chapter 6 once more: steps of fixed rate, logs with other last digits, arms that differ.

What is run, on which seeds, and the words that come of it were announced before a row was looked at
(docs/decisions/0065-varied-runs.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude_studies.thesis.arm_runs import ARM_RUNS, LONG, ROUNDS, Settings

Varied = Mapping[str, tuple[str, Settings]]
STEPPED = ("A1", "A2", "A3", "A4", "A5", "A6", "A7", *(f"S{number}" for number in range(1, 10)))
"""Runs whose hyperparameters are trained by steps."""
CHAOTIC = ("A1", "A7")
"""Runs that carry chapter 6.3, and that another machine's rounding moves."""
HEADLINES = ("A1", "A2", "A3", "A5", "A7", "S1", "S2", "S9")
"""Runs behind schedule, rule, steps, design, and dictionary against SSGP."""
PLANTS: Mapping[str, tuple[str, dict[str, float]]] = {
    "lg": ("half the feedback gains", {"gain": 0.5}),
    "hg": ("twice the feedback gains", {"gain": 2.0}),
    "lf": ("0.7 of the friction", {"friction": 0.7}),
    "hf": ("1.5 times the friction", {"friction": 1.5}),
    "hn": ("twice the encoder noise", {"noise": 2.0}),
}
"""What each arm has, and its factors."""
SECOND_BLOCK = 20
"""First seed of the runs on these arms; no run before has it."""


def _again(run: str, rounds: int = ROUNDS, **more: Any) -> Settings:
    """A run's settings without lines beside it; keys of [model] are laid over its own."""
    settings = {name: value for name, value in ARM_RUNS[run][1].items() if name != "beside"}
    return {**settings, "rounds": rounds, **more, "model": {**settings["model"], **more.get("model", {})}}


DESCENT: Varied = {
    f"G{run}": (
        f"{run} with steps of fixed rate along the gradient",
        _again(run, model={"method": "descent"}),
    )
    for run in STEPPED
}
ROUNDED: Varied = {
    f"U{run}": (f"{run} on logs with other last digits", _again(run, LONG, rounding=1)) for run in CHAOTIC
}
ON_PLANTS: Varied = {
    f"V{run}{plant}": (f"{run} on an arm with {what}, new seeds", _again(run, plant=factors))
    for plant, (what, factors) in PLANTS.items()
    for run in HEADLINES
}
