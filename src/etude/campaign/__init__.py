"""Campaigns: a folder and the operations on it. Their only shared state is in files."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.campaign.create import RobotPart, create_campaign, find_robot
    from etude.campaign.deployment.payload_motion import ask_to_weigh
    from etude.campaign.deployment.predict import states_for, write_table
    from etude.campaign.evaluate.confirm import ask_to_confirm
    from etude.campaign.ingest.ingest_result import IngestResult
    from etude.campaign.ingest.inspection import Inspected, inspect
    from etude.campaign.ingest.questions import Answers, LogQuestions, judged_commands
    from etude.campaign.ingest.tell import abandon
    from etude.campaign.propose.approach import There, there_and_back
    from etude.campaign.propose.ask import Proposal
    from etude.campaign.propose.typical_motions import typical_motions
    from etude.campaign.record.config import CampaignConfig, preset_config
    from etude.campaign.record.config_file import CONFIG, config_text, load_config
    from etude.campaign.record.confirmation import errors, left_over, moving, trained_speeds, without_it
    from etude.campaign.record.controls import FEEDBACK, LEARNED
    from etude.campaign.record.events import (
        FORMAT,
        Asked,
        Created,
        Evaluated,
        Event,
        Exported,
        Fact,
        PrequentialScore,
        Trained,
        event_from_json,
        event_to_json,
    )
    from etude.campaign.record.folder import Campaign, open_campaign
    from etude.campaign.record.journal import JOURNAL, chained, commit, read_events
    from etude.campaign.record.state import Round, State, replay
    from etude.campaign.record.stored_files import stored_trajectory
    from etude.campaign.record.stored_models import (
        ingested_samples,
        label,
        newest_model,
        stored_log,
        stored_model,
    )
    from etude.campaign.simulation import CERTAIN, RUN_STREAM, TEST_STREAM, simulate, test_motions
    from etude.campaign.training import TrainingOutcome

__all__ = [
    "CERTAIN",
    "CONFIG",
    "FEEDBACK",
    "FORMAT",
    "JOURNAL",
    "LEARNED",
    "RUN_STREAM",
    "TEST_STREAM",
    "Answers",
    "Asked",
    "Campaign",
    "CampaignConfig",
    "Created",
    "Evaluated",
    "Event",
    "Exported",
    "Fact",
    "IngestResult",
    "Inspected",
    "LogQuestions",
    "PrequentialScore",
    "Proposal",
    "RobotPart",
    "Round",
    "State",
    "There",
    "Trained",
    "TrainingOutcome",
    "abandon",
    "ask_to_confirm",
    "ask_to_weigh",
    "chained",
    "commit",
    "config_text",
    "create_campaign",
    "errors",
    "event_from_json",
    "event_to_json",
    "find_robot",
    "ingested_samples",
    "inspect",
    "judged_commands",
    "label",
    "left_over",
    "load_config",
    "moving",
    "newest_model",
    "open_campaign",
    "preset_config",
    "read_events",
    "replay",
    "simulate",
    "states_for",
    "stored_log",
    "stored_model",
    "stored_trajectory",
    "test_motions",
    "there_and_back",
    "trained_speeds",
    "typical_motions",
    "without_it",
    "write_table",
]
__getattr__, __dir__ = face(__name__)
