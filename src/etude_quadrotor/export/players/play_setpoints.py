"""Sends setpoints.csv to PX4 in offboard mode, if the vehicle is where the motion begins and at rest.

    python3 play.py [--tolerance 0.3] [--heading 15] [--speed 0.2] [--away M] [--wait 5]

Bring the vehicle to the first row of setpoints.csv (north, east, down of the local frame): it hovers there,
or stands there if the motion begins with a take-off. Its nose points as the row's yaw says. Run this, arm,
and switch to offboard mode while it says so; switch back at any time. If the vehicle gets too far from its
set-point, or loses its position, the motion ends where the vehicle is. Too far is twice the margin for
tracking in certificate.json, and the margin itself where the room ends; or --away, in m. It needs ROS 2 with
rclpy, px4_msgs of the firmware's version (1.14 or newer) and PX4's uXRCE-DDS bridge; no package of Etude. The
last row, which is at rest, is held until you take over.
"""

import argparse
import csv
import json
import math
import pathlib
import sys

import rclpy
from px4_msgs.msg import OffboardControlMode, TrajectorySetpoint, VehicleLocalPosition, VehicleStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

RATE = 50.0  # Hz; offboard mode ends below 2
PLACE, STATUS = "/fmu/out/vehicle_local_position", "/fmu/out/vehicle_status"
VERSIONS = 9  # of messages, that names are tried for where px4_msgs does not say its own
SILENT = 2.0  # s without a word, after which the vehicle is not known; its state comes twice a second
AWAY = 1.0  # m, where no certificate says a margin: twice the one that robots keep of their walls by default
TWICE = 2.0  # margins from a set-point: what tracking may take, and as much again
ARMED = 2  # VehicleStatus.ARMING_STATE_ARMED
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


def tracking_room(path):
    """Low and high end of the room and margin for tracking, m, by axis, from the certificate."""
    try:
        rows = json.loads(path.read_text())["rows"]
    except (OSError, ValueError, KeyError):
        rows = []
    ends_by_axis = {}
    for row in rows:
        margin = row["tracking_margin"]
        if row["quantity"] in ("position", "radius") and margin > 0.0:
            low, high, most = ends_by_axis.get(row["axis"], (math.inf, -math.inf, 0.0))
            ends = min(low, row["lower"] - margin), max(high, row["upper"] + margin)
            ends_by_axis[row["axis"]] = (*ends, max(most, margin))
    return ends_by_axis


def along(place):
    """A place (north, east, down) by the certificate's axes: x east, y north, z up, the vehicle's level."""
    north, east, down = place
    return {"x": east, "y": north, "z": -down, "vehicle": math.hypot(north, east)}


def names(base, kind):
    """Topics of a message. Since 1.16 PX4 adds its version, but for version 0; px4_msgs then says its own,
    and another one would be read wrongly. Older ones do not say it, and have no version in their names.
    """
    version = getattr(kind, "MESSAGE_VERSION", None)
    if version is None:
        return [base, *(f"{base}_v{number}" for number in range(1, VERSIONS + 1))]
    return [f"{base}_v{version}" if version else base]


