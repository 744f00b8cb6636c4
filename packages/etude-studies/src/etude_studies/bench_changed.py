"""`etude bench changed`: is a real robot that is the same taken for another one?

Each third of a recording is judged by a model of the two others, taken as two logs, without a rigid body: a
new piece of motion of the same robot. Beside it the same third with all commands 1.3 times as large. Of the
Crazyflie's flights a third of every stretch, by a model of the others; and each flight by a model of the
others, whose manoeuvres are not its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from etude.models import ChangeTest, change_test, near_times
from etude.progress import counted
from etude.types import Index, Samples, joined_samples
from etude_arm import filter_cutoff
from etude_studies.crazyflie_flights import crazyflie, crazyflie_flights
from etude_studies.real_logs import REAL_LOGS, arm_log
from etude_studies.rows import Row, rows_json, table
from etude_studies.world import World

THIRDS = 3
GAIN = 1.3
FLIGHT_GAP_S = 0.1
"""The gap of flights: longer than the means and the filters."""


def run(*, json: bool = False, seed: int = 0, logs: Path | None = None) -> list[Row]:
    """Judges all recordings and prints the rows; `logs` is a folder with those not in the project."""
    rows = [row for world, name, splits in counted(cases(logs)) for row in rows_of(world, name, splits, seed)]
    if json:
        command = "etude bench changed" + " --logs FOLDER" * (logs is not None) + " --json"
        print(rows_json(rows, command))  # noqa: T201
    else:
        table(rows, "real robots, unchanged")
    return rows


Split = tuple[Samples, list[Samples]]
"""Training samples, a group for each log, and the logs to judge by them."""


def cases(logs: Path | None) -> Iterator[tuple[World, str, list[Split]]]:
    """Robot, name and what is judged by what."""
    for real in REAL_LOGS:
        path = real.find(logs)
        if path is None:
            continue
        if real.name == "sarcos":
            from etude_studies.external_logs import sarcos_samples

            world, samples = sarcos_samples(path)
            yield world, real.name, thirds([samples], 0.0)
        else:
            log, world = arm_log(real.name, path)
            yield world, real.name, thirds([world.samples(log)], 1.0 / filter_cutoff(log, world.config.data))
    flights = {
        number: crazyflie().samples(*logs_of_flight) for number, logs_of_flight in crazyflie_flights().items()
    }
    stretches = [s.take(s.group == g) for s in flights.values() for g in np.unique(s.group)]
    if flights:
        yield crazyflie(), "crazyflie", thirds(stretches, FLIGHT_GAP_S)
        yield crazyflie(), "crazyflie_unseen", others(list(flights.values()))


def thirds(logs: Sequence[Samples], gap_s: float) -> list[Split]:
    """Each third of each log, and all logs' other thirds, less what is nearer than the gap."""
    place = [np.argsort(np.argsort(log.t, kind="stable")) * THIRDS // len(log) for log in logs]
    splits = []
    for number in range(THIRDS):
        train = [
            grouped(log, THIRDS * i + third).take(
                (third != number) & ~near_times(log.t, third == number, gap_s)
            )
            for i, (log, third) in enumerate(zip(logs, place, strict=True))
        ]
        tests = [log.take(third == number) for log, third in zip(logs, place, strict=True)]
        splits.append((joined_samples(train), tests))
    return splits


def others(flights: Sequence[Samples]) -> list[Split]:
    """The stretches of each flight, and the rest of the flights."""
    named = [grouped(flight, 10 * i + flight.group) for i, flight in enumerate(flights)]
    return [
        (
            joined_samples([f for f in named if f is not chosen]),
            [chosen.take(chosen.group == number) for number in np.unique(chosen.group)],
        )
        for chosen in named
    ]


def grouped(samples: Samples, group: Index) -> Samples:
    """The same samples as parts of other logs."""
    return Samples(samples.log, group, samples.usable, samples.moving)


def larger(samples: Samples) -> Samples:
    """The same motion with larger commands."""
    log = samples.log
    more = log.put(log.channels["command"], GAIN * samples.command)
    return Samples(more, samples.group, samples.usable, samples.moving)


def rows_of(world: World, name: str, splits: Sequence[Split], seed: int) -> list[Row]:
    """False alarms, the largest evidence, and how often larger commands are noticed."""
    same: list[ChangeTest] = []
    changed: list[ChangeTest] = []
    for train, tests in splits:
        rng = np.random.default_rng(seed)
        model = world.learned(train, world.config.model, rng, body=False).model
        same += [change_test(model, test) for test in tests]
        changed += [change_test(model, larger(test)) for test in tests]
    of = f"of {len(same)} parts"
    alarms, noticed = (sum(result.alarm is not None for result in results) for results in (same, changed))
    return [
        Row(f"false_alarms_{name}", alarms, "1", of),
        Row(f"largest_{name}", max(float(result.evidence.max()) for result in same), "nats"),
        Row(
            f"z2_{name}", float(np.mean([result.z2 for result in same])), "1", "mean of their squared errors"
        ),
        Row(f"noticed_{name}", noticed, "1", f"{of}, commands x {GAIN:g}"),
    ]
