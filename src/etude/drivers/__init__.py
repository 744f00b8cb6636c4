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
    "VelocityEnvelope",
    "Watch",
]
__getattr__, __dir__ = face(__name__)
