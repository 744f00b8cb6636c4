"""Drivers of robots that come with Étude, found by the table of plug-ins like those of other packages."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_drivers.crazyflie import CrazyflieVehicle
    from etude_drivers.dds import DdsTopics, JointRow, Points, Topics, message_of, types
    from etude_drivers.franka import FrankaArm
    from etude_drivers.lerobot import LeRobotArm
    from etude_drivers.machine import Machine, MachineSettings
    from etude_drivers.mujoco import MujocoRobot
    from etude_drivers.px4 import Px4Vehicle
    from etude_drivers.ros2 import Ros2Controller
    from etude_drivers.ur import UrArm

__all__ = [
    "CrazyflieVehicle",
    "DdsTopics",
    "FrankaArm",
    "JointRow",
    "LeRobotArm",
    "Machine",
    "MachineSettings",
    "MujocoRobot",
    "Points",
    "Px4Vehicle",
    "Ros2Controller",
    "Topics",
    "UrArm",
    "message_of",
    "types",
]
__getattr__, __dir__ = face(__name__)
