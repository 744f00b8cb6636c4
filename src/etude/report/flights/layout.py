"""The page of a flying vehicle, in the order of reading."""

from __future__ import annotations

from etude.report.flights.paths import paths
from etude.report.flights.proposals import flight_proposals
from etude.report.flights.tracking import tracking
from etude.report.flights.voltages import voltages
from etude.report.sections.calibration import calibration
from etude.report.sections.ladder import ladder
from etude.report.sections.learning import learning
from etude.report.sections.provenance import provenance, repairs
from etude.report.sections.rounds import rounds

FLIGHT_SECTIONS = (
    learning,
    rounds,
    paths,
    tracking,
    voltages,
    calibration,
    ladder,
    flight_proposals,
    repairs,
    provenance,
)

FLIGHT_CONTENTS = {
    "learning": "learning curve",
    "rounds": "cost of each round",
    "paths": "flights in 3-D",
    "tracking": "before and after",
    "voltages": "predicted against measured",
    "calibration": "calibration",
    "ladder": "model ladder",
    "trajectories": "flights and proofs",
    "repairs": "repairs",
    "provenance": "provenance",
}
