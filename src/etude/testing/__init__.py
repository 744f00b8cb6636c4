"""Conformance suites for plug-ins: laws as test methods, one class for each protocol.

Subclass one in a test file, name what is to be tested, and pytest finds the laws:

    from etude.testing import KindSuite
    from etude_vessel import KIND

    class TestVessel(KindSuite):
        kind, robot = KIND, "vessel"

Assertions are plain, so nothing but pytest's collection is needed. The suites are public; the modules under
this package are not.
"""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.testing.differences import central
    from etude.testing.driver_suite import DriverSuite
    from etude.testing.fake_robot import FakeRobot
    from etude.testing.faults import FAULTS, Faulty, RobotFault
    from etude.testing.file_suites import ExporterSuite, ReaderSuite
    from etude.testing.kind_suite import InputsSuite, KindSuite, PhysicsSuite, RobotSuite
    from etude.testing.model_suites import CriterionSuite, KernelSuite, ProcessSuite
    from etude.testing.motion_suites import FamilySuite, LimitSuite
    from etude.testing.robot_world import World, world

__all__ = [
    "FAULTS",
    "CriterionSuite",
    "DriverSuite",
    "ExporterSuite",
    "FakeRobot",
    "FamilySuite",
    "Faulty",
    "InputsSuite",
    "KernelSuite",
    "KindSuite",
    "LimitSuite",
    "PhysicsSuite",
    "ProcessSuite",
    "ReaderSuite",
    "RobotFault",
    "RobotSuite",
    "World",
    "central",
    "world",
]
__getattr__, __dir__ = face(__name__)
