"""CampaignConfig: the whole configuration of a campaign."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from etude.design.config import DesignConfig
from etude.errors import UsageError
from etude.limits.tracking_margins import TrackingConfig
from etude.logs.config import LogConfig
from etude.models.config import ModelConfig
from etude.protocols import Kind
from etude.toml_tables import read_table


@dataclass(frozen=True)
class StopConfig:
    """The stop rule (see `campaign.evaluate.stopping`); each criterion can be switched off with 0.

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
        for own in fields(self):
            value = getattr(self, own.name)
            if not math.isfinite(value) or value < 0:
                raise UsageError(f"{own.name} = {value} must be 0 or a positive number", where=own.name)
        if self.consecutive < 1:
            raise UsageError("consecutive must be 1 or more", where="consecutive")


SHARED: dict[str, type] = {
    "model": ModelConfig,
    "design": DesignConfig,
    "tracking": TrackingConfig,
    "stop": StopConfig,
    "log": LogConfig,
}
"""Tables that mean the same for every kind; [trajectory] and [data] are the kind's own."""
SECTIONS = ("trajectory", "data", *SHARED)


@dataclass(frozen=True)
class CampaignConfig:
    """The whole configuration; each table of the file is one frozen dataclass of the room that uses it.

    Attributes:
        kind: of the robot, a name in the group etude.robots.
        preset: the named configuration that keys left out are taken from.
        seed: of every random number the campaign draws.
        trajectory: which trajectories may be asked for; the kind's own dataclass.
        data: how a log becomes samples; the kind's own dataclass.
        model: what is learned.
        design: how the next trajectory is chosen.
        stop: when another trajectory is not worth its robot time.
        log: how the robot's logs name things.
        tracking: what is kept of the limits for tracking errors.
    """

    kind: str
    preset: str
    seed: int
    trajectory: Any
    data: Any
    model: ModelConfig
    design: DesignConfig
    stop: StopConfig
    log: LogConfig = field(default_factory=LogConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)

    @property
    def duration(self) -> float:
        """Of each trajectory, s."""
        return float(self.trajectory.duration)


def preset_config(kind: Kind, name: str, where: str = "") -> CampaignConfig:
    """The kind's configuration of that name, with seed 0: its preset laid over the dataclasses' defaults.

    Raises:
        UsageError: the kind has no preset of that name, or the preset is impossible.
    """
    if name not in kind.presets:
        raise UsageError(
            f"unknown preset {name!r}", where=where, next_step=f"Use one of: {', '.join(kind.presets)}."
        )
    given = kind.presets[name]
    classes = tables_of(kind)
    tables = {
        section: read_table(classes[section], given.get(section, {}), classes[section](), f"preset {name}")
        for section in SECTIONS
    }
    return CampaignConfig(kind.name, name, 0, **tables)


def tables_of(kind: Kind) -> dict[str, type]:
    """The dataclass of each section of campaign.toml."""
    return {**{name: kind.tables[name] for name in ("trajectory", "data")}, **SHARED}
