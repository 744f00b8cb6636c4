"""Message types that a recording without their definitions needs beside those of ROS itself.

rosbag2 stores definitions in every MCAP, and in SQLite since ROS 2 Iron. What is older is of Foxy, Galactic
or Humble, which differ in what a controller's state holds (control_msgs, branches of these names).
"""

from __future__ import annotations

from collections.abc import Mapping

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
DYNAMIC_STATE = "control_msgs/msg/DynamicJointState"

_NAMED = "std_msgs/Header header\nstring[] joint_names\n"
_GALACTIC, _HUMBLE = (
    ("desired", "actual", "error"),
    ("reference", "feedback", "error", "output", "desired", "actual"),
)


def _points(names: tuple[str, ...], kind: str, before: str = "") -> str:
    return "".join(f"trajectory_msgs/{kind} {before}{name}\n" for name in names)


DEFINITIONS: Mapping[str, str] = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    DYNAMIC_STATE: "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values\n",
    CONTROLLER_STATE: _NAMED + _points(_GALACTIC, "JointTrajectoryPoint"),
}
"""Type -> definition."""
LATER: Mapping[str, str] = {
    CONTROLLER_STATE: _NAMED
    + _points(_HUMBLE, "JointTrajectoryPoint")
    + "string[] multi_dof_joint_names\n"
    + _points(_HUMBLE, "MultiDOFJointTrajectoryPoint", "multi_dof_"),
}
"""The same of a later release, for messages that are not of the first kind."""
