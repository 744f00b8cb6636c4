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
    from etude.testing.criterion import CriterionSuite
    from etude.testing.exporter import ExporterSuite
    from etude.testing.family import FamilySuite
    from etude.testing.inputs import InputsSuite
    from etude.testing.kernel import KernelSuite
    from etude.testing.kind import KindSuite
    from etude.testing.limits import LimitSuite
    from etude.testing.physics import PhysicsSuite
    from etude.testing.process import ProcessSuite
    from etude.testing.reader import ReaderSuite
    from etude.testing.robot import RobotSuite

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
    "CriterionSuite": "criterion",
    "ExporterSuite": "exporter",
    "FamilySuite": "family",
    "InputsSuite": "inputs",
    "KernelSuite": "kernel",
    "KindSuite": "kind",
    "LimitSuite": "limits",
    "PhysicsSuite": "physics",
    "ProcessSuite": "process",
    "ReaderSuite": "reader",
    "RobotSuite": "robot",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(importlib.import_module(f"etude.testing.{_PLACES[name]}"), name)
    raise AttributeError(f"module 'etude.testing' has no attribute {name!r}")
