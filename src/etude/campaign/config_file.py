"""campaign.toml: the configuration in one file that people edit by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from etude.campaign.comments import COMMENTS, HEAD
from etude.campaign.config import SECTIONS, CampaignConfig
from etude.campaign.presets import preset
from etude.campaign.tables import read_table, refuse_unknown, write_table
from etude.errors import UsageError
from etude.storage import unreadable

CONFIG = "campaign.toml"
KINDS = ("joints", "vehicle")


def load_config(folder: Path) -> tuple[CampaignConfig, str]:
    """The configuration in `folder` and the SHA-256 of campaign.toml's bytes.

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
    return parse_config(data, str(path)), hashlib.sha256(data).hexdigest()


def parse_config(data: bytes, where: str) -> CampaignConfig:
    """The configuration in the bytes of a campaign.toml. Errors as `load_config`."""
    import msgspec

    try:
        table = msgspec.toml.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UsageError(
            f"this file is not TOML: {error}",
            where=where,
            next_step="Correct that place, or restore the file from a copy.",
        ) from None
    refuse_unknown(table, ["kind", "preset", "seed", *SECTIONS], where)
    name, seed = table.get("preset", "default"), table.get("seed", 0)
    if (kind := table.get("kind", "joints")) not in KINDS:
        raise UsageError(f"kind = {kind!r} must be one of {', '.join(KINDS)}", where=f"{where} kind")
    start = preset(name, where, flying=kind == "vehicle")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise UsageError(f"seed = {seed!r} must be a whole number, 0 or more", where=f"{where} seed")
    if start.flight is None:
        return CampaignConfig(name, seed, **{s: _section(s, table, start, where) for s in SECTIONS})
    parts = {field.name: _section(field.name, table, start.flight, where) for field in fields(start.flight)}
    stop = _section("stop", table, start, where)
    return replace(start, seed=seed, stop=stop, flight=replace(start.flight, **parts))


def _section(name: str, table: Mapping[str, Any], start: Any, where: str) -> Any:
    value = getattr(start, name)
    return read_table(type(value), table.get(name, {}), value, f"{where} [{name}]")


def config_text(config: CampaignConfig) -> str:
    """campaign.toml with every value written out and explained."""
    owners: dict[str, tuple[Any, dict[str, str]]] = {s: (config, COMMENTS[s]) for s in SECTIONS}
    kind = ""
    if config.flight is not None:
        from etude.campaign.flight.config import FLIGHT_COMMENTS

        kind = 'kind = "vehicle"\n'
        owners |= {
            field.name: (config.flight, FLIGHT_COMMENTS[field.name]) for field in fields(config.flight)
        }
    head = HEAD + kind + f'preset = "{config.preset}"\nseed = {config.seed}\n'
    tables = (write_table(name, getattr(owner, name), comments) for name, (owner, comments) in owners.items())
    return "\n".join([head, *tables])
