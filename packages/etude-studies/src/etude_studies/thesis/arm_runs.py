"""The runs of chapter 6 by name: what each is, in a sentence and in settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from etude_studies.spec import Spec
from etude_studies.thesis.excitations import WAVES

ROUNDS, LONG = 6, 10
DOWNSAMPLED = {"rate_hz": 100.0 / 12.0, "offset": "first"}
"""Each 12th of 6000 samples, from the first on (thesis 6.2)."""
EVERY_SAMPLE = 6000 * ROUNDS

Settings = dict[str, Any]
Rule = Literal["error", "variance"]


def _dictionary(other: Settings | None = None, rule: Rule = "error", **more: Any) -> Settings:
    """500 points, random motions."""
    other = {**(other or {}), **more}
    model = {"process": f"thesis_dictionary_{rule}", **other.pop("model", {})}
    return {"rounds": ROUNDS, "model": model, **other}


def _spectrum(steps: int, schedule: str = "reinitialise", *, learned: bool = True, **other: Any) -> Settings:
    """200 spectral points on the downsampled logs."""
    process = "ssgp_learned" if learned else "ssgp_fixed"
    model = {
        "process": process,
        "basis": 200,
        "fit_points": 500 * ROUNDS,
        "steps": steps,
        "schedule": schedule,
    }
    return {"rounds": ROUNDS, "data": DOWNSAMPLED, "model": model | other.pop("model", {}), **other}


def _member(process: str, points: int = 500 * ROUNDS) -> Settings:
    """Another member of the family, on the samples of full regression; hyperparameters of 500 of them."""
    model = {"process": process, "basis": 200, "points": points, "fit_points": 500}
    return {"rounds": ROUNDS, "data": DOWNSAMPLED, "model": model}


def _evaluated(steps: int, schedule: str = "", rule: Rule = "error") -> Settings:
    """A dictionary whose steps are evaluations of the likelihood."""
    keys = {"schedule": schedule} if schedule else {}
    return _dictionary({"model": {"steps": -steps, **keys}}, rule)


def _default(rung: str, criterion: str = "", **other: Any) -> Settings:
    """The default protocol; random motions without a criterion."""
    design = {"criterion": criterion} if criterion else {}
    motions = "designed" if criterion else "scaled"
    model = {"rung": rung, **other.pop("model", {})}
    return {
        "preset": "default",
        "rounds": ROUNDS,
        "motions": motions,
        "model": model,
        "design": design,
        **other,
    }


_FULL = {"process": "exact", "points": 500 * ROUNDS, "fit_points": 500 * ROUNDS}
_LONG: Settings = {"rounds": LONG, "beside": True, "described": True, "again": 5}
_DESIGNED: Settings = {"motions": "designed", "beside": True}
ONE_START = {"candidates": 1, "refine": 1}
UNREFINED = {"candidates": 24, "refine": 0}
_RAW = {"inputs": "measured", "cutoff_hz": "none"}
_AT_ONCE = {"process": "exact", "points": 500, "fit_points": 500}

ARM_RUNS: Mapping[str, tuple[str, Settings]] = {
    "A0": ("dictionary by error, hyperparameters not trained, random", _dictionary(model={"steps": 0})),
    "A1": ("dictionary by error, 25 steps, updated, random", _dictionary(_LONG)),
    "A2": ("dictionary by error, constant hyperparameters", _dictionary(model={"schedule": "constant"})),
    "A3": ("dictionary by error, 25 steps, reinitialised", _dictionary(model={"schedule": "reinitialise"})),
    "A4": ("dictionary by error, 100 steps, updated", _dictionary(model={"steps": 100})),
    "A5": ("dictionary by variance, 25 steps, updated, random", _dictionary(rule="variance")),
    "A6": ("full GPR on every 12th sample, random", {"rounds": ROUNDS, "data": DOWNSAMPLED, "model": _FULL}),
    "A7": ("dictionary by error, 25 steps, updated, designed", _dictionary(_LONG | _DESIGNED)),
    "S1": ("SSGP, learned points, 5 steps, reinitialised, random", _spectrum(5, described=True)),
    "S2": ("SSGP, learned points, 25 steps", _spectrum(25, described=True)),
    "S3": ("SSGP, learned points, constant hyperparameters", _spectrum(5, "constant")),
    "S4": ("SSGP, learned points, 5 steps, updated", _spectrum(5, "update")),
    "S5": ("SSGP, fixed points, 5 steps, reinitialised, random", _spectrum(5, learned=False)),
    "S6": ("SSGP, fixed points, 25 steps", _spectrum(25, learned=False)),
    "S7": ("SSGP, fixed points, constant hyperparameters", _spectrum(5, "constant", learned=False)),
    "S8": ("SSGP, fixed points, 5 steps, updated", _spectrum(5, "update", learned=False)),
    "S9": ("SSGP, learned points, 5 steps, designed", _spectrum(5, described=True) | _DESIGNED),
    "X1": ("A1 on a second draw of trajectories, same tests", _dictionary(draw=1)),
    "X2": ("A1 on random motions of random amplitude", _dictionary(motions="amplitude")),
    "X3": ("A1 with a base frequency for each joint", _dictionary(own_omega0=True)),
    "X4": ("A7 with a base frequency for each joint", _dictionary(own_omega0=True, motions="designed")),
    "X5a": ("A1 with 25 evaluations of the likelihood", _dictionary(model={"steps": -25})),
    "X5b": (
        "A3 with 25 evaluations of the likelihood",
        _dictionary(model={"steps": -25, "schedule": "reinitialise"}),
    ),
    "X5c": ("A2 with 25 evaluations of the likelihood", _evaluated(25, "constant")),
    "X5d": ("A4 with 100 evaluations of the likelihood", _evaluated(100)),
    "X5e": ("A5 with 25 evaluations of the likelihood", _evaluated(25, rule="variance")),
    "X5f": (
        "A6 with 25 evaluations of the likelihood",
        {"rounds": ROUNDS, "data": DOWNSAMPLED, "model": {**_FULL, "steps": -25}},
    ),
    "X5g": ("A7 with 25 evaluations of the likelihood", _evaluated(25) | {"motions": "designed"}),
    "X6c": ("S3 with 5 evaluations of the likelihood", _spectrum(-5, "constant")),
    "X6d": ("S4 with 5 evaluations of the likelihood", _spectrum(-5, "update")),
    "X6e": ("S5 with 5 evaluations of the likelihood", _spectrum(-5, learned=False)),
    "X6f": ("S6 with 25 evaluations of the likelihood", _spectrum(-25, learned=False)),
    "X6g": ("S7 with 5 evaluations of the likelihood", _spectrum(-5, "constant", learned=False)),
    "X6h": ("S8 with 5 evaluations of the likelihood", _spectrum(-5, "update", learned=False)),
    "X6i": ("S9 with 5 evaluations of the likelihood", _spectrum(-5) | {"motions": "designed"}),
    "X6a": ("S1 with 5 evaluations of the likelihood", _spectrum(-5)),
    "X6b": ("S2 with 25 evaluations of the likelihood", _spectrum(-25)),
    "X7": (
        "A3 with as many steps in all as A1 has had by then",
        _dictionary(model={"schedule": "reinitialise"}, steps_grow=True),
    ),
    "X8": ("A7 from one random start", _dictionary(motions="designed", design=ONE_START)),
    "X9": ("A1 on measured positions, differentiated without a filter", _dictionary(data=_RAW)),
    "X11": (
        "S1 on all samples",
        _spectrum(5, data={"rate_hz": 100.0}, model={"fit_points": EVERY_SAMPLE}),
    ),
    "X13": (
        "the best of 24 random trajectories, not refined",
        _dictionary(motions="designed", design=UNREFINED),
    ),
    "X14": (
        "exact on 500 samples, evenly spread over all trajectories",
        {"rounds": ROUNDS, "data": DOWNSAMPLED, "model": _AT_ONCE},
    ),
    "Y2": ("LWPR on A6's samples", _member("lwpr")),
    "Y3": ("SPGP with 200 inducing inputs on A6's samples", _member("fitc")),
    "Y4": ("SOGP with 200 basis points on A6's samples", _member("sogp")),
    "Y7": ("local GPs of at most 500 samples each on A6's samples", _member("local_gp", points=500)),
    "W1": ("A1 on an arm on a wheeled base", _dictionary(robot="mobile_arm", beside=True)),
    "DP1": ("default protocol, process alone, random", _default("gp", beside=True)),
    "DP2": ("default protocol, process alone, designed by log_ivr", _default("gp", "log_ivr")),
    "DP3": ("default protocol, ladder, random", _default("auto")),
    "DP4": ("default protocol, ladder, designed by log_ivr", _default("auto", "log_ivr")),
}
_SMALL: Settings = {"points": 40, "fit_points": 40, "steps": 2}
MINIATURE: Mapping[str, tuple[str, Settings]] = {
    "mA1": ("A1 in miniature", _dictionary(rounds=2, model=_SMALL, beside=True, described=True, again=2)),
    "mA5": ("A5 in miniature", _dictionary(rule="variance", rounds=2, model=_SMALL)),
    "mA6": ("A6 in miniature", {"rounds": 2, "data": DOWNSAMPLED, "model": {"process": "exact", **_SMALL}}),
    "mA7": ("A7 in miniature", _dictionary(motions="designed", rounds=2, model=_SMALL)),
    "mS1": ("S1 in miniature", _spectrum(1, rounds=2, model={"basis": 10, "fit_points": 60})),
    "mS5": ("S5 in miniature", _spectrum(1, learned=False, rounds=2, model={"basis": 10, "fit_points": 60})),
    "mGA1": ("GA1 in miniature", _dictionary(rounds=2, model={**_SMALL, "method": "descent"})),
    "mUA1": ("UA1 in miniature", _dictionary(rounds=2, model=_SMALL, rounding=1)),
    "mVA1hg": ("VA1hg in miniature", _dictionary(rounds=2, model=_SMALL, plant={"gain": 2.0})),
    "mDP1": ("DP1 in miniature", _default("gp", rounds=2, model={"points": 60, "steps": 5})),
}
"""A run of each family that takes seconds: does all of it work here?"""
CONTROLLERS = {
    "B0": ("feedback alone", "pd"),
    "B1": ("exact inverse", "exact"),
    "B2": ("exact inverse of the arm without friction", "frictionless"),
}


def arm_spec(settings: Mapping[str, Any], seed: int) -> Spec:
    """A run with the motions that it shares with others of its seed."""
    shared = ("robot", "preset", "draw", "own_omega0")
    draw_settings = {name: settings[name] for name in shared if name in settings}
    motions = settings.get("motions", "scaled")
    draw_settings["motions"] = motions if motions in ("amplitude", *WAVES) else "scaled"
    draws = Spec("etude_studies.thesis.arm_motions:draws", draw_settings, seed)
    return Spec("etude_studies.thesis.arm:run", settings, seed, [draws])


def baseline_spec(controller: str, seed: int, robot: str = "arm4") -> Spec:
    """A line that learns nothing."""
    settings = {"robot": robot, "rounds": LONG, "controller": controller}
    return Spec("etude_studies.thesis.arm:baseline", settings, seed)
