"""Mass and centre of a load on arms of seven joints, and how often one is reported that is not there.

    python tests/foreign/measure_payload.py loads.jsonl panda,xarm7,tiago [RUNS] [asked] [empty]

Each arm of pinocchio (masses off by up to 15 %, friction, cogging, delay) tells LOGS motions of 20 s without
a load. Then it makes other motions with a fifth of its rated load, and without one; with `asked` those of
10 s that `etude ask --payload` designs, with `empty` without a load alone. Runs that the file has are not
made again.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pinocchio_arm as plant
from measure_arms import share
from small_arm import QUICK

import etude
from etude.campaign import Campaign, RobotPart, ask_to_weigh, create_campaign, typical_motions
from etude.protocols import Trajectory
from etude.trajectories import from_json

ARMS: dict[str, tuple[str, tuple[str, ...], float]] = {
    "panda": ("panda_description/urdf/panda.urdf", tuple(f"panda_joint{i}" for i in range(1, 8)), 3.0),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", (), 3.5),
    "tiago": (
        "tiago_description/robots/tiago_no_hand.urdf",
        tuple(f"arm_{i}_joint" for i in range(1, 8)),
        3.0,
    ),
}
"""Of example-robot-data: file, joints, rated load in kg."""
LOGS, DURATION = 4, 20.0
SHARE = 0.2
SHAPES = re.compile(r"<(visual|collision)\b.*?</\1>", re.DOTALL)


def campaign_of(folder: Path, arm: str) -> tuple[Campaign, plant.Arm]:
    """An arm without shapes, and the plant of it."""
    file, joints, _ = ARMS[arm]
    text = SHAPES.sub("", (share() / file).read_text())
    (folder / f"{arm}.urdf").write_text(plant.one_turn(text))
    part = RobotPart(joints=joints)
    lab = create_campaign(folder / "lab", str(folder / f"{arm}.urdf"), part=part)[0].path
    (lab / "campaign.toml").write_text(QUICK.format(seed=0, duration=DURATION))
    return etude.open_campaign(lab), plant.arm_of_urdf(text, joints, seed=7)


def log_of(path: Path, campaign: Campaign, arm: plant.Arm, motion: Trajectory, seed: int) -> Path:
    """The arm along a motion."""
    t = np.arange(round(motion.duration * plant.RATE) + 1) / plant.RATE
    orders = motion.motion(t, 3).orders
    order = [campaign.spec.names.index(name) for name in arm.names]
    run = plant.run(arm, plant.Reference(t, *(part[:, order] for part in orders)), seed=seed)
    _, rows = run.log().decode().split("\n", 1)
    names = [f"{word}_{name}" for word in ("q", "dq", "tau") for name in arm.names]
    path.write_text(",".join(["time_s", *names]) + "\n" + rows)
    return path


def loaded(arm: plant.Arm, mass: float, centre: tuple[float, float, float]) -> plant.Arm:
    """With a ball of 4 cm radius at its last link."""
    true = arm.true.copy()
    ball = pin.Inertia(mass, np.array(centre), 0.4 * mass * 0.04**2 * np.eye(3))
    true.appendBodyToJoint(true.getJointId(arm.names[-1]), ball, pin.SE3.Identity())
    true.armature = arm.drives.armature
    return replace(arm, true=true)


def rows_of(
    arm: str, runs: int, folder: Path, asked: bool, shares: tuple[float, ...], known: set[Any]
) -> Any:
    """A row for each run and share of the rated load that is not known yet."""
    if all((run, part * ARMS[arm][2]) in known for run in range(runs) for part in shares):
        return
    campaign, bare = campaign_of(folder, arm)
    motions = typical_motions(campaign, np.random.default_rng(1), LOGS + runs)
    for k in range(LOGS):
        etude.tell(campaign, log_of(folder / f"{k}.csv", campaign, bare, motions[k], k), foreign=True)
    rated = ARMS[arm][2]
    rng = np.random.default_rng(2)
    for k in range(runs):
        if asked and not all((k, part * rated) in known for part in shares):
            own = ask_to_weigh(campaign, new=True)
            motions[LOGS + k] = from_json((own.folder / "trajectory.json").read_bytes())
        centre = tuple((rng.uniform(-1.0, 1.0, 3) * (0.04, 0.04, 0.06) + (0.0, 0.0, 0.1)).tolist())
        for mass in (part * rated for part in shares if (k, part * rated) not in known):
            robot = loaded(bare, mass, centre) if mass else bare
            log = log_of(folder / "run.csv", campaign, robot, motions[LOGS + k], 100 + k)
            load = etude.payload(campaign, log).load
            yield {
                "arm": arm, "asked": asked, "run": k, "mass": mass, "centre": centre, "verdict": load.verdict,
                "found": load.mass, "deviation": load.deviation, "found_centre": load.centre.tolist(),
                "centre_deviation": load.centre_deviation.tolist(), "left": load.left,
            }  # fmt: skip


def summary(rows: list[dict[str, Any]]) -> None:
    for arm in dict.fromkeys(row["arm"] for row in rows):
        own = [row for row in rows if row["arm"] == arm]
        there, none = ([r for r in own if bool(r["mass"]) is with_load] for with_load in (True, False))
        mass = np.array([abs(r["found"] / r["mass"] - 1.0) for r in there])
        off = np.array([np.linalg.norm(np.subtract(r["found_centre"], r["centre"])) for r in there])
        inside = np.mean([abs(r["found"] - r["mass"]) < 1.96 * r["deviation"] for r in own])
        false = sum(r["verdict"] == "load" for r in none)
        seen = sum(r["verdict"] == "load" for r in there)
        print(
            f"| {arm} | {seen} of {len(there)} | {_spread(100 * mass, '%')} | {_spread(1e3 * off, 'mm')} | ",
            end="",
        )
        print(f"{inside:.2f} | {false} of {len(none)} |")


def _spread(values: Any, unit: str) -> str:
    return f"{np.median(values):.1f} {unit}, {values.max():.1f} {unit}" if len(values) else ""


def main() -> None:
    file, arms = Path(sys.argv[1]), sys.argv[2].split(",")
    runs, asked = int(sys.argv[3]) if len(sys.argv) > 3 else 10, "asked" in sys.argv
    shares = (0.0,) if "empty" in sys.argv else (0.0, SHARE)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for arm in arms:
        known = {(row["run"], row["mass"]) for row in rows if (row["arm"], row["asked"]) == (arm, asked)}
        with tempfile.TemporaryDirectory() as folder:
            for row in rows_of(arm, runs, Path(folder), asked, shares, known):
                rows.append(row)
                with file.open("a") as out:
                    out.write(json.dumps(row) + "\n")
    summary(rows)


if __name__ == "__main__":
    main()
