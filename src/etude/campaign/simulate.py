"""Closes the loop with a simulated robot: the same asks and tells, and tests a real robot would not allow."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.ask import ask, stored_trajectory
from etude.campaign.folder import Campaign
from etude.campaign.learn import newest_model
from etude.campaign.learner import Say
from etude.campaign.rounds import SimulatedRound, interrupted_round, known_evaluation, robot_seconds
from etude.campaign.tell import tell
from etude.control.closed_loop import run_closed_loop, tracking_error
from etude.control.feedforward import (
    Feedforward,
    model_feedforward,
    no_feedforward,
    perfect_feedforward,
)
from etude.errors import UsageError
from etude.logs.log import RobotLog
from etude.logs.parquet import write_parquet
from etude.plants.registry import plant_names, simulated_robot
from etude.plants.robot import SimulatedRobot
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.moves import random_moves
from etude.trajectories.random import random_trajectory
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]
RUN_STREAM, TEST_STREAM = 3, 4
"""Separate the random numbers of simulated runs and of the tests from those of `ask` and of training."""
MOVES = 12
TEST_DURATION = 60.0  # s


def simulate(
    campaign: Campaign, rounds: int, engine: str = "compiled", say: Say = lambda _: None
) -> Iterator[SimulatedRound]:
    """Asks, runs and tells `rounds` trajectories, and evaluates the controller after each one.

    Trajectories are collected under the robot's own PD control. The stop rule is not heeded: who simulates
    wants the whole curve. Interrupted work is finished first; a test of a round is evaluated once.

    Raises:
        UsageError: the robot has no simulated plant.
    """
    if campaign.spec.flight is not None:
        from etude.campaign.flight.simulate import simulate_flights

        yield from simulate_flights(campaign, rounds, say)
        return
    robot = _robot(campaign, engine)
    tests = test_motions(campaign)
    _evaluate_baselines(campaign, robot, tests)
    left = interrupted_round(campaign, say)
    if left is not None:  # or its tests would be missing from the curve
        _evaluate_round(campaign, robot, tests, left)
    for _ in range(rounds):
        number = ask(campaign, go_on=True, say=say).number
        say(f"Running trajectory {number} on the simulated {robot.name}.")
        trajectory = stored_trajectory(campaign, number)
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = run_closed_loop(robot, trajectory, no_feedforward(campaign.spec), rng)
        path = campaign.path / "simulated" / f"{number:04d}.parquet"
        write_parquet(log, path)
        tell(campaign, path, number=number, say=say)
        yield _evaluate_round(campaign, robot, tests, number)


def test_motions(campaign: Campaign) -> dict[str, Trajectory]:
    """The campaign's test motions by name; fixed by its seed, never trained on.

    They do not depend on which family the campaign trains on, so that settings can be compared: the thesis's
    own form (3.5) with N = 2, one to two periods long, and point-to-point moves.
    """
    rng = np.random.default_rng([campaign.state().seed, TEST_STREAM])
    period = 2.0 * np.pi / TEST_DURATION
    thesis = TrajectoryFamily(2, TEST_DURATION, (period, 2.0 * period), rest="ramp", ramp=2.0)
    return {
        "fourier": random_trajectory(rng, campaign.spec, thesis),
        "moves": random_moves(rng, campaign.spec, MOVES),
    }


def _robot(campaign: Campaign, engine: str) -> SimulatedRobot:
    plant = campaign.spec.plant
    if plant is None:
        raise UsageError(
            f"robot '{campaign.spec.name}' has no simulated plant",
            where=str(campaign.path / "robot.toml"),
            next_step=f'Write plant = "..." with one of {", ".join(plant_names())}, or run the real robot.',
        )
    return simulated_robot(plant, engine, campaign.spec)


def _evaluate_baselines(campaign: Campaign, robot: SimulatedRobot, tests: dict[str, Trajectory]) -> None:
    feedforwards = {"pd": no_feedforward(campaign.spec), "perfect": perfect_feedforward(robot)}
    for name, feedforward in feedforwards.items():
        _evaluate(campaign, robot, tests, 0, feedforward, baseline=name)


def _evaluate_round(
    campaign: Campaign, robot: SimulatedRobot, tests: dict[str, Trajectory], number: int
) -> SimulatedRound:
    state = campaign.state()
    model = newest_model(campaign, state)
    errors = _evaluate(campaign, robot, tests, number, model_feedforward(model, campaign.spec))
    identified = _identified(campaign, number)
    if identified is not None:
        rigid = model_feedforward(identified, campaign.spec, fade=False)
        _evaluate(campaign, robot, tests, number, rigid, baseline="rigid_body")
    return SimulatedRound(number, robot_seconds(campaign), errors, "deg")


def _identified(campaign: Campaign, number: int) -> Any:
    """The identified rigid-body model of that round, what a careful user has today; None if there is none."""
    from etude.campaign.ladder_files import load_kind

    return load_kind(campaign.model_folder(number), "identified")


def _evaluate(
    campaign: Campaign,
    robot: SimulatedRobot,
    tests: dict[str, Trajectory],
    number: int,
    feedforward: Feedforward,
    **facts: Any,
) -> dict[str, list[float]]:
    """Runs each test motion once, unless it was before; commits and returns the errors in degrees."""
    run = partial(run_closed_loop, robot, feedforward=feedforward)
    errors = {}
    for index, (name, motion) in enumerate(tests.items()):
        before = known_evaluation(campaign, name, number, facts.get("baseline"))
        if before is None:
            rng = np.random.default_rng([campaign.state().seed, index, TEST_STREAM, TEST_STREAM])
            log = run(trajectory=motion, rng=rng)
            error = np.rad2deg(tracking_error(log)).tolist()
            measured = {**facts, "test": name, "robot_seconds": robot_seconds(campaign)}
            with campaign.writing():
                files = _kept(campaign, log, number, facts.get("baseline")) if index == 0 else []
                campaign.commit("evaluated", number, files, **measured, tracking_error_deg=error)
        else:
            error = before["tracking_error_deg"]
        errors[name] = list(error)
    return errors


def _kept(campaign: Campaign, log: RobotLog, number: int, baseline: str | None) -> list[Path]:
    """Stores a test run that the report draws: the learned controller's, and PD alone to hold it against."""
    if baseline not in (None, "pd"):
        return []
    path = campaign.path / "tests" / f"{number:04d}.{baseline or 'learned'}.parquet"
    write_parquet(log, path)
    return [path]
