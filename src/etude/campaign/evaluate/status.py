"""Status of a campaign for people and programs, computed from committed facts alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from etude.campaign.evaluate.stopping import LogOutcome, calibration_factor, seen_by_the_rule, stop_verdict
from etude.campaign.record.alerts import campaign_alerts, motion_open
from etude.campaign.record.confirmation import confirmed
from etude.campaign.record.events import Created, plain
from etude.campaign.record.folder import Campaign
from etude.campaign.record.journal import damaged_files, read_events
from etude.campaign.record.known_faults import affected
from etude.campaign.record.state import Round, State, replay
from etude.campaign.record.stored_files import edited, proved_otherwise


def status(campaign: Campaign) -> dict[str, Any]:
    """The status of the campaign as JSON values.

    Keys:

    * alerts: red ones first; see `codes`. problems: committed files that are missing or were changed.
    * kind, robot, axes, outputs, preset, seed; robot_seconds: recorded motion, s.
    * trajectories: one entry for each number. prequential: newest scores of each structure on a log before it
      was learned. chosen, rungs: structure in use, of all outputs and of each.
    * calibration_factor, next_gain; forecast_fraction: null after one log, or slow ones; choice: fraction by
      which the newest design leaves less variance than the median random motion.
    * new_motion: scores on logs left out; null after one log. held_out: scores on blocks of a single log;
      null after more. confirmed: tracking errors of the confirmation motions.
    * in_use: the promoted model, or null. known_faults: files of earlier versions that must not be used, each
      with code, what, path, command. proved_otherwise: open proposals proved under another robot.toml or
      campaign.toml.
    * verdict: of the stop rule. edited: which of robot.toml and campaign.toml were edited since `ask` or
      `tell` read them, and files of exported models that were.
    """
    events = campaign.events()
    state = campaign.state()
    evidence = seen_by_the_rule(campaign, state)
    verdict = stop_verdict(evidence, campaign.config.stop)
    alerts = (
        *motion_open(state, campaign.path),
        *campaign_alerts(state, campaign.command.parts, len(campaign.axes)),
    )
    trained = state.trained
    newest = state.newest
    return {
        "alerts": [notice.facts() for notice in alerts],
        "folder": str(campaign.path),
        "kind": campaign.kind.name,
        "robot": campaign.name,
        "axes": list(campaign.axes),
        "outputs": list(campaign.command.parts),
        "command_unit": ", ".join(dict.fromkeys(campaign.command.units)),
        "preset": campaign.config.preset,
        "seed": state.seed,
        "trajectories": [_trajectory(r) for _, r in sorted(state.rounds.items())],
        "robot_seconds": state.robot_seconds,
        "scored_log": trained[-1].number if trained else None,
        "prequential": plain(newest.models) if newest else {},
        "chosen": newest.chosen if newest else None,
        "rungs": list(newest.rungs) if newest else None,
        "calibration_factor": calibration_factor(trained),
        "forecast_fraction": expected_error(state, evidence),
        "next_gain": evidence[-1].gain if evidence else None,
        "choice": _variance_saved_by_design(state),
        "new_motion": plain(newest.new_motion) if newest and newest.new_motion else None,
        "held_out": _held_out(state),
        "in_use": _in_use(state),
        "confirmed": [confirmed(campaign, one) for one in state.confirmations],
        "verdict": verdict.facts(),
        "known_faults": [asdict(one) | {"sentence": one.sentence} for one in affected(campaign, state)],
        "proved_otherwise": [
            one.facts() for one in proved_otherwise(campaign, [r.number for r in state.proposals])
        ],
        "edited": [one.facts() for one in edited(campaign, events)],
        "problems": [one.facts() for one in damaged_files(campaign.path, events)],
    }


def status_without_robot(folder: Path) -> dict[str, Any] | None:
    """What the journal alone says, by the same keys, where the campaign cannot be opened; None: nothing."""
    events = read_events(folder)
    created = next((e.fact for e in events if isinstance(e.fact, Created)), None)
    if created is None:
        return None
    state = replay(events)
    return {
        "alerts": [notice.facts() for notice in motion_open(state, folder)],
        "folder": str(folder),
        "kind": created.kind,
        "robot": created.robot,
        "axes": list(created.axes),
        "preset": created.preset,
        "seed": state.seed,
        "trajectories": [_trajectory(r) for _, r in sorted(state.rounds.items())],
        "robot_seconds": state.robot_seconds,
        "in_use": _in_use(state),
        "problems": [one.facts() for one in damaged_files(folder, events)],
    }


def expected_error(state: State, evidence: Sequence[LogOutcome]) -> float | None:
    """Expected command error; None after a single log, whose motion is the only one seen, or slow ones."""
    newest = state.newest
    single = newest is not None and len(newest.logs) == 1
    return None if not evidence or single or evidence[-1].slow else evidence[-1].forecast


def _in_use(state: State) -> dict[str, Any] | None:
    """The promotion in force, and whether a newer model exists; None without a promotion."""
    if not state.promoted:
        return None
    number, promoted = state.promoted[-1]
    newest = state.trained[-1].number if state.trained else None
    return {"number": number, "sha256": promoted.sha256, "forced": promoted.forced, "newest": newest}


def _trajectory(round_: Round) -> dict[str, Any]:
    ingested, trained = round_.ingested, round_.trained
    return {
        "number": round_.number,
        "standing": _standing(round_),
        "foreign": round_.asked is None,
        "robot_seconds": ingested.robot_seconds if ingested else None,
        "source": ingested.source if ingested else None,
        "chosen": trained.chosen if trained else None,
    }


def _standing(round_: Round) -> str:
    if round_.abandoned:
        return "abandoned"
    if round_.confirms:
        return f"confirms, {len(round_.runs)} of 2 runs"
    if round_.weighs:
        return "weighs a load"
    if round_.ingested is None:
        return "open" if round_.asked is not None else "taken back"
    if round_.excluded:
        return "set aside"
    if round_.awaits_answer:
        return "waits for an answer"
    return "learned" if round_.learned else "told"


def _variance_saved_by_design(state: State) -> float | None:
    """Fraction by which the newest proposal leaves less variance than the median random one.

    None until a design from a model gives it.
    """
    proposals = [r.asked for _, r in sorted(state.rounds.items()) if r.asked]
    choices = [a.choice for a in proposals if a.learned and a.choice is not None]
    return choices[-1] if choices else None


def _held_out(state: State) -> dict[str, Any] | None:
    """Block scores of the only log in the newest model; None for a model of several logs."""
    scores = state.newest.held_out if state.newest else None
    return None if scores is None else {"number": state.trained[-1].number, **plain(scores)}
