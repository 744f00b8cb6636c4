"""CampaignConfig: everything a campaign was told to do."""

from __future__ import annotations

from dataclasses import dataclass, fields

from etude.campaign.stop_config import StopConfig
from etude.design.config import DesignConfig
from etude.models.model_config import ModelConfig
from etude.models.preprocess import DataConfig
from etude.trajectories.family import TrajectoryFamily


@dataclass(frozen=True)
class CampaignConfig:
    """The whole configuration; each table of the file is one frozen dataclass of the room that uses it.

    Attributes:
        preset: the named configuration that keys left out are taken from.
        seed: of every random number the campaign draws.
        trajectory: which trajectories may be asked for.
        data: how a log becomes a data set.
        model: what is learned.
        design: how the next trajectory is chosen.
        stop: when another trajectory is not worth its robot time.
    """

    preset: str
    seed: int
    trajectory: TrajectoryFamily
    data: DataConfig
    model: ModelConfig
    design: DesignConfig
    stop: StopConfig


SECTIONS = tuple(field.name for field in fields(CampaignConfig) if field.name not in ("preset", "seed"))
