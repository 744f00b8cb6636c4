"""Runs beyond the thesis, in Étude's default protocol: criteria, unmodelled physics, one factor at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude_studies.thesis.arm_runs import ROUNDS, Settings

CRITERIA = ("mean_variance", "info_gain", "ivr", "sum_log", "mi_region")
"""Beside log_ivr, which is DP2."""
ROUGH = "arm4_rough"
FACTORS: Mapping[str, tuple[str, Settings]] = {
    "inputs": ("desired inputs", {"data": {"inputs": "desired"}}),
    "filter": ("no filter", {"data": {"cutoff_hz": "none"}}),
    "friction": (
        "the ARD-SE kernel and no friction inputs, which the structured kernel is made of",
        {"data": {"friction_fraction": 0.0}, "model": {"kernel": "ard_se"}},
    ),
    "mask": ("no stick mask", {"data": {"stick_fraction": 0.0}}),
    "kernel": ("ARD-SE kernel", {"model": {"kernel": "ard_se"}}),
    "prior": ("no prior", {"model": {"prior": "none"}}),
    "floor": ("no noise floor", {"model": {"noise_floor": 0.0}}),
}
"""What the default protocol has and the thesis's has not, each taken away from DP1 alone."""


def _process(rung: str, robot: str = "arm4", criterion: str = "", **other: Any) -> Settings:
    settings: Settings = {"robot": robot, "preset": "default", "rounds": ROUNDS, "model": {"rung": rung}}
    if criterion:
        settings |= {"motions": "designed", "design": {"criterion": criterion}}
    for table, keys in other.items():
        settings[table] = {**settings.get(table, {}), **keys} if isinstance(keys, Mapping) else keys
    return settings


def _criteria() -> dict[str, tuple[str, Settings]]:
    return {
        f"DC_{name}": (f"default protocol, process alone, designed by {name}", _process("gp", criterion=name))
        for name in CRITERIA
    }


def _excitations() -> dict[str, tuple[str, Settings]]:
    return {
        "DE_chirp": ("DP1 on chirps", _process("gp", motions="chirp")),
        "DE_prbs": ("DP1 on pseudo-random binary velocities", _process("gp", motions="prbs")),
        "DE_condition": ("DP1 on motions of least condition number", _process("gp", motions="condition")),
        "DE_d_opt": ("DP1 designed by d_opt", _process("gp", criterion="d_opt")),
    }


def _unmodelled() -> dict[str, tuple[str, Settings]]:
    rungs = {
        "gp": "process alone",
        "identified+gp": "identified and process",
        "identified": "identified alone",
    }
    runs = {}
    for rung, what in rungs.items():
        name = f"DU_{rung.replace('+', '_')}"
        runs[name] = (f"arm with unmodelled physics, {what}, random", _process(rung, ROUGH))
        if rung.endswith("gp"):
            designed = _process(rung, ROUGH, "log_ivr")
            runs[f"{name}_designed"] = (f"arm with unmodelled physics, {what}, designed", designed)
    return runs


def _ablations() -> dict[str, tuple[str, Settings]]:
    return {
        f"DA_{name}": (f"DP1 with {what}", _process("gp", **changed))
        for name, (what, changed) in FACTORS.items()
    }


BEYOND_RUNS: Mapping[str, tuple[str, Settings]] = {
    **_criteria(),
    **_excitations(),
    **_unmodelled(),
    **_ablations(),
}
BEYOND_LINES: Mapping[str, tuple[str, str]] = {
    "DU_pd": ("arm with unmodelled physics, feedback alone", "pd"),
    "DU_nominal": ("arm with unmodelled physics, exact inverse of the arm without", "nominal"),
    "DU_exact": ("arm with unmodelled physics, exact inverse", "exact"),
}
