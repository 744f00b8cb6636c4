"""Robots of joints: arms, gantries, legs with a fixed base."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_arm.kind import KIND as KIND
    from etude_arm.spec import ArmSpec as ArmSpec

PUBLIC = ("adaptive_control", "controller", "preprocessing", "spec")
"""Modules that may be used from outside."""
__getattr__, __dir__ = face(
    __name__,
    {
        "ArmSpec": "spec",
        "KIND": "kind",
    },
)
