"""Campaigns on robots of joints: the arm's trajectories, logs and models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.campaign.kinds import TakenIn
from etude.campaign.learner import Learned, Say
from etude.logs.log import RobotLog
from etude.robots.spec import RobotSpec
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.samples import Trajectory

if TYPE_CHECKING:
    from etude.campaign.folder import Campaign
    from etude.campaign.state import State
    from etude.deploy.trajectory_files import TrajectoryFiles
    from etude.models.inverse_dynamics import InverseDynamicsModel


class JointKind:
    """See `kinds.RobotKind`. Modules are loaded when they are needed: most commands need few of them."""

    def first(self, campaign: Campaign, rng: np.random.Generator) -> tuple[FourierTrajectory, str]:
        from etude.trajectories.random import random_trajectory

        return random_trajectory(
            rng, campaign.spec, campaign.config.trajectory
        ), "random, scaled to the limits"

    def design(
        self,
        campaign: Campaign,
        model: InverseDynamicsModel,
        rng: np.random.Generator,
        tasks: Sequence[Trajectory],
    ) -> tuple[FourierTrajectory, dict[str, Any]]:
        from etude.design.solve import design

        config = campaign.config
        found = design(model, campaign.spec, config.trajectory, config.design, rng, tasks or None)
        facts = {
            "status": found.status,
            "gain": found.variance_removed,
            "criterion": found.criterion,
            "value": found.value,
            "baseline_value": found.baseline,
            "active_limits": [list(pair) for pair in found.active_limits],
            "deviation_before": found.deviation_before.tolist(),
            "deviation_after": found.deviation_after.tolist(),
            "evaluations": found.evaluations,
            "seconds": found.seconds,
        }
        return found.trajectory, facts

    def render(self, trajectory: FourierTrajectory, spec: RobotSpec) -> TrajectoryFiles:
        from etude.deploy.trajectory_files import render

        return render(trajectory, spec)

    def read(self, path: Path, spec: RobotSpec, degrees: bool) -> RobotLog:
        from etude.logs.read import read_log

        return read_log(path, spec, degrees=degrees)

    def align(self, log: RobotLog, trajectory: FourierTrajectory, spec: RobotSpec) -> RobotLog:
        from etude.logs.identity import align_with

        return align_with(log, trajectory, spec)

    def take_in(self, campaign: Campaign, number: int, log: RobotLog, source: str) -> TakenIn:
        from etude.logs.parquet import parquet_bytes
        from etude.models.preprocess import build_dataset

        build_dataset(log, campaign.spec, campaign.config.data, group=number)
        moving = log.t[log.t >= 0.0]
        seconds = float(moving[-1] - moving[0]) if len(moving) else 0.0
        return TakenIn(parquet_bytes(replace(log, source=source)), seconds, len(log.t))

    def learn(self, campaign: Campaign, state: State, number: int, _: Say) -> Learned:
        from etude.campaign.ladder_learner import learn_ladder

        return learn_ladder(campaign, state, number)

    def load_model(self, folder: Path) -> InverseDynamicsModel:
        from etude.models.model_file import load_model

        return load_model(folder)


JOINTS = JointKind()
