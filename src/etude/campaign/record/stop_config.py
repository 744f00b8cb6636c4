"""What the user wants to have reached before the robot is given back."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from etude.errors import UsageError


@dataclass(frozen=True)
class StopConfig:
    """The stop rule (see `campaign.stopping`); each criterion can be switched off with 0.

    Attributes:
        command_tolerance: forecast command error that is good enough, as a fraction of each axis's command
            limit; every axis must be below. Off by default: only the user knows what is good enough.
        noise_fraction: stop when the variance that is left is below this fraction of the noise variance.
        gain_per_minute: stop when the next trajectory removes less than this fraction of the variance
            left per minute of robot time, set-up included.
        setup_s: seconds of robot time that each trajectory costs besides its own duration.
        budget_trajectories: stop after this many logs.
        budget_minutes: stop after this many minutes of recorded motion.
        consecutive: how many logs in a row must agree before the first three criteria stop the campaign.
    """

    command_tolerance: float = 0.0
    noise_fraction: float = 0.1
    gain_per_minute: float = 0.05
    setup_s: float = 30.0
    budget_trajectories: int = 20
    budget_minutes: float = 0.0
    consecutive: int = 2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value) or value < 0:
                raise UsageError(f"{field.name} = {value} must be 0 or a positive number", where=field.name)
        if self.consecutive < 1:
            raise UsageError("consecutive must be 1 or more", where="consecutive")
