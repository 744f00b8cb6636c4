"""FlightDataset: the samples of one or several flights that an inverse model learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.flight.log import FlightLog
from etude.robots.flight_spec import FlightSpec
from etude.trajectories.flight.states import FlightStates, join_states

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEAR_LIMIT = 1e-3
"""A command this close to its limit, as a part of its range, is saturated."""
MOST_SATURATED = 0.95


@dataclass(frozen=True)
class FlightDataset:
    """States and commands of flights, by flight and time.

    Attributes:
        states: of the vehicle, (n,) samples.
        command: (n, 4) in `command_unit`.
        group: (n,) number of each sample's flight.
        t: (n,) s since its flight began.
        command_unit: "V", or another, for which a vehicle's motors say nothing.
    """

    states: FlightStates
    command: Array
    group: NDArray[np.int64]
    t: Array
    command_unit: str = "V"

    def __len__(self) -> int:
        return len(self.t)

    @property
    def flights(self) -> NDArray[np.int64]:
        """Numbers of the flights, increasing."""
        return np.unique(self.group)

    def take(self, index: NDArray[np.int64] | Mask) -> FlightDataset:
        """The samples at `index` (integer positions or a boolean mask)."""
        return replace(
            self,
            states=self.states.take(index),
            command=self.command[index],
            group=self.group[index],
            t=self.t[index],
        )

    def after(self, seconds: float) -> Mask:
        """(n,) samples later than `seconds` in their flight: without the transient of its start."""
        return np.asarray(self.t >= seconds)


def flight_dataset(
    logs: Sequence[FlightLog],
    spec: FlightSpec | None = None,
    *,
    first_s: float = 0.0,
    last_s: float = 0.0,
    numbers: Sequence[int] | None = None,
) -> FlightDataset:
    """The samples of `logs`, one flight each.

    Args:
        spec: gives the commands' limits; without it saturation is not looked for.
        first_s, last_s: what is trimmed from the beginning and the end of each flight, s.
        numbers: of the flights, if not 0, 1, ...

    Raises:
        DataError: no log or no sample left, different command units, NaN, commands that are saturated
            throughout, or no command that ever changes.
    """
    if not logs:
        raise DataError("there is no flight to learn from", next_step="Fly one and tell its log.")
    if len({log.command_unit for log in logs}) > 1:
        raise DataError(
            "the flights give their commands in different units",
            where=", ".join(sorted({log.command_unit for log in logs})),
            next_step="Learn from flights of one vehicle.",
        )
    numbers = range(len(logs)) if numbers is None else numbers
    for log in logs:
        _finite("t", log.t, log.source)
    parts = [_samples(log, number, first_s, last_s) for log, number in zip(logs, numbers, strict=True)]
    for log, part in zip(logs, parts, strict=True):
        _check(part, log, spec)
    joined = FlightDataset(
        join_states([part.states for part in parts]),
        np.concatenate([part.command for part in parts]),
        np.concatenate([part.group for part in parts]),
        np.concatenate([part.t for part in parts]),
        logs[0].command_unit,
    )
    if not np.ptp(joined.command, axis=0).any():
        raise DataError(
            "no command ever changes, so nothing can be learned",
            where=logs[0].source,
            next_step="Check that the log's commands are those that were sent.",
        )
    return joined.take(np.lexsort((joined.t, joined.group)))


def _samples(log: FlightLog, number: int, first_s: float, last_s: float) -> FlightDataset:
    t = log.t - log.t[0] if len(log) else log.t
    kept = (t >= first_s) & (t <= (t[-1] if len(t) else 0.0) - last_s)
    if not kept.any():
        raise DataError(
            "nothing is left of a flight after trimming",
            where=log.source or f"flight {number}",
            next_step="Trim less, or fly longer.",
        )
    group = np.full(int(kept.sum()), number, dtype=np.int64)
    return FlightDataset(log.states.take(kept), log.command[kept], group, t[kept], log.command_unit)


def _check(part: FlightDataset, log: FlightLog, spec: FlightSpec | None) -> None:
    where = log.source or f"flight {part.group[0]}"
    for name, values in {"command": part.command, **vars(part.states)}.items():
        if values is not None:
            _finite(name, values, where)
    if spec is None:
        return
    lower, upper = np.array(spec.command_lower), np.array(spec.command_upper)
    near = NEAR_LIMIT * (upper - lower)
    saturated = (part.command <= lower + near) | (part.command >= upper - near)
    if saturated.any(axis=1).mean() > MOST_SATURATED:
        raise DataError(
            "the commands are saturated throughout, so they do not tell what the motion needs",
            where=where,
            next_step="Fly slower, or correct the limits of the commands.",
        )


def _finite(name: str, values: Array, where: str) -> None:
    if not np.isfinite(values).all():
        raise DataError(
            f"the flight's {name} contains NaN or infinite values",
            where=where,
            next_step="Repair the log, or trim the samples off.",
        )
