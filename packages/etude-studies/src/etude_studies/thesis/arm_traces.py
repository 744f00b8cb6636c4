"""Traces of a test of chapter 6: angles and commands of one seed (figures 6.3, 6.4, 6.13)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from etude.threads import threads_for
from etude.types import Log
from etude_studies.measured import Measured
from etude_studies.spec import Spec
from etude_studies.thesis.arm import PRIMARY, joint_rows, plan_of, stages, tested
from etude_studies.thesis.arm_lines import Given
from etude_studies.thesis.arm_measures import standing
from etude_studies.thesis.arm_motions import tests_of, training_motions
from etude_studies.thesis.arm_runs import ARM_RUNS, arm_spec
from etude_studies.thesis.arm_settings import ArmSettings
from etude_studies.world import World

RATE_HZ = 10.0
"""Of what is drawn; the robot runs at its own."""
ANGLES = {"q_des": "q_des", "q": "q_true"}
COMMANDS = {"u_ff": "command_ff", "u": "command"}
"""Measures and the channels that they are of."""
TRACED: Mapping[str, tuple[str, list[int]]] = {
    "A1t": ("A1", [4, 6]),
    "A7t": ("A7", [4, 6]),
    "S1t": ("S1", [4, 6]),
    "S2t": ("S2", [4]),
    "S9t": ("S9", [4, 6]),
}
"""Name -> the run whose test is drawn, and after how many trajectories."""


def trace_spec(name: str, seed: int) -> Spec:
    """The run of a name in `TRACED`: as far as it is drawn, with the motions that other runs have."""
    run, after = TRACED[name]
    settings = {**ARM_RUNS[run][1], "rounds": max(after)}
    needs = arm_spec(settings, seed).needs
    return Spec("etude_studies.thesis.arm_traces:traces", {**settings, "after": after}, seed, needs)


def traces(settings: Mapping[str, Any], seed: int, needs: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """The seed's own test at 10 Hz; k counts the instants, the test is named "after 4", ... .

    Per joint the desired and the true angle, "q_des" and "q", deg, and the feedforward and the applied
    command, "u_ff" and "u", command units; of part "mean" the time "t", s. Beside them what
    `arm_measures.standing` finds in the whole run, after k trajectories.

    Args:
        settings: of `ArmSettings`, and `after`: numbers of trajectories, 0 not among them.
        seed: of the study. needs: the table of `arm_motions.draws`.
    """
    after = {int(number) for number in settings["after"]}
    arm_settings = ArmSettings(**{name: value for name, value in settings.items() if name != "after"})
    world, rows = arm_settings.world, list[Measured]()
    motion = tests_of(arm_settings.robot, seed)[PRIMARY]
    with threads_for(0):
        for stage in stages(arm_settings, seed, training_motions(next(iter(needs.values())))):
            if stage.number in after:
                command = stage.model.mean(plan_of(world, stage.model, motion))
                applied = Given(command, world.spec.rate, world.kind.limit(world.spec))
                log = tested(arm_settings, motion, applied, seed, PRIMARY)
                rows += drawn_rows(log, world, f"after {stage.number}")
                rows += joint_rows(stage.number, PRIMARY, "", world, standing(log, world.spec.rate))
    return rows


def drawn_rows(log: Log, world: World, test: str) -> Iterator[Measured]:
    """A run from t = 0 on, thinned to 10 Hz."""
    log = log.take(log.t >= 0.0).take(slice(None, None, round(world.spec.rate / RATE_HZ)))
    curves = {name: np.rad2deg(log[channel]) for name, channel in ANGLES.items()}
    curves |= {name: log[channel] for name, channel in COMMANDS.items()}
    for k, t in enumerate(log.t):
        yield Measured(k, test, "", "mean", "t", float(t))
        for name, values in curves.items():
            for joint, value in zip(world.spec.names, values[k], strict=True):
                yield Measured(k, test, "", joint, name, float(value))
