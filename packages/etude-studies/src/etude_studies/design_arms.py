"""The arms of the study of design: how each runs, learns and is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np

from etude.design import MOTIONS, Source, design_chain, linked_chain, prior_latents
from etude.models import LearnedModel, Structure
from etude.protocols import Controller, Trajectory
from etude.trajectories import segment_starts
from etude.types import Array, Log, Samples
from etude_studies.seven_joints import PANDA_LIKE, SevenJoints
from etude_studies.world import World

JUDGED = 6
"""Random motions of each kind that predictions are judged on."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A simulated arm. made: it runs a motion; structures: what is trained, in the words of `model.rung`."""

    name: str
    world: World
    made: Any
    rungs: tuple[Structure | Literal["auto"], ...]

    @property
    def limits(self) -> Any:
        return self.world.kind.limits(self.world.spec, self.world.config, None, {})

    @property
    def home(self) -> Array:
        return self.world.kind.home(self.world.spec)

    def having(self, **keys: float) -> Arm:
        """The arm with other keys of [trajectory]."""
        config = self.world.config
        changed = replace(config, trajectory=replace(config.trajectory, **keys))
        return replace(self, world=replace(self.world, config=changed))

    def random(self, rng: np.random.Generator, count: int) -> tuple[Trajectory, ...]:
        """`count` random segments scaled to the limits."""
        family = self.world.kind.family(self.world.spec, self.world.config)
        source = Source(family, tuple(self.limits), self.home, "scaled")
        return tuple(drawn.trajectory for drawn in source.typical(rng, count))

    def chained(self, segments: Sequence[Trajectory]) -> Trajectory:
        """One recording of the segments."""
        return linked_chain(segments, self.approaches, self.limits, self.home)[0]

    def approaches(self, motion: Trajectory, pose: Array) -> Any:
        return self.world.kind.approaches(self.world.spec, motion, pose)

    def designed(
        self,
        model: LearnedModel | None,
        rng: np.random.Generator,
        count: int,
        tasks: Sequence[Trajectory] = (),
        **design: Any,
    ) -> Trajectory:
        """A recording of `count` segments as `ask` designs it; without a model from the limits alone."""
        kind, spec, config = self.world.kind, self.world.spec, self.world.config
        inputs = kind.inputs(spec, config) if model is None else model.inputs
        latents: Any = model or prior_latents(
            inputs,
            kind.expected(spec).limits,
            kind.limit(spec),
            config.model,
            tuple(next(c for c in kind.channels(spec) if c.role == "command").parts),
        )
        return design_chain(
            kind.family(spec, config),
            self.limits,
            self.home,
            inputs,
            latents,
            replace(config.design, **design),
            rng,
            tasks,
            count=count,
            approaches=self.approaches,
            standing_in=() if model is None else self.reference(rng),
            rate=float(spec.rate),
            physics=kind.physics(spec, config),
        ).trajectory

    def reference(self, rng: np.random.Generator) -> list[Trajectory]:
        """Half moves, half slow series, as `ask` draws them."""
        motions: list[Trajectory] = []
        while len(motions) < MOTIONS:
            motions += self.world.kind.tests(self.world.spec, self.world.config, rng).values()
        return motions

    def recorded(self, motion: Trajectory, rng: np.random.Generator) -> Log:
        log: Log = self.made.run(motion, None, rng)
        return log

    def samples(self, runs: Sequence[tuple[Trajectory, Log]]) -> Samples:
        """Of several recordings, each segment a group."""
        groups, first = [], 0
        for motion, log in runs:
            starts = segment_starts(motion)
            groups.append(first + np.maximum(np.searchsorted(starts, log.t, side="right") - 1, 0))
            first += len(starts)
        logs = [log for _, log in runs]
        return self.world.kind.samples(self.world.spec, self.world.config, logs, groups)

    def learned(
        self,
        runs: Sequence[tuple[Trajectory, Log]],
        rung: Structure | Literal["auto"],
        rng: np.random.Generator,
    ) -> LearnedModel:
        """The model of that structure; "auto": as the ladder chooses, with everything that is averaged."""
        model_config = replace(self.world.config.model, rung=rung)
        config = model_config if rung == "auto" else replace(model_config, candidates=("default",))
        return self.world.learned(self.samples(runs), config, rng).model

    def errors(self, model: LearnedModel, tests: Sequence[Trajectory], rng: np.random.Generator) -> float:
        """Mean absolute error on the tests: tracking error in the loop, deg, of an arm that is simulated so;
        of one that follows exactly the error of the torques, per cent of their limits.
        """
        if hasattr(self.made, "error"):
            controller = self.world.kind.controller(self.world.spec, self.world.config, model)
            return self.tracked(controller, tests, rng)
        errors = []
        for test in tests:
            t = np.arange(0.0, test.duration, 0.05)
            q, qd, qdd = test.motion(t, 3).orders
            channels = {c.name: c for c in self.world.kind.channels(self.world.spec)}
            log = Log(t, {n: channels[n] for n in ("q", "qd", "qdd")}, {"q": q, "qd": qd, "qdd": qdd})
            wrong = np.abs(model.posterior(log)[0] - self.made.inverse(q, qd, qdd))
            errors.append(wrong / self.world.kind.limit(self.world.spec))
        return 100.0 * float(np.mean(np.concatenate(errors)))

    def tracked(
        self, controller: Controller | None, tests: Sequence[Trajectory], rng: np.random.Generator
    ) -> float:
        """Mean tracking error on the tests, deg, of an arm that is simulated in its loop."""
        logs = [self.made.run(test, controller, rng) for test in tests]
        return float(np.mean([self.made.error(log)[0] for log in logs]))

    def tests(self, rng: np.random.Generator) -> list[Trajectory]:
        """The kind's tests; of an arm that follows exactly, more of them and random motions too."""
        standard = list(self.world.kind.tests(self.world.spec, self.world.config, rng).values())
        if hasattr(self.made, "error"):
            return standard
        return [*self.random(rng, JUDGED), *standard]


@cache
def arm_of(name: str) -> Arm:
    """arm4, arm4_rough, or "seven": one that served for no choice of settings."""
    if name == "seven":
        made = SevenJoints(built=PANDA_LIKE)
        return Arm(name, made.world, made, ("identified+gp", "gp"))
    world = World.of(name)
    return Arm(name, world, world.robot, ("gp", "auto"))
