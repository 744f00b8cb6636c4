"""Limits, the set of motions inside them, samplers of it, certificates."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.limits.certificate import (
        APPROACH,
        COLLISIONS,
        SPEED,
        Certificate,
        certify,
        certify_bytes,
        in_words,
        place_of,
        require_certified,
        slack,
        utilization,
    )
    from etude.limits.commands import CommandLimit
    from etude.limits.feasible import Block, FeasibleSet
    from etude.limits.lead_ins import at_rest
    from etude.limits.lipschitz import LipschitzLimit
    from etude.limits.motion_limits import AxisLimit, NormLimit, TiltLimit
    from etude.limits.robot_file_limits import LimitTable, made_limits, read_limits
    from etude.limits.samplers import SAMPLERS, boundary, scaled, timid, uniform
    from etude.limits.tracking_margins import HELD, HIDDEN, Ranges, TrackingConfig, margins_of, within_room

__all__ = [
    "APPROACH",
    "COLLISIONS",
    "HELD",
    "HIDDEN",
    "SAMPLERS",
    "SPEED",
    "AxisLimit",
    "Block",
    "Certificate",
    "CommandLimit",
    "FeasibleSet",
    "LimitTable",
    "LipschitzLimit",
    "NormLimit",
    "Ranges",
    "TiltLimit",
    "TrackingConfig",
    "at_rest",
    "boundary",
    "certify",
    "certify_bytes",
    "in_words",
    "made_limits",
    "margins_of",
    "place_of",
    "read_limits",
    "require_certified",
    "scaled",
    "slack",
    "timid",
    "uniform",
    "utilization",
    "within_room",
]
__getattr__, __dir__ = face(__name__)
