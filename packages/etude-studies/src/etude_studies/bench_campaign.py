"""`etude bench campaign`: CPU seconds and memory of `tell` and `ask`, over the number of logs and of joints.

Each figure is of a whole process on one thread, user and system, with compiled code cached. Logs are of
random motions of simulated arms: of arm4_rough, and of chains of hinges about crossing axes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.campaign import create_campaign, open_campaign, typical_motions
from etude.errors import UsageError
from etude.logs import write_log
from etude_studies.rows import Row, rows_json, table

LOGS, QUICK = (1, 2, 4, 8, 16, 32), (1, 3)
JOINTS, AT = (2, 7), 4
"""Chains, and the logs that these are measured at."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CHILD = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "etude", *sys.argv[1:]], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(done.returncode)
"""
"""Runs a command and prints what it took. Resources are those of all children: each has its own parent."""
INERTIAL = (
    '<inertial><mass value="{mass}"/><origin xyz="0 0 0.1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def chain(joints: int) -> str:
    """The URDF of a chain of so many hinges, each lighter than the one before."""
    parts = ['<robot name="chain"><link name="base"/>']
    for k in range(joints):
        parent, axis = f"link{k}" if k else "base", "0 0 1" if k % 2 == 0 else "0 1 0"
        parts.append(f'<link name="link{k + 1}">{INERTIAL.format(mass=2.0 / (1 + k))}</link>')
        parts.append(
            f'<joint name="joint{k + 1}" type="revolute"><parent link="{parent}"/><child link="link{k + 1}"/>'
            f'<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>'
            f'<limit lower="-1" upper="1" velocity="1.5" effort="{60 / (1 + k):g}"/></joint>'
        )
    return "".join([*parts, "</robot>"])


@dataclass(frozen=True)
class Cost:
    """Of a command: CPU seconds, and the most memory it held, MB."""

    seconds: float
    memory: float


def measured(*arguments: str) -> Cost:
    """What `etude` takes with these words, in a process of its own. UsageError: it fails."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    command = [sys.executable, "-c", CHILD, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode not in (0, 5):  # 5: the stop rule
        raise UsageError(f"etude {arguments[0]} failed: {done.stderr.strip()[-400:]}")
    seconds, memory = done.stdout.split()[-2:]
    return Cost(float(seconds), float(memory) / (2**20 if sys.platform == "darwin" else 2**10))


def logs_of(folder: Path, robot: str, count: int, seed: int) -> list[Path]:
    """Logs of random motions of a simulated robot."""
    create_campaign(folder / "source", robot, seed=seed)
    campaign = open_campaign(folder / "source")
    plant = campaign.kind.robot(campaign.spec, campaign.config)
    if plant is None:
        raise UsageError(f"there is no simulated {robot}")
    paths = []
    for i, motion in enumerate(typical_motions(campaign, np.random.default_rng(seed), count)):
        paths.append(folder / f"{i:04d}.parquet")
        write_log(paths[-1], plant.run(motion, None, np.random.default_rng([seed, i])))
    return paths


def of_robot(name: str, robot: str, counts: Sequence[int], seed: int) -> Iterator[Row]:
    """Rows of a robot: telling the last of so many logs, the others in one before, and asking then."""
    with tempfile.TemporaryDirectory() as place:
        logs = [str(path) for path in logs_of(Path(place), robot, max(counts), seed)]
        for count in counts:
            lab = str(Path(place) / f"lab{count}")
            create_campaign(Path(lab), robot, seed=seed)
            if count > 1:
                measured("tell", lab, *logs[: count - 1])
            for word, cost in (
                ("tell", measured("tell", lab, logs[count - 1])),
                ("ask", measured("ask", lab)),
            ):
                yield Row(f"{word}_{name}_logs{count}", cost.seconds, "CPU s")
                yield Row(f"{word}_{name}_logs{count}_memory", cost.memory, "MB")


def run(*, json: bool = False, quick: bool = False, seed: int = 0) -> list[Row]:
    """Measures and prints the rows; `quick`: few logs of one robot."""
    rows = list(of_robot("arm4_rough", "arm4_rough", QUICK if quick else LOGS, seed))
    with tempfile.TemporaryDirectory() as place:
        for joints in () if quick else JOINTS:
            path = Path(place) / f"chain{joints}.urdf"
            path.write_text(chain(joints), encoding="utf-8")
            rows += of_robot(f"chain{joints}", str(path), (AT,), seed)
    if json:
        print(rows_json(rows, "etude bench campaign --json"))  # noqa: T201
    else:
        table(rows, "What tell and ask take, over logs and joints")
    return rows
