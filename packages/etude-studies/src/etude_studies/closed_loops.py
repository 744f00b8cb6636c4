"""Coverage of tracking margins: how often simulated robots leave their limits.

A loop is one motion, run: drawn at random inside the limits less the margins that the runs before have left,
eight in a row from a robot that nobody knows. Feedback alone, or the exact inverse beside it from the second
run on, as a learned one would be; each of the two has margins of its own, as in a campaign. Truth is the
simulation's own position and its rate, not the encoder's.

    python -m etude_studies.closed_loops FILE [ROWS_OF_EIGHT]

goes on where FILE ends, one line of JSON for each row, and prints the table.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.limits import HELD, FeasibleSet, Ranges, margins_of, scaled, within_room
from etude.logs import largest_errors
from etude.protocols import Controller, Limit, Trajectory
from etude.trajectories import random_moves
from etude.types import Array, Log, Margins
from etude_arm import ArmSpec, PerfectController
from etude_studies.seven_loop import seven_loop
from etude_studies.world import World

ROBOTS = ("arm4", "arm4_rough", "seven")
FORMS = ("fourier", "moves")
CONTROLS = ("feedback", "feedforward")
RUNS = 8
MOVES = 6
ROWS = 140
FIRST = 2000
"""Seed of the first row; how rates are read, and what they hide, was settled on rows of other seeds."""
SLACK = 1e-9


@dataclass(frozen=True)
class Case:
    """One row of eight runs."""

    robot: str
    form: str
    control: str
    margin: bool
    seed: int


def cases(rows: int) -> list[Case]:
    """Robots, forms and controls in turn; one row in eight is without margins."""
    kinds = [(r, f, c) for r in ROBOTS for c in CONTROLS for f in FORMS]
    return [
        Case(*kinds[i % len(kinds)], margin=i // len(kinds) % 8 != 7, seed=FIRST + i) for i in range(rows)
    ]


def run_row(case: Case) -> list[dict[str, Any]]:
    """What became of each run; `logs`: those that its margins are of."""
    robot, world = _robot(case.robot)
    spec: ArmSpec = world.spec
    largest_error = world.kind.largest_error(spec)  # type: ignore[attr-defined]
    tracking = world.config.tracking
    rng, rows = np.random.default_rng([case.seed, 15]), []
    errors: dict[bool, list[Array]] = {False: [], True: []}
    ranges = Ranges.of((spec.lower, spec.upper), (-spec.velocity, spec.velocity), _home(spec), _units(spec))
    for run in range(RUNS):
        exact = case.control == "feedforward" and run > 0
        measured = {case.form: errors[exact]} if errors[exact] else {}
        margins_by_form = margins_of(tracking, ranges, measured, FORMS, largest_error)
        margins = {
            f: within_room(t, np.asarray(c), ranges, tracking.most) for f, (t, c) in margins_by_form.items()
        }
        constraints = world.kind.limits(spec, world.config, None, margins if case.margin else {})
        motion = _motion(world, case.form, constraints, margins if case.margin else {}, rng)
        log = robot.run(motion, _exact(robot) if exact else None, rng)
        true = _true_errors(log, motion)
        outside = _outside(log, motion, spec)
        table, sure = margins_by_form[case.form][0], margins[case.form][1]
        rows.append(
            {
                "run": run,
                "logs": len(errors[exact]),
                "outside": outside.max(axis=1).tolist(),
                "covered": [bool(np.all(true[i] <= table[i])) for i in range(HELD)],
                "cut": [bool(np.any(margins[case.form][0][i] < table[i])) for i in range(HELD)],
                "assumed": [bool(np.any(np.asarray(sure)[i] == 0.0)) for i in range(HELD)],
                "margin": (table / ranges.room).max(axis=1).tolist(),
                "beyond": ((true - table) / ranges.room).max(axis=1).tolist(),
            }
        )
        errors[exact].append(largest_errors(log, motion, "q")[case.form])
    return rows


def _robot(name: str) -> tuple[Any, World]:
    if name == "seven":
        robot = seven_loop()
        return robot, robot.world
    world = World.of(name)
    return world.robot, world


def _exact(robot: Any) -> Controller:
    return PerfectController(robot)


def _home(spec: ArmSpec) -> Array:
    return 0.5 * (spec.lower + spec.upper)


def _units(spec: ArmSpec) -> list[str]:
    return [axis.unit for axis in spec.axes]


def _motion(
    world: World, form: str, constraints: Sequence[Limit], margins: Margins, rng: np.random.Generator
) -> Trajectory:
    """A large one inside the limits."""
    spec: ArmSpec = world.spec
    if form == "moves":
        m = margins[form][0] if margins else np.zeros((HELD, spec.dof))
        low, high = spec.lower + m[0], spec.upper - m[0]
        return random_moves(rng, low, high, spec.velocity - m[1], spec.acceleration, MOVES, box_fraction=1.0)
    family = world.kind.family(spec, world.config).drawn(rng)
    return family.trajectory(scaled(rng, FeasibleSet.of(constraints, family, _home(spec)))[0])


def _true_errors(log: Log, motion: Trajectory) -> Array:
    """(HELD, k) largest true errors while it moves."""
    moving = (log.t >= 0.0) & (log.t <= motion.duration)
    planned = motion.motion(log.t[moving], HELD).orders
    return np.stack([np.abs(a - b).max(axis=0) for a, b in zip(_truth(log, moving), planned, strict=True)])


def _outside(log: Log, motion: Trajectory, spec: ArmSpec) -> Array:
    """(HELD, k) how far positions and velocities left their limits, in parts of the range; <= 0: never."""
    moving = (log.t >= 0.0) & (log.t <= motion.duration)
    q, qd = _truth(log, moving)
    beyond = np.maximum(q - spec.upper, spec.lower - q) / (spec.upper - spec.lower)
    return np.stack([beyond.max(axis=0), (np.abs(qd) / spec.velocity - 1.0).max(axis=0)])


def _truth(log: Log, moving: Any) -> tuple[Array, Array]:
    q = log["q_true"]
    return q[moving], np.gradient(q, log.t, axis=0)[moving]


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """A table: of each robot and control, runs, how many left a limit, and how many kept their margins."""
    lines = [
        f"{'':34}{'runs':>6}{'position':>10}{'velocity':>10}{'either':>8}{'kept pos.':>11}{'kept vel.':>11}"
    ]
    for margin in (True, False):
        for name in [*ROBOTS, "all"]:
            for part in ("assumed", "learned"):
                selected = [
                    run
                    for row in rows
                    if row["margin"] == margin and name in (row["robot"], "all")
                    for run in row["runs"]
                    if (run["logs"] == 0) == (part == "assumed")
                ]
                if selected:
                    lines.append(
                        _line(f"{'with' if margin else 'without'} margins, {name}, {part}", selected)
                    )
    return "\n".join(lines)


def _line(name: str, runs: Sequence[Mapping[str, Any]]) -> str:
    out = np.array([run["outside"] for run in runs]) > SLACK
    covered = np.mean([run["covered"] for run in runs], axis=0)
    share = [*out.mean(axis=0), out.any(axis=1).mean(), *covered]
    text = "".join(f"{100 * s:>{w}.1f}" for s, w in zip(share, (10, 10, 8, 11, 11), strict=True))
    return f"{name:<34}{len(runs):>6}{text}"


def main(path: Path, rows: int) -> None:
    """Runs what FILE lacks, and prints the table."""
    done = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    with path.open("a") as file:
        for case in cases(rows)[len(done) :]:
            done.append({**vars(case), "runs": run_row(case)})
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
    print(summary(done))  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else ROWS)
