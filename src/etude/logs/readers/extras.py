"""Libraries that only some formats need: imported late, and named with the one command if missing."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from etude.errors import UsageError


def needed(module: str, extra: str, path: Path) -> Any:
    """The module. UsageError that names the extra to install if it is not there."""
    try:
        return importlib.import_module(module)
    except ImportError as problem:
        library = module.split(".")[0]
        raise UsageError(
            f"reading this log needs {library}, which is not installed ({problem})",
            where=str(path),
            next_step=f"Install it: pip install 'etude[{extra}]'",
        ) from None
