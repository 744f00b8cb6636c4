"""trajectory_msgs/JointTrajectory as YAML, for `ros2 topic pub`: every float as YAML 1.1 reads it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from etude.deploy.commanded import Commanded
from etude.deploy.exporters.joint_trajectory import MESSAGE, ORDERS, TOPIC, played
from etude.deploy.exporters.knots import NANO, Knots, knots_of, require_joints
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined

FILE = "joint_trajectory.yaml"
ARGUMENT = 128 * 1024
"""Bytes that one argument of a command may have on Linux."""


class JointTrajectoryYaml:
    """A `protocols.Exporter`: the message as one YAML document that is JSON below its comments."""

    def __call__(self, what: Trajectory | Commanded, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The file. UsageError: no robot of joints, or too quick a motion."""
        require_joints(kind, spec, "a JointTrajectory")
        text = _document(knots_of(what, kind, spec, ORDERS))
        return {FILE: (_head(len(text)) + text).encode()}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """What joint_trajectory_controller plays of it."""
        lines = files[FILE].decode().splitlines()
        content = json.loads("\n".join(line for line in lines if not line.startswith("#")))
        return played([_noun(point) for point in content["points"]])


def _head(size: int) -> str:
    lines = [f"{MESSAGE}, to be published once on {TOPIC}."]
    if size < ARGUMENT:
        lines.append(f'ros2 topic pub --once {TOPIC} {MESSAGE} "$(cat {FILE})"')
    else:
        lines.append(
            "Too long for an argument of a command: ros2 topic pub has --yaml-file in newer releases;"
        )
        lines.append("or play the bag that etude ask --format ros2 writes.")
    return "".join(f"# {line}\n" for line in lines)


def _document(knots: Knots) -> str:
    """YAML's flow style, one point a line. Names are quoted: some of them are numbers or words of YAML."""
    names = ", ".join(map(json.dumps, knots.names))
    points = ",\n".join(_point(knots, i) for i in range(len(knots.nanoseconds)))
    head = '{"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}'
    return f'{head}, "joint_names": [{names}], "points": [\n{points}]}}\n'


def _point(knots: Knots, i: int) -> str:
    sec, nanosec = divmod(int(knots.nanoseconds[i]), NANO)
    fields = dict(zip(("positions", "velocities", "accelerations"), knots.points[:, i], strict=True))
    if knots.command is not None:
        fields["effort"] = knots.command[i]
    lists = ", ".join(f'"{name}": {_numbers(row.tolist())}' for name, row in fields.items())
    return f'{{{lists}, "time_from_start": {{"sec": {sec}, "nanosec": {nanosec}}}}}'


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _number(value: float) -> str:
    """Its shortest text with a point in it: YAML 1.1 reads 1e-05 as a word."""
    text = repr(value)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0{exponent}{power}" if exponent and "." not in mantissa else text


def _noun(content: Any) -> Any:
    if isinstance(content, dict):
        return SimpleNamespace(**{name: _noun(value) for name, value in content.items()})
    return content


YAML = JointTrajectoryYaml()
