"""Runs of iterative and adaptive control, which learn one motion or the parameters of a known structure.

Both stand beside the models of chapter 6 (thesis 2.2): the same robot, motions, noise and figures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from etude.protocols import Controller, Trajectory
from etude.threads import threads_for
from etude.types import Array, Motion, Row
from etude_arm import AdaptiveController, craig_hsu_sastry, slotine_li
from etude_studies.measured import Measured
from etude_studies.spec import Spec
from etude_studies.thesis.arm import PRIMARY, joint_rows, tested
from etude_studies.thesis.arm_lines import Given
from etude_studies.thesis.arm_measures import tracking
from etude_studies.thesis.arm_motions import RUN, tests_of, training_motions
from etude_studies.thesis.arm_runs import ROUNDS, arm_spec
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.thesis.ilc import learned_command
from etude_studies.world import World

LAWS = {"": slotine_li, "craig": craig_hsu_sastry}
"""Adaptive laws by the line's name; "" is the run's own."""


def repeated_spec(seed: int) -> Spec:
    """Y1. It needs no draws: all that it learns is the test."""
    return Spec("etude_studies.thesis.ilc_runs:repeated", {"robot": "arm4", "rounds": ROUNDS}, seed)


def adaptive_spec(seed: int) -> Spec:
    """Y6, with the motions that other runs learn from."""
    settings = {"robot": "arm4", "rounds": ROUNDS}
    return Spec("etude_studies.thesis.ilc_runs:adaptive", settings, seed, arm_spec(settings, seed).needs)


def repeated(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """Iterative learning control: k repetitions of the seed's own test, then every test with its signal.

    It learns from repetitions with noise of their own; measured is, as of every controller, one more run. On
    another motion the signal is what it is: a function of time, cut off or followed by zeros.

    Args:
        settings: `robot`, `rounds` of `ArmSettings`. seed: of the study.
    """
    arm_settings, rows = ArmSettings(**settings), list[Measured]()
    world = arm_settings.world
    motions = tests_of(arm_settings.robot, seed)
    signal: Array | None = None
    for k in range(arm_settings.rounds + 1):
        for name, motion in motions.items():
            applied = None if signal is None else given_on(world, motion, signal)
            log = tested(arm_settings, motion, applied, seed, name)
            rows += joint_rows(k, name, "", world, tracking(log, world.spec.rate))
        rng = np.random.default_rng([seed, RUN, k])
        applied = None if signal is None else given_on(world, motions[PRIMARY], signal)
        signal = learned_command(world.robot.run(motions[PRIMARY], applied, rng)).values
    return rows


def given_on(world: World, motion: Trajectory, signal: Array) -> Given:
    """A signal (T, J) as feedforward of a motion of another length."""
    robot: Any = world.robot
    commands = np.zeros((len(robot.planned(motion).t), signal.shape[1]))
    count = min(len(commands), len(signal))
    commands[:count] = signal[:count]
    return Given(commands, world.spec.rate, world.kind.limit(world.spec))


def adaptive(settings: Mapping[str, Any], seed: int, needs: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """Adaptive control: k training motions under it, from no knowledge of the parameters, then the test.

    Models "" (Slotine and Li) and "craig" (Craig, Hsu and Sastry) go on adapting in the test, which leaves
    no trace in the next motion; "frozen" and "craig frozen", after the last motion alone, keep theirs.

    Args:
        settings: `robot`, `rounds` of `ArmSettings`. seed: of the study.
        needs: the table of `arm_motions.draws`.
    """
    arm_settings, rows = ArmSettings(**settings), list[Measured]()
    drawn = training_motions(next(iter(needs.values())))[: arm_settings.rounds]
    physics: Any = arm_settings.world.kind.physics(arm_settings.world.spec, arm_settings.config)["identified"]
    with threads_for(0):
        for name, law in LAWS.items():
            rows += _adapted(arm_settings, seed, drawn, name, law(physics))
    return rows


def _adapted(
    settings: ArmSettings, seed: int, drawn: Sequence[Trajectory], name: str, controller: AdaptiveController
) -> Iterator[Measured]:
    """The test before the first motion and after each."""
    for k in range(len(drawn) + 1):
        if k:
            settings.world.robot.run(drawn[k - 1], controller, np.random.default_rng([seed, RUN, k]))
        beside: dict[str, Controller] = {name: copy(controller)}
        if k == len(drawn):
            beside[f"{name} frozen".strip()] = Frozen.of(controller)
        for line, tested_one in beside.items():
            motion = tests_of(settings.robot, seed)[PRIMARY]
            log = tested(settings, motion, tested_one, seed, PRIMARY)
            yield from joint_rows(k, PRIMARY, line, settings.world, tracking(log, settings.world.spec.rate))


@dataclass(eq=False)
class Frozen:
    """An adaptive law that uses its estimates and changes them no more (implements `protocols.Controller`).

    Attributes:
        controller: of its own. weights: (J, n) its estimates.
    """

    controller: AdaptiveController
    weights: Array

    @classmethod
    def of(cls, controller: AdaptiveController) -> Frozen:
        """With the estimates that the controller has now."""
        return cls(copy(controller), controller.weights)

    def planned(self, motion: Motion) -> Array | None:
        """None: it is asked tick by tick."""
        return self.controller.planned(motion)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The estimated command (J,) along the reference that the tracking error moves."""
        return self.controller.command(t, row)

    def observe(self, t: float, row: Row) -> None:
        """Follows the tracking error."""
        self.controller.observe(t, row)
        self.controller.weights = self.weights
