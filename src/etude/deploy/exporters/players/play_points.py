"""Sends points.csv to joint_trajectory_controller, if the robot is at rest where the motion begins.

    python3 play.py [--controller /joint_trajectory_controller] [--tolerance 0.02] [--states /joint_states]

Ctrl-C cancels the motion: the controller then stops the robot. A joint may be as far from the start as
certificate.json keeps for tracking, and 0.02 rad (m) at most; or --tolerance. Needs ROS 2 (Humble or newer)
with rclpy, control_msgs and sensor_msgs; no package of Etude. It ends with 1 if the robot is elsewhere or
moves, if the controller refuses, or if the motion was not finished; with 130 after Ctrl-C.
"""

import argparse
import csv
import json
import pathlib
import signal
import sys

import rclpy
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

NANO = 10**9  # ns in a second
PATIENCE = 5.0  # s
NEAR = 0.02  # rad or m from the start
STILL = 0.05  # rad/s or m/s: encoders at rest show less


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


def tolerances(path, names):
    """Distance by joint within which a motion may begin: the certificate's tracking margin, at most NEAR."""
    try:
        rows = json.loads(path.read_text())["rows"]
    except (OSError, ValueError, KeyError):
        rows = []
    kept = [(r["axis"], r["tracking_margin"]) for r in rows if r["quantity"] == "position"]
    # pieces may have margins of their own: the least of them
    return {name: min([NEAR, *(m for axis, m in kept if axis == name and m > 0.0)]) for name in names}


def standing(node, topic):
    """Positions and velocities by joint, of the first message; velocities where the message has them."""
    places, speeds = {}, {}

    def heard(message):
        places.update(zip(message.name, message.position))
        speeds.update(zip(message.name, message.velocity))

    node.create_subscription(JointState, topic, heard, 10)
    end = node.get_clock().now().nanoseconds + PATIENCE * NANO
    while not places and node.get_clock().now().nanoseconds < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    return places, speeds


def not_ready(start, places, speeds, near):
    """Sentences about joints that are not at rest where the motion begins; start: positions by joint."""
    missing = [name for name in start if name not in places]
    if missing:
        return ["no position of " + ", ".join(missing)]
    return [
        f"{name} is at {places[name]:.4f}, the motion begins at {wanted:.4f}, and {near[name]:.4f} is allowed"
        for name, wanted in start.items()
        if not abs(places[name] - wanted) <= near[name]
    ] + [
        f"{name} moves at {speeds[name]:.3f} a second"
        for name in start
        if not abs(speeds.get(name, 0.0)) <= STILL
    ]


def wait(node, future):
    """The result. The loop comes back to Python often, so that Ctrl-C is heard."""
    while not future.done():
        rclpy.spin_once(node, timeout_sec=0.1)
    return future.result()


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
    try:
        handle = wait(node, sent)
        if not handle.accepted:
            print("the controller refused the motion", file=sys.stderr)
            return False
        result = wait(node, handle.get_result_async()).result
    except KeyboardInterrupt:
        wait(node, wait(node, sent).cancel_goal_async())
        print("the motion was cancelled: the controller stops the robot", file=sys.stderr)
        raise
    if result.error_code != FollowJointTrajectory.Result.SUCCESSFUL:
        print(f"the motion was not finished: {result.error_code} {result.error_string}", file=sys.stderr)
        return False
    return True


def main(arguments=None):
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", default="/joint_trajectory_controller")
    parser.add_argument("--states", default="/joint_states")
    parser.add_argument("--tolerance", type=float, help="rad or m at the start; else by certificate.json")
    given = parser.parse_args(arguments)
    beside = pathlib.Path(__file__)
    names, points = read(beside.with_name("points.csv"))
    near = tolerances(beside.with_name("certificate.json"), names)
    if given.tolerance is not None:
        near = dict.fromkeys(names, given.tolerance)
    # rclpy's own handler would close the connection first, and the motion could not be cancelled
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node = Node("etude_player")
    try:
        start = dict(zip(names, points[0].positions))
        wrong = not_ready(start, *standing(node, given.states), near)
        for sentence in wrong:
            print(sentence, file=sys.stderr)
        return 1 if wrong or not play(node, given.controller, names, points) else 0
    except KeyboardInterrupt:
        return 130
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
