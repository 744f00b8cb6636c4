"""CrazyPAD: flights of two Crazyflies with weights and damaged propellers, as samples of a kind of their own.

The logs hold no gyroscope and no pitch, so what is logged predicts the motors but weakly, and a quadrotor's
inputs cannot be made of it. Commands are the four motors' shares, states what there is, averaged to 10 Hz.
Masalimov, Muslimov, Kozlov, Munasypov: CrazyPAD, Data 9(6):79, 2024 (MIT).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Channel, Column, Log, Samples

FILE = "crazypad_motor.npz"
MOTORS = ("m1", "m2", "m3", "m4")
STATES = ("z", "vx", "vy", "vz", "ax", "ay", "az", "roll")
COLUMNS = {
    **{name: f"stateEstimate.{name}" for name in STATES},
    **{name: f"motor.{name}" for name in MOTORS},
}
FULL = 65535.0
LEAD_IN, AFTER_S = 0.5, 0.5
"""In flight the mean command is above that part of its median; s left out beside it (ground effect)."""
ROWS = 10
"""That many rows of 100 Hz are averaged."""
NORMAL = "normal_flight"


@dataclass(frozen=True)
class Flight:
    """One flight: of which machine, in what condition, and its samples."""

    machine: str
    condition: str
    samples: Samples


@dataclass(frozen=True)
class Inputs:
    """The states as they are (the part of `protocols.Inputs` that learning takes)."""

    orders, rate = 1, 0.0

    @property
    def columns(self) -> tuple[Column, ...]:
        return tuple(("state", name, "1", "") for name in STATES)

    def of_log(self, log: Log) -> Array:
        return log["state"]

    def fitted(self, samples: Samples) -> Inputs:  # noqa: ARG002
        return self

    def arrays(self) -> dict[str, Array]:
        return {}

    def restore(self, arrays: Mapping[str, Array]) -> Inputs:  # noqa: ARG002
        return self


def flights(folder: Path) -> list[Flight]:
    """Every flight of the file in that folder.

    Raises:
        UsageError: it is not there.
    """
    path = folder / FILE
    if not path.is_file():
        step = "See docs/decisions/0035-promote-and-watch.md."
        raise UsageError(f"there is no {FILE}", where=str(folder), next_step=step)
    with np.load(path) as arrays:
        names, t, data, number = (arrays[n] for n in ("columns", "t", "data", "flight"))
        conditions, logs = arrays["condition"], arrays["log"]
    places = {name: int(np.flatnonzero(names == column)[0]) for name, column in COLUMNS.items()}
    recorded = []
    for i, (condition, log) in enumerate(zip(conditions.tolist(), logs.tolist(), strict=True)):
        rows = number == i
        values = {name: data[rows, place].astype(float) for name, place in places.items()}
        recorded.append(Flight(log[:2], condition, samples_of(t[rows] - t[rows][0], values, i)))
    return recorded


def samples_of(t: Array, values: Mapping[str, Array], number: int) -> Samples:
    """Means of ten rows each, in flight; t (T,) s, values (T,) by name of a state or motor."""
    command = np.column_stack([values[name] for name in MOTORS]) / FULL
    state = np.column_stack([values[name] for name in STATES])
    whole = len(t) // ROWS * ROWS
    mean = [a[:whole].reshape(-1, ROWS, *a.shape[1:]).mean(axis=1) for a in (t, state, command)]
    load = mean[2].mean(axis=1)
    up = mean[0][load > LEAD_IN * np.median(load[load > 0.0])]
    inside = (mean[0] >= up[0] + AFTER_S) & (mean[0] <= up[-1] - AFTER_S)
    channels = {
        "state": Channel("state", STATES, ("1",) * len(STATES)),
        "command": Channel("command", MOTORS, ("1",) * len(MOTORS), "command"),
    }
    log = Log(mean[0], channels, {"state": mean[1], "command": mean[2]}, f"flight {number}").take(inside)
    every = np.ones((len(log), len(MOTORS)), dtype=np.bool_)
    return Samples(log, np.full(len(log), number, dtype=np.int64), every, every)
