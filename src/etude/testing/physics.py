"""What physics owe: plans and logs are predicted alike, and gravity is what remains at rest."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.protocols import Kind, Mean
from etude.testing.differences import close, same
from etude.testing.world import World, samples_of, world
from etude.types import Motion


class PhysicsSuite:
    """Laws of `protocols.Physics` and `protocols.Mean`, of one robot of a kind. Set `kind` and `robot`."""

    kind: ClassVar[Kind]
    robot: ClassVar[str]

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def means(self) -> dict[str, Mean]:
        """Every rung of physics, fitted to a simulated run."""
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
            if not hasattr(physics, "without"):
                continue
            for number, predicted in physics.without(samples, fold).items():
                alone = physics(samples.take(fold != number)).predict(samples.log)
                close(predicted, alone, 1e-9, f"{name}: without the fold {number}")
