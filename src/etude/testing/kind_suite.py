"""Laws of a kind of robot: its simulated robot, feature map and physics, all its parts together, and two
rounds of a simulated campaign.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from etude.abilities import SupportsWithout
from etude.limits.certificate import certify
from etude.plugins import require_whole
from etude.protocols import Family, Kind, Limit, Mean
from etude.testing.differences import central, close, same
from etude.testing.motion_suites import FamilySuite, LimitSuite
from etude.testing.robot_world import World, log_of, samples_of, world
from etude.types import Array, Motion


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
        channels = {channel.name: channel for channel in self.kind.channels(here.spec)}
        for name, channel in log.channels.items():
            if channel.role != "truth":
                assert name in channels, f"{name} is no channel of the kind"
            assert log[name].shape == (len(log), len(channel.parts)), f"shape of {name}"
        missing = [name for name, channel in channels.items() if channel.required and name not in log]
        assert not missing, f"required and not recorded: {missing}"
        assert np.all(np.diff(log.t) > 0.0), "time increases"

    def test_a_gentle_run_is_near_its_plan(self) -> None:
        here = self.world
        robot = here.kind.robot(here.spec, here.config)
        assert robot is not None
        slow = here.trajectory(1).slowed(4.0)
        log = robot.run(slow, None, np.random.default_rng(1))
        inside = (log.t >= 0.25 * slow.duration) & (log.t <= slow.duration)
        planned = slow.motion(log.t[inside], 1).orders[0]
        off = np.sqrt(np.mean((log[self.kind.path][inside] - planned) ** 2))
        assert off <= self.gentle * planned.std(axis=0).max(), f"a slow motion is missed by {off:.3g}"

    def test_the_error_is_one_number_for_each_axis(self) -> None:
        here = self.world
        robot = here.kind.robot(here.spec, here.config)
        assert robot is not None
        error, units = robot.error(log_of(here, 0))
        assert error.shape == (len(units),), "one unit for each axis"
        assert np.all(np.isfinite(error)), "the error is a number"
        assert np.all(error >= 0.0), "the error has no sign"


class InputsSuite:
    """Laws of `protocols.Inputs`, of one robot of a kind. Set `kind` and `robot`."""

    kind: ClassVar[Kind]
    robot: ClassVar[str]

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def test_plan_and_log_are_the_same_to_the_bit(self) -> None:
        here = self.world
        for seed in range(3):
            motion = here.motion(seed)
            same(
                here.inputs.plan(motion).X,
                here.inputs.of_log(here.inputs.states(motion)),
                "X of plan and log",
            )

    def test_keeping_some_rows_is_taking_them_afterwards(self) -> None:
        here = self.world
        motion, keep = here.motion(3), np.array([0, 4, 5, 11])
        whole, some = here.inputs.plan(motion), here.inputs.plan(motion, keep)
        same(some.X, whole.X[keep], "X of the rows kept")
        same(some.gains, whole.gains[keep], "gains of the rows kept")

    def test_step_by_step_is_the_whole_log(self) -> None:
        here = self.world
        log = here.inputs.states(here.motion(4))
        memory, rows = None, []
        for i in range(len(log)):
            x, memory = here.inputs.step({name: values[i] for name, values in log.values.items()}, memory)
            rows.append(x)
        close(np.array(rows), here.inputs.of_log(log), 1e-12, "X step by step")

    def test_columns_name_what_a_log_has(self) -> None:
        here = self.world
        columns = here.inputs.columns
        log = here.inputs.states(here.motion(5))
        assert here.inputs.of_log(log).shape == (len(log), len(columns)), "one column for each input"
        for channel, part, unit, _ in columns:
            assert channel in log.channels, f"{channel} is no channel of the states"
            source = log.channels[channel]
            assert part in source.parts, f"{channel} has no part {part}"
            assert unit, f"{channel} {part} has no unit"

    def test_pull_is_the_gradient(self) -> None:
        here = self.world
        motion = here.motion(6, 6)
        planned, rng = here.inputs.plan(motion), np.random.default_rng(7)
        in_X, in_gains = rng.standard_normal(planned.X.shape), rng.standard_normal(planned.gains.shape)

        def value(orders: np.ndarray) -> float:
            again = here.inputs.plan(Motion(motion.t, orders))
            return float(np.sum(in_X * again.X) + np.sum(in_gains * again.gains))

        pulled = planned.vjp(in_X, in_gains)
        assert pulled.shape == motion.orders.shape, "pull has the shape of the motion"
        close(pulled, central(value, motion.orders, 1e-5), 1e-5, "pull")

    def test_gains_are_square_roots_of_weights(self) -> None:
        here = self.world
        gains = here.inputs.plan(here.motion(8)).gains
        assert np.all(np.abs(gains) <= 1.0), "a sample is used at most once"
        assert gains.shape[1] == len(self.kind.limit(here.spec)), "one gain for each command"


class PhysicsSuite:
    """Laws of `protocols.Physics` and `protocols.Mean`, of one robot of a kind. Set `kind` and `robot`."""

    kind: ClassVar[Kind]
    robot: ClassVar[str]

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def means(self) -> dict[str, Mean]:
        """Every structure of physics, fitted to a simulated run."""
        here = self.world
        samples = samples_of(here, 1)
        return {name: physics(samples) for name, physics in self.kind.physics(here.spec, here.config).items()}

    def test_every_command_is_predicted(self) -> None:
        here = self.world
        log = here.inputs.states(here.motion(0))
        for name, mean in self.means().items():
            predicted = mean.predict(log)
            assert predicted.shape == (len(log), len(self.kind.limit(here.spec))), f"{name}: shape of predict"
            assert np.isfinite(predicted).all(), f"{name} predicts numbers that are not finite"

    def test_rows_do_not_depend_on_their_company(self) -> None:
        here = self.world
        log, rows = here.inputs.states(here.motion(1)), np.array([7, 3, 3])
        for name, mean in self.means().items():
            close(mean.predict(log.take(rows)), mean.predict(log)[rows], 1e-9, f"{name}: rows alone")

    def test_static_is_the_part_at_rest(self) -> None:
        here = self.world
        motion = here.motion(2)
        still = np.zeros_like(motion.orders)
        still[0] = motion.orders[0]
        log = here.inputs.states(Motion(motion.t, still))
        moving = here.inputs.states(motion)
        means = self.means()
        for name, mean in means.items():
            close(mean.static(moving), mean.static(log), 1e-9, f"{name}: static of a moving robot")
        for row in (0, len(motion.t) // 2):  # what rests stays where it is, and so does what it remembers
            pose = np.repeat(still[:, row : row + 1], 3, axis=1)
            log = here.inputs.states(Motion(motion.t[:3], pose))
            for name, mean in means.items():
                close(mean.static(log), mean.predict(log), 1e-9, f"{name}: static of a resting robot")

    def test_a_stored_mean_predicts_the_same(self) -> None:
        here = self.world
        log = here.inputs.states(here.motion(3))
        table = self.kind.physics(here.spec, here.config)
        for name, mean in self.means().items():
            again = table[name].restore(mean.arrays())
            same(again.predict(log), mean.predict(log), f"{name}: restored")

    def test_what_a_fold_says_is_not_in_the_mean_without_it(self) -> None:
        here = self.world
        samples = samples_of(here, 2)
        fold = np.arange(len(samples)) * 3 // len(samples)
        for name, physics in self.kind.physics(here.spec, here.config).items():
            if not isinstance(physics, SupportsWithout):
                continue
            for number, predicted in physics.without(samples, fold).items():
                alone = physics(samples.take(fold != number)).predict(samples.log)
                close(predicted, alone, 1e-9, f"{name}: without the fold {number}")


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
        for part, subject in parts:
            require_whole(subject, part, f"{part} of {kind.name}")

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
        assert len(forth) == len(back), "the order of ingestion changes the number of samples"
        for number in (0, 1):
            a, b = forth.take(forth.group == number), back.take(back.group == number)
            assert np.array_equal(a.command, b.command), (
                f"the order of ingestion changes the samples of log {number}"
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
        same_test = [(number, run) for number, run in evaluated if run.test == evaluated[0][1].test]
        learned = [float(np.mean(run.errors)) for _, run in same_test if not run.baseline]
        alone = max(float(np.mean(run.errors)) for number, run in same_test if number == 0 and run.baseline)
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


def _limit_suite(here: World, tested_limit: Limit, is_tight: bool) -> LimitSuite:
    class Suite(LimitSuite):
        limit = tested_limit
        family = here.family
        home = here.kind.home(here.spec)
        tight = is_tight

    return Suite()
