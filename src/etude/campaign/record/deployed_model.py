"""Deployed model of a campaign: the promoted one, identified by the hash of its file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from etude.campaign.record.events import Promoted
from etude.campaign.record.folder import Campaign
from etude.campaign.record.journal import MODEL
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import require_description
from etude.campaign.record.stored_models import newest_model, of_another_body, read_stored
from etude.errors import UsageError, typed
from etude.storage import sha256_of, write_atomic

if TYPE_CHECKING:
    from etude.models.learned_model import LearnedModel

FOLDER = "promoted"


@dataclass(frozen=True, eq=False)
class DeployedModel:
    """The model that is sent to the robot.

    Attributes:
        model: the model itself.
        number: of the last log in its training.
        path: of its file. sha256: of the file.
        promoted: False if no model was promoted yet; the newest one then takes its place.
        sentence: names the model, for people.
    """

    model: LearnedModel
    number: int
    path: Path
    sha256: str
    promoted: bool
    sentence: str


def deployed_model(campaign: Campaign, state: State | None = None) -> DeployedModel:
    """The promoted model; before any promotion the newest one, with a sentence that says so.

    Raises:
        UsageError: nothing was learned yet, or the model's file is missing or was changed.
        DataError: the file cannot be read.
    """
    require_description(campaign)
    state = campaign.state() if state is None else state
    if not state.promoted:
        model, number = newest_model(campaign, state), state.trained[-1].number
        path = campaign.model_folder(number) / MODEL
        digest = sha256_of(path)
        sentence = f"No model was promoted yet. The newest model is used, of log {number} ({digest[:12]})."
        return DeployedModel(model, number, path, digest, False, sentence + of_another_body(campaign, number))
    number, promoted = state.promoted[-1]
    sentence = f"The promoted model is used, of log {number} ({promoted.sha256[:12]})."
    model, path = promoted_model(campaign, number, promoted), pinned(campaign, promoted.sha256)
    sentence += of_another_body(campaign, number)
    return DeployedModel(model, number, path, promoted.sha256, True, sentence)


def model_to_command(campaign: Campaign, state: State | None = None) -> DeployedModel:
    """The deployed model, for what commands the robot: set-points with commands, and exports. UsageError: it
    was learned of another body.
    """
    used = deployed_model(campaign, state)
    if other := of_another_body(campaign, used.number):
        raise UsageError("the model is of another robot", next_step=other.strip())
    return used


def model_of_sha256(campaign: Campaign, digest: str) -> LearnedModel | None:
    """The stored model whose file has that hash, promoted or not; None if it no longer exists."""
    places = [pinned(campaign, digest), *sorted(campaign.path.glob(f"models/*/{MODEL}"))]
    for path in places:
        if path.is_file() and sha256_of(path) == digest:
            return read_stored(campaign, path)
    return None


def promoted_model(campaign: Campaign, number: int, promoted: Promoted) -> LearnedModel:
    """The model of a promotion, of log `number`, from its copy of the file. Errors as `deployed_model`."""
    check_pinned(campaign, number, promoted)
    return read_stored(campaign, pinned(campaign, promoted.sha256))


def check_pinned(campaign: Campaign, number: int, promoted: Promoted) -> None:
    """Compares the file of a promoted model with the journal. UsageError: it is missing or was changed."""
    path = pinned(campaign, promoted.sha256)
    if path.is_file() and sha256_of(path) == promoted.sha256:
        return
    what = "was changed after it was promoted" if path.is_file() else "is missing"
    folder = campaign.path
    force = f'promote the newest: etude promote {typed(folder)} --force --reason "altered file"'
    other = f"go back: etude rollback {typed(folder)}" if len(campaign.state().promoted) > 1 else force
    raise UsageError(
        f"the promoted model of log {number} {what}",
        where=str(path),
        next_step=f"Do not use it. Restore the file from a copy, or {other}.",
    )


def pinned(campaign: Campaign, digest: str) -> Path:
    """Path of a promoted model's copy, which later trainings do not overwrite."""
    return campaign.path / FOLDER / f"{digest[:12]}.npz"


def pin(campaign: Campaign, path: Path) -> tuple[Path, str]:
    """Copies a model's file atomically; returns the copy's path and hash."""
    digest = sha256_of(path)
    copy = pinned(campaign, digest)
    write_atomic(copy, path.read_bytes())
    return copy, digest
