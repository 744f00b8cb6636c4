"""Model export: a folder for another program, with the model's motion and limits if it needs them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude import __version__, plugins
from etude._runtime.options import MODEL_HASH
from etude.abilities import SupportsNeeds
from etude.campaign.deployment.motion_files import TABLES, is_plan, motion_of_table
from etude.campaign.propose.constraints import constraints_now, constraints_under
from etude.campaign.record.controls import LEARNED
from etude.campaign.record.deployed_model import model_to_command
from etude.campaign.record.events import Created, Exported
from etude.campaign.record.folder import ROBOT, Campaign, open_campaign
from etude.campaign.record.stored_files import EXPORTS, MARK, require_description, stored_trajectory
from etude.campaign.record.stored_models import ingested_samples, stored_log
from etude.deploy.targets.trajectory import MotionWithLimits
from etude.errors import EtudeError, UsageError
from etude.progress import counted, part
from etude.protocols import Target, Trajectory
from etude.storage import GENERATION, write_folder
from etude.trajectories.json_text import from_json
from etude.types import Delivered, Log, Samples

GROUP = "etude.targets"
GATHERING = 0.3
"""Approximate fraction of the time for gathering logs and samples for a target, for progress."""


@dataclass(frozen=True)
class ModelFiles:
    """Result of an export.

    Attributes:
        target: its name among `etude.targets`.
        folder: where the files are; files: their names in it.
        notes: sentences on the model and the files, for users. facts: the same for programs.
    """

    target: str
    folder: Path
    files: tuple[str, ...]
    notes: tuple[str, ...]
    facts: Mapping[str, Any]


def bounded_motion(campaign: Campaign, motion: str | Path | Trajectory | None) -> MotionWithLimits:
    """A motion with its limits, less the margins of tracking with the learned feedforward.

    Args:
        motion: a trajectory.json, a table of times and poses, or a trajectory; None: the newest proposal.

    Raises:
        UsageError: no such file, no proposal, or a changed file.
    """
    return _newest_proposal(campaign) if motion is None else _named_motion(campaign, motion)


def _named_motion(campaign: Campaign, motion: str | Path | Trajectory) -> MotionWithLimits:
    if isinstance(motion, str | Path):
        place = Path(motion)
        if not place.is_file():
            raise UsageError("there is no such motion", where=str(place), next_step="Check the path.")
        motion = _read(campaign, place)
    constraints = constraints_now(campaign, campaign.state(), LEARNED)
    return MotionWithLimits(motion, constraints.limits_as_played(campaign, motion), constraints.control)


def _read(campaign: Campaign, place: Path) -> Trajectory:
    """The motion of a trajectory.json, or of a table of times and poses. UsageError, DataError: invalid."""
    if is_plan(campaign, place):
        place = place.with_suffix(".json")
    if place.suffix in TABLES:
        return motion_of_table(campaign, place)
    try:
        return from_json(place.read_bytes())
    except UsageError as problem:
        raise UsageError(
            problem.fact,
            where=str(place),
            next_step="Name a trajectory.json from proposals/NUMBER, or a table with a time and the path.",
        ) from None


def _newest_proposal(campaign: Campaign) -> MotionWithLimits:
    """The newest proposal, with or without a log."""
    proposals = [r for _, r in sorted(campaign.state().rounds.items()) if r.asked is not None]
    if not proposals:
        raise UsageError(
            "there is no proposal yet", where=str(campaign.path), next_step="--set motion=trajectory.json"
        )
    newest = proposals[-1]
    motion = stored_trajectory(campaign, newest.number)
    constraints = constraints_under(campaign, newest.number, LEARNED)
    return MotionWithLimits(
        motion, constraints.limits_as_played(campaign, motion, described=True), constraints.control
    )


def supplied(campaign: Campaign, needs: Sequence[str], options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of these names: config, logs, samples, description, motion.

    Args:
        options: the options that the user gave; the motion may be one of them.
    """
    getters: Mapping[str, Callable[[], Any]] = {
        "config": lambda: campaign.config,
        "logs": lambda: ingested_logs(campaign),
        "samples": lambda: all_samples(campaign),
        "description": lambda: description(campaign),
        "motion": lambda: bounded_motion(campaign, options.get("motion")),
    }
    return {name: getters[name]() for name in counted(needs)}


