"""Vehicles with four rotors: what they are, how they fly and what a model of them looks at."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_quadrotor.kind import KIND as KIND
    from etude_quadrotor.spec import QuadrotorSpec as QuadrotorSpec

PUBLIC = ("controller", "flatness", "inputs", "kind", "preprocessing", "recorder", "spec")
"""Modules that may be used from outside."""
__getattr__, __dir__ = face(
    __name__,
    {
        "KIND": "kind",
        "QuadrotorSpec": "spec",
    },
)
