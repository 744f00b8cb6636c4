"""Robots of joints: arms, gantries, legs with a fixed base."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_arm.adaptive_control import AdaptiveController, craig_hsu_sastry, slotine_li
    from etude_arm.controller import PerfectController
    from etude_arm.inputs import ArmInputs
    from etude_arm.kind import KIND
    from etude_arm.physics.mean import ArmPhysics
    from etude_arm.preprocessing import filter_cutoff
    from etude_arm.spec import ArmSpec, Axis

__all__ = [
    "KIND",
    "AdaptiveController",
    "ArmInputs",
    "ArmPhysics",
    "ArmSpec",
    "Axis",
    "PerfectController",
    "craig_hsu_sastry",
    "filter_cutoff",
    "slotine_li",
]
__getattr__, __dir__ = face(__name__)
