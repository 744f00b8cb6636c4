"""Parameters of a quadrotor with a load off the centre, a hexacopter and an octocopter, flown in rotorpy.

    python tests/foreign/measure_vehicle_parameters.py RESULTS.jsonl [--seeds 10 11] [--flights 6] [--sweep]
        [--sideways]

Each line is a parameter of one campaign of so many flights of 15 s, beside the plant's own value; with
`--sweep` the last of them goes up and down, with `--sideways` the last three to and fro. What stands in the
file is not flown again, so other flights take another file. `--table` prints what there is.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from flight_lab import from_rest  # noqa: E402
from rotorpy_vehicle import RADIUS, Airframe, Array, Flight, fly  # noqa: E402
from scipy.optimize import root  # noqa: E402

from etude import plugins  # noqa: E402
from etude.types import Log  # noqa: E402
from etude_quadrotor import KIND, QuadrotorSpec  # noqa: E402

FRAMES = {"quadrotor": Airframe(), "hexacopter": Airframe(rotors=6), "octocopter": Airframe(rotors=8)}
SEEDS, FLIGHTS = tuple(range(10, 20)), 6
LOW = 1.3
"""m that flights stay above."""
TARGETS = {"hover thrust": 0.02, "motor time constant": 0.15, "rotor drag": 0.15, "centre of mass": 0.005}
"""Relative; of the centre of mass in m."""


def set_points(seed: int) -> Array:
    """(N, 9) of a random flight of 15 s about 3 m of height, at 50 Hz."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 15.0, 0.02)
    while True:
        velocity = rng.standard_normal((6, 3)) * [1.0, 1.0, 0.5]
        orders = from_rest(velocity, most=3.3, centre=3.0).motion(t, 3).orders
        if orders[0, :, 2].min() > LOW:
            return np.concatenate(list(orders), axis=1)


def up_and_down() -> Array:
    """(N, 9) of 15 s about 3 m of height: 3 m/s^2 at 0.5 to 1.5 Hz, as docs/vehicle_parameters.md has it."""
    t = np.arange(0.0, 15.001, 0.02)
    found, hertz = np.zeros((len(t), 9)), 0.5 * 3.0 ** (t / 15.0)
    soft = np.clip(np.minimum(t, 15.0 - t) / 2.0, 0.0, 1.0)
    size = 3.0 * soft**2 * (3.0 - 2.0 * soft) / (2.0 * np.pi * hertz) ** 2
    found[:, 2] = 3.0 - size * np.sin(2.0 * np.pi * np.cumsum(hertz) * 0.02)
    found[:, 5] = np.gradient(found[:, 2], t)
    found[:, 8] = np.gradient(found[:, 5], t)
    return found


def to_and_fro() -> Array:
    """(N, 9) of 15 s at 3 m of height: along x and y at once, up to 7 m/s each, as the page has it."""
    t, period = np.arange(0.0, 15.001, 0.02), 7.0
    found, part = np.zeros((len(t), 9)), np.minimum(t, 15.0 - t) / 7.5
    size = 7.0 * period / (2.0 * np.pi) * part**2 * (3.0 - 2.0 * part)
    found[:, 0] = found[:, 1] = size * np.sin(2.0 * np.pi * t / period)
    found[:, 2] = 3.0
    for order in (3, 6):
        found[:, order] = found[:, order + 1] = np.gradient(found[:, order - 3], t)
    return found


def flown(frame: Airframe, seed: int, count: int = FLIGHTS, last: Sequence[Array] = ()) -> list[Flight]:
    """Flights of one campaign, the last of them along given set-points."""
    paths = [*(set_points(100 * seed + i) for i in range(count - len(last))), *last]
    return [fly(path, frame=frame, seed=100 * seed + i) for i, path in enumerate(paths)]


def spec_of(frame: Airframe) -> QuadrotorSpec:
    """The vehicle as its owner knows it: without the load."""
    own, count = frame.bare(), frame.rotors
    pairs = zip(own["rotor_pos"].values(), own["rotor_directions"], strict=True)
    return QuadrotorSpec(
        "foreign",
        (-14.0, -14.0, 0.0),
        (14.0, 14.0, 6.0),
        8.0,
        tuple(f"motor_{i + 1}" for i in range(count)),
        "1",
        (0.0,) * count,
        (1.0,) * count,
        25.0,
        # rotorpy's direction is that of the torque on the body
        rotors=tuple((float(x), float(y), -float(way)) for (x, y, _), way in pairs),
        thrust_curve=frame.curve,
    )


def log_of(spec: QuadrotorSpec, rows: Array) -> Log:
    """What `Flight.log` holds as a log."""
    channels, first = {c.name: c for c in KIND.channels(spec)}, 1
    found = Log(rows[:, 0], {}, {}, "rotorpy")
    for name in ("specific_force", "rates", "command", "position", "velocity", "orientation"):
        width = len(channels[name].parts)
        found = found.put(channels[name], rows[:, first : first + width])
        first += width
    return found


