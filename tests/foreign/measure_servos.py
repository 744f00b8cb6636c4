"""Dead band and backlash of cheap servos: evidence with and without them, and coverage of the intervals.

    python tests/foreign/measure_servos.py servos.jsonl 20 [band,backlash,none,horn]

Each of the seeds draws five servos and masses, makes LOGS random motions, and tells the logs. `band`: a dead
band alone. `backlash`: backlash alone, with the encoder at the motor. `horn`: both, with the encoder at the
horn, where no log shows backlash. Cases that the file has are not made again.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import servo_arm as plant
from small_arm import QUICK

import etude
from etude.campaign import Campaign, create_campaign, typical_motions

LOGS, DURATION = 3, 30.0
CASES = {
    "none": {"band": False, "backlash": False, "at_motor": True},
    "band": {"band": True, "backlash": False, "at_motor": False},
    "backlash": {"band": False, "backlash": True, "at_motor": True},
    "horn": {"band": True, "backlash": True, "at_motor": False},
}
LOADS = "[log.columns]\n" + "".join(f'"tau_{name}" = "load_{name}"\n' for name in plant.JOINTS)


def campaign_of(folder: Path, seed: int) -> Campaign:
    """A campaign whose commands are counts."""
    (folder / "servos.urdf").write_text(plant.urdf())
    lab = create_campaign(folder / "lab", str(folder / "servos.urdf"), seed=seed)[0].path
    text = (lab / "robot.toml").read_text().replace('command_unit = "N m"', 'command_unit = "pwm"')
    (lab / "robot.toml").write_text(text.replace(f"command = {plant.STALL}", f"command = {plant.FULL}"))
    (lab / "campaign.toml").write_text(QUICK.format(seed=seed, duration=DURATION) + LOADS)
    return etude.open_campaign(lab)


def learned(folder: Path, case: str, seed: int) -> tuple[Campaign, plant.Servos]:
    """With its logs."""
    campaign, own = campaign_of(folder, seed), plant.servos(seed, **CASES[case])
    order = [campaign.spec.names.index(name) for name in plant.JOINTS]
    for k, motion in enumerate(typical_motions(campaign, np.random.default_rng(seed), LOGS)):
        t = np.arange(0.0, motion.duration, plant.PERIOD)
        goals = motion.motion(t, 1).orders[0][:, order]
        (folder / f"{k}.csv").write_bytes(plant.log(*plant.run(own, goals, 100 * seed + k)))
    # a dead band may pass for commands that are early
    logs = [folder / f"{k}.csv" for k in range(LOGS)]
    etude.tell(campaign, logs, foreign=True, accept=("delay",))
    return campaign, own


def row_of(case: str, seed: int) -> dict[str, Any]:
    """The friction table, with the truth of both terms."""
    with tempfile.TemporaryDirectory() as folder:
        campaign, own = learned(Path(folder), case, seed)
        rows = etude.export(campaign, "parameters").facts["friction"]
    truth = {"dead band": own.band, "backlash": own.backlash, "coulomb": own.coulomb / own.gain}
    truth["viscous"] = own.viscous / own.gain
    found = [{**row, "truth": float(truth[row["term"]][plant.JOINTS.index(row["joint"])])}
             for row in rows if row["term"] in truth]  # fmt: skip
    return {"case": case, "seed": seed, "rows": found}


def summary(rows: list[dict[str, Any]]) -> None:
    """For each case, term and joint: robots, shown, evidence, and coverage of the intervals."""
    for case in dict.fromkeys(row["case"] for row in rows):
        own = [one for row in rows if row["case"] == case for one in row["rows"]]
        for term in dict.fromkeys(one["term"] for one in own):
            for joint in ("all", *plant.JOINTS):
                each = [o for o in own if o["term"] == term and joint in ("all", o["joint"])]
                nats = [o["evidence_nats"] for o in each]
                told = [o for o in each if o["lower"] is not None]
                z = np.array([(o["value"] - o["truth"]) / o["deviation"] for o in told])
                inside = f"{np.mean(np.abs(z) < 1.96):.2f}" if len(z) else "-"
                width = np.median([o["deviation"] for o in told]) if told else np.nan
                off = np.median([o["value"] / o["truth"] - 1 for o in told if o["truth"]] or [np.nan])
                print(
                    f"| {case} | {term} | {joint} | {sum(o['shown'] for o in each)} of {len(each)} | "
                    f"{np.median(nats):.1f}, {max(nats):.1f} | {inside} | {width:.3g} | {100 * off:+.1f} % |"
                )


def beside_a_band(rows: list[dict[str, Any]]) -> None:
    """Coverage of friction on the joints whose dead band is shown."""
    z: dict[str, list[float]] = {}
    for row in rows:
        banded = {o["joint"] for o in row["rows"] if o["term"] == "dead band" and o["shown"]}
        for o in row["rows"]:
            if o["joint"] in banded and o["term"] in ("coulomb", "viscous"):
                z.setdefault(o["term"], []).append((o["value"] - o["truth"]) / o["deviation"])
    for term, own in z.items():
        print(f"{term} beside a dead band: {np.mean(np.abs(own) < 1.96):.2f} of {len(own)} intervals")


def main() -> None:
    file, count = Path(sys.argv[1]), int(sys.argv[2])
    cases = sys.argv[3].split(",") if len(sys.argv) > 3 else list(CASES)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["case"], row["seed"]) for row in rows}
    for case, seed in [(c, k) for k in range(count) for c in cases if (c, k) not in known]:
        rows.append(row_of(case, seed))
        with file.open("a") as out:
            out.write(json.dumps(rows[-1]) + "\n")
    summary(rows)
    beside_a_band(rows)


if __name__ == "__main__":
    main()
