"""False alarms of "the robot has changed" on flights of one vehicle, flown in rotorpy.

    python tests/foreign/measure_alarms.py FOLDER [--seeds 12]

Resumable: a campaign that stands in the folder is not flown again. Each learns two flights that it asked for,
of the SE(3) controller (THR_MDL_FAC 1) or of PX4's cascade (0). The third and the fourth flight are each held
against the model of those before, as `etude tell` does; then with the variances as they are predicted, and
the same flights with commands times 1.1.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from flight_lab import learned_lab, run, table_of  # noqa: E402
from rotorpy_vehicle import Airframe, Cascade, Geometric, fly  # noqa: E402

from etude.campaign import (  # noqa: E402
    ingested_samples,
    open_campaign,
    stored_model,
)
from etude.models import ChangeTest, change_test  # noqa: E402
from etude.types import Samples  # noqa: E402

FIRST, LAST = 2, 4
"""Flights that are learned before the first question, and the last one that is asked about."""
CONTROLS: dict[str, tuple[type[Cascade], float]] = {"se3": (Geometric, 1.0), "px4": (Cascade, 0.0)}
"""Controllers, each with its THR_MDL_FAC."""
FACTOR = 1.1


def flown(folder: Path, seed: int, control: str) -> Path:
    """The campaign's folder, with all its flights learned."""
    lab, (controller, curve) = folder / "lab", CONTROLS[control]
    if (lab / "models" / f"{LAST:04d}").is_dir():
        return lab
    folder.mkdir(parents=True)
    frame = Airframe(curve=curve)
    learned_lab(folder, FIRST, seed=seed, frame=frame, controller=controller, quick=True)
    for number in range(FIRST + 1, LAST + 1):
        run("ask", lab, "--format", "px4", "--continue")
        table, _ = table_of(lab / "proposals" / f"{number:04d}" / "px4" / "setpoints.csv")
        log = folder / f"{number}.csv"
        log.write_text(fly(table, seed=1000 * seed + number, frame=frame, controller=controller).csv())
        run("tell", lab, log, "--changed", "same")
    return lab


def judgements(lab: Path) -> Iterator[tuple[int, ChangeTest, ChangeTest, ChangeTest]]:
    """Of each flight: the logs that the model had, what is said of it, with variances that are not doubted,
    and with commands times `FACTOR`.
    """
    campaign = open_campaign(lab)
    for number in range(FIRST + 1, LAST + 1):
        model, samples = stored_model(campaign, number - 1), ingested_samples(campaign, [number])
        with patch("etude.models.change.evidence.detection_variances", lambda variance, _: variance):
            trusted = change_test(model, samples)
        yield number - 1, change_test(model, samples), trusted, change_test(model, scaled(samples))


def scaled(samples: Samples) -> Samples:
    """With commands times `FACTOR`."""
    log = samples.log
    return replace(samples, log=log.put(log.channels["command"], FACTOR * samples.command))


def main() -> None:
    """Flies what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=12)
    given = parser.parse_args()
    found: dict[tuple[str, int], list[tuple[ChangeTest, ChangeTest, ChangeTest]]] = {}
    for seed in range(given.seeds):
        for control in CONTROLS:
            lab = flown(given.folder / f"{control}_{seed}", seed, control)
            for logs, same, trusted, other in judgements(lab):
                found.setdefault((control, logs), []).append((same, trusted, other))
                print(control, seed, logs, f"{same.evidence.max():.1f} {same.z2:.2f}", flush=True)
    print("| controller | logs | false alarms | as predicted | largest evidence | z² | x 1.1 noticed |")
    for (control, logs), rows in found.items():
        alarms, before, noticed = (
            f"{sum(one.alarm is not None for one in own)} of {len(rows)}" for own in zip(*rows, strict=True)
        )
        sizes = sorted(same.z2 for same, *_ in rows)
        most = max(float(same.evidence.max()) for same, *_ in rows)
        z2 = f"{sizes[len(rows) // 2]:.2f}, {sizes[-1]:.2f}"
        print(f"| {control} | {logs} | {alarms} | {before} | {most:.1f} | {z2} | {noticed} |")


if __name__ == "__main__":
    main()
