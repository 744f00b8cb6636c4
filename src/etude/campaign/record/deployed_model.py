"""The model in use: the one that was promoted, pinned by the hash of its file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from etude.campaign.record.events import Promoted, Trained
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import require_description
from etude.campaign.record.stored_models import MODEL, newest_model, read_stored
from etude.errors import UsageError
from etude.storage import sha256_of, write_atomic

if TYPE_CHECKING:
    from etude.models.model import LearnedModel

FOLDER = "promoted"


@dataclass(frozen=True, eq=False)
class InUse:
    """What leaves for the robot.

    Attributes:
        model: it.
        number: of the log that its training ended with.
        path: its file. sha256: of that.
        promoted: False where nothing was promoted yet, and the newest model stands in.
        sentence: which model it is, for people.
    """

    model: LearnedModel
    number: int
    path: Path
    sha256: str
    promoted: bool
    sentence: str


def model_in_use(campaign: Campaign, state: State | None = None) -> InUse:
    """The promoted model; the newest one, and a sentence that says so, where nothing was promoted yet.

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
        said = f"Nothing was promoted yet: the newest model is used, of log {number} ({digest[:12]})."
        return InUse(model, number, path, digest, False, said + _of_another(campaign, number))
    number, promoted = state.promoted[-1]
    said = f"The promoted model is used, of log {number} ({promoted.sha256[:12]})."
    model, path = promoted_model(campaign, number, promoted), pinned(campaign, promoted.sha256)
    said += _of_another(campaign, number)
    return InUse(model, number, path, promoted.sha256, True, said)


def _of_another(campaign: Campaign, number: int) -> str:
    """A sentence, if robot.toml changed since the model was learned: its physics are of the file as it is."""
    trained = [e for e in campaign.events() if isinstance(e.fact, Trained) and e.number == number]
    before = trained[-1].robot_sha256 if trained else ""
    if before in ("", campaign.robot_sha256):
        return ""
    told = campaign.state().rounds[number].told
    log = told.source if told is not None else "LOG"
    return (
        " robot.toml changed since it was learned, so its physics are others. The next log that is told has "
        f"all learned again; or now: etude untell {campaign.path} {number}, then "
        f"etude tell {campaign.path} {log}."
    )


def model_of_sha256(campaign: Campaign, digest: str) -> LearnedModel | None:
    """The stored model whose file has that hash, promoted or not; None if there is none any more."""
    places = [pinned(campaign, digest), *sorted(campaign.path.glob(f"models/*/{MODEL}"))]
    for path in places:
        if path.is_file() and sha256_of(path) == digest:
            return read_stored(campaign, path)
    return None


def promoted_model(campaign: Campaign, number: int, promoted: Promoted) -> LearnedModel:
    """The model of a promotion, of log `number`, from its own copy of the file. Errors as `model_in_use`."""
    check_pinned(campaign, number, promoted)
    return read_stored(campaign, pinned(campaign, promoted.sha256))


def check_pinned(campaign: Campaign, number: int, promoted: Promoted) -> None:
    """Holds the file of a promoted model against the journal. UsageError: it is missing or was changed."""
    path = pinned(campaign, promoted.sha256)
    if path.is_file() and sha256_of(path) == promoted.sha256:
        return
    what = "was changed after it was promoted" if path.is_file() else "is missing"
    folder = campaign.path
    force = f'promote the newest: etude promote {folder} --force --reason "altered file"'
    other = f"go back: etude rollback {folder}" if len(campaign.state().promoted) > 1 else force
    raise UsageError(
        f"the promoted model of log {number} {what}",
        where=str(path),
        next_step=f"Do not use it. Restore the file from a copy, or {other}.",
    )


def pinned(campaign: Campaign, digest: str) -> Path:
    """Where the copy of a promoted model lies: later trainings do not write there."""
    return campaign.path / FOLDER / f"{digest[:12]}.npz"


def pin(campaign: Campaign, path: Path) -> tuple[Path, str]:
    """Copies a model's file to its place, whole or not at all; the path and the hash."""
    digest = sha256_of(path)
    copy = pinned(campaign, digest)
    write_atomic(copy, path.read_bytes())
    return copy, digest
