"""The command `etude payload`: reads one log for `models.change.payload_estimate`; nothing is learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from etude.abilities import SupportsPayload, SupportsVariations, SupportsWithout
from etude.campaign.ingest.ingest_result import answered_proposal, read
from etude.campaign.ingest.questions import answers_of, body_of, questions_of
from etude.campaign.record.deployed_model import DeployedModel, deployed_model
from etude.campaign.record.folder import ROBOT, Campaign, Say
from etude.campaign.record.stored_models import ingested_samples, of_another_body
from etude.errors import DataError, EtudeError, UsageError, typed
from etude.logs.columns.units import start_at_zero
from etude.models.accuracy import NORMAL_95
from etude.models.change.payload_estimate import Load, apparent_loads, load_of
from etude.models.learned_model import LearnedModel
from etude.storage import write_atomic
from etude.types import Array, Log

TOLD = 0.05
"""m: a centre with a wider half of the 95 % interval is not reported."""
ROUGH = 0.25
"""Fraction of a mass: with a wider half of the interval it is not written to the file."""
SCALE = "scale"
"""The check of command units that a load may trigger."""
MUCH_LEFT = 4.0
"""Ratio of squared errors with the load to the predicted variance; above it more than a load has changed."""
MOTION = "Record the motion that identifies the payload best: etude ask {} --payload."
ITS_MOTION = "This log is of the motion that identifies the payload best."


@dataclass(frozen=True, eq=False)
class Weighed:
    """Result for one log.

    Attributes:
        used: the model that it was compared with. load: the load found.
        notes: sentences on the load. written: the robot.toml that was changed; None if none was.
    """

    used: DeployedModel
    load: Load
    notes: tuple[str, ...]
    written: Path | None = None


def payload(
    campaign: Campaign,
    log: str | Path,
    *,
    write: bool = False,
    degrees: bool = False,
    accept: Sequence[str] = (),
    repair: Sequence[str] = (),
    say: Say = lambda _: None,
) -> Weighed:
    """Mass and centre of the load that the robot carries in addition to that of the model in use.

    Args:
        campaign: the folder. log: a file of any motion.
        write: add the load to the payload of robot.toml if it is significant.
        degrees: the log's angles are degrees.
        accept: checks whose findings are accepted: the log is used unchanged. repair: those that change it.
        say: receives one sentence per step.

    Raises:
        UsageError: nothing was learned yet, the robot's links are unknown, or there is nothing to write.
        DataError: the log cannot be used, or lacks inputs of the model.
    """
    used = deployed_model(campaign)
    say(used.sentence)
    body = weighable(campaign)
    # a load multiplies the torque of a wrist, which looks like another unit
    answers = answers_of(campaign.state(), (*accept, SCALE), repair)
    questions = questions_of(campaign, campaign.state(), answers)
    rows = start_at_zero(read(campaign, Path(log), degrees=degrees, questions=questions))
    group = np.zeros(len(rows), dtype=np.int64)
    samples = campaign.kind.samples(campaign.spec, campaign.config, [rows], [group])
    try:
        load = load_of(used.model, samples, body, apparent_of(campaign, used.model, body))
    except KeyError as error:
        raise DataError(
            f"the log lacks an input of the model ({error.args[0]})",
            where=str(log),
            next_step="Record that column too, as in the logs that the model learned from.",
        ) from None
    better = ITS_MOTION if _is_weighing_motion(campaign, rows) else MOTION.format(typed(campaign.path))
    sentences = _sentences(load, better)
    return Weighed(used, load, sentences, _written(campaign, used, load, better) if write else None)


def weighable(campaign: Campaign) -> SupportsVariations:
    """The physics of the model file. UsageError: there are none, or the kind of robot has no payload."""
    if not isinstance(campaign.kind, SupportsPayload):
        raise UsageError(
            f"robots of the kind '{campaign.kind.name}' have no payload that Étude can estimate",
            where=str(campaign.path / ROBOT),
            next_step=f"Parameters that logs identify: etude export {typed(campaign.path)} --to parameters.",
        )
    body: object = body_of(campaign.kind, campaign.spec)
    if isinstance(body, SupportsVariations):
        return body
    raise UsageError(
        f"the payload of '{campaign.spec.name}' cannot be estimated without a model file with masses and "
        "commands that are forces",
        where=str(campaign.path / ROBOT),
        next_step="Name a URDF or MJCF as model_file, and record torques in N m.",
    )


def apparent_of(campaign: Campaign, model: LearnedModel, body: SupportsVariations) -> Array | None:
    """Apparent loads in the logs of the model; None without identified physics."""
    physics: object = campaign.kind.physics(campaign.spec, campaign.config).get("identified")
    numbers = [r.number for r in campaign.state().learned if campaign.run_file(r.number).is_file()]
    if not isinstance(physics, SupportsWithout) or not numbers:
        return None
    samples = ingested_samples(campaign, numbers)
    return apparent_loads(physics.without(samples, samples.group), model, samples, body)


def _is_weighing_motion(campaign: Campaign, log: Log) -> bool:
    """Whether the log is of a motion that was designed to weigh, at any speed."""
    state = campaign.state()
    for weighing in state.weighings:
        try:
            answered_proposal(campaign, state, log, weighing.number)
        except EtudeError:
            continue
        return True
    return False


def _sentences(load: Load, better: str) -> tuple[str, ...]:
    """The load, and whether it explains the log. better: a sentence on the motion that shows more."""
    sentences = _load_sentences(load, better)
    if load.left <= MUCH_LEFT:
        return sentences
    other = (
        f"With this load, squared errors are still {load.left:.2g} times their variance: more than a load "
        "has changed, or the log is of another robot. etude watch names other causes."
    )
    return (*sentences, other)


def _load_sentences(load: Load, better: str) -> tuple[str, ...]:
    low, high = load.interval
    if load.verdict == "cannot tell" and load.left > MUCH_LEFT:
        return (f"The errors do not determine the load: {low:.2g} to {high:.2g} kg.",)
    if load.verdict == "cannot tell":
        return (f"The motion does not determine the load: {low:.2g} to {high:.2g} kg. {better}",)
    if load.verdict == "none":
        shows = (
            "No load is visible"
            if low <= 0.0 <= high
            else "Not significant, since below four standard deviations"
        )
        return (f"{shows}: {low:.2g} to {high:.2g} kg.",)
    less = " less than in the model" if load.mass < 0.0 else ""
    sentences = [f"{abs(load.mass):.3g} kg +- {NORMAL_95 * load.deviation:.2g} kg (95 %){less}."]
    axes = zip("xyz", load.centre.tolist(), (NORMAL_95 * load.centre_deviation).tolist(), strict=True)
    coordinates = [
        f"{name} {1e3 * value:.0f} +- {1e3 * wide:.0f} mm" if wide <= TOLD else f"{name} cannot be determined"
        for name, value, wide in axes
    ]
    sentences.append(
        f"Centre of mass in the frame of the link that the last axis moves: {', '.join(coordinates)}."
    )
    if (NORMAL_95 * load.centre_deviation > TOLD).any():
        sentences.append(better)
    return tuple(sentences)


def _written(campaign: Campaign, used: DeployedModel, load: Load, better: str) -> Path:
    kind, place = campaign.kind, campaign.path / ROBOT
    if load.verdict != "load" or not isinstance(kind, SupportsPayload):
        raise UsageError(f"nothing to write: {_sentences(load, better)[0]}", where=str(place))
    if NORMAL_95 * load.deviation > ROUGH * abs(load.mass):
        raise UsageError(
            f"the estimate is too uncertain to be written: {_sentences(load, better)[0]}",
            where=str(place),
            next_step=better,
        )
    if of_another_body(campaign, used.number):
        raise UsageError(
            "the payload in robot.toml differs from that of the model's training, so nothing was added to it",
            where=str(place),
            next_step="Restore the payload of that time, or ingest a log of the robot as it is now: "
            "--changed new.",
        )
    text = kind.with_payload(campaign.spec, place.read_text(encoding="utf-8"), load.mass, load.centre)
    with campaign.writing():
        write_atomic(place, text.encode())
    return place
