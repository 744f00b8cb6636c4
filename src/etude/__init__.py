"""Étude: composes the motions that teach a robot's inverse dynamics in as little robot time as possible.

What stands in `__all__` is loaded when it is first used, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.2.0"

_PLACES = {
    "create_campaign": "etude.campaign.create",
    "open_campaign": "etude.campaign.record.folder",
    "ask": "etude.campaign.propose.ask",
    "tell": "etude.campaign.ingest.ingest_many",
    "untell": "etude.campaign.ingest.tell",
    "promote": "etude.campaign.deployment.promote",
    "rollback": "etude.campaign.deployment.promote",
    "watch": "etude.campaign.deployment.monitor",
    "status": "etude.campaign.evaluate.status",
    "simulate": "etude.campaign.simulation",
    "read_log": "etude.campaign.ingest.inspection",
    "load_robot": "etude.campaign.create",
    "load_model": "etude.campaign.record.stored_models",
    "predict": "etude.campaign.deployment.predict",
    "export": "etude.campaign.deployment.model_export",
    "certify": "etude.limits.certificate",
}
PUBLIC = ("abilities", "errors", "plugins", "progress", "protocols", "storage", "testing", "threads", "types")
"""Modules that may be used from outside; every room says of its own."""
_MODULES = ("abilities", "errors", "protocols", "testing", "types")
__all__ = [
    "abilities",
    "ask",
    "certify",
    "create_campaign",
    "errors",
    "export",
    "load_model",
    "load_robot",
    "open_campaign",
    "predict",
    "promote",
    "protocols",
    "read_log",
    "rollback",
    "simulate",
    "status",
    "tell",
    "testing",
    "types",
    "untell",
    "watch",
]


def __getattr__(name: str) -> Any:
    """Functions that commands are made of, and the modules that plug-ins need."""
    if name in _MODULES:
        return importlib.import_module(f"etude.{name}")
    if name not in _PLACES:
        raise AttributeError(f"module 'etude' has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
