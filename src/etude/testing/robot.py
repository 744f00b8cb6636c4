"""What a simulated robot owes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.protocols import Kind
from etude.testing.differences import same
from etude.testing.world import World, log_of, world


class RobotSuite:
    """Laws of `protocols.Robot`, of one robot of a kind. Set `kind` and `robot`."""

    kind: ClassVar[Kind]
    robot: ClassVar[str]
    gentle: ClassVar[float] = 0.3
    """How far recorded states may be from the plan's, as a part of the plan's spread, in a gentle run."""

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def test_the_same_seed_gives_the_same_log(self) -> None:
        here = self.world
        robot = here.kind.robot(here.spec, here.config)
        assert robot is not None
        first = log_of(here, 0)
        again = robot.run(here.trajectory(0), None, np.random.default_rng(0))
        same(again.t, first.t, "times")
        assert set(again.values) == set(first.values)
        for name, values in first.values.items():
            same(again[name], values, f"channel {name}")

    def test_the_log_holds_what_the_kind_promises(self) -> None:
        here, log = self.world, log_of(self.world, 0)
        known = {channel.name: channel for channel in self.kind.channels(here.spec)}
        for name, channel in log.channels.items():
            if channel.role != "truth":
                assert name in known, f"{name} is no channel of the kind"
            assert log[name].shape == (len(log), len(channel.parts)), f"shape of {name}"
        missing = [name for name, channel in known.items() if channel.required and name not in log]
        assert not missing, f"required and not recorded: {missing}"
        assert np.all(np.diff(log.t) > 0.0), "time increases"

    def test_a_gentle_run_is_near_its_plan(self) -> None:
        here = self.world
        robot = here.kind.robot(here.spec, here.config)
        assert robot is not None
        slow = here.trajectory(1).slowed(4.0)
        log = robot.run(slow, None, np.random.default_rng(1))
        inside = (log.t >= 0.25 * slow.duration) & (log.t <= slow.duration)
        wanted = slow.motion(log.t[inside], 1).orders[0]
        off = np.sqrt(np.mean((log[self.kind.path][inside] - wanted) ** 2))
        assert off <= self.gentle * wanted.std(axis=0).max(), f"a slow motion is missed by {off:.3g}"

    def test_the_error_is_one_number_for_each_axis(self) -> None:
        here = self.world
        robot = here.kind.robot(here.spec, here.config)
        assert robot is not None
        error, units = robot.error(log_of(here, 0))
        assert error.shape == (len(units),), "one unit for each axis"
        assert np.all(np.isfinite(error)), "the error is a number"
        assert np.all(error >= 0.0), "the error has no sign"
