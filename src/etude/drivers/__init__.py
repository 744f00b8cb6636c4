"""Robots that Étude moves itself: the contract of drivers, and what streams, watches and records."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.drivers.contract import (
        About,
        Bounds,
        Control,
        Ended,
        Factory,
        Person,
        PlannedMotion,
        Player,
        Reaction,
        Recording,
        Sample,
        Stream,
        VelocityEnvelope,
        Watch,
    )
    from etude.drivers.find import find_driver
    from etude.drivers.plans import first_segment_ends, planned
    from etude.drivers.recordings import read_recording, write_recording
    from etude.drivers.streaming import Streamed
    from etude.drivers.supervisor import Supervisor

__all__ = [
    "About",
    "Bounds",
    "Control",
    "Ended",
    "Factory",
    "Person",
    "PlannedMotion",
    "Player",
    "Reaction",
    "Recording",
    "Sample",
    "Stream",
    "Streamed",
    "Supervisor",
    "VelocityEnvelope",
    "Watch",
    "find_driver",
    "first_segment_ends",
    "planned",
    "read_recording",
    "write_recording",
]
__getattr__, __dir__ = face(__name__)
