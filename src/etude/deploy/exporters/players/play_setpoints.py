"""Sends setpoints.csv to PX4 in offboard mode, if the vehicle hovers where the motion begins.

    python3 play.py [--tolerance 0.3]

Take off, hover at the start (first row of setpoints.csv: north, east, down of the local frame), then run this
and switch to offboard mode while it says so; switch back at any time. It needs ROS 2 with rclpy and px4_msgs
and PX4's uXRCE-DDS bridge; no package of Etude. The last set-point is held until you take over.
"""

import argparse
import csv
import math
import pathlib
import sys

import rclpy
from px4_msgs.msg import OffboardControlMode, TrajectorySetpoint, VehicleLocalPosition, VehicleStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

RATE = 50.0  # Hz
QOS = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
)


def read(path):
    """Rows of numbers."""
    with open(path, newline="") as file:
        _, *rows = csv.reader(file)
    return [[float(cell) for cell in row] for row in rows]


class Player(Node):
    """Holds the first set-point until offboard mode is on, then plays, then holds the last."""

    def __init__(self, rows, tolerance):
        super().__init__("etude_player")
        self.rows, self.tolerance = rows, tolerance
        self.place, self.offboard, self.begun, self.problem = None, False, None, ""
        self.mode = self.create_publisher(OffboardControlMode, "/fmu/in/offboard_control_mode", QOS)
        self.setpoint = self.create_publisher(TrajectorySetpoint, "/fmu/in/trajectory_setpoint", QOS)
        self.create_subscription(VehicleLocalPosition, "/fmu/out/vehicle_local_position", self.on_place, QOS)
        self.create_subscription(VehicleStatus, "/fmu/out/vehicle_status", self.on_status, QOS)
        self.create_timer(1.0 / RATE, self.tick)

    def on_place(self, message):
        """Where the vehicle is."""
        self.place = (message.x, message.y, message.z)

    def on_status(self, message):
        """Whether the pilot has switched to offboard mode."""
        self.offboard = message.nav_state == VehicleStatus.NAVIGATION_STATE_OFFBOARD

    def near(self):
        """Whether the vehicle is where the motion begins; NaN is nowhere."""
        return self.place is not None and math.dist(self.place, self.rows[0][1:4]) <= self.tolerance

    def tick(self):
        """One set-point. The motion begins where offboard mode does, and is over where that ends."""
        now = self.get_clock().now().nanoseconds
        if self.begun is not None and not self.offboard:
            self.problem = "offboard mode ended before the motion did"
        elif self.begun is None and not self.near():
            if self.offboard:
                self.problem = f"the vehicle is at {self.place}, the motion begins at {self.rows[0][1:4]}"
            return  # without set-points PX4 does not enter offboard mode
        elif self.begun is None and self.offboard:
            self.begun = now
        seconds = 0.0 if self.begun is None else (now - self.begun) * 1e-9
        k = min(int(seconds * RATE + 1e-6), len(self.rows) - 1)
        self.send(self.rows[k], now // 1000)

    def send(self, row, microseconds):
        """The mode, which keeps offboard mode alive, and the set-point."""
        self.mode.publish(OffboardControlMode(timestamp=microseconds, position=True))
        message = TrajectorySetpoint(timestamp=microseconds)
        message.position, message.velocity, message.acceleration = row[1:4], row[4:7], row[7:10]
        message.yaw = row[10]
        self.setpoint.publish(message)


def main(arguments=None):
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tolerance", type=float, default=0.3, help="m at the start")
    given = parser.parse_args(arguments)
    rclpy.init()
    node = Player(read(pathlib.Path(__file__).with_name("setpoints.csv")), given.tolerance)
    try:
        while rclpy.ok() and not node.problem:
            rclpy.spin_once(node, timeout_sec=0.1)
        if node.problem:
            print(node.problem, file=sys.stderr)
        return 1 if node.problem else 0
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
