"""Coverage of printed intervals, and their width beside the spread: campaigns of one robot, other seeds.

    python tests/foreign/measure_parameters.py same.jsonl three:5,three:6@8,ur5:1,z1:1 10 [bare]

Each campaign asks twice, and pinocchio's arm, whose masses are not the file's, runs it. A robot is a file,
the seed that draws its masses and drives, and, as in three:5:0.05@8, the part of the top speed over which its
friction turns its sign, and ms from a command to its torque. Campaigns that the file has are not made again;
the table is of all. With `bare` another campaign, without a model file, is told the logs, and friction is all
that it prints.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio_arm as plant
from pinocchio_arm import Array
from small_arm import QUICK, URDF, campaign_of_small_arm

import etude
from etude.campaign import Campaign, create_campaign

LOGS = 2
FILES = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
}
"""Of example-robot-data; "three" is the small arm."""
DURATION = 24.0
SHAPES = re.compile(r"<(visual|collision)\b.*?</\1>", re.DOTALL)
PRINTED = ("coulomb", "viscous")


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


def learned(folder: Path, arm: plant.Arm, seed: int, text: str = "") -> Campaign:
    """The campaign of that seed, with its logs; of the small arm, or of a URDF's text."""
    folder.mkdir(exist_ok=True)
    if text:
        (folder / "arm.urdf").write_text(text)
        lab = create_campaign(folder / "lab", str(folder / "arm.urdf"), seed=seed)[0].path
        (lab / "campaign.toml").write_text(QUICK.format(seed=seed, duration=DURATION))
        campaign = etude.open_campaign(lab)
    else:
        campaign = campaign_of_small_arm(folder, seed=seed)
    for k in range(LOGS):
        table = (etude.ask(campaign).folder / "trajectory.csv").read_bytes()
        run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=100 * seed + k)
        (folder / f"{k}.csv").write_bytes(run.log())
        etude.tell(campaign, folder / f"{k}.csv")
    return campaign


def bare(campaign: Campaign, folder: Path) -> Campaign:
    """Another campaign of the same logs, whose robot has no model file."""
    lines = (campaign.path / "robot.toml").read_text().splitlines(keepends=True)
    (folder / "bare.toml").write_text("".join(line for line in lines if not line.startswith("model_file")))
    lab = create_campaign(folder / "bare", str(folder / "bare.toml"))[0]
    for k in range(LOGS):
        etude.tell(lab, folder / f"{k}.csv", foreign=True)
    return lab


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


def printed(campaign: Campaign, arm: plant.Arm) -> dict[str, tuple[float, float, float]]:
    """By name: value, truth and deviation of base parameters, Coulomb and viscous friction."""
    truth, own = true_parameters(arm), {}
    facts = etude.export(campaign, "parameters").facts
    for row in facts["parameters"]:
        if row["lower"] is not None:
            true = sum(part["factor"] * truth[part["of"], part["parameter"]] for part in row["parts"])
            own[row["parameter"]] = (row["value"], true, row["deviation"])
    for row in facts["friction"]:
        if row["term"] in PRINTED and row["lower"] is not None:
            name = row["joint"], row["term"]
            own[" ".join(name)] = (row["value"], truth[name], row["deviation"])
    return own


def coverage(rows: list[dict[str, tuple[float, float, float]]]) -> Coverage:
    """Of what all of several campaigns of one robot printed."""
    names = [name for name in rows[0] if all(name in own for own in rows)]
    table = np.array([[own[name] for name in names] for own in rows])
    return Coverage(tuple(names), *np.moveaxis(table, 2, 0))


def robot(name: str) -> tuple[plant.Arm, str]:
    """The plant of a file and a seed, and the text that Étude gets ("" of the small arm)."""
    name, _, late = name.partition("@")
    file, seed, *turns = name.split(":")
    text = ""
    if file != "three":
        from measure_arms import share

        text = plant.one_turn(SHAPES.sub("", (share() / FILES[file]).read_text()))
    arm = plant.arm_of_urdf(text or URDF, seed=int(seed))
    for part in turns:
        arm = replace(arm, drives=replace(arm.drives, smooth=float(part) * arm.speed))
    if late:
        arm = replace(arm, drives=replace(arm.drives, delay=1e-3 * float(late)))
    return arm, text


def measured(name: str, seeds: Iterator[int], without_masses: bool) -> Iterator[dict[str, Any]]:
    """A row for each campaign."""
    arm, text = robot(name)
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            campaign = learned(Path(folder), arm, seed, text)
            campaign = bare(campaign, Path(folder)) if without_masses else campaign
            yield {"robot": name, "seed": seed, "rows": printed(campaign, arm)}


KINDS = {"armature": r"\S+ armature", "inertia": r".* I[xyz]{2}.*", "viscous": r"\S+ viscous"}
"""Of printed parameters, by their names. The others: Coulomb friction, masses and centres."""


def by_kind(rows: list[dict[str, Any]]) -> None:
    """A row for each delay and kind of parameter."""
    found: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        late = row["robot"].partition("@")[2] or f"{1e3 * plant.Drives.delay:g}"
        for name, (value, truth, deviation) in row["rows"].items():
            kind = next((kind for kind, form in KINDS.items() if re.fullmatch(form, name)), "other")
            for one in (kind, "all"):
                found.setdefault((late, one), []).append((value - truth) / deviation)
    for (late, kind), z in sorted(found.items()):
        share = np.mean(np.abs(z) <= 1.96)
        print(f"| {late} ms | {kind} | {len(z)} | {share:.3f} | {np.mean(z):+.2f} | {np.std(z):.2f} |")


def summary(rows: list[dict[str, Any]]) -> None:
    inside, widths, each = [], [], []
    for name in dict.fromkeys(row["robot"] for row in rows):
        found = coverage([row["rows"] for row in rows if row["robot"] == name])
        inside.append(found.inside.mean())
        widths.append(found.width)
        z = (found.value - found.truth) / found.deviation
        pairs = zip(found.names, found.inside.mean(axis=0), found.width, strict=True)
        each += [f"{name}, {one}: coverage {own:.2f}, width {w:.2f} of the spread" for one, own, w in pairs]
        worst = ", ".join(found.names[i] for i in np.argsort(found.inside.mean(axis=0))[:3])
        print(
            f"| {name} | {len(found.value)} | {len(found.names)} | {100 * inside[-1]:.1f} % | "
            f"{np.median(widths[-1]):.2f}, {widths[-1].max():.1f} | {np.median(np.abs(z)):.2f} | {worst} |"
        )
    print("\n".join(each))
    by_kind(rows)
    print(f"all: coverage {np.mean(inside):.3f}, median width {np.median(np.concatenate(widths)):.2f}")


def main() -> None:
    file, names, count = Path(sys.argv[1]), sys.argv[2].split(","), int(sys.argv[3])
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["robot"], row["seed"]) for row in rows}
    for name in names:
        for row in measured(
            name, iter([k for k in range(count) if (name, k) not in known]), "bare" in sys.argv
        ):
            rows.append(row)
            with file.open("a") as out:
                out.write(json.dumps(row) + "\n")
    summary(rows)


if __name__ == "__main__":
    main()