def ingested_logs(campaign: Campaign) -> list[Log]:
    """The logs that the newest model was learned from."""
    return [stored_log(campaign, number) for number in counted(_numbers(campaign))]


def all_samples(campaign: Campaign) -> Samples:
    """The samples that the newest model was learned from."""
    return ingested_samples(campaign, _numbers(campaign))


def description(campaign: Campaign) -> Mapping[str, bytes]:
    """Files of the robot's description by name: the original ones, and the current robot.toml.

    UsageError: a file other than robot.toml was changed.
    """
    require_description(campaign)
    created = next(event for event in campaign.events() if isinstance(event.fact, Created))
    return {name: (campaign.path / name).read_bytes() for name in sorted({ROBOT, *created.files})}


def _numbers(campaign: Campaign) -> list[int]:
    return [r.number for r in campaign.state().learned if campaign.run_file(r.number).is_file()]


def export(
    campaign: Campaign | str | Path, to: str, output: str | Path | None = None, **options: Any
) -> ModelFiles:
    """Write the model in the format of target `to`, completely or not at all; replace an earlier export.

    Args:
        campaign: the folder, or it opened.
        to: name of a target, such as "c"; `etude plugins` lists them.
        output: folder to write; by default exports/`to` in the campaign.
        options: of the target, named as those of the command with _ for -.

    Raises:
        UsageError: nothing learned yet, a model of another robot than robot.toml describes now, no such
            target, an unknown option, a model that it cannot export, or a folder with other contents.
            EtudeError: the folder cannot be written.
    """
    campaign = campaign if isinstance(campaign, Campaign) else open_campaign(Path(campaign))
    target: Target = plugins.load(GROUP, to)
    used = model_to_command(campaign)
    with part(GATHERING):
        needed = supplied(campaign, target.needs if isinstance(target, SupportsNeeds) else (), options)
    options |= {**needed, MODEL_HASH: used.sha256}
    with part(1.0 - GATHERING):
        delivered = target(used.model, campaign.kind, campaign.spec, options)
    folder = campaign.path / EXPORTS / to if output is None else Path(output)
    marked = {**delivered.files, MARK: _mark(to, used.sha256, delivered)}
    write_folder(folder, marked, MARK, _files_of(folder))
    sentences = (used.sentence, *delivered.notes, *_recorded(campaign, to, folder, used.sha256))
    return ModelFiles(to, folder, tuple(delivered.files), sentences, delivered.facts)


def _recorded(campaign: Campaign, to: str, folder: Path, digest: str) -> tuple[str, ...]:
    """Record in the journal where a model was exported, for faults found later; a sentence if that fails."""
    place = str(folder.resolve())
    try:
        with campaign.writing():
            campaign.commit(Exported(target=to, place=place, model_sha256=digest))
    except EtudeError as error:
        return (f"The journal could not record this export: {error.fact}.",)
    return ()


def _files_of(folder: Path) -> tuple[str, ...]:
    """Names of the files of an earlier export, as its mark states them; () if it states none."""
    try:
        return tuple(json.loads((folder / MARK).read_bytes())["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def _mark(to: str, digest: str, delivered: Delivered) -> bytes:
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in delivered.files.items()}
    mark = {
        "etude": __version__,
        "generation": GENERATION,
        "target": to,
        "model_sha256": digest,
        "files": hashes,
    }
    return (json.dumps(mark, indent=1) + "\n").encode()


def given(**options: Any) -> dict[str, Any]:
    """The options that the user gave: those that are neither None nor False nor empty.

    Raises:
        UsageError: an entry of `more` is not key=value, or an option is given twice.
    """
    values = {n: v for n, v in options.items() if not (v is None or v is False or v == "" or v == ())}
    for word in values.pop("more", ()):
        name, equals, value = word.partition("=")
        if not (name and equals):
            raise UsageError(
                f"--set takes NAME=VALUE, not {word!r}",
                next_step="Write a name, = and a value, without blanks.",
            )
        name = name.replace("-", "_")
        if name in values:
            raise UsageError(
                f"{name} is given twice, as {values[name]!r} and as {value!r}", next_step="Give it once."
            )
        values[name] = value
    return values
