"""Conformance suites for plug-ins: laws as test methods, one class for each noun.

Subclass one in a test file, name what is to be tested, and pytest finds the laws:

    from etude.testing import KindSuite
    from etude_vessel import KIND

    class TestVessel(KindSuite):
        kind, robot = KIND, "vessel"

Assertions are plain, so nothing but pytest's collection is needed. The suites are public; the modules under
this package are not.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from etude.testing.files import ExporterSuite, ReaderSuite
    from etude.testing.kind import KindSuite
    from etude.testing.models import CriterionSuite, KernelSuite, ProcessSuite
    from etude.testing.motions import FamilySuite, LimitSuite
    from etude.testing.robot import InputsSuite, PhysicsSuite, RobotSuite

__all__ = [
    "CriterionSuite",
    "ExporterSuite",
    "FamilySuite",
    "InputsSuite",
    "KernelSuite",
    "KindSuite",
    "LimitSuite",
    "PhysicsSuite",
    "ProcessSuite",
    "ReaderSuite",
    "RobotSuite",
]

_PLACES = {
    "CriterionSuite": "models",
    "ExporterSuite": "files",
    "FamilySuite": "motions",
    "InputsSuite": "robot",
    "KernelSuite": "models",
    "KindSuite": "kind",
    "LimitSuite": "motions",
    "PhysicsSuite": "robot",
    "ProcessSuite": "models",
    "ReaderSuite": "files",
    "RobotSuite": "robot",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(importlib.import_module(f"etude.testing.{_PLACES[name]}"), name)
    raise AttributeError(f"module 'etude.testing' has no attribute {name!r}")
