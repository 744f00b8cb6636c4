"""Which kind a robot is of."""

from __future__ import annotations

from etude.campaign.kinds import RobotKind
from etude.robots.spec import RobotSpec


def kind_of(spec: RobotSpec) -> RobotKind:
    """The kind of that robot: of joints, or flying."""
    if spec.flight is not None:
        from etude.campaign.flight.kind import FLIGHTS

        return FLIGHTS
    from etude.campaign.joint_kind import JOINTS

    return JOINTS
