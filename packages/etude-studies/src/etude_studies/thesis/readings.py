"""Other readings of the thesis: which runs and tests take others' places, and what the verdicts then are.

A reading is a change to settings. Every run that it concerns is exchanged for the run that has its settings
so changed; where the catalogue has none, the comparison has not been run so, whatever its other sides are.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from dataclasses import replace as changed_copy
from functools import cache
from typing import Any

import msgspec

from etude_studies.thesis.arm_runs import ARM_RUNS, DOWNSAMPLED, EVERY_SAMPLE, ONE_START, UNREFINED
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.contrasts import Values
from etude_studies.thesis.flights import FLIGHT_RUNS
from etude_studies.thesis.ledger import Claim, Ledger, Part
from etude_studies.thesis.part_verdicts import DEPENDS, NOT_RUN
from etude_studies.thesis.parts import read_so, run_of
from etude_studies.thesis.varied_runs import CHAOTIC, DESCENT, ON_PLANTS, PLANTS, ROUNDED
from etude_studies.thesis.verdicts import Verdict, judge, weighed


@dataclass(frozen=True)
class Reading:
    """The verdicts where the thesis is read otherwise, or another protocol takes its place.

    Attributes:
        name: a few words. ambiguity: id of what is read otherwise; "" if nothing of the thesis is.
        replace: runs by those that take their place, of every run that this concerns.
        tests, measures: those by others that take their place. verdicts: of the claims that this touches.
    """

    name: str
    ambiguity: str
    replace: Mapping[str, str]
    tests: Mapping[str, str] = field(default_factory=dict)
    measures: Mapping[str, str] = field(default_factory=dict)
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)


Settings = dict[str, Any]
Change = Callable[[Settings], Settings | None]
"""Settings read otherwise; the same where the reading is not about them, None where nothing expresses it."""
RECORDED = ("rounds", "beside", "described", "again", "source", "flights", "tests", "points", "steps")
"""Settings of what is recorded, how long, and how finely a design is searched."""
STEPS = 25
"""Of the preset."""


def missing(run: str) -> str:
    """What stands for a run that has not been run so."""
    return f"{run} (so read)"


def exchange(change: Change) -> dict[str, str]:
    """Every run that a change concerns, by the run that has its settings so changed."""
    runs = _settings()
    by_settings = {_canonical(settings): name for name, settings in reversed(runs.items())}
    out = {}
    for name, settings in runs.items():
        other = change(settings)
        if other is None:
            out[name] = missing(name)
        elif _canonical(other) != _canonical(settings):
            out[name] = by_settings.get(_canonical(other), missing(name))
    return out


@cache
def _settings() -> dict[str, Settings]:
    """Of every run of chapters 5 and 6."""
    runs = {**ARM_RUNS, **DESCENT, **ROUNDED, **ON_PLANTS}
    arms = {name: asdict(ArmSettings(**settings)) for name, (_, settings) in runs.items()}
    return arms | {name: asdict(settings) for name, (_, settings) in FLIGHT_RUNS.items()}


def _canonical(settings: Settings) -> str:
    relevant = {name: value for name, value in settings.items() if name not in RECORDED}
    return json.dumps(relevant, sort_keys=True, default=str)


def _arm(change: Change) -> Change:
    """A change to arms of the thesis's protocol alone."""
    return lambda settings: change(settings) if settings.get("preset") == "thesis" else settings


def _flight(change: Change, vehicle: str = "") -> Change:
    return lambda settings: change(settings) if vehicle in settings.get("vehicle", ()) else settings


def _key(name: str, old: Any, new: Any) -> Change:
    """A value in the place of another."""
    return lambda settings: {**settings, name: new} if settings.get(name) == old else settings


def _amplitude(settings: Settings) -> Settings | None:
    # designed trajectories begin with a random one, which no run draws so
    return None if settings["motions"] == "designed" else {**settings, "motions": "amplitude"}


def _evaluations(settings: Settings) -> Settings:
    steps = settings["model"].get("steps", STEPS)
    return {**settings, "model": {**settings["model"], "steps": -steps}} if steps > 0 else settings


