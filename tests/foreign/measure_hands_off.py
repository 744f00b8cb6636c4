"""From robot files to promoted models without a hand: etude run on MuJoCo's own idea of each robot.

    python tests/foreign/measure_hands_off.py --rounds 2 ARM.urdf ... > hands_off.jsonl

Masses are up to 10 % off the file's, set-points come 4 ms late, and joints rub. A run that was stopped is
started again, as a person would, at most --tries times. One line of JSON a robot.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from etude import create_campaign

SETTINGS = "wrong_masses = 0.1\ndelay = 0.004\n"


def prepared(folder: Path, robot: Path) -> Path:
    """A campaign whose simulated robot stands at home."""
    campaign = create_campaign(folder, str(robot))[0]
    home = np.asarray(campaign.kind.home(campaign.spec), dtype=float)
    start = ", ".join(f"{axis} = {x:.4f}" for axis, x in zip(campaign.axes, home, strict=True))
    text = f'[driver]\non = "mujoco:{robot.resolve()},virtual"\n{SETTINGS}start = {{ {start} }}\n'
    (campaign.path / "run.toml").write_text(text)
    return campaign.path


def run(folder: Path, rounds: int, tries: int) -> tuple[int, dict[str, Any], int]:
    """Exit code and last line of the last try, and how many there were."""
    command = [sys.executable, "-m", "etude", "run", str(folder), "--yes", "--json", "--rounds", str(rounds)]
    count, code, text = 0, 7, ""
    while code == 7 and count < tries:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        count, code, text = count + 1, done.returncode, done.stdout
    return code, json.loads(text.splitlines()[-1]), count


def measured(robot: Path, rounds: int, tries: int) -> dict[str, Any]:
    """Mean errors of the motion that confirms, robot seconds, CPU, and what became of the model."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        code, said, count = run(prepared(Path(folder) / "lab", robot), rounds, tries)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    confirmed = said.get("confirmed") or {}
    errors = {name: float(np.mean(confirmed[name])) for name in ("without", "with") if name in confirmed}
    return {
        "robot": robot.stem,
        "exit_code": code,
        "tries": count,
        "error_deg": errors,
        "robot_seconds": said.get("robot_seconds"),
        "cpu_seconds": after.ru_utime - before.ru_utime,
        "promoted": said.get("promoted", False),
        "why_not": said.get("error") or [*said.get("said", []), *said.get("not_promoted", [])],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="+", type=Path)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--tries", type=int, default=4)
    own = parser.parse_args()
    for path in own.robots:
        print(json.dumps(measured(path, own.rounds, own.tries)), flush=True)
