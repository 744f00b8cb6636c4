"""Sends points.csv to joint_trajectory_controller, if the robot stands where the motion begins.

    python3 play.py [--controller /joint_trajectory_controller] [--tolerance 0.02] [--states /joint_states]

Needs ROS 2 with rclpy, control_msgs and sensor_msgs; no package of Etude. It ends with 1 if the robot is
elsewhere, if the controller refuses, or if the motion was not finished.
"""

import argparse
import csv
import pathlib
import sys

import rclpy
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

NANO = 10**9  # ns in a second
PATIENCE = 5.0  # s


def read(path):
    """Joint names and points of the table."""
    with open(path, newline="") as file:
        header, *rows = csv.reader(file)
    names = [column.split("/", 1)[1] for column in header if column.startswith("position/")]
    points = []
    for row in rows:
        sec, nanosec = divmod(int(row[0]), NANO)
        point = JointTrajectoryPoint()
        point.time_from_start = Duration(sec=sec, nanosec=nanosec)
        for word, field in (
            ("position", "positions"),
            ("velocity", "velocities"),
            ("acceleration", "accelerations"),
            ("effort", "effort"),
        ):
            cells = [float(cell) for name, cell in zip(header, row) if name.startswith(word + "/")]
            setattr(point, field, cells)
        points.append(point)
    return names, points


def standing(node, topic):
    """Positions by joint, of the first message."""
    found = {}
    node.create_subscription(JointState, topic, lambda m: found.update(zip(m.name, m.position)), 10)
    end = node.get_clock().now().nanoseconds + PATIENCE * NANO
    while not found and node.get_clock().now().nanoseconds < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    return found


def elsewhere(names, start, found, tolerance):
    """Sentences about joints that are not where the motion begins."""
    missing = [name for name in names if name not in found]
    if missing:
        return ["no position of " + ", ".join(missing)]
    return [
        f"{name} stands at {found[name]:.4f}, the motion begins at {wanted:.4f}"
        for name, wanted in zip(names, start)
        if not abs(found[name] - wanted) <= tolerance
    ]


def play(node, controller, names, points):
    """Whether the controller took the motion and finished it."""
    client = ActionClient(node, FollowJointTrajectory, controller + "/follow_joint_trajectory")
    if not client.wait_for_server(timeout_sec=PATIENCE):
        print(f"{controller} does not answer", file=sys.stderr)
        return False
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = names
    goal.trajectory.points = points
    sent = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, sent)
    if not sent.result().accepted:
        print("the controller refused the motion", file=sys.stderr)
        return False
    ended = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    result = ended.result().result
    if result.error_code != FollowJointTrajectory.Result.SUCCESSFUL:
        print(f"the motion was not finished: {result.error_code} {result.error_string}", file=sys.stderr)
        return False
    return True


def main(arguments=None):
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", default="/joint_trajectory_controller")
    parser.add_argument("--states", default="/joint_states")
    parser.add_argument("--tolerance", type=float, default=0.02, help="rad or m at the start")
    given = parser.parse_args(arguments)
    names, points = read(pathlib.Path(__file__).with_name("points.csv"))
    rclpy.init()
    node = Node("etude_player")
    try:
        wrong = elsewhere(names, points[0].positions, standing(node, given.states), given.tolerance)
        for sentence in wrong:
            print(sentence, file=sys.stderr)
        return 1 if wrong or not play(node, given.controller, names, points) else 0
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
