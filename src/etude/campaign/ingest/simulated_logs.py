"""Which logs a simulated robot left, and which are of the robot itself: no model may learn from both."""

from __future__ import annotations

from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round, State

SIMULATED = "simulated"
"""The folder of a campaign with the logs that its simulated robot left."""


def simulated_logs(campaign: Campaign, state: State) -> list[Round]:
    """Rounds in use whose log came out of `etude simulate`, by number."""
    return [r for r in state.told if _left(campaign, r)]


def real_logs(campaign: Campaign, state: State) -> list[Round]:
    """Rounds in use whose log came from elsewhere, by number."""
    return [r for r in state.told if not _left(campaign, r)]


def mixed(campaign: Campaign, state: State) -> tuple[str, ...]:
    """A sentence where a model learns from a robot and from what was made of its model file.

    A built-in robot has a plant of its own: nothing else is real of it.
    """
    simulated, real = simulated_logs(campaign, state), real_logs(campaign, state)
    if not simulated or not real or getattr(campaign.spec, "plant", None) is not None:
        return ()
    numbers = ", ".join(str(r.number) for r in simulated)
    return (
        f"log {numbers} was simulated, log {real[0].number} is of the robot itself: the model learns from two"
        f" robots. Take the simulated ones back: etude untell {campaign.path} {simulated[-1].number}",
    )


def _left(campaign: Campaign, one: Round) -> bool:
    return (campaign.path / SIMULATED / f"{one.number:04d}.parquet").is_file()
