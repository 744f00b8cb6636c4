"""`etude bench odds`: how often what is decided of commands is true, over simulated arms right and wrong.

Each number stands for one arm, one motion and one fault: the log is judged as it is, and with the fault.
Arms have two to seven joints. Their lengths, masses, frictions, speeds and model files (masses 30 % off, or
none) are drawn. Two in five are the simulated arms of four joints. Numbers that were judged are files in
results/odds and are not judged again, so a run goes on where another ended.
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from etude.logs import Decision, Mendable, finding_of, sign_decision
from etude.protocols import Mean
from etude.storage import write_atomic
from etude.types import Array, Log
from etude_studies.engines.each import each
from etude_studies.rows import Row, rows_json, table
from etude_studies.seven_joints import LIGHT, Built, SevenJoints, body, described
from etude_studies.truth_logs import ARMS, Source, load
from etude_studies.world import one_period

FOLDER = Path("results/odds")
COUNT, QUICK, WORKERS = 1000, 20, 2
FIRST = 50_000
"""Of the seeds: those of the tests and of `etude bench truth` differ."""
MASSES_OFF = 0.3
ENDS = ("repaired", "asked", "silent", "asked_of_others", "repaired_wrong")
STATED = (3.0, 7.0, 14.0, 30.0, np.inf)
"""Edges of stated log odds, each group of which is counted by itself."""


class Verdict(msgspec.Struct, frozen=True):
    """What was decided of one log.

    Attributes:
        robot, file: which arm, and whether its model file was known.
        fault: "" of the right log, "sign" or "swapped". truth: the signs, or the column of each joint.
        level, check, by, odds, ahead: as in `Decision`. offered: a repair was.
        told: of the log as it is, log odds of each moving joint's sign to the other one.
        seconds: of CPU.
    """

    robot: str
    file: bool
    fault: str
    truth: tuple[float, ...]
    level: str
    check: str
    by: tuple[float, ...]
    odds: float
    ahead: float
    offered: bool
    told: tuple[float, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class Case:
    """One arm's log. body: of its model file, if it is known."""

    robot: str
    log: Log
    body: Mean | None


def run(*, json: bool = False, seed: int = 0, quick: bool = False) -> list[Row]:
    """Judges `COUNT` right and as many wrong logs and prints the rows; `quick`: 20 of each."""
    numbers = range(FIRST + seed, FIRST + seed + (QUICK if quick else COUNT))
    verdicts = [v for pair in each(partial(kept, folder=FOLDER), numbers, WORKERS) for v in pair]
    rows = odds_rows(verdicts)
    if json:
        print(rows_json(rows, "etude bench odds" + " --quick" * quick + " --json"))  # noqa: T201
    else:
        table(rows, "odds of decisions")
    return rows


def kept(number: int, folder: Path) -> list[Verdict]:
    """What was decided of one number's two logs, from its file if it was judged before."""
    path = folder / f"{number}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, msgspec.json.encode(judged(number)))
    return msgspec.json.decode(path.read_bytes(), type=list[Verdict])


def judged(number: int) -> list[Verdict]:
    """Of the right log and of the wrong one."""
    rng = np.random.default_rng([number, 31])
    case = made(number, rng)
    joints = case.log["command"].shape[1]
    fault, truth = FAULTS[int(rng.integers(len(FAULTS)))](joints, rng)
    right = np.arange(joints, dtype=np.float64) if fault == "swapped" else np.ones(joints)
    return [verdict(case, "", right), verdict(case, fault, truth)]


def _signs(share: float, joints: int, rng: np.random.Generator) -> tuple[str, Array]:
    """One joint, or about so many, at least one, are inverted."""
    turned = rng.random(joints) < share
    turned[rng.integers(joints)] = True
    return "sign", np.where(turned, -1.0, 1.0)


def _pair(joints: int, rng: np.random.Generator) -> tuple[str, Array]:
    order = np.arange(joints, dtype=np.float64)
    a, b = rng.choice(joints, 2, replace=False)
    order[[a, b]] = order[[b, a]]
    return "swapped", order


FAULTS: tuple[Callable[[int, np.random.Generator], tuple[str, Array]], ...] = (
    partial(_signs, 0.0),
    partial(_signs, 0.4),
    partial(_signs, 1.0),
    _pair,
)


def driven(built: Built, rng: np.random.Generator) -> Log:
    """A log of the arm."""
    none = (0.0,) * len(built.limit)
    robot = SevenJoints(friction=float(np.exp(rng.uniform(-1.5, 1.5))), sensor=none, built=built)
    motion = robot.world.motion(rng, **one_period(float(rng.uniform(8.0, 60.0))))
    return robot.run(motion, None, rng)


