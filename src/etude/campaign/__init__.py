"""A campaign folder and what is done with it: the only circle, through files."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.campaign.create import create_campaign, find_robot
    from etude.campaign.ingest.questions import Answers, LogQuestions, judged_commands
    from etude.campaign.record.config import CampaignConfig, preset_config
    from etude.campaign.record.config_file import CONFIG, config_text, load_config
    from etude.campaign.record.confirmation import errors, left_over, moving, trained_speeds, without_it
    from etude.campaign.record.controls import FEEDBACK, LEARNED
    from etude.campaign.record.folder import Campaign, open_campaign
    from etude.campaign.record.journal import JOURNAL
    from etude.campaign.record.stored_files import stored_trajectory
    from etude.campaign.record.stored_models import label, newest_model, stored_model
    from etude.campaign.simulation import CERTAIN, RUN_STREAM, TEST_STREAM, simulate, test_motions

__all__ = [
    "CERTAIN",
    "CONFIG",
    "FEEDBACK",
    "JOURNAL",
    "LEARNED",
    "RUN_STREAM",
    "TEST_STREAM",
    "Answers",
    "Campaign",
    "CampaignConfig",
    "LogQuestions",
    "config_text",
    "create_campaign",
    "errors",
    "find_robot",
    "judged_commands",
    "label",
    "left_over",
    "load_config",
    "moving",
    "newest_model",
    "open_campaign",
    "preset_config",
    "simulate",
    "stored_model",
    "stored_trajectory",
    "test_motions",
    "trained_speeds",
    "without_it",
]
__getattr__, __dir__ = face(__name__)
