"""The motions that were proposed, read from their files."""

from __future__ import annotations

from pathlib import Path

from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import stored_bytes
from etude.deploy.trajectory_files import COEFFICIENTS
from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.json_text import from_json

FULL = 100
"""%, of the speed that was asked for."""


def stored_trajectory(campaign: Campaign, number: int, speed: int = FULL) -> Trajectory:
    """The trajectory of a proposal, or its slowed copy, from its file.

    Raises:
        UsageError: there is no such file, the journal does not know it, or it was changed.
    """
    path = speed_folder(campaign, number, speed) / COEFFICIENTS
    try:
        return from_json(stored_bytes(campaign, path, proposal_advice(campaign, number)))
    except FileNotFoundError:
        raise UsageError(f"there is no proposal {number} at {speed} %", where=str(path)) from None


def proposal_advice(campaign: Campaign, number: int) -> str:
    """What to do where a file of a proposal is not what was committed."""
    return (
        f"Do not run it. Restore the file from a copy, or give the trajectory up and ask for another: "
        f"etude abandon {campaign.path} {number}, then etude ask {campaign.path}."
    )


def speed_folder(campaign: Campaign, number: int, speed: int) -> Path:
    """Where the files of a proposal at this speed (per cent) are."""
    folder = campaign.proposal(number)
    return folder if speed == FULL else folder / f"speed_{speed:03d}"
