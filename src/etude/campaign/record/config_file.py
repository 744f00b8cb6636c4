"""campaign.toml: the configuration in one file that people edit by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from etude import plugins
from etude.campaign.record.comments import COMMENTS, HEAD
from etude.campaign.record.config import SECTIONS, CampaignConfig, preset_config, tables_of
from etude.campaign.record.journal import JOURNAL
from etude.campaign.record.renamed import KINDS, modern
from etude.errors import UsageError
from etude.protocols import Kind
from etude.storage import unreadable
from etude.toml_tables import CORRECT, decoded, read_table, refuse_unknown, write_table
from etude.trust import folder_id, is_trusted, names_in, require_trusted, trust

CONFIG = "campaign.toml"
FIRST_KIND = "arm"
"""Files of 0.1 name no kind for robots of joints."""


@dataclass(frozen=True)
class ConfigFile:
    """A campaign.toml, read.

    Attributes:
        config: what it says.
        kind: of the robot.
        sha256: of its bytes.
        notes: one sentence for each key that was renamed since it was written.
    """

    config: CampaignConfig
    kind: Kind
    sha256: str
    notes: tuple[str, ...]


def load_config(folder: Path) -> ConfigFile:
    """The campaign.toml in `folder`.

    Raises:
        UsageError: no campaign there, or a file edited into something impossible; names the file and the key.
    """
    path = folder / CONFIG
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(
            "there is no campaign here",
            where=str(path),
            next_step="Start one: etude init FOLDER --robot NAME.",
        ) from None
    except OSError as error:
        raise unreadable(path, error) from error
    require_trusted_names(folder, CONFIG, _names(data, str(path)))
    return parse_config(data, str(path))


def require_trusted_names(folder: Path, file: str, named: Mapping[str, str]) -> None:
    """UsageError: a file of the campaign names code, and this user does not trust the folder."""
    if named:
        command = trusting(folder)
        require_trusted(named, folder / file, folder, folder_id(folder / JOURNAL), command)


def trust_campaign(folder: Path) -> None:
    """Puts the campaign in a folder on this user's list: code that its files name is run from now on.

    Raises:
        UsageError: there is no campaign. OSError: the list cannot be written.
    """
    identity = folder_id(folder / JOURNAL)
    if not identity:
        raise UsageError("there is no campaign here", where=str(folder), next_step="Check the path.")
    if not is_trusted(folder, identity):
        trust(folder, identity)


def trusting(folder: Path) -> str:
    """The command that trusts the campaign in a folder."""
    return f"etude status {folder} --trust"


def _names(data: bytes, where: str) -> dict[str, str]:
    """Code that a campaign.toml names; how logs name their columns is none."""
    try:
        table = decoded(data.decode(), where)
    except UnicodeDecodeError:
        return {}  # said by whoever reads it
    return names_in({name: value for name, value in table.items() if name != "log"})


def parse_config(data: bytes, where: str) -> ConfigFile:
    """The configuration in the bytes of a campaign.toml. Errors as `load_config`."""
    try:
        table = decoded(data.decode(), where)
    except UnicodeDecodeError as error:
        raise UsageError(f"not valid TOML: {error}", where=where, next_step=CORRECT) from None
    refuse_unknown(table, ["kind", "preset", "seed", *SECTIONS], where)
    kind, notes = _kind(table, where)
    known = {name: tuple(f.name for f in fields(cls)) for name, cls in tables_of(kind).items()}
    table, renamed = modern(table, known, where)
    config = _config(kind, table, where)
    return ConfigFile(config, kind, hashlib.sha256(data).hexdigest(), (*notes, *renamed))


def config_text(config: CampaignConfig, kind: Kind) -> str:
    """campaign.toml with every value written out and explained."""
    head = f'{HEAD}kind = "{config.kind}"\npreset = "{config.preset}"\nseed = {config.seed}\n'
    comments = {name: {**COMMENTS.get(name, {}), **kind.comments.get(name, {})} for name in SECTIONS}
    return "\n".join([head, *(write_table(n, getattr(config, n), comments[n]) for n in SECTIONS)])


def _kind(table: Mapping[str, Any], where: str) -> tuple[Kind, tuple[str, ...]]:
    name = table.get("kind", FIRST_KIND)
    if not isinstance(name, str):
        raise UsageError(f"kind = {name!r} must be the name of a kind of robot", where=f"{where} kind")
    now = KINDS.get(name, name)
    note = f'kind = "{name}" in campaign.toml is called "{now}" now; it was read as that.'
    try:
        return plugins.load("etude.robots", now), (note,) if now != name else ()
    except UsageError as error:
        raise UsageError(error.fact, where=f"{where} kind", next_step=error.next_step) from None


def _config(kind: Kind, table: Mapping[str, Any], where: str) -> CampaignConfig:
    name, seed = table.get("preset", "default"), table.get("seed", 0)
    start = preset_config(kind, name, f"{where} preset") if isinstance(name, str) else None
    if start is None:
        raise UsageError(f"preset = {name!r} must be a name", where=f"{where} preset")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise UsageError(f"seed = {seed!r} must be a whole number, 0 or more", where=f"{where} seed")
    parts = {section: _section(section, table, start, where) for section in SECTIONS}
    return replace(start, seed=seed, **parts)


def _section(name: str, table: Mapping[str, Any], start: Any, where: str) -> Any:
    value = getattr(start, name)
    return read_table(type(value), table.get(name, {}), value, f"{where} [{name}]")
