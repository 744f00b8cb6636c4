"""Drivers of robots that come with Étude, found by the table of plug-ins like those of other packages."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_drivers.franka import FrankaArm
    from etude_drivers.lerobot import LeRobotArm
    from etude_drivers.machine import MachineSettings
    from etude_drivers.mujoco import MujocoRobot

__all__ = ["FrankaArm", "LeRobotArm", "MachineSettings", "MujocoRobot"]
__getattr__, __dir__ = face(__name__)
