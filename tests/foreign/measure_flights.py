"""Position errors of exported set-points and of the addition on board, flown in rotorpy.

    python tests/foreign/measure_flights.py FOLDER [--curve 1.0] [--control se3|px4]

Resumable: each flight is one line of rows.csv, and what stands there is not flown again. One campaign for
each of three seeds learns from two flights of its own. It flies three motions, each with noise of its own.
Errors are mean distances from the set-points after 5 s.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from flight_lab import (  # noqa: E402
    exported,
    from_rest,
    learned_lab,
    least_squares_drag,
    table_of,
    with_drag,
    without_acceleration,
)
from onboard import onboard  # noqa: E402
from rotorpy_vehicle import Airframe, Cascade, Flight, Geometric, exact_acceleration, fly  # noqa: E402

from etude.trajectories import FourierTrajectory  # noqa: E402

SEEDS, FLIGHTS = (0, 1, 2), 2
MOTIONS = ("eight", "loops", "random")
WAYS = ("PID", "PID + acceleration", "least squares", "set-points", "set-points + on board", "exact")
CONTROLS: dict[str, type[Cascade]] = {"se3": Geometric, "px4": Cascade}


def motions(seed: int) -> dict[str, FourierTrajectory]:
    """Three motions of 15 s from rest to rest, at up to 4 m/s; the third is drawn anew for each seed."""
    eight, loops = np.zeros((6, 3)), np.zeros((6, 3))
    eight[[0, 1], 0], eight[[3, 4], 1], eight[[3, 5], 2] = (2.0, -2.0), (2.0, -1.0), (0.3, -0.1)
    loops[[0, 2], 0], loops[[3, 5], 1], loops[[0, 1], 2] = (2.0, -2.0), (2.0, -2.0 / 3.0), (0.3, -0.3)
    drawn = np.random.default_rng(100 + seed).uniform(-1.0, 1.0, (6, 3)) * [1.0, 1.0, 0.3]
    return {"eight": from_rest(eight), "loops": from_rest(loops, centre=1.5), "random": from_rest(drawn)}


def rows_of(
    folder: Path, curve: float, control: str, known: set[tuple[str, ...]]
) -> Iterator[tuple[str, ...]]:
    """seed, motion, way, error in m: those that are not known yet."""
    frame, controller = Airframe(curve=curve), CONTROLS[control]
    for seed in SEEDS:
        wanted = [(str(seed), m, w) for m in MOTIONS for w in WAYS]
        if all(row in known for row in wanted):
            continue
        place = folder / f"seed{seed}"
        lab, flown = _campaign(place, seed, frame, controller)
        added = onboard(lab, place / "px4", decouple=controller is Cascade)
        drag = least_squares_drag(flown)
        for name, motion in motions(seed).items():
            file = place / f"{name}.json"
            file.write_text(motion.to_json())
            told, held = exported(lab, file, place / name)
            plain = told.copy()
            plain[:, 6:9] -= held
            noise = 10 * seed + MOTIONS.index(name)
            rows = {
                "PID": without_acceleration(plain),
                "PID + acceleration": plain,
                "least squares": with_drag(plain, drag),
                "set-points": told,
                "set-points + on board": told,
                "exact": exact_acceleration(plain, frame),
            }
            for way in WAYS:
                if (str(seed), name, way) in known:
                    continue
                own = added if "on board" in way else None
                flight = fly(rows[way], frame=frame, controller=controller, seed=noise, onboard=own)
                yield str(seed), name, way, f"{flight.error():.6f}"


def _campaign(
    place: Path, seed: int, frame: Airframe, controller: type[Cascade]
) -> tuple[Path, list[Flight]]:
    """The campaign of a seed, learned once; what was flown is flown again for the logs alone."""
    done = place / "lab" / "models" / f"{FLIGHTS:04d}"
    if not done.is_dir():
        place.mkdir(parents=True, exist_ok=True)
        return learned_lab(place, FLIGHTS, seed=seed, frame=frame, controller=controller, per_step=print)
    flown = []
    for number in range(1, FLIGHTS + 1):
        table, _ = table_of(place / "lab" / "proposals" / f"{number:04d}" / "px4" / "setpoints.csv")
        flown.append(fly(table, seed=1000 * seed + number, frame=frame, controller=controller))
    return place / "lab", flown


def main() -> None:
    """Flies what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--curve", type=float, default=1.0, help="PX4's THR_MDL_FAC")
    parser.add_argument("--control", choices=tuple(CONTROLS), default="se3")
    given = parser.parse_args()
    folder: Path = given.folder / f"{given.control}_{given.curve:g}"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "rows.csv"
    rows = [tuple(row) for row in csv.reader(path.read_text().splitlines())] if path.is_file() else []
    with path.open("a", newline="") as file:
        for row in rows_of(folder, given.curve, given.control, {row[:3] for row in rows}):
            csv.writer(file).writerow(row)
            file.flush()
            rows.append(row)
            print(*row)
    print(f"| {given.control}, THR_MDL_FAC {given.curve:g} | {' | '.join(MOTIONS)} | mean | worst |")
    for way in WAYS:
        own = {name: [float(r[3]) for r in rows if r[1:3] == (name, way)] for name in MOTIONS}
        every = np.concatenate([np.array(values) for values in own.values()])
        each = " | ".join(f"{np.mean(values):.3f}" for values in own.values())
        print(f"| {way} | {each} | {every.mean():.3f} | {every.max():.3f} |")


if __name__ == "__main__":
    main()
