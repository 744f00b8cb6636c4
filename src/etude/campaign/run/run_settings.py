"""run.toml: which driver moves the robot of a campaign, and what is usual for its runs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude._runtime.trusted_folders import folder_id
from etude.campaign.record.config_file import trust_command
from etude.campaign.record.folder import Campaign
from etude.campaign.record.journal import JOURNAL
from etude.drivers import Player, find_driver
from etude.errors import UsageError, typed
from etude.plugins import named_in, require_inside
from etude.toml_tables import decoded, read_table, read_text, refuse_unknown

FILE = "run.toml"
DRIVER, RUN = "driver", "run"


@dataclass(frozen=True)
class RunDefaults:
    """The table [run].

    Attributes:
        rounds: motions at most; 0: as many as the stop rule asks for.
        learned: send the learned command with motions that teach, where the robot takes one.
        confirm: then run a motion that confirms, without and with the learned command. promote: and put the
            model in use if it is better.
    """

    rounds: int = 0
    learned: bool = True
    confirm: bool = True
    promote: bool = True


@dataclass(frozen=True)
class RunSettings:
    """A run.toml.

    Attributes:
        on: the driver, as it is typed after --on; "" if the file names none. of_file: the file named it.
        driver: the table [driver] without that. defaults: the table [run].
    """

    on: str = ""
    of_file: bool = False
    driver: Mapping[str, Any] = field(default_factory=dict)
    defaults: RunDefaults = field(default_factory=RunDefaults)


def read_settings(campaign: Campaign, on: str = "") -> RunSettings:
    """The run.toml of a campaign, or none; `on`, as it was typed, counts before it.

    Raises:
        UsageError: an impossible file, or nobody names a driver.
    """
    path = campaign.path / FILE
    tables = decoded(read_text(path), str(path)) if path.exists() else {}
    refuse_unknown(tables, [DRIVER, RUN], str(path))
    settings = dict(tables.get(DRIVER, {}))
    named = str(settings.pop("on", ""))
    if not on and not named:
        raise UsageError(
            "the driver of the robot is not named",
            where=str(path),
            next_step=f'etude run {typed(campaign.path)} --on DRIVER, or write on = "DRIVER" in [driver].',
        )
    defaults = read_table(RunDefaults, tables.get(RUN, {}), RunDefaults(), f"{path} [{RUN}]")
    return replace(RunSettings(on or named, not on, settings), defaults=defaults)


def driver_of(campaign: Campaign, settings: RunSettings) -> Player:
    """The driver, not connected. What a file names as module:attribute is run only of a trusted folder.

    Raises:
        UsageError: as `find_driver`; or a folder that is not trusted names a file outside itself.
    """
    at_home = np.asarray(campaign.kind.home(campaign.spec), dtype=float).tolist()
    home = dict(zip(campaign.axes, at_home, strict=True))
    path, folder = campaign.path / FILE, campaign.path
    in_file = partial(named_in, path, folder, folder_id(folder / JOURNAL), trust_command(folder))
    values = (*settings.driver.values(), *(settings.on.split(":")[1:] if settings.of_file else ()))
    with in_file():
        require_inside(_files(values))
    with in_file() if settings.of_file else contextlib.nullcontext():
        return find_driver(settings.on, campaign.axes, settings.driver, home=home)


def _files(values: Iterable[Any]) -> Iterator[Path]:
    """Files that exist and that a word of these values names."""
    for word in (word for value in values if isinstance(value, str) for word in value.split(",")):
        with contextlib.suppress(OSError, ValueError):
            if Path(word).is_file():
                yield Path(word)
