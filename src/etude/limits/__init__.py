"""What may not be exceeded: limits, the set of motions inside them, samplers of it, certificates."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.limits.certificate import Certificate as Certificate
    from etude.limits.certificate import certify as certify
    from etude.limits.library import AxisLimit as AxisLimit
    from etude.limits.library import NormLimit as NormLimit
    from etude.limits.library import TiltLimit as TiltLimit
    from etude.limits.lipschitz import LipschitzLimit as LipschitzLimit

PUBLIC = ("certificate", "feasible", "samplers", "tracking")
"""Modules that may be used from outside."""
__getattr__, __dir__ = face(
    __name__,
    {
        "AxisLimit": "library",
        "Certificate": "certificate",
        "LipschitzLimit": "lipschitz",
        "NormLimit": "library",
        "TiltLimit": "library",
        "certify": "certificate",
    },
)
