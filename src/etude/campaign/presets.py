"""Named, frozen configurations: `default`, the good one, and `thesis`, the faithful protocol."""

from __future__ import annotations

from dataclasses import replace

from etude.campaign.config import CampaignConfig
from etude.campaign.stop_config import StopConfig
from etude.design.config import DesignConfig
from etude.errors import UsageError
from etude.models.model_config import PRESETS as MODEL
from etude.models.preprocess import PRESETS as DATA
from etude.trajectories.family import TrajectoryFamily

NAMES = ("default", "thesis")


def preset(name: str, where: str = "", *, flying: bool = False) -> CampaignConfig:
    """The named configuration, with seed 0; of a flying vehicle, or of a robot of joints.

    Raises:
        UsageError: there is no preset of that name.
    """
    if flying and name in NAMES:
        from etude.campaign.flight.config import FLIGHT_PRESETS

        return replace(preset(name), flight=FLIGHT_PRESETS[name])
    if name == "default":
        return CampaignConfig(
            name, 0, TrajectoryFamily(), DATA[name], MODEL[name], DesignConfig(), StopConfig()
        )
    if name == "thesis":
        return _thesis()
    raise UsageError(f"unknown preset {name!r}", where=where, next_step=f"Use one of: {', '.join(NAMES)}.")


def _thesis() -> CampaignConfig:
    """Chapter 6: two harmonics, desired inputs, ARD-SE, dictionary by error, mean variance, six logs."""
    return CampaignConfig(
        preset="thesis",
        seed=0,
        trajectory=TrajectoryFamily(harmonics=2, duration=60.0, omega0=(0.105, 0.2), rest="ramp"),
        data=DATA["thesis"],
        model=MODEL["thesis"],
        design=DesignConfig(criterion="mean_variance", raw_units=True),
        stop=StopConfig(
            command_tolerance=0.0, noise_fraction=0.0, gain_per_minute=0.0, budget_trajectories=6
        ),
    )
