"""Export of an open proposal in its receiver's format, certified as the receiver reads it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from etude import plugins
from etude.abilities import SupportsCollecting, SupportsRobotCheck
from etude.campaign.propose.constraints import constraints_under
from etude.campaign.record.controls import FEEDBACK, LEARNED, asked_under
from etude.campaign.record.deployed_model import deployed_model, model_to_command
from etude.campaign.record.events import Exported
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import settle
from etude.campaign.record.stored_models import of_another_body
from etude.deploy.feedforward import MotionWithCommands, require_forces, with_accelerations, with_commands
from etude.deploy.playback_certificate import certified_playback
from etude.deploy.trajectory_files import command_unit
from etude.limits.certificate import Certificate
from etude.models.learned_model import LearnedModel
from etude.protocols import Trajectory
from etude.storage import GENERATION

GROUP = "etude.exporters"
CERTIFICATE = "certificate.json"


@dataclass(frozen=True)
class ExportedMotion:
    """Files of a motion in another format.

    Attributes:
        format: its name among `etude.exporters`.
        files: their paths.
        certificate: of the motion that the receiver plays from these bytes.
        renewed: a sentence, if the files were written anew.
    """

    format: str
    files: tuple[Path, ...]
    certificate: Certificate
    renewed: tuple[str, ...] = ()


def require_formats(campaign: Campaign, names: Sequence[str], *, effort: bool = False) -> None:
    """Refuses before any design what the robot alone decides; arguments as `ask`.

    Raises:
        UsageError: a format is unknown or not for this robot, or its commands are not forces.
    """
    for name in names:
        exporter = plugins.load(GROUP, name)
        if isinstance(exporter, SupportsRobotCheck):
            exporter.require_robot(campaign.kind, campaign.spec)
    if names and effort:
        _require_forces(campaign)


def export(
    campaign: Campaign,
    number: int,
    trajectory: Trajectory,
    folder: Path,
    name: str,
    *,
    effort: bool = False,
    drag: bool = True,
) -> ExportedMotion:
    """Writes `folder`/`name`/... once and commits it; writes it anew if its contents have changed.

    Existing files are compared with the journal first. The caller holds the writer's lock.

    Args:
        campaign: the folder. number: of the proposal.
        trajectory: to be run. folder: of its own files.
        name: of the exporter.
        effort: include the learned command along the motion, and use the margins for it.
        drag: let accelerations compensate the learned drag, where the format has them, as simulated flights
            do (`Kind.collecting`).

    Raises:
        UsageError: the format is unknown or not for this robot, no model gives commands, the commands are not
            forces, or a file was changed.
        UnsafeTrajectoryError: the received motion leaves a limit; nothing is written.
    """
    exporter = plugins.load(GROUP, name)
    what = _with_effort(campaign, trajectory) if effort else trajectory
    what = _accelerated(campaign, what) if drag else what
    controls = asked_under(campaign.round(number).asked)
    constraints = constraints_under(campaign, number, LEARNED if effort else next(iter(controls), FEEDBACK))
    limits = constraints.limits_as_played(campaign, trajectory)
    files, certificate = certified_playback(
        exporter, what, campaign.kind, campaign.spec, limits, constraints.control
    )
    place = folder / (f"{name}_effort" if effort else name)
    contents = {**files, CERTIFICATE: _proof(certificate)}
    fact = Exported(format=name, effort=effort)
    fact = fact if constraints.controls == controls else constraints.recorded(fact)
    written = {place / file: data for file, data in contents.items()}
    renewed = settle(campaign, number, written, fact)
    return ExportedMotion(name, tuple(written), certificate, renewed)


def _proof(certificate: Certificate) -> bytes:
    document = {"generation": GENERATION, **json.loads(certificate.to_json())}
    return (json.dumps(document, indent=1) + "\n").encode()


def _with_effort(campaign: Campaign, trajectory: Trajectory) -> MotionWithCommands:
    _require_forces(campaign)
    return with_commands(trajectory, model_to_command(campaign).model)


def _require_forces(campaign: Campaign) -> None:
    require_forces(command_unit(campaign.spec), campaign.spec.name, "Export without --effort.")


def _accelerated(
    campaign: Campaign, what: Trajectory | MotionWithCommands
) -> Trajectory | MotionWithCommands:
    """The motion with the accelerations of flights that collect logs, once a model exists."""
    if not isinstance(campaign.kind, SupportsCollecting) or not campaign.state().trained:
        return what
    used = deployed_model(campaign)
    if of_another_body(campaign, used.number):
        return what  # the drag of another vehicle
    return accelerated_by(campaign, what, used.model)


def accelerated_by(
    campaign: Campaign, what: Trajectory | MotionWithCommands, model: LearnedModel
) -> Trajectory | MotionWithCommands:
    """The motion with the accelerations that this model gives to flights that collect logs."""
    kind = campaign.kind
    if not isinstance(kind, SupportsCollecting):
        return what  # it collects under feedback alone
    return with_accelerations(
        what, kind.collecting(campaign.spec, campaign.config, model), model.inputs.orders
    )
