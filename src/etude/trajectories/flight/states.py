"""FlightStates: what an inverse model of a vehicle looks at, planned by flatness or measured alike."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightStates:
    """Samples of a flight; vectors are in the body frame. None: the log does not say.

    Attributes:
        altitude: (T,) m above ground, or None.
        specific_force: (T, 3) what an accelerometer reads, R_body_world (a + g z), m/s^2.
        rates: (T, 3) rad/s.
        angular_acceleration: (T, 3) rad/s^2.
        velocity: (T, 3) of the centre through still air, m/s, or None.
        acceleration: (T, 3) R_body_world a, without gravity, m/s^2, or None (thesis's own input).
    """

    altitude: Array | None
    specific_force: Array
    rates: Array
    angular_acceleration: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    def __len__(self) -> int:
        return len(self.specific_force)

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> FlightStates:
        """The samples at `index`."""
        return _made({name: None if part is None else part[index] for name, part in vars(self).items()})


def join_states(parts: list[FlightStates]) -> FlightStates:
    """One after the other; a quantity that one part lacks, the whole lacks."""
    columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(FlightStates)}
    return _made(
        {n: None if any(c is None for c in col) else np.concatenate(col) for n, col in columns.items()}
    )


def _made(columns: dict[str, Any]) -> FlightStates:
    return FlightStates(**columns)
