"""The model leaves the house: as a folder of what another program runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude import __version__, plugins
from etude.campaign.deployment.supplied import supplied
from etude.campaign.record.deployed_model import model_in_use
from etude.campaign.record.folder import Campaign, open_campaign
from etude.errors import EtudeError, UsageError
from etude.generation import GENERATION
from etude.options import MODEL_HASH
from etude.progress import part
from etude.protocols import Target
from etude.storage import write_folder
from etude.types import Delivered

GROUP = "etude.targets"
MARK = "etude-export.json"
"""Says what the folder is: one that holds it may be replaced by the next export."""
GATHERING = 0.3
"""About the part of the time in which logs and samples are gathered for a target."""
EXPORTS = "exports"
"""Where in the campaign folders are written unless another is named."""


@dataclass(frozen=True)
class ModelFiles:
    """What an export wrote.

    Attributes:
        target: its name among `etude.targets`.
        folder: where the files are; files: their names in it.
        said: which model it is, and what people should know of the files. facts: the same for machines.
    """

    target: str
    folder: Path
    files: tuple[str, ...]
    said: tuple[str, ...]
    facts: Mapping[str, Any]


def export(
    campaign: Campaign | str | Path, to: str, output: str | Path | None = None, **options: Any
) -> ModelFiles:
    """Writes the model as `to` names it, whole or not at all; an earlier export there is replaced.

    Args:
        campaign: the folder, or it opened.
        to: name of a target, such as "c"; `etude plugins` lists them.
        output: folder to write; by default exports/`to` in the campaign.
        options: of the target, named as those of the command with _ for -.

    Raises:
        UsageError: nothing learned yet, no such target, an option that it does not know, what it cannot
            export, or a folder that holds something else. EtudeError: it may not be written.
    """
    campaign = campaign if isinstance(campaign, Campaign) else open_campaign(Path(campaign))
    target: Target = plugins.load(GROUP, to)
    used = model_in_use(campaign)
    with part(GATHERING):
        needed = supplied(campaign, getattr(target, "needs", ()), options)
    options |= {**needed, MODEL_HASH: used.sha256}
    with part(1.0 - GATHERING):
        delivered = target(used.model, campaign.kind, campaign.spec, options)
    folder = campaign.path / EXPORTS / to if output is None else Path(output)
    write_folder(folder, {**delivered.files, MARK: _mark(to, used.sha256, delivered)}, MARK)
    said = (used.sentence, *delivered.said, *_recorded(campaign, to, folder, used.sha256))
    return ModelFiles(to, folder, tuple(delivered.files), said, delivered.facts)


def _recorded(campaign: Campaign, to: str, folder: Path, digest: str) -> tuple[str, ...]:
    """Has the journal know where a model went, for faults that are found later; a sentence if it cannot."""
    place = str(folder.resolve())
    try:
        with campaign.writing():
            campaign.commit("exported", None, [], target=to, place=place, model_sha256=digest)
    except EtudeError as error:
        return (f"The journal does not know of this export: {error.fact}.",)
    return ()


def _mark(to: str, digest: str, delivered: Delivered) -> bytes:
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in delivered.files.items()}
    words = {
        "etude": __version__,
        "generation": GENERATION,
        "target": to,
        "model_sha256": digest,
        "files": hashes,
    }
    return (json.dumps(words, indent=1) + "\n").encode()


def given(**options: Any) -> dict[str, Any]:
    """The options that somebody gave: those that are neither None nor False nor empty.

    Raises:
        UsageError: `more`, as key=value, that is none, or an option that is given twice.
    """
    found = {n: v for n, v in options.items() if not (v is None or v is False or v == "" or v == ())}
    for word in found.pop("more", ()):
        name, equals, value = word.partition("=")
        if not (name and equals):
            raise UsageError(f"--set takes NAME=VALUE, not {word!r}")
        name = name.replace("-", "_")
        if name in found:
            raise UsageError(
                f"{name} is given twice, as {found[name]!r} and as {value!r}", next_step="Give it once."
            )
        found[name] = value
    return found
