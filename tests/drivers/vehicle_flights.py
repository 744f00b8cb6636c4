"""Motions of the tests of vehicles' drivers, and who lets them go on."""

from __future__ import annotations

import numpy as np

from etude.drivers import PlannedMotion, Reaction, Sample, planned
from etude.trajectories import PointToPoint

AXES = ("x", "y", "z")


def through(*points: np.ndarray) -> PlannedMotion:
    """From point to point (3,), m, and at rest at each."""
    path = PointToPoint(np.array(points), 0.5, dwell=0.1, peak_acceleration=2.0, peak_jerk=50.0)
    text = path.to_json().encode()
    return planned(text, number=1, part="motion", speed=100, names=AXES, joints=AXES, rate=50.0)


def go(sample: Sample) -> Reaction:
    return Reaction.GO
