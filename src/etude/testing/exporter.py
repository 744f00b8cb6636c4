"""What every exporter owes: what its receiver plays is what was proved."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.deploy.played import HELD_STILL, ORDERS_HELD, certify_played
from etude.limits.lead_ins import at_rest
from etude.protocols import Exporter, Kind
from etude.testing.differences import close
from etude.testing.world import World, world


class ExporterSuite:
    """Laws of `protocols.Exporter`. Set `exporter` (a staticmethod), `kind` and `robot`."""

    exporter: ClassVar[Exporter]
    kind: ClassVar[Kind]
    robot: ClassVar[str]
    accuracy: ClassVar[float] = 1e-6
    """Of the path that the receiver plays, as a part of its size."""

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def test_the_receiver_plays_the_trajectory(self) -> None:
        here = self.world
        trajectory = here.trajectory(0)
        files = type(self).exporter(trajectory, here.kind, here.spec)
        assert files, "nothing was exported"
        played = type(self).exporter.back(files)  # type: ignore[attr-defined]
        t = np.linspace(0.0, trajectory.duration, 500)
        close(played.motion(t, 1).orders[0], trajectory.motion(t, 1).orders[0], self.accuracy, "path played")

    def test_what_it_plays_is_certified(self) -> None:
        here = self.world
        trajectory = at_rest(here.trajectory(1), here.limits)  # receivers hold the first row and the last
        files = type(self).exporter(trajectory, here.kind, here.spec)
        found = certify_played(type(self).exporter, files, here.limits, trajectory)
        assert found.seen, "nothing is proved of what the receiver plays"

    def test_its_receiver_goes_from_rest_to_rest(self) -> None:
        """It holds the first row before, and the last one for ever."""
        here = self.world
        trajectory = at_rest(here.trajectory(3), here.limits)
        played = type(self).exporter.back(  # type: ignore[attr-defined]
            type(self).exporter(trajectory, here.kind, here.spec)
        )
        ends = np.array([0.0, played.duration])
        moves = np.abs(played.motion(ends, ORDERS_HELD).orders[1:]).max()
        assert moves <= HELD_STILL, f"a row that is held moves: {moves:.3g} per s or s^2"
        outside = played.motion(ends + np.array([-10.0, 10.0]), ORDERS_HELD).orders
        close(outside[0], played.motion(ends, 1).orders[0], self.accuracy, "place held")
        assert not outside[1:].any(), "it moves before the first row, or after the last"

    def test_the_same_motion_gives_the_same_bytes(self) -> None:
        here = self.world
        once, twice = (type(self).exporter(here.trajectory(2), here.kind, here.spec) for _ in range(2))
        assert once == twice, "the files depend on more than the trajectory"