def made(number: int, rng: np.random.Generator) -> Case:
    """An arm and its log."""
    if number % 5 < len(ARMS):
        _, log = load(Source(f"{ARMS[number % 5]}_{number}", False, seed=number))
        return Case(ARMS[number % 5], log, None)
    built = drawn_arm(rng)
    log = driven(built, rng)
    return Case(f"{len(built.links)} joints", log, _file(built, rng) if rng.random() < 0.5 else None)


def drawn_arm(rng: np.random.Generator) -> Built:
    """The first joints of a light arm, as another maker would build it."""
    joints, speed = int(rng.integers(2, 8)), float(np.exp(rng.uniform(-2.5, 0.0)))
    links = tuple(
        (length * rng.uniform(0.6, 1.5), mass * rng.uniform(0.5, 2.0), limit)
        for length, mass, limit in LIGHT.links[:joints]
    )
    parts = {name: getattr(LIGHT, name)[:joints] for name in ("lower", "upper")}
    rates = {"velocity": (speed,) * joints, "acceleration": (2.5 * speed,) * joints}
    return Built(links, **parts, **rates, rough=float(rng.choice([0.0, 0.4])))


def _file(built: Built, rng: np.random.Generator) -> Mean:
    """What a model file with other masses says."""
    described.cache_clear()
    body.cache_clear()
    return body(0.0, other_masses(built, rng))


def other_masses(built: Built, rng: np.random.Generator) -> Built:
    """The arm as a model file with other masses describes it."""
    off = rng.uniform(1.0 - MASSES_OFF, 1.0 + MASSES_OFF, len(built.links))
    links = tuple(
        (length, mass * by, limit) for (length, mass, limit), by in zip(built.links, off, strict=True)
    )
    return replace(built, links=links)


def verdict(case: Case, fault: str, truth: Array) -> Verdict:
    """What is decided of the log with that fault."""
    log, path = case.log, case.log.channels["q"]
    if fault:
        command = log["command"] * truth if fault == "sign" else log["command"][:, truth.astype(np.int64)]
        log = log.put(log.channels["command"], np.ascontiguousarray(command))
    start = time.process_time()
    decision = sign_decision([log], path, case.body, accepted=("delay",))
    offered = decision.level != "silent" and isinstance(finding_of(decision, path.parts, [""]), Mendable)
    return Verdict(
        case.robot,
        case.body is not None,
        fault,
        tuple(truth.tolist()),
        decision.level,
        decision.check,
        decision.by,
        float(decision.odds),
        float(min(decision.ahead, 1e9)),
        offered,
        tuple(decision.sign_odds[decision.moving].tolist()) if fault != "sign" else _against(decision, truth),
        time.process_time() - start,
    )


def _against(decision: Decision, truth: Array) -> tuple[float, ...]:
    """Log odds of the true sign to the other one."""
    return tuple((decision.sign_odds * truth)[decision.moving].tolist())


def end(verdict: Verdict) -> str:
    """Which of ENDS a wrong log came to."""
    if verdict.level == "silent":
        return "silent"
    same_check = verdict.check == verdict.fault
    if verdict.offered:
        return "repaired" if same_check and verdict.by == verdict.truth else "repaired_wrong"
    about = _about(verdict.check, verdict.by) == _about(verdict.fault, verdict.truth)
    return "asked" if same_check and about else "asked_of_others"


def _about(check: str, by: Sequence[float]) -> set[int]:
    return {i for i, value in enumerate(by) if (value < 0.0 if check == "sign" else value != i)}


def odds_rows(verdicts: Sequence[Verdict]) -> list[Row]:
    """Right logs refused and asked, what wrong ones came to, how often signs are what the stated odds say."""
    right = [v for v in verdicts if not v.fault]
    rows = [
        Row(f"right_{what}", sum(v.level == level for v in right), "1", "of", len(right))
        for what, level in (("refused", "certain"), ("asked", "ask"))
    ]
    for fault in ("sign", "swapped"):
        ends = Counter(end(v) for v in verdicts if v.fault == fault)
        rows += [Row(f"{fault}_{name}", ends[name], "1", "of", ends.total()) for name in ENDS]
    log_odds = np.array([odds for v in verdicts if v.fault != "swapped" for odds in v.told])
    for low, high in itertools.pairwise(STATED):
        stated = log_odds[(np.abs(log_odds) >= low) & (np.abs(log_odds) < high)]
        rows.append(Row(f"wrong_signs_stated_{low:.0f}", int((stated < 0.0).sum()), "1", "of", len(stated)))
    seconds = [v.seconds for v in verdicts]
    return [*rows, Row("cpu_of_a_log", float(np.mean(seconds)) if seconds else 0.0, "s")]
