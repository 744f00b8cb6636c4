"""What a target of a model asks for beside it, by name: its attribute `needs` lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from etude.campaign.deployment.bounded_motion import bounded_motion
from etude.campaign.ingest.groups import told_samples
from etude.campaign.record.folder import ROBOT, Campaign
from etude.campaign.record.stored import stored_log
from etude.campaign.record.stored_files import require_description
from etude.progress import counted
from etude.types import Log, Samples


def supplied(campaign: Campaign, needs: Sequence[str], given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of these names: config, logs, samples, description, motion.

    Args:
        given: the options that somebody gave; of these a motion says along which.
    """
    known: Mapping[str, Callable[[], Any]] = {
        "config": lambda: campaign.config,
        "logs": lambda: told_logs(campaign),
        "samples": lambda: all_samples(campaign),
        "description": lambda: description(campaign),
        "motion": lambda: bounded_motion(campaign, given.get("motion")),
    }
    return {name: known[name]() for name in counted(needs)}


def told_logs(campaign: Campaign) -> list[Log]:
    """The logs that the newest model was learned from."""
    return [stored_log(campaign, number) for number in counted(_numbers(campaign))]


def all_samples(campaign: Campaign) -> Samples:
    """The samples that the newest model was learned from."""
    return told_samples(campaign, _numbers(campaign))


def description(campaign: Campaign) -> Mapping[str, bytes]:
    """Files of the robot's description by name, as the campaign was made with them; robot.toml as it is now.

    UsageError: another one of them was changed.
    """
    require_description(campaign)
    created = next(event for event in campaign.events() if event.event == "created")
    return {name: (campaign.path / name).read_bytes() for name in sorted({ROBOT, *created.files})}


def _numbers(campaign: Campaign) -> list[int]:
    return [r.number for r in campaign.state().learned if campaign.run_file(r.number).is_file()]
