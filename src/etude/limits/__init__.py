"""What may not be exceeded: limits, the set of motions inside them, samplers of it, certificates."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.limits.certificate import Certificate, certify
    from etude.limits.feasible import FeasibleSet
    from etude.limits.library import AxisLimit, NormLimit, TiltLimit
    from etude.limits.limit_tables import LimitTable, made_limits, read_limits
    from etude.limits.lipschitz import LipschitzLimit
    from etude.limits.samplers import SAMPLERS, boundary, scaled, timid, uniform
    from etude.limits.tracking import HELD, Ranges, margins_of, within_room

__all__ = [
    "HELD",
    "SAMPLERS",
    "AxisLimit",
    "Certificate",
    "FeasibleSet",
    "LimitTable",
    "LipschitzLimit",
    "NormLimit",
    "Ranges",
    "TiltLimit",
    "boundary",
    "certify",
    "made_limits",
    "margins_of",
    "read_limits",
    "scaled",
    "timid",
    "uniform",
    "within_room",
]
__getattr__, __dir__ = face(__name__)