def _descent(settings: Settings) -> Settings:
    stepped = settings["model"].get("steps", STEPS) > 0
    return {**settings, "model": {**settings["model"], "method": "descent"}} if stepped else settings


def _plant(factors: Mapping[str, float]) -> Change:
    return lambda settings: {**settings, "plant": factors}


def _growing_steps(settings: Settings) -> Settings:
    return (
        {**settings, "steps_grow": True} if settings["model"].get("schedule") == "reinitialise" else settings
    )


def _all_samples(settings: Settings) -> Settings:
    if not settings["model"].get("process", "").startswith("ssgp") or settings["data"] != DOWNSAMPLED:
        return settings
    more = {"data": {"rate_hz": 100.0}, "model": {**settings["model"], "fit_points": EVERY_SAMPLE}}
    return {**settings, **more}


def _search(design: Settings) -> Change:
    def change(settings: Settings) -> Settings:
        return (
            {**settings, "design": design}
            if settings["motions"] == "designed" and not settings["design"]
            else settings
        )

    return change


def _default(settings: Settings) -> Settings | None:
    # the protocol learns by other members of the family: nothing corresponds to the others
    designed = settings["motions"] == "designed"
    plain = settings["model"] == {"process": "thesis_dictionary_error"} and not settings["design"]
    criterion = {"criterion": "log_ivr"} if designed else {}
    return {**settings, "preset": "default", "model": {"rung": "gp"}, "design": criterion} if plain else None


def _ladder(settings: Settings) -> Settings | None:
    other = _default(settings)
    return None if other is None else {**other, "model": {"rung": "auto"}}


LEARN_THE_TEST = ("Y1",)
"""Runs that repeat the test motion to learn it."""
ON_PLANT = "an arm with "
"""How the names of readings on other arms begin."""
ON_EDGE, EXTREME = (dict.fromkeys(("uniform", "single", "fresh"), kind) for kind in ("boundary", "extreme"))
SLOW = exchange(_flight(_key("speed", None, 3.0), "quadrotor"))
HARMONICS = exchange(_flight(_key("harmonics", 2, 5), "quadrotor"))
KINEMATIC = exchange(_flight(lambda own: {**own, "acceleration": "kinematic"}, "pelican"))
FROM_GROUND = exchange(_flight(_key("from_ground", False, True), "pelican"))
FLOOR = exchange(_flight(_key("noise_floor", None, 0.2), "quadrotor"))
RANDOM = exchange(_arm(_amplitude)) | exchange(_flight(_key("arm", "uniform", "scaled")))
ONE = exchange(_arm(_search(ONE_START))) | exchange(_flight(_key("arm", "designed", "designed_one_start")))
EQUAL = "R4"
"""The ambiguity whose readings are all as good: none of them is the headline."""
DECIDED = ("holds", "reversed", "tie")
AROUND = {f"{run}t": run for run in ("A1", "A7", "S1", "S9")}
WINDOWS = {"after_reversal": "reversal_share", "stuck_after": "stuck_share"}
"""Rows of runs over time, and of the runs that they are of."""
READINGS: Sequence[Reading] = (
    Reading("random trajectories drawn again", "", exchange(_arm(_key("draw", 0, 1)))),
    Reading("logs with other last digits", "", {run: f"U{run}" for run in CHAOTIC}),
    *(Reading(f"{ON_PLANT}{what}", "", exchange(_arm(_plant(factors)))) for what, factors in PLANTS.values()),
    Reading("feedforward fades", "R1", {run: f"{run}:faded" for run in ARM_RUNS}),
    Reading("random amplitudes, flights of random size", "R2", RANDOM),
    Reading("random flights on the edge", "R2", exchange(_flight(_key("arm", "uniform", "boundary")))),
    Reading("a base frequency for each joint", "R3", exchange(_arm(_key("own_omega0", False, True)))),
    Reading("steps are evaluations of the likelihood", "R4", exchange(_arm(_evaluations))),
    Reading("steps have a fixed rate along the gradient", "R4", exchange(_arm(_descent))),
    Reading("reinitialised with as many steps in all", "R4", exchange(_arm(_growing_steps))),
    Reading("designs from one random start", "R5", ONE),
    Reading("spectrum on all samples", "R7", exchange(_arm(_all_samples))),
    Reading("kinematic acceleration on the Pelican", "R12", KINEMATIC),
    Reading("the Pelican's first flight from take-off to landing", "", FROM_GROUND),
    Reading("a noise floor of 0.2 deviations", "", FLOOR),
    Reading("flights up to 3 m/s", "", SLOW),
    Reading("five harmonics", "", HARMONICS),
    Reading("best of 24 random, not refined", "", exchange(_arm(_search(UNREFINED)))),
    Reading("default protocol, process alone", "", exchange(_arm(_default))),
    Reading("default protocol, ladder", "", exchange(_arm(_ladder))),
    Reading("the window around reversals", "", AROUND, measures=WINDOWS),
    Reading("one test motion common to all seeds", "", {}, {"fourier": "common"}),
    Reading("point-to-point moves as the test", "", {}, {"fourier": "moves"}),
    Reading("uniform test flights", "", {}, dict.fromkeys(("single", "fresh"), "uniform")),
    Reading("one test flight for each seed", "", {}, {"uniform": "single"}),
    Reading("test flights on the edge", "", {}, ON_EDGE),
    Reading("extreme test flights", "", {}, EXTREME),
    Reading("flights up to 3 m/s, extreme test flights", "", SLOW, EXTREME),
    Reading("five harmonics, extreme test flights", "", HARMONICS, EXTREME),
)


