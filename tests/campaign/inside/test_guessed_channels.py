"""Channels of a log whose robot is not known."""

from __future__ import annotations

from etude.campaign.ingest.inspection import guessed_channels
from etude.logs import match_columns

TOPIC = "/joint_trajectory_controller/controller_state"


def test_without_a_robot_joints_are_numbered() -> None:
    parts = ("feedback/positions", "reference/positions", "error/positions", "output/effort")
    own = ["__time", f"{TOPIC}/header/stamp", *(f"{TOPIC}/{p}[{i}]" for i in range(3) for p in parts)]
    q, command = guessed_channels(own)
    assert q.parts == command.parts == ("joint_0", "joint_1", "joint_2")
    assert match_columns([name for name in own if "/header/" not in name][1:], (q, command), "").channels
