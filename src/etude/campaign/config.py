"""CampaignConfig: everything a campaign was told to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from etude.campaign.stop_config import StopConfig
from etude.design.config import DesignConfig
from etude.models.model_config import ModelConfig
from etude.models.preprocess import DataConfig
from etude.trajectories.family import TrajectoryFamily

if TYPE_CHECKING:
    from etude.campaign.flight.config import FlightConfig


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
        flight: of a flying vehicle, in place of trajectory, data, model and design; None for joints.
    """

    preset: str
    seed: int
    trajectory: TrajectoryFamily
    data: DataConfig
    model: ModelConfig
    design: DesignConfig
    stop: StopConfig
    flight: FlightConfig | None = None

    @property
    def duration(self) -> float:
        """Of each trajectory, s."""
        return self.trajectory.duration if self.flight is None else self.flight.trajectory.duration


SECTIONS = ("trajectory", "data", "model", "design", "stop")
