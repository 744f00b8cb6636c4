"""Étude: composes the motions that teach a robot's inverse dynamics in as little robot time as possible.

What stands in `__all__` is loaded when it is first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from etude import abilities, errors, protocols, testing, types
    from etude.campaign.create import create_campaign, load_robot
    from etude.campaign.deployment.model_export import export
    from etude.campaign.deployment.monitor import watch
    from etude.campaign.deployment.payload import payload
    from etude.campaign.deployment.predict import predict
    from etude.campaign.deployment.promote import promote, rollback
    from etude.campaign.evaluate.status import status
    from etude.campaign.ingest.inspection import read_log
    from etude.campaign.ingest.tell import tell, untell
    from etude.campaign.propose.ask import ask
    from etude.campaign.record.folder import open_campaign
    from etude.campaign.record.stored_models import load_model
    from etude.campaign.run.connection import connect
    from etude.campaign.simulation import simulate
    from etude.limits.certificate import certify

__version__ = "0.2.0"
__all__ = [
    "abilities",
    "ask",
    "certify",
    "connect",
    "create_campaign",
    "errors",
    "export",
    "load_model",
    "load_robot",
    "open_campaign",
    "payload",
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
    if name.startswith("__"):
        raise AttributeError(f"module 'etude' has no attribute {name!r}")
    from etude._runtime.lazy import loaded

    return loaded(__name__, name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
