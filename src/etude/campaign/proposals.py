"""The motions that were proposed, read from their files."""

from __future__ import annotations

from pathlib import Path

from etude.campaign.folder import Campaign
from etude.contracts import Trajectory
from etude.deploy.trajectory_files import COEFFICIENTS
from etude.errors import UsageError
from etude.storage import unreadable
from etude.trajectories.json_text import from_json

FULL = 100
"""%, of the speed that was asked for."""


def stored_trajectory(campaign: Campaign, number: int, speed: int = FULL) -> Trajectory:
    """The trajectory of a proposal, or its slowed copy, from its file.

    Raises:
        UsageError: there is no such file, or it is damaged.
    """
    path = speed_folder(campaign, number, speed) / COEFFICIENTS
    try:
        return from_json(path.read_bytes())
    except FileNotFoundError:
        raise UsageError(f"there is no proposal {number} at {speed} %", where=str(path)) from None
    except OSError as error:
        raise unreadable(path, error) from error
    except UsageError as error:
        raise UsageError(error.fact, where=str(path), next_step="Restore the file from a copy.") from None


def speed_folder(campaign: Campaign, number: int, speed: int) -> Path:
    """Where the files of a proposal at this speed (per cent) are."""
    folder = campaign.proposal(number)
    return folder if speed == FULL else folder / f"speed_{speed:03d}"
