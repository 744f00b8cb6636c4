"""How soon a supervisor notices what goes wrong with a robot, and how often it stops a sound one.

    python tests/drivers/measure_faults.py faults.jsonl --runs 1000
    python tests/drivers/measure_faults.py faults.jsonl --table

Robots are of 2 to 7 joints, on a clock of their own, with feedback of other stiffness and noise each. Bounds
are those of use: twice the worst errors that a sound run of the robot has shown. Runs that stand in the file
are not run again.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from etude.drivers import Bounds, Ended, PlannedMotion, Recording, Streamed, Supervisor, planned
from etude.testing import FAULTS, FakeRobot, Faulty
from etude.trajectories import PointToPoint

TARGETS = {"blocked": 0.2, "frozen": 0.1, "silence": 0.4, "silence 1 s": 0.4}
"""s from the fault to the first set-point that brakes."""
BRAKED, LAGS = 0.05, 3.0
"""s, and time constants of the robot's feedback, that rest may come later than the braking itself."""
STILL = 0.02
"""rad/s"""


def robot(rng: np.random.Generator, motion: PlannedMotion, seed: int) -> Callable[[], FakeRobot]:
    """A maker of one robot, whose noise differs each time."""
    stiffness, part = float(rng.uniform(200, 2000)), float(rng.uniform(0.0, 0.9))
    noise, seeds = float(10 ** rng.uniform(-5, -3.5)), iter(range(seed, seed + 100))
    start = motion.q[0]

    def made() -> FakeRobot:
        off = 1.0 + 0.05 * rng.uniform(-1, 1)  # it is not the same each day
        return FakeRobot(
            motion.joints, motion.rate, start, off * stiffness, part, noise=noise, seed=next(seeds)
        )

    return made


def motion_of(rng: np.random.Generator) -> PlannedMotion:
    """Moves through random places, 250 Hz."""
    count = int(rng.integers(2, 8))
    names = [f"joint{number}" for number in range(count)]
    places = rng.uniform(-1.2, 1.2, (5, count))
    path = PointToPoint(places, float(rng.uniform(0.5, 2.0)), dwell=0.1, peak_acceleration=8.0)
    text = path.to_json().encode()
    return planned(text, number=1, part="motion", speed=100, names=names, joints=names, rate=250.0)


def struck_at(rng: np.random.Generator, motion: PlannedMotion) -> tuple[int, float]:
    """A joint and a time (s) at which it moves: of a joint that rests a fault shows when it is to move."""
    joint = int(rng.integers(motion.q.shape[1]))
    speed = np.abs(motion.qd[:, joint])
    moves = np.flatnonzero((speed > 0.3 * speed.max()) & (motion.t < motion.duration - 0.5))
    return joint, float(motion.t[rng.choice(moves)])


def bounds_of(sound: Supervisor, motion: PlannedMotion) -> Bounds:
    """As after a first run that was measured."""
    error = np.maximum(2.0 * sound.worst_error, 2e-3)
    low, high = motion.q.min(axis=0) - 0.2, motion.q.max(axis=0) + 0.2
    return Bounds(np.minimum(error, 0.2), low, high, 1.5 * np.abs(motion.qd).max(axis=0) + 0.1)


def wide(motion: PlannedMotion) -> Bounds:
    ones = np.ones(motion.q.shape[1])
    return Bounds(ones, -9 * ones, 9 * ones, 99 * ones)


def run(seed: int) -> Mapping[str, Any]:
    """One run, of the fault whose turn it is."""
    rng = np.random.default_rng(seed)
    fault = list(FAULTS)[seed % len(FAULTS)]
    motion = motion_of(rng)
    make = robot(rng, motion, 1000 * seed)
    calm = make()
    sound = Supervisor(wide(motion), calm.about(), motion)
    with Streamed(calm) as player:
        first = player.play(motion, sound.watch, "feedback")
    assert first.ended is Ended.DONE
    joint, after = struck_at(rng, motion)
    own = make()
    size = {"push": 60.0}.get(fault, 1.0)
    faulty = Faulty(own, fault, after, joint, size * float(rng.choice([-1.0, 1.0])))
    bounds = bounds_of(sound, motion)
    supervisor = Supervisor(bounds, own.about(), motion)
    with Streamed(faulty) as player:
        recording = player.play(motion, supervisor.watch, "feedback")
    return {
        "seed": seed,
        "fault": fault,
        "ended": recording.ended.value,
        "right": recording.ended in FAULTS[fault].ends,
        "reason": supervisor.reason or recording.reason,
        **times(own, faulty, recording, motion),
        "left": left(own, bounds, fault == "push"),
    }