class Player(Node):
    """Holds the first set-point until offboard mode is on, then plays, then holds the last."""

    def __init__(self, rows, options, room):
        super().__init__("etude_player")
        self.rows, self.options, self.room = rows, options, room
        self.place, self.velocity, self.heading, self.good = None, None, None, True
        self.offboard, self.armed, self.free = False, False, False
        self.heard = {"position": None, "status": None}
        self.begun, self.printed, self.problem = None, None, ""
        self.started = self.now()
        self.mode = self.create_publisher(OffboardControlMode, "/fmu/in/offboard_control_mode", QOS)
        self.setpoint = self.create_publisher(TrajectorySetpoint, "/fmu/in/trajectory_setpoint", QOS)
        self.topics = names(PLACE, VehicleLocalPosition), names(STATUS, VehicleStatus)
        for topic in self.topics[0]:
            self.create_subscription(VehicleLocalPosition, topic, self.on_place, QOS)
        for topic in self.topics[1]:
            self.create_subscription(VehicleStatus, topic, self.on_status, QOS)
        self.create_timer(1.0 / RATE, self.tick)

    def now(self):
        """s of the node's clock."""
        return self.get_clock().now().nanoseconds * 1e-9

    def on_place(self, message):
        """Where the vehicle is, how it moves and where it looks; nowhere while the estimate does not hold."""
        valid = getattr(message, "xy_valid", True) and getattr(message, "z_valid", True)
        self.place = (message.x, message.y, message.z) if valid else None
        self.velocity = tuple(getattr(message, name, 0.0) for name in ("vx", "vy", "vz"))
        self.heading = getattr(message, "heading", None)
        self.good = getattr(message, "heading_good_for_control", True)
        self.heard["position"] = self.now()

    def on_status(self, message):
        """Whether the pilot has armed and switched to offboard mode."""
        self.offboard = message.nav_state == VehicleStatus.NAVIGATION_STATE_OFFBOARD
        self.armed = getattr(message, "arming_state", ARMED) == ARMED
        self.free = self.free or not (self.offboard and self.armed)
        self.heard["status"] = self.now()

    def wrong(self):
        """Why the motion cannot begin, or nothing; NaN is nowhere."""
        if self.place is None:
            return "the vehicle does not know its position"
        away = math.dist(self.place, self.rows[0][1:4])
        if not away <= self.options.tolerance:
            start = ", ".join(f"{value:.2f}" for value in self.rows[0][1:4])
            return f"the vehicle is {away:.2f} m off: the motion begins at ({start})"
        speed = math.hypot(*self.velocity)
        if not speed <= self.options.speed:
            return f"the vehicle moves at {speed:.2f} m/s, and the motion begins at rest"
        return self.turned()

    def turned(self):
        """Why its heading is not that of the first set-point, or nothing: PX4 would turn at once."""
        if not self.good:
            return "the vehicle does not know its heading (heading_good_for_control is false)"
        if self.heading is None:
            return ""
        target = self.rows[0][10]
        turn = target - self.heading
        off = math.degrees(math.remainder(turn, math.tau)) if math.isfinite(turn) else math.nan
        if abs(off) <= self.options.heading:
            return ""
        return (
            f"the nose points to {math.degrees(self.heading) % 360.0:.0f} deg, and the motion begins at "
            f"{math.degrees(target) % 360.0:.0f} deg (0 north, 90 east): turn it {abs(off):.0f} deg "
            f"{'clockwise' if off > 0.0 else 'anticlockwise'} seen from above, by hand or with the yaw stick"
        )

    def strayed(self, row):
        """Why the motion cannot go on, or nothing.

        Where its place is known, the vehicle is told to stay there:
        PX4 holds the last set-point until it leaves offboard mode (COM_OF_LOSS_T), and it may be far off.
        """
        if self.place is None or not all(map(math.isfinite, self.place)):
            return "the vehicle has lost its position: no more set-points are sent, take over"
        far = self.far(row)
        if not far:
            return ""
        self.send([row[0], *self.place, *[0.0] * 6, row[10]], int(self.now() * 1e6))
        return f"the vehicle is {far}: it holds its position, no more set-points are sent, take over"

    def far(self, row):
        """How far the vehicle is from its set-point, in words, or nothing if it may be."""
        if self.options.away is not None or not self.room:
            most = AWAY if self.options.away is None else self.options.away
            away = math.dist(self.place, row[1:4])
            return "" if away <= most else f"{away:.2f} m from its set-point, more than --away {most:g}"
        at, target = along(self.place), along(row[1:4])
        for axis, (low, high, margin) in self.room.items():
            off = at[axis] - target[axis]
            reach = high - target[axis] if off > 0.0 else target[axis] - low
            most = max(margin, min(TWICE * margin, reach))
            if not abs(off) <= most:
                where = "from the axis" if axis == "vehicle" else f"along {axis}"
                return (
                    f"{abs(off):.2f} m from its set-point {where}, more than {most:.2f} m "
                    f"(certificate.json keeps {margin:.2g} m for tracking; or say --away)"
                )
        return ""

    def silent(self, now):
        """A sentence if PX4 does not answer, or does not any more."""
        waited = now - self.started
        for what, topics in zip(self.heard, self.topics):
            if self.heard[what] is None and waited > self.options.wait:
                return (
                    f"nothing answers on {' or '.join(topics[:2])} after {self.options.wait:g} s: is the "
                    "uXRCE-DDS agent running, and px4_msgs of the firmware's version? "
                    "ros2 topic list shows the names"
                )
            if self.heard[what] is not None and now - self.heard[what] > SILENT:
                return f"no {what} of the vehicle has arrived for {SILENT:g} s"
        return ""

    def tick(self):
        """One set-point. The motion begins where offboard mode does, and is over where that ends."""
        now = self.now()
        self.problem = self.problem or self.silent(now)
        if self.problem or None in self.heard.values():
            self.say(now, "waiting for PX4")
            return
        if self.begun is not None and not (self.offboard and self.armed):
            self.problem = "offboard mode ended: the pilot has the vehicle, no more set-points are sent"
            return
        if self.begun is None:
            if not self.free:
                self.problem = (
                    "the vehicle is armed and in offboard mode already: end what flies it, "
                    "leave offboard mode, start this again, and switch to offboard mode when it says so"
                )
                return
            wrong = self.wrong()
            if wrong and self.offboard and self.armed:
                self.problem = wrong
            if wrong:  # without set-points PX4 does not enter offboard mode
                self.say(now, f"waiting: {wrong}")
                return
            self.begun = now if self.offboard and self.armed else None
        seconds = 0.0 if self.begun is None else now - self.begun
        k = min(int(seconds * RATE + 1e-6), len(self.rows) - 1)
        self.problem = self.strayed(self.rows[k]) if self.begun is not None else ""
        if self.problem:
            return
        self.send(self.rows[k], int(now * 1e6))
        self.say(now, self.state(seconds, self.rows[k]))

    def state(self, seconds, row):
        """In words."""
        if self.begun is None:
            return f"ready at the start: {'switch to offboard mode' if self.armed else 'arm'}"
        last = self.rows[-1][0]
        over = "over: the last set-point is held"
        what = f"playing {seconds:.0f} of {last:.0f} s" if seconds < last else over
        return f"{what}, {math.dist(self.place, row[1:4]):.2f} m from the set-point"

    def say(self, now, text):
        """One line a second."""
        if self.printed is None or now - self.printed >= 1.0:
            self.printed = now
            print(f"{now - self.started:6.0f} s  {text}", flush=True)

    def send(self, row, microseconds):
        """The mode, which keeps offboard mode alive, and the set-point. With `position` PX4 adds velocity and
        acceleration of the set-point to its own.
        """
        self.mode.publish(OffboardControlMode(timestamp=microseconds, position=True))
        message = TrajectorySetpoint(timestamp=microseconds)
        message.position, message.velocity, message.acceleration = row[1:4], row[4:7], row[7:10]
        message.yaw = row[10]
        self.setpoint.publish(message)


def main(arguments=None):
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tolerance", type=float, default=0.3, help="m at the start")
    parser.add_argument("--heading", type=float, default=15.0, help="deg at the start")
    parser.add_argument("--speed", type=float, default=0.2, help="m/s at the start")
    parser.add_argument(
        "--away", type=float, help="m from the set-point, at which the motion ends; else by certificate.json"
    )
    parser.add_argument("--wait", type=float, default=5.0, help="s for PX4's first answer")
    options = parser.parse_args(arguments)
    rclpy.init()
    beside = pathlib.Path(__file__)
    room = tracking_room(beside.with_name("certificate.json"))
    node = Player(read(beside.with_name("setpoints.csv")), options, room)
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
