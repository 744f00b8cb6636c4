"""Drivers by the text after `--on`: NAME, NAME:ADDRESS, module:factory or file.py:factory."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from etude.abilities import SupportsPlacement
from etude.drivers.contract import Player, Stream
from etude.drivers.streaming import Streamed
from etude.errors import UsageError, did_you_mean
from etude.plugins import FULL_NAME, load, names, of_group, require_word

GROUP = "etude.drivers"
FORMS = "NAME, NAME:ADDRESS, module:factory or file.py:factory"


def find_driver(
    on: str,
    joints: Sequence[str],
    settings: Mapping[str, Any] | None = None,
    *,
    home: Mapping[str, float] | None = None,
) -> Player:
    """The driver, not yet connected; a stream is given its clock loop.

    Args:
        on: what names it. A name typed by a person is trusted; in a file, under `plugins.named_in`, only if
            the file's folder is.
        joints: of the campaign, by name.
        settings: table [driver] of run.toml.
        home: pose by joint, rad or m, where a simulation that nobody has placed begins.

    Raises:
        UsageError: no such driver, one that cannot be loaded, a library that it needs is missing, or it is
            neither a Stream nor a Player.
    """
    factory, address = _resolve(on)
    try:
        driver = factory(tuple(joints), address, dict(settings or {}))
        if home is not None and isinstance(driver, SupportsPlacement):
            driver.place(home)
    except UsageError:
        raise
    except Exception as error:
        raise UsageError(
            f"the driver {on} cannot be made: {type(error).__name__}: {error}",
            where=GROUP,
            next_step="Check its address and the table [driver] of run.toml.",
        ) from error
    # a Player first: it may have the methods of a Stream too
    if isinstance(driver, Player):
        return driver
    if isinstance(driver, Stream):
        return Streamed(driver)
    raise UsageError(
        f"{on} returned a {type(driver).__name__}, which is neither a Stream nor a Player",
        where=GROUP,
        next_step=f"It lacks {_missing_members(driver)}: docs/drivers.md has both.",
    )


def _resolve(on: str) -> tuple[Any, str]:
    """(factory, address) of a driver; neither is called."""
    name, _, argument = on.partition(":")
    if name in names(GROUP):
        return load(GROUP, name), argument
    if name.endswith(".py"):
        attribute, _, address = argument.partition(":")
        return of_group(GROUP, f"{name}:{attribute}", _of_file(name, attribute)), address
    attribute, _, address = argument.partition(":")
    if FULL_NAME.fullmatch(f"{name}:{attribute}"):
        return load(GROUP, f"{name}:{attribute}"), address
    known = names(GROUP)
    step = f"{did_you_mean(name, known)}Name it as {FORMS}. Known: {', '.join(known) or 'none'}."
    raise UsageError(f"there is no driver {on!r}", next_step=step)


def _of_file(name: str, attribute: str) -> Any:
    """The attribute of that name in a Python file."""
    path = Path(name).expanduser().resolve()
    if not path.is_file():
        raise UsageError("there is no such file", where=str(path), next_step=f"Name a driver as {FORMS}.")
    if not attribute:
        raise UsageError(
            "a file of drivers needs the name of a factory in it",
            where=str(path),
            next_step=f"Name it: --on {name}:FACTORY",
        )
    require_word(f"{name}:{attribute}", GROUP)
    module_name = f"etude_driver_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[module_name]
        raise UsageError(
            f"{attribute} cannot be loaded: {type(error).__name__}: {error}",
            where=str(path),
            next_step="Repair the file, or install what it imports.",
        ) from error
    if not hasattr(module, attribute):
        raise UsageError(
            f"the file has no {attribute}",
            where=str(path),
            next_step=f"{did_you_mean(attribute, vars(module))}Correct the name after the colon.",
        )
    return getattr(module, attribute)


def _missing_members(driver: Any) -> str:
    """Members of a Stream that the driver lacks."""
    members = ("about", "__enter__", "__exit__", "state", "send", "ready", "stop")
    return ", ".join(name for name in members if not hasattr(driver, name)) or "nothing"


def require_known(settings: Mapping[str, Any], keys: Sequence[str], driver: str) -> None:
    """UsageError: the table [driver] of run.toml has a key that the driver does not know."""
    unknown = [name for name in settings if name not in keys]
    if unknown:
        raise UsageError(
            f"[driver] has no key {', '.join(unknown)} for {driver}",
            where="run.toml",
            next_step=f"{did_you_mean(unknown[0], keys)}It knows {', '.join(keys)}.",
        )
