"""The physics of a vehicle as structures: nominal, which needs no data, and identified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from etude.errors import DataError
from etude.protocols import Mean
from etude.types import Array, Samples
from etude_quadrotor.physics.linear_inverse import OPTIONAL, LinearInverse, identify_linear
from etude_quadrotor.physics.vehicle_inverse import (
    VehicleInverse,
    identify_vehicle,
    nominal_inverse,
)
from etude_quadrotor.vehicle import Vehicle

CORRELATION_S = 0.5
"""s: samples within this time count as one in the identification."""


@dataclass(frozen=True)
class Nominal:
    """The vehicle as its owner describes it. A `protocols.Physics`."""

    vehicle: Vehicle

    def __call__(self, samples: Samples | None = None) -> Mean:  # noqa: ARG002
        """The same for any samples."""
        return nominal_inverse(self.vehicle)

    def restore(self, arrays: Mapping[str, Array]) -> Mean:
        """The mean whose `arrays()` these are."""
        return VehicleInverse(self.vehicle, arrays["coefficients"])


@dataclass(frozen=True)
class Identified:
    """Identified physics: coefficients of the vehicle's motors, or weights of features. A
    `protocols.Physics`.

    Attributes:
        vehicle: whose motors explain the commands, which are then in V; None without description.
        trims: whether each motor has a constant of its own.
    """

    vehicle: Vehicle | None
    trims: bool = True

    def __call__(self, samples: Samples | None) -> Mean:
        """Identified from the samples. DataError: none, or NaN."""
        if samples is None:
            raise DataError("there is no sample to identify a model from", next_step="Ingest a flight first.")
        steps = np.diff(samples.t)[np.diff(samples.group) == 0]
        weight = min(1.0, float(np.median(steps)) / CORRELATION_S) if len(steps) else 1.0
        if self.vehicle is None:
            return identify_linear(samples.log, weight, samples.usable)
        return identify_vehicle(self.vehicle, samples.log, weight, trims=self.trims, use=samples.usable)

    def restore(self, arrays: Mapping[str, Array]) -> Mean:
        """The mean whose `arrays()` these are, bit for bit."""
        if self.vehicle is not None:
            return VehicleInverse(self.vehicle, arrays["coefficients"], arrays.get("deviation"))
        uses = tuple(name for name, used in zip(OPTIONAL, arrays["uses"], strict=True) if used)
        parameters = {name: arrays[name] for name in ("centre", "spread", "weights", "offset")}
        return LinearInverse(uses, **parameters)
