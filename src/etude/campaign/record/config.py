"""CampaignConfig: everything a campaign was told to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from etude.campaign.record.stop_config import StopConfig
from etude.design.config import DesignConfig
from etude.errors import UsageError
from etude.limits.tracking import TrackingConfig
from etude.logs.columns.mapping import LogConfig
from etude.models.config import ModelConfig
from etude.protocols import Kind
from etude.toml_tables import read_table

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
