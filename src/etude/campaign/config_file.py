"""campaign.toml: the configuration in one file that people edit by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from etude.campaign.comments import COMMENTS, HEAD
from etude.campaign.config import SECTIONS, CampaignConfig
from etude.campaign.presets import preset
from etude.campaign.tables import read_table, refuse_unknown, write_table
from etude.errors import UsageError

CONFIG = "campaign.toml"


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
    return parse_config(data, str(path)), hashlib.sha256(data).hexdigest()


def parse_config(data: bytes, where: str) -> CampaignConfig:
    """The configuration in the bytes of a campaign.toml. Errors as `load_config`."""
    import msgspec

    try:
        table = msgspec.toml.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"this file is not TOML: {error}", where=where) from None
    refuse_unknown(table, ["preset", "seed", *SECTIONS], where)
    name, seed = table.get("preset", "default"), table.get("seed", 0)
    start = preset(name, where)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise UsageError(f"seed = {seed!r} must be a whole number, 0 or more", where=f"{where} seed")
    return CampaignConfig(name, seed, **{s: _section(s, table, start, where) for s in SECTIONS})


def _section(name: str, table: Mapping[str, Any], start: CampaignConfig, where: str) -> Any:
    value = getattr(start, name)
    return read_table(type(value), table.get(name, {}), value, f"{where} [{name}]")


def config_text(config: CampaignConfig) -> str:
    """campaign.toml with every value written out and explained."""
    head = HEAD + f'preset = "{config.preset}"\nseed = {config.seed}\n'
    tables = (write_table(name, getattr(config, name), COMMENTS[name]) for name in SECTIONS)
    return "\n".join([head, *tables])
