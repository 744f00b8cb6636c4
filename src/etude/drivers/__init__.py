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
        identity_with,
    )
    from etude.drivers.find import find_driver, require_known
    from etude.drivers.plans import first_segment_ends, planned
    from etude.drivers.playing import Interrupt, RecordedRows, interrupts, own_arrays, why_not
    from etude.drivers.recordings import read_recording, write_recording
    from etude.drivers.set_points import PathInTime, Stopping, acceleration_limits
    from etude.drivers.streaming import Streamed
    from etude.drivers.supervisor import Supervisor
    from etude.drivers.within_limits import refusals

__all__ = [
    "About",
    "Bounds",
    "Control",
    "Ended",
    "Factory",
    "Interrupt",
    "PathInTime",
    "Person",
    "PlannedMotion",
    "Player",
    "Reaction",
    "RecordedRows",
    "Recording",
    "Sample",
    "Stopping",
    "Stream",
    "Streamed",
    "Supervisor",
    "VelocityEnvelope",
    "Watch",
    "acceleration_limits",
    "find_driver",
    "first_segment_ends",
    "identity_with",
    "interrupts",
    "own_arrays",
    "planned",
    "read_recording",
    "refusals",
    "require_known",
    "why_not",
    "write_recording",
]
__getattr__, __dir__ = face(__name__)
