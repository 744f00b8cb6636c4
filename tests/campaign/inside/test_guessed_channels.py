"""Channels of a log whose robot is not known."""

from __future__ import annotations

from test_controllers import table

from etude.campaign.ingest.inspection import guessed_channels
from etude.logs import match_columns


def test_without_a_robot_joints_are_numbered() -> None:
    own = list(table("[{}]", "feedback", "reference", "output"))
    q, command = guessed_channels(own)
    assert q.parts == command.parts == ("joint_0", "joint_1", "joint_2")
    assert match_columns([name for name in own if "/header/" not in name][1:], (q, command), "").channels
