"""Coverage of printed intervals, and their width beside the spread: one arm, campaigns of other seeds.

    python tests/foreign/measure_parameters.py 10 [SEED]

Each campaign asks twice, and pinocchio's arm, whose masses are not the file's, runs it. SEED draws the arm.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio_arm as plant
from pinocchio_arm import Array
from small_arm import URDF, campaign_of_small_arm

import etude
from etude.campaign import Campaign

LOGS = 2


def true_parameters(arm: plant.Arm) -> dict[tuple[str, str], float]:
    """By link or joint and name, as Étude calls them; friction beside them."""
    found: dict[tuple[str, str], float] = {}
    links = [
        next(f.name for f in arm.true.frames if f.parentJoint == i and f.type == plant.pin.BODY)
        for i in range(1, arm.true.njoints)
    ]
    for link, inertia in zip(links, list(arm.true.inertias)[1:], strict=True):
        m, x, y, z, xx, xy, yy, xz, yz, zz = inertia.toDynamicParameters().tolist()
        names = ("mass", "m cx", "m cy", "m cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
        found |= {
            (link, name): v for name, v in zip(names, (m, x, y, z, xx, yy, zz, xy, xz, yz), strict=True)
        }
    for j, name in enumerate(arm.names):
        found[name, "armature"] = float(arm.drives.armature[j])
        found[name, "viscous"] = float(arm.drives.viscous[j])
        found[name, "coulomb"] = float(arm.drives.coulomb[j])
    return found


def learned(folder: Path, arm: plant.Arm, seed: int) -> Campaign:
    """The campaign of that seed, with its logs."""
    folder.mkdir(exist_ok=True)
    campaign = campaign_of_small_arm(folder, seed=seed)
    for k in range(LOGS):
        table = (etude.ask(campaign).folder / "trajectory.csv").read_bytes()
        run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=100 * seed + k)
        (folder / f"{k}.csv").write_bytes(run.log())
        etude.tell(campaign, folder / f"{k}.csv")
    return campaign


@dataclass(frozen=True)
class Coverage:
    """Of printed intervals: value, truth, deviation (campaigns, parameters)."""

    names: tuple[str, ...]
    value: Array
    truth: Array
    deviation: Array

    @property
    def inside(self) -> Array:
        """Whether each 95 % interval holds the truth."""
        return np.asarray(np.abs(self.value - self.truth) <= 1.96 * self.deviation)

    @property
    def width(self) -> Array:
        """(parameters,) of the intervals, in that of the spread between campaigns."""
        return np.asarray(self.deviation.mean(axis=0) / self.value.std(axis=0, ddof=1))


def coverage(campaigns: list[Campaign], arm: plant.Arm) -> Coverage:
    """Of base parameters, Coulomb and viscous friction."""
    truth, rows = true_parameters(arm), []
    for campaign in campaigns:
        facts = etude.export(campaign, "parameters").facts
        own = {}
        for row in facts["parameters"]:
            if row["lower"] is not None:
                true = sum(part["factor"] * truth[part["of"], part["parameter"]] for part in row["parts"])
                own[row["parameter"]] = (row["value"], true, row["deviation"])
        for row in facts["friction"]:
            if row["term"] in ("coulomb", "viscous"):
                name = row["joint"], row["term"]
                own[" ".join(name)] = (row["value"], truth[name], row["deviation"])
        rows.append(own)
    table = np.array([[own[name] for name in rows[0]] for own in rows])
    return Coverage(tuple(rows[0]), *np.moveaxis(table, 2, 0))


def main() -> None:
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 5
    arm = plant.arm_of_urdf(URDF, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        found = coverage([learned(Path(folder) / str(k), arm, k) for k in range(count)], arm)
    for name, inside, width in zip(found.names, found.inside.mean(axis=0), found.width, strict=True):
        print(f"{name}: coverage {inside:.2f}, width {width:.2f} times the spread")
    print(f"all: coverage {found.inside.mean():.3f}, median width {np.median(found.width):.2f}")


if __name__ == "__main__":
    main()
