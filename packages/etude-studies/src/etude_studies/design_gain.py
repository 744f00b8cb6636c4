"""etude study design_gain: what the search finds beyond the best of its random candidates.

A seed's model has learned one to four random motions; both figures are the criterion's own value.
"""

from __future__ import annotations

import json as text
from pathlib import Path

import numpy as np

from etude.design import Design, design
from etude.progress import counted
from etude.storage import write_atomic
from etude_studies.rows import Row, mean_rows, rows_json, table
from etude_studies.world import World

ROBOTS = ("arm4", "quadrotor")
MOST_LOGS = 4


def run(*, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Designs once for every robot and seed, and prints the rows; finished ones are files in `folder`."""
    rows = []
    for robot in counted(ROBOTS):
        cells = [cell(robot, s, folder) for s in counted(range(seed, seed + seeds))]
        rows += gain_rows(robot, cells)
    command = f"etude study design_gain --seed {seed} --seeds {seeds}"
    if json:
        print(rows_json(rows, command))  # noqa: T201
    else:
        table(rows, "What the search finds")


def cell(robot: str, seed: int, folder: Path) -> dict[str, float]:
    """Value, best random value, evaluations and CPU seconds of one search, from its file if it was run."""
    path = folder / f"{robot}_{seed:04d}.json"
    if not path.exists():
        result = searched(robot, seed)
        facts = {
            name: float(getattr(result, name)) for name in ("value", "baseline", "evaluations", "seconds")
        }
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.dumps(facts).encode())
    stored: dict[str, float] = text.loads(path.read_bytes())
    return stored


def searched(robot: str, seed: int) -> Design:
    """The design of the next motion after 1 + seed % 4 random ones."""
    world, rng = World.of(robot), np.random.default_rng([seed, 1])
    motions = [world.motion(rng) for _ in range(1 + seed % MOST_LOGS)]
    samples = world.samples(*(world.robot.run(motion, None, rng) for motion in motions))
    model = world.learned(samples, world.config.model, rng).model
    kind, spec, config = world.kind, world.spec, world.config
    return design(
        kind.family(spec, config),
        kind.limits(spec, config, None, {}),
        kind.home(spec),
        model.inputs,
        model,
        config.design,
        np.random.default_rng([seed, 2]),
        rate=float(spec.rate),
        physics=kind.physics(spec, config),
    )


def gain_rows(robot: str, cells: list[dict[str, float]]) -> list[Row]:
    """Means over seeds with intervals."""
    gains = [c["value"] - c["baseline"] for c in cells]
    against = "over the best random candidate"
    return [
        *mean_rows(f"design_gain_{robot}", gains, "1", against, []),
        *mean_rows(f"design_cpu_{robot}", [c["seconds"] for c in cells], "s", "", []),
    ]