def times(own: FakeRobot, faulty: Faulty, recording: Recording, motion: PlannedMotion) -> Mapping[str, float]:
    """s from the fault to the last set-point of the path, from that to rest less the braking, and how late
    that may be: a robot lags behind its set-points by its own feedback.
    """
    if recording.ended in (Ended.DONE, Ended.REFUSED) or not own.truth:
        return {}
    truth, sent = np.array(own.truth), np.array(own.sent)
    count = motion.q.shape[1]
    last = np.array([np.interp(recording.reached, motion.t, q) for q in motion.q.T])
    struck = int(np.searchsorted(truth[:, 0], faulty.struck))
    stop = struck + int(np.argmin(np.abs(sent[struck:] - last).max(axis=1))) if struck < len(sent) else -1
    asked = np.abs([np.interp(recording.reached, motion.t, qd) for qd in motion.qd.T])
    braking = min(float((1.5 * asked / np.abs(motion.qdd).max(axis=0)).max()), 1.0)
    moves = np.flatnonzero(np.abs(truth[:, 1 + count :]).max(axis=1) > STILL)
    rest = float(truth[moves[-1], 0]) if len(moves) else 0.0
    return {
        "noticed": float(truth[stop, 0]) - faulty.struck,
        "rest": rest - float(truth[stop, 0]) - braking,
        "allowed": BRAKED + LAGS / float(np.sqrt(own.stiffness)),
    }


def left(own: FakeRobot, bounds: Bounds, pushed: bool) -> bool:
    """Whether the true robot left a limit of position, or one of velocity that no push made it leave."""
    if not own.truth:
        return False
    truth, count = np.array(own.truth), len(bounds.lower)
    q, qd = truth[:, 1 : 1 + count], np.abs(truth[:, 1 + count :])
    inside = np.all((q >= bounds.lower) & (q <= bounds.upper))
    return not bool(inside and (pushed or np.all(qd <= bounds.velocity)))


def table(rows: list[dict[str, Any]]) -> None:
    """Markdown by fault, and what the targets are of."""
    groups = defaultdict(list)
    for row in rows:
        groups[row["fault"]].append(row)
    print("| fault | runs | ended as it has to | noticed after s: median, worst | limits left |")
    print("|---|---|---|---|---|")
    for fault, own in groups.items():
        noticed = [row["noticed"] for row in own if "noticed" in row]
        after = f"{np.median(noticed):.3f}, {max(noticed):.3f}" if noticed else ""
        right, bad = sum(row["right"] for row in own), sum(row["left"] for row in own)
        print(f"| {fault} | {len(own)} | {right} | {after} | {bad} |")
    harmless = [row for row in rows if FAULTS[row["fault"]].ends == (Ended.DONE,)]
    false = sum(row["ended"] != "done" for row in harmless)
    bad = sum(row["left"] for row in rows)
    print(f"\n{len(rows)} runs; false stops {false} of {len(harmless)}; limits left {bad}")
    for name, target in TARGETS.items():
        own = [row["noticed"] for row in groups[name] if "noticed" in row]
        print(f"{name}: {sum(value <= target for value in own)} of {len(own)} within {target} s")
    rest = [row for row in rows if row["ended"] in ("stopped", "lost", "interrupted") and "rest" in row]
    for words, at in (
        (f"{BRAKED} s", [BRAKED] * len(rest)),
        ("that + lag", [row["allowed"] for row in rest]),
    ):
        inside = sum(row["rest"] <= most for row, most in zip(rest, at, strict=True))
        print(f"rest within braking + {words}: {inside} of {len(rest)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("--runs", type=int, default=0)
    parser.add_argument("--table", action="store_true")
    own = parser.parse_args()
    lines = own.results.read_text().splitlines() if own.results.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {row["seed"] for row in rows}
    for seed in range(own.runs):
        if seed not in done:
            rows.append(dict(run(seed)))
            with own.results.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    if own.table:
        table(rows)


if __name__ == "__main__":
    main()