def truth(frame: Airframe, heights: Array) -> dict[str, float]:
    """The plant's own values, hover thrust at the heights flown (N,) m."""
    own, n = frame.parameters(), frame.rotors
    mass, still = own["mass"], frame.still()
    shift = frame.load / mass * np.array(frame.place)
    lift = float(np.mean(1.0 / (1.0 - (RADIUS / (4.0 * heights)) ** 2)))
    curved = (still / frame.full) ** 2 / lift
    found = {
        "hover thrust": _trimmed(frame, shift, lift),
        "thrust curve": 1.0,  # of rotors whose thrust goes with the squared set-point
        "hover thrust with that curve": curved,
        "motor time constant": frame.lag,
    }
    for axis, name in enumerate("xy"):
        found[f"centre of mass {name}"] = float(shift[axis])
        found[f"rotor drag {name}"] = n * own["k_d"] * still / mass
        found[f"body drag {name}"] = own[f"c_D{name}"] / mass
    return found


def _trimmed(frame: Airframe, shift: Array, lift: float) -> float:
    """Mean control of all motors that hold the vehicle level, allocated as PX4 does."""
    own = frame.parameters()
    places = np.stack(list(frame.bare()["rotor_pos"].values()))
    spins, ones = own["rotor_directions"], np.ones(frame.rotors)
    mix = np.linalg.pinv(np.stack([ones, places[:, 1], -places[:, 0], 0.05 * spins]))
    arms = places - shift
    effect = np.stack([ones, arms[:, 1], -arms[:, 0], own["k_m"] / own["k_eta"] * spins])
    most = own["k_eta"] * frame.full**2 * lift

    def left(asked: Array) -> Array:
        u = np.maximum(mix @ asked, 0.0)
        u = u if frame.curve == 0.0 else _driven(u, frame.curve)
        return np.asarray(effect @ (most * u**2) / (own["mass"] * 9.81) - [1.0, 0.0, 0.0, 0.0])

    return float((mix @ root(left, [0.5 * frame.rotors, 0.0, 0.0, 0.0]).x).mean())


def _driven(control: Array, curve: float) -> Array:
    half = (1.0 - curve) / (2.0 * curve)
    return np.asarray(np.sqrt(half**2 + control / curve) - half)


def measured(frame: Airframe, logs: Sequence[Array]) -> list[dict[str, Any]]:
    """Of each parameter: truth, value, lower, upper; None where it is not measured."""
    spec, n = spec_of(frame), frame.rotors
    target = plugins.load("etude.targets", "parameters")
    given = {"samples": None, "config": None, "logs": [log_of(spec, rows) for rows in logs]}
    rows = target(None, KIND, spec, given).facts["parameters"]
    true = truth(frame, np.concatenate([own[:, 9 + n] for own in logs]))
    kept = ("parameter", "value", "lower", "upper")
    return [{**{key: row[key] for key in kept}, "truth": true[row["parameter"]]} for row in rows]


def campaigns(
    seeds: Sequence[int], count: int, last: Sequence[Array], known: set[tuple[str, int]]
) -> Iterator[dict[str, Any]]:
    """Lines of those campaigns that are not known yet."""
    for seed in seeds:
        for name, frame in FRAMES.items():
            if (name, seed) not in known:
                for row in measured(frame, [own.log for own in flown(frame, seed, count, last)]):
                    yield {"frame": name, "seed": seed, **row}


def covered(rows: Sequence[dict[str, Any]]) -> float:
    """Part of the intervals that hold the truth."""
    return float(np.mean([row["lower"] <= row["truth"] <= row["upper"] for row in rows]))


def off(row: dict[str, Any]) -> float:
    """How far a value is off: of the centre of mass and the curve in their units, else relative."""
    error = abs(row["value"] - row["truth"])
    absolute = row["parameter"].startswith(("centre", "thrust curve"))
    return error if absolute else error / abs(row["truth"])


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: error and coverage by parameter, over all frames and seeds."""
    lines = ["| parameter | measured | worst error | half the interval, median | coverage |"]
    lines.append("|---|---|---|---|---|")
    for name in dict.fromkeys(row["parameter"] for row in rows):
        every = [row for row in rows if row["parameter"] == name]
        own = [row for row in every if row["value"] is not None]
        if not own:
            lines.append(f"| {name} | 0 of {len(every)} | | | |")
            continue
        half = np.median([off({**row, "value": row["truth"] + row["upper"] - row["value"]}) for row in own])
        worst, unit = max(map(off, own)), ""
        if name.startswith("centre"):
            worst, half, unit = 1e3 * worst, 1e3 * half, " mm"
        elif not name.startswith("thrust curve"):
            worst, half, unit = 100.0 * worst, 100.0 * half, " %"
        held = f"{covered(own):.2f}"
        lines.append(
            f"| {name} | {len(own)} of {len(every)} | {worst:.2g}{unit} | {half:.2g}{unit} | {held} |"
        )
    told = [row for row in rows if row["value"] is not None]
    lines.append(f"| all | {len(told)} of {len(rows)} | | | {covered(told):.3f} |")
    return "\n".join(lines)


def main() -> None:
    """Flies what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS)
    parser.add_argument("--flights", type=int, default=FLIGHTS)
    parser.add_argument("--sweep", action="store_true", help="the last flight goes up and down")
    parser.add_argument("--sideways", action="store_true", help="the last three flights go to and fro")
    parser.add_argument("--table", action="store_true", help="of what there is")
    given = parser.parse_args()
    path: Path = given.results
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
    if not given.table:
        with path.open("a") as file:
            known = {(row["frame"], row["seed"]) for row in rows}
            last = [up_and_down()] * given.sweep + [to_and_fro()] * (3 * given.sideways)
            for row in campaigns(given.seeds, given.flights, last, known):
                file.write(json.dumps(row) + "\n")
                file.flush()
                rows.append(row)
    print(table(rows))


if __name__ == "__main__":
    main()
