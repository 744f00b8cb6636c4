"""FlightLog: one recorded flight, at the rate that a model learns from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightLog:
    """A flight as a model sees it.

    Attributes:
        t: (T,) s, uniform.
        states: of the vehicle, (T,) samples.
        command: (T, 4) in `command_unit`, in the order of `command_names`.
        position, position_des: (T, 3) m in the world frame, measured and desired, or None.
        source: where it comes from.
        repairs: one sentence for each repair made while reading.
    """

    t: Array
    states: FlightStates
    command: Array
    command_names: tuple[str, ...]
    command_unit: str
    position: Array | None = None
    position_des: Array | None = None
    source: str = ""
    repairs: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)
