"""Each proposed flight: its path, its quantities as fractions of their limits, and its certificate."""

from __future__ import annotations

import numpy as np

from etude.report.flights.scene import Path, scene
from etude.report.markup import Html, element, join, number, paragraph, table
from etude.report.record import Facts, Record
from etude.report.sections.trajectories import fractions, interval, margin, meter, proposals
from etude.robots.spec import RobotSpec
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.limits import inner_box
from etude.trajectories.samples import Trajectory

UNITS = {"position": "m", "radius": "m", "speed": "m/s", "lift": "m/s²", "thrust": "m/s²", "tilt": "rad"}
SIZES = ("speed", "radius", "tilt")
"""Quantities without a sign; their certificates are written as -limit..limit."""
SAMPLES = 301


def flight_proposals(record: Record) -> Html:
    """One folded part per proposed flight, the newest open."""
    text = (
        "The room of a plan is the vehicle's, less a margin for the tracking error. Curves are drawn as a "
        "fraction of each limit: the dotted lines at ±1 are the limits. Lift is the vertical part of the "
        "thrust, and thrust and tilt are those of a vehicle without drag."
    )
    return proposals(record, text, flight_panels, proofs)


def flight_panels(trajectory: Trajectory, spec: RobotSpec) -> list[Html]:
    """The plan in its room; position and motion over time as fractions of their limits."""
    flight = spec.flight
    assert flight is not None  # the page is a vehicle's
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    samples = trajectory.sample(t)
    low, high = (np.array(side) for side in inner_box(flight))
    inside = (samples.q - 0.5 * (low + high)) / (0.5 * (high - low))
    force = samples.qdd + np.array([0.0, 0.0, GRAVITY])
    motion = {"speed": np.linalg.norm(samples.qd, axis=1) / flight.speed}
    if flight.thrust is not None:
        motion["thrust"] = np.linalg.norm(force, axis=1) / flight.thrust[1]
    if flight.tilt is not None:
        motion["tilt"] = np.arctan2(np.linalg.norm(force[:, :2], axis=1), force[:, 2]) / flight.tilt
    return [
        scene("The plan in its room", flight, [Path(t, samples.q)]),
        fractions("Position within its room", t, inside, ("x", "y", "z")),
        fractions("Motion / limit", t, np.stack(list(motion.values()), axis=1), tuple(motion), signed=False),
    ]


def proofs(certificate: Facts) -> Html:
    """One row per limit; how it was proved stands below, once."""
    rows = certificate.get("rows", ())
    body = [_row(row) for row in rows]
    methods = "; ".join(dict.fromkeys(str(row["method"]) for row in rows))
    header = ["limit of", "proved", "limit", "margin"]
    return join([table(header, body), paragraph(f"Method: {methods}.", class_="soft")])


def _row(row: Facts) -> list[object]:
    quantity = str(row["quantity"])
    unit = UNITS.get(quantity, "1")
    name = quantity if row["axis"] == "vehicle" else f"{row['axis']}, {quantity}"
    if quantity in SIZES:
        drawn = meter({**row, "lower": 0.0, "proved_lower": 0.0})
        proved, limit = (f"at most {number(row[key], 4)}" for key in ("proved_upper", "upper"))
    else:
        drawn = meter(row)
        proved = interval(row["proved_lower"], row["proved_upper"])
        limit = interval(row["lower"], row["upper"])
    return [name, join([element("b", f"{proved} {unit}"), drawn], ""), f"{limit} {unit}", margin(row)]
