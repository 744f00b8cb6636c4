"""What every feature map owes: a plan and a log of the same motion are the same to a model."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.protocols import Kind
from etude.testing.differences import central, close, same
from etude.testing.world import World, world
from etude.types import Motion


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
            known = log.channels[channel]
            assert part in known.parts, f"{channel} has no part {part}"
            assert unit, f"{channel} {part} has no unit"

    def test_pull_is_the_gradient(self) -> None:
        here = self.world
        motion = here.motion(6, 6)
        planned, rng = here.inputs.plan(motion), np.random.default_rng(7)
        in_X, in_gains = rng.standard_normal(planned.X.shape), rng.standard_normal(planned.gains.shape)

        def value(orders: np.ndarray) -> float:
            again = here.inputs.plan(Motion(motion.t, orders))
            return float(np.sum(in_X * again.X) + np.sum(in_gains * again.gains))

        pulled = planned.pull(in_X, in_gains)
        assert pulled.shape == motion.orders.shape, "pull has the shape of the motion"
        close(pulled, central(value, motion.orders, 1e-5), 1e-5, "pull")

    def test_gains_are_square_roots_of_weights(self) -> None:
        here = self.world
        gains = here.inputs.plan(here.motion(8)).gains
        assert np.all(np.abs(gains) <= 1.0), "a sample counts at most once"
        assert gains.shape[1] == len(self.kind.limit(here.spec)), "one gain for each command"
