"""What every kind of robot owes: all its nouns together, and two rounds of a simulated campaign."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from etude.limits.certificate import certify
from etude.plugins import require_whole
from etude.protocols import Family, Kind, Limit
from etude.testing.motion_suites import FamilySuite, LimitSuite
from etude.testing.robot_suites import InputsSuite, PhysicsSuite, RobotSuite
from etude.testing.robot_world import World, world
from etude.types import Array


class KindSuite(InputsSuite, PhysicsSuite, RobotSuite):
    """Laws of `protocols.Kind`, those of its inputs, physics and simulated robot among them.

    Set `kind` and `robot`: a built-in name, or a file that the kind recognises.
    """

    kind: ClassVar[Kind]
    robot: ClassVar[str]
    loose: ClassVar[frozenset[str]] = frozenset()
    """Names of limits whose cones are narrower than they are."""
    rounds: ClassVar[int] = 2

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def test_the_description_is_whole(self, tmp_path: Path) -> None:
        """A campaign folder needs nothing outside itself."""
        path = self.kind.built_in().get(self.robot, Path(self.robot))
        assert self.kind.recognises(path), f"{path.name} is not recognised"
        for name, content in self.kind.described(path).files.items():
            (tmp_path / name).write_bytes(content)
        assert (tmp_path / "robot.toml").is_file(), "there is no robot.toml"
        assert self.kind.recognises(tmp_path / "robot.toml"), "its own robot.toml is not recognised"
        spec = self.kind.spec(tmp_path / "robot.toml")
        again = self.kind.described(tmp_path / "robot.toml")
        assert spec.name == self.world.spec.name
        assert set(again.files) == {file.name for file in tmp_path.iterdir()}, "described twice, other files"

    def test_every_ability_is_whole(self) -> None:
        """Of the kind and of what it makes: all members of an ability, or none."""
        here, kind = self.world, self.kind
        robot = kind.robot(here.spec, here.config)
        parts = [("Kind", kind), ("Description", here.spec), ("Inputs", here.inputs), ("Robot", robot)]
        parts += [("[trajectory]", here.config.trajectory), *(("Limit", limit) for limit in here.limits)]
        parts += [("Physics", physics) for physics in kind.physics(here.spec, here.config).values()]
        for part, found in parts:
            require_whole(found, part, f"{part} of {kind.name}")

    def test_channels_are_well_formed(self) -> None:
        channels = {channel.name: channel for channel in self.kind.channels(self.world.spec)}
        assert self.kind.path in channels, "the path is one of the channels"
        assert "command" in channels, "there is a channel called command"
        assert channels["command"].role == "command"
        assert len(channels["command"].parts) == len(self.kind.limit(self.world.spec))
        assert len(channels[self.kind.path].parts) == len(self.kind.home(self.world.spec))
        for channel in channels.values():
            assert len(channel.units) == len(channel.parts), f"{channel.name}: one unit for each part"
            assert len(set(channel.parts)) == len(channel.parts), f"{channel.name}: parts are distinct"
            if channel.derivative_of:
                assert channel.derivative_of in channels, f"{channel.name} is the rate of no channel"

    def test_tables_have_presets_and_comments(self) -> None:
        assert {"default", "thesis"} <= set(self.kind.presets), "both presets"
        config = self.world.config
        assert math.isfinite(config.trajectory.duration), "[trajectory] says how long a motion is"
        for table, cls in self.kind.tables.items():
            fields = {field.name for field in dataclasses.fields(cls)}
            unknown = set(self.kind.comments.get(table, {})) - fields
            assert not unknown, f"[{table}] comments keys that there are not: {unknown}"
            for name, preset in self.kind.presets.items():
                wrong = set(preset.get(table, {})) - fields
                assert not wrong, f"preset {name}, [{table}]: unknown keys {wrong}"

    def test_random_motions_are_certified(self) -> None:
        for seed in range(5):
            certificate = certify(self.world.trajectory(seed), self.world.limits)
            assert certificate.ok, f"a motion inside the set is refused: {certificate.worst}"

    def test_the_family_keeps_its_laws(self) -> None:
        run_laws(_family_suite(self.world))

    def test_each_limit_keeps_its_laws(self) -> None:
        resting = self.world.trajectory(0)
        for limit in self.world.limits:
            if not limit.prove(resting):
                continue  # rest at both ends is checked for all limits together
            run_laws(_limit_suite(self.world, limit, limit.name not in self.loose))

    def test_samples_do_not_depend_on_the_order_of_telling(self) -> None:
        from etude.testing.robot_world import log_of

        here = self.world
        logs = [log_of(here, 1), log_of(here, 2)]
        groups = [np.full(len(log), number, dtype=np.int64) for number, log in enumerate(logs)]
        forth = here.kind.samples(here.spec, here.config, logs, groups)
        back = here.kind.samples(here.spec, here.config, logs[::-1], groups[::-1])
        assert len(forth) == len(back), "order of telling changes how much is learned"
        for number in (0, 1):
            a, b = forth.take(forth.group == number), back.take(back.group == number)
            assert np.array_equal(a.command, b.command), (
                f"order of telling changes the samples of log {number}"
            )

    def test_the_error_falls_within_two_rounds(self, tmp_path: Path) -> None:
        """The whole loop on the simulated robot: asked, run, told, learned, tested."""
        from etude.campaign.create import create_campaign
        from etude.campaign.simulation import simulate

        path = self.kind.built_in().get(self.robot, Path(self.robot))
        campaign, _ = create_campaign(tmp_path / "lab", str(path), seed=3)
        for _ in simulate(campaign, self.rounds):
            pass
        evaluated = campaign.state().evaluated
        own = [(number, run) for number, run in evaluated if run.test == evaluated[0][1].test]
        learned = [float(np.mean(run.errors)) for _, run in own if not run.baseline]
        alone = max(float(np.mean(run.errors)) for number, run in own if number == 0 and run.baseline)
        assert learned[-1] < alone, f"{learned[-1]:.3g} with learning, {alone:.3g} without"


def run_laws(suite: object) -> None:
    """Calls every law of a suite that needs no fixture."""
    for name in dir(suite):
        if name.startswith("test_"):
            getattr(suite, name)()


def _family_suite(here: World) -> FamilySuite:
    class Suite(FamilySuite):
        family = here.family
        instants = 20_000

        def draw(self, seed: int) -> tuple[Family, Array]:
            return here.parameters(seed)

    return Suite()


def _limit_suite(here: World, own: Limit, is_tight: bool) -> LimitSuite:
    class Suite(LimitSuite):
        limit = own
        family = here.family
        home = here.kind.home(here.spec)
        tight = is_tight

    return Suite()
