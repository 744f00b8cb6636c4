"""Feedforward from a model, and the closed loop that uses it."""

from etude.control.closed_loop import control_times, run_closed_loop, tracking_error
from etude.control.feedforward import (
    Feedforward,
    model_feedforward,
    no_feedforward,
    perfect_feedforward,
    trust,
)

__all__ = [
    "Feedforward",
    "control_times",
    "model_feedforward",
    "no_feedforward",
    "perfect_feedforward",
    "run_closed_loop",
    "tracking_error",
    "trust",
]