def readings(
    ledger: Ledger,
    results: Values,
    *,
    planned: Mapping[str, int] | None = None,
    blocks: Mapping[str, int] | None = None,
    among: Sequence[Reading] = READINGS,
) -> list[Reading]:
    """Each with the verdicts on the claims that it touches; `planned` and `blocks` as of `judge`."""
    usual = weighed(ledger, results, planned=planned, blocks=blocks)
    out = []
    for reading in among:
        read = {claim.id: tuple(_read(reading, part) for part in claim.parts) for claim in ledger.claims}
        claims = tuple(msgspec.structs.replace(claim, parts=read[claim.id]) for claim in ledger.claims)
        whole = Ledger(claims, ledger.entries, ledger.ambiguities)
        verdicts = judge(whole, results, planned=planned, usual=usual)
        out.append(changed_copy(reading, verdicts=_touched(ledger, verdicts, read)))
    return out


def depending(verdicts: Mapping[str, Verdict], others: Sequence[Reading]) -> dict[str, Verdict]:
    """The verdicts, DEPENDS in the place of a decided word that is another one under an equal reading."""
    return {
        id: _depending(verdict, [one for one in others if id in one.verdicts])
        for id, verdict in verdicts.items()
    }


def _depending(verdict: Verdict, others: Sequence[Reading]) -> Verdict:
    words = {one.name: one.verdicts[verdict.claim].word for one in others}
    decided = {name: word for name, word in words.items() if word in DECIDED}
    if verdict.word not in DECIDED or set(decided.values()) <= {verdict.word}:
        return verdict
    beside = [f"{name}: {decided.get(name, NOT_RUN)}" for name in words]
    reason = "; ".join([f"steps are line searches: {verdict.word}", *beside])
    return msgspec.structs.replace(verdict, word=DEPENDS, reason=reason)


def _read(reading: Reading, part: Part) -> Part:
    """A part so read; where two conditions make a reading, it has to change both or it is another's.

    The test of what has learned that very motion is no other motion.
    """
    if reading.tests and {run_of(source) for source in part.sources} & set(LEARN_THE_TEST):
        return part
    other = read_so(part, reading.replace, reading.tests, reading.measures)
    both = reading.replace and reading.tests
    alone = (read_so(part, reading.replace), read_so(part, {}, reading.tests))
    return part if both and part in alone else other


def _touched(
    ledger: Ledger, verdicts: Mapping[str, Verdict], read: Mapping[str, tuple[Part, ...]]
) -> dict[str, Verdict]:
    def changes(claim: Claim) -> bool:
        originals = [ledger.claim(id) for id in claim.alias_of] or [claim]
        return any(one.parts != read[one.id] for one in originals)

    return {claim.id: verdicts[claim.id] for claim in ledger.claims if changes(claim)}
