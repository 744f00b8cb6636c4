"""The table of coverage in docs/foreign_plants.md: six arms or more, three seeds, one row a campaign.

    python tests/foreign/measure_coverage.py coverage.jsonl [--arms ur5,z1] [--seeds 0,1,2] [--logs]
    python tests/foreign/measure_coverage.py coverage.jsonl --table

Rows that the file has already are not measured again. Each campaign is asked three times; with --logs each
proposal is first run by `etude simulate`, else it stays open. Beside it the same arm is asked once without
collisions, its ranges cut to one turn. CPU is user time of `etude ask`, one thread.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from coverage_ruler import ruler_of_campaign, swept

from etude.trajectories import from_json

ARMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", ()),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ()),
    "panda": ("panda_description/urdf/panda.urdf", ()),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ()),
    "z1": ("z1_description/urdf/z1.urdf", ()),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
    "so100": ("so_arm_description/urdf/so100.urdf", ()),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", ("arm_*_joint",)),
    "talos": ("talos_data/robots/talos_full_v2.urdf", ("arm_left_?_joint",)),
    "iiwa": ("kuka_iiwa/model.urdf", ()),
    "xarm6": ("xarm/xarm6_robot.urdf", ()),
}
BULLET = ("iiwa", "xarm6")
"""Of pybullet; the others are of example-robot-data."""
HEAD = "| arm | segments | least, median after 1 | after 3 | speed, slowest | in links | CPU s of 1, 2, 3 |"


def robots() -> Path:
    files = distribution("example-robot-data")
    return Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def file_of(arm: str) -> Path:
    if arm not in BULLET:
        return robots() / ARMS[arm][0]
    where = os.environ.get("PYBULLET_DATA")
    if where:
        return Path(where) / ARMS[arm][0]
    found = find_spec("pybullet_data")
    if found is None or found.origin is None:
        raise SystemExit("pybullet_data is not installed: pip install pybullet, or set PYBULLET_DATA")
    return Path(found.origin).parent / ARMS[arm][0]


def packages_of(arm: str) -> tuple[Path, ...]:
    """Folders in which an arm's meshes are."""
    return robots().parents[1], robots(), file_of(arm).parents[1], file_of(arm).parent


def etude(*words: str) -> float:
    """Runs a command; user seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(
        [sys.executable, "-m", "etude", *words],
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"etude {' '.join(words)}: {done.stdout}{done.stderr}")
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def made(lab: Path, arm: str, seed: int) -> None:
    joints = [word for pattern in ARMS[arm][1] for word in ("--joints", pattern)]
    etude("init", str(lab), "--robot", str(file_of(arm)), *joints, "--seed", str(seed))


def without_collisions(lab: Path) -> None:
    """Ranges cut to a turn about home, and nothing to keep clear of."""
    path = lab / "robot.toml"
    robot, lines, axis = tomllib.loads(path.read_text()), [], -1
    for line in path.read_text().splitlines():
        axis += line == "[[axis]]"
        name, _, _ = line.partition(" = ")
        if axis >= 0 and name in ("lower", "upper"):
            own, home = robot["axis"][axis], robot["search"]["home"][axis]
            if own["upper"] - own["lower"] > 2.0 * math.pi and own.get("unit", "rad") == "rad":
                low = min(max(home - math.pi, own["lower"]), own["upper"] - 2.0 * math.pi)
                line = f"{name} = {low if name == 'lower' else low + 2.0 * math.pi!r}"
        if line in ("[collision]", "[floor]", "[search]") or line.startswith("[["):
            axis = axis if line == "[[axis]]" else -(10**6)
        lines.append(line)
    text = "\n".join(lines)
    head = "[collision]\nlook = false"
    text = text.replace("[collision]", head) if "[collision]" in text else f"{text}\n{head}\n"
    path.write_text(text)


def measured(arm: str, seed: int, *, logs: bool) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        lab, bare = Path(folder) / "lab", Path(folder) / "bare"
        made(lab, arm, seed)
        made(bare, arm, seed)
        without_collisions(bare)
        etude("ask", str(bare))
        cpu = []
        for _ in range(3):
            cpu.append(etude("ask", str(lab), *(() if logs else ("--new",))))
            if logs and len(cpu) < 3:
                etude("simulate", str(lab), "--rounds", "1")
        ruler = ruler_of_campaign(lab, file_of(arm), packages_of(arm))
        lower, upper = ruler.clear_range(np.random.default_rng(7))
        asked = [from_json(path.read_bytes()) for path in sorted(lab.glob("proposals/*/trajectory.json"))[:3]]
        free = swept([from_json((bare / "proposals/0001/trajectory.json").read_bytes())], lower, upper)
        first, third = swept(asked[:1], lower, upper), swept(asked, lower, upper)
        speed = float(free.speeds.mean())
        return {
            "arm": arm,
            "seed": seed,
            "logs": logs,
            "segments": len(first.speeds),
            "first": first.share.tolist(),
            "third": third.share.tolist(),
            "speed": float(first.speeds.mean()) / speed,
            "slowest": float(third.speeds.min()) / speed,
            "links": max(swept([one], lower, upper).links for one in asked),
            "cpu": cpu,
        }


def table(rows: list[dict[str, Any]]) -> str:
    """The worst seed of each arm."""
    lines = [HEAD, "|" + "---|" * HEAD.count(" | ") + "---|"]
    for logs in (False, True):
        for arm in dict.fromkeys(row["arm"] for row in rows):
            own = [row for row in rows if (row["arm"], row["logs"]) == (arm, logs)]
            if not own:
                continue
            cells = [f"{arm}{', with logs' if logs else ''} ({len(own)} seeds)", str(own[0]["segments"])]
            for name in ("first", "third"):
                least, median = (min(f(row[name]) for row in own) for f in (np.min, np.median))
                cells.append(f"{least:.2f}, {median:.2f}")
            cells.append(f"{min(r['speed'] for r in own):.2f}, {min(r['slowest'] for r in own):.2f}")
            cells.append(f"{max(r['links'] for r in own):.2f}")
            cells.append(", ".join(f"{max(r['cpu'][i] for r in own):.1f}" for i in range(3)))
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("file", type=Path)
    words.add_argument("--arms", default=",".join(ARMS))
    words.add_argument("--seeds", default="0,1,2")
    words.add_argument("--logs", action="store_true")
    words.add_argument("--table", action="store_true")
    given = words.parse_args()
    rows = [json.loads(line) for line in given.file.read_text().splitlines()] if given.file.exists() else []
    if not given.table:
        done = {(row["arm"], row["seed"], row["logs"]) for row in rows}
        for seed in map(int, given.seeds.split(",")):
            for arm in given.arms.split(","):
                if (arm, seed, given.logs) not in done:
                    row = measured(arm, seed, logs=given.logs)
                    rows.append(row)
                    with given.file.open("a") as out:
                        out.write(json.dumps(row) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
