"""Configuration of a campaign: `CampaignConfig`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from etude.design.config import DesignConfig
from etude.errors import UsageError, did_you_mean
from etude.limits.tracking_margins import TrackingConfig
from etude.logs.config import LogConfig
from etude.models.config import ModelConfig
from etude.protocols import Kind
from etude.toml_tables import read_table


@dataclass(frozen=True)
class StopConfig:
    """The stop rule (see `campaign.evaluate.stopping`); 0 switches a criterion off.

    Attributes:
        command_tolerance: sufficient expected command error, as a fraction of each axis's command limit;
            every axis must be below. Off by default, because only the user knows the tolerance.
        noise_fraction: stop if the remaining variance is below this fraction of the noise variance.
        gain_per_minute: stop if the next trajectory removes less than this fraction of the remaining variance
            per minute of robot time, set-up included.
        setup_s: set-up time of each trajectory, s.
        budget_trajectories: stop after this many logs.
        budget_minutes: stop after this many minutes of recorded motion.
        consecutive: number of successive logs on which each of the first three criteria must hold.
    """

    command_tolerance: float = 0.0
    noise_fraction: float = 0.1
    gain_per_minute: float = 0.05
    setup_s: float = 30.0
    budget_trajectories: int = 20
    budget_minutes: float = 0.0
    consecutive: int = 2

    def __post_init__(self) -> None:
        for setting in fields(self):
            value = getattr(self, setting.name)
            if not math.isfinite(value) or value < 0:
                raise UsageError(
                    f"{setting.name} = {value} must be 0 or a positive number", where=setting.name
                )
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
    """The whole configuration; each table of campaign.toml is one frozen dataclass of the room that uses it.

    Attributes:
        kind: of the robot, a name in the group etude.robots.
        preset: named configuration that gives the omitted keys.
        seed: of every random number in the campaign.
        trajectory: trajectories that may be proposed; the kind's own dataclass.
        data: preprocessing of a log into samples; the kind's own dataclass.
        model: to be learned.
        design: of the next trajectory.
        stop: stop rule.
        log: names in the robot's logs.
        tracking: margins for tracking errors.
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
        """Duration of each trajectory, s."""
        return float(self.trajectory.duration)


def preset_config(kind: Kind, name: str, where: str = "") -> CampaignConfig:
    """The kind's configuration of that name with seed 0: its preset laid over the dataclasses' defaults.

    Raises:
        UsageError: the kind has no such preset, or the preset is invalid.
    """
    if name not in kind.presets:
        raise UsageError(
            f"unknown preset {name!r}",
            where=where,
            next_step=f"{did_you_mean(name, kind.presets)}Use one of: {', '.join(kind.presets)}.",
        )
    preset = kind.presets[name]
    classes = tables_of(kind)
    tables = {
        section: read_table(classes[section], preset.get(section, {}), classes[section](), f"preset {name}")
        for section in SECTIONS
    }
    return CampaignConfig(kind.name, name, 0, **tables)


def tables_of(kind: Kind) -> dict[str, type]:
    """The dataclass of each section of campaign.toml."""
    return {**{name: kind.tables[name] for name in ("trajectory", "data")}, **SHARED}
