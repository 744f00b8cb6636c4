"""Simulated campaign: the same proposals and logs in a loop, and tests that a real robot would not allow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from etude.abilities import SupportsAssumptions, SupportsCollecting, SupportsEngines, SupportsTestRuns
from etude.campaign.ingest.ingest_result import How
from etude.campaign.ingest.tell import abandon, tell
from etude.campaign.propose.ask import ask
from etude.campaign.record.controls import FEEDBACK, LEARNED, asked_under
from etude.campaign.record.events import Evaluated
from etude.campaign.record.folder import ROBOT, Campaign, Say
from etude.campaign.record.rounds import (
    SimulatedRound,
    interrupted_round,
    known_evaluation,
    robot_seconds,
)
from etude.campaign.record.stored_files import stored_trajectory
from etude.campaign.record.stored_models import SIMULATED, newest_model, only_structure, real_logs
from etude.errors import DataError, UsageError, typed
from etude.logs.readers.log_file import write_log
from etude.progress import counted, part
from etude.protocols import Controller, Model, Robot, Trajectory
from etude.types import Log

MOST_TRIES = 4
"""Largest number of trajectories that are tried for each requested one."""
BASELINES = 0.15
"""Approximate fraction of the total time for the tests under feedback alone, for progress."""


RUN_STREAM, TEST_STREAM = 3, 4
"""Streams that separate the random numbers of simulated runs and tests from those of `ask` and training."""
CERTAIN = ("sign", "delay")
"""Checks whose questions are accepted for a simulated robot, since the answer is known. Coupled joints
exchange power, so a joint may take more power out of the motion than its friction dissipates."""
ASKING = 0.3
"""Approximate fraction of a round's time for the design, for progress; the rest is learning."""
IDENTIFIED, RIGID_BODY = "identified", "rigid_body"
"""The structure of the state-of-the-art baseline, and the name of that baseline."""

ONLINE = "online"
"""Name of the baseline with a learned model that keeps learning during the test."""


def test_motions(campaign: Campaign) -> Mapping[str, Trajectory]:
    """The campaign's test motions by name; fixed by its seed, never trained on."""
    rng = np.random.default_rng([campaign.state().seed, TEST_STREAM])
    return campaign.kind.tests(campaign.spec, campaign.config, rng)


class Adaptation(Protocol):
    """Online learning in a simulated test, as made by an entry point in `etude.adaptations`."""

    def require(self, campaign: Campaign, robot: Robot) -> None:
        """Raise UsageError if nothing can be learned while this robot runs."""
        ...

    def controllers(self, campaign: Campaign, robot: Robot) -> Callable[[], Controller]:
        """Makes a controller for each test, which begins with the campaign's newest model."""
        ...


@dataclass(frozen=True)
class Loop:
    """A campaign and the simulated robot that replaces the real one.

    Attributes:
        answer: to the question whether the robot has changed; "" where a change is rehearsed.
        feedforward: whether training motions also use the learned feedforward; None: according to [tracking],
            or with the addition of the kind.
    """

    campaign: Campaign
    robot: Robot
    answer: str
    tests: Mapping[str, Trajectory]
    baselines: Mapping[str, Controller | None]
    online: Adaptation | None
    feedforward: bool | None = None

    @classmethod
    def of(
        cls, campaign: Campaign, engine: str, change: Mapping[str, float], online: Adaptation | None
    ) -> Loop:
        kind, spec, config = campaign.kind, campaign.spec, campaign.config
        robot = kind.robot(spec, config)
        if robot is None:
            raise UsageError(
                f"robot '{campaign.name}' has no simulated plant",
                where=str(campaign.path / ROBOT),
                next_step="For a rehearsal, name its URDF or MJCF with masses as model_file there; or "
                "run the real robot.",
            )
        if isinstance(robot, SupportsAssumptions):  # a simulated replacement of an existing robot
            _check_rehearsed(campaign)
        if engine:
            robot = _with_engine(robot, engine, campaign.name)
        robot, answer = (robot.changed(**change), "") if change else (robot, "same")
        baselines = kind.baselines(spec, config)
        return cls(campaign, robot, answer, test_motions(campaign), baselines, online)

    def learned_one(self, say: Say) -> int | None:
        """Propose, run and ingest one trajectory; return its number, or None if its log was refused."""
        campaign = self.campaign
        with part(ASKING):
            number, beside = self._next_motion(say)
        say(f"Running trajectory {number} on the simulated {campaign.name}.")
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = self.robot.run(stored_trajectory(campaign, number), beside, rng)
        path = campaign.path / SIMULATED / f"{number:04d}.parquet"
        write_log(path, log)
        how: How = {"accept": CERTAIN, "control": _control(beside)}
        try:
            with part(1.0 - ASKING):
                ingested = tell(campaign, path, number=number, changed=self.answer, say=say, **how)
        except DataError as refused:  # the run broke off: abandon it, as a user would
            say(f"Trajectory {number} is abandoned: {refused.fact}.")
            abandon(campaign, number)
            return None
        if ingested.foreign:  # the run broke off; its first part is learned
            say(f"Trajectory {number} is abandoned: less than half of it was run, as log {ingested.number}.")
            abandon(campaign, number)
        if ingested.awaits_answer:
            for finding in ingested.findings:
                say(f"Log {ingested.number} is not used for training yet: {finding.sentence}. {finding.step}")
        return ingested.number

    def _next_motion(self, say: Say) -> tuple[int, Controller | None]:
        """The next trajectory, and its controller beside the feedback, which its margins are for."""
        campaign = self.campaign
        control = "" if campaign.state().proposals else _control(self._collecting())
        number = ask(campaign, go_on=True, control=control, say=say).number
        under = asked_under(campaign.round(number).asked)  # () for proposals of earlier versions
        return number, self._collecting() if LEARNED in (under or (LEARNED,)) else None

    def _collecting(self) -> Controller | None:
        """Controller of training motions beside the feedback, after the first fit."""
        campaign, state = self.campaign, self.campaign.state()
        kind, feedforward = campaign.kind, self.feedforward
        made: Callable[[Any, Any, Model], Controller | None] = kind.controller
        if feedforward is None and isinstance(kind, SupportsCollecting):
            feedforward, made = True, kind.collecting
        elif feedforward is None:
            feedforward = campaign.config.tracking.control == LEARNED
        if not feedforward or not state.trained:
            return None
        return made(campaign.spec, campaign.config, newest_model(campaign, state))

    def evaluate_round(self, number: int) -> SimulatedRound:
        """Test the model of that round, and its identified physics alone."""
        campaign = self.campaign
        kind, spec, config = campaign.kind, campaign.spec, campaign.config
        model = newest_model(campaign, campaign.state())
        errors, unit = self.evaluate(number, same(kind.controller(spec, config, model)))
        identified = only_structure(model, IDENTIFIED)
        if identified is not None:
            self.evaluate(number, same(kind.controller(spec, config, identified)), RIGID_BODY)
        if self.online is not None:
            self.evaluate(number, self.online.controllers(campaign, self.robot), ONLINE)
        return SimulatedRound(number, robot_seconds(campaign), errors, unit, len(campaign.axes))

    def evaluate(
        self, number: int, made: Callable[[], Controller | None], baseline: str = ""
    ) -> tuple[dict[str, list[float]], str]:
        """Run each test once, unless it was run before; commit and return the errors and their unit.

        `made` makes a controller for each test, which may learn during it.
        """
        errors, unit = {}, ""
        for index, (name, motion) in enumerate(self.tests.items()):
            evaluation = known_evaluation(self.campaign, name, number, baseline)
            if evaluation is None:
                rng = np.random.default_rng([self.campaign.state().seed, index, TEST_STREAM, TEST_STREAM])
                evaluation = self._commit(number, baseline, name, self.tried(motion, made(), rng))
            errors[name], unit = list(evaluation.errors), evaluation.unit
        return errors, unit

    def tried(self, motion: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        """A test run; where the robot supports it, it continues to its end despite large errors."""
        run = self.robot.test if isinstance(self.robot, SupportsTestRuns) else self.robot.run
        return run(motion, controller, rng)

    def _commit(self, number: int, baseline: str, test: str, log: Log) -> Evaluated:
        error, units = self.robot.error(log)
        evaluation = Evaluated(
            test=test,
            baseline=baseline,
            robot_seconds=robot_seconds(self.campaign),
            errors=tuple(error.tolist()),
            unit=units[0] if len(set(units)) == 1 else "mixed",
        )
        with self.campaign.writing():
            self.campaign.commit(evaluation, number, self._store_run(number, baseline, test, log))
        return evaluation

    def _store_run(self, number: int, baseline: str, test: str, log: Log) -> list[Path]:
        """Stores the runs that the report draws: the learned controller's, and the feedback's alone."""
        if baseline not in ("", next(iter(self.baselines), "")):
            return []
        path = self.campaign.path / "tests" / f"{number:04d}.{baseline or 'learned'}.{test}.parquet"
        write_log(path, log)
        return [path]


def _control(beside: Controller | None) -> str:
    """Name of the control of a training motion: learned feedforward, or feedback alone."""
    return FEEDBACK if beside is None else LEARNED


def same(controller: Controller | None) -> Callable[[], Controller | None]:
    """The same controller for each test."""
    return lambda: controller


def _with_engine(robot: Robot, engine: str, name: str) -> Robot:
    """The same robot on another engine."""
    if not isinstance(robot, SupportsEngines):
        raise UsageError(f"the simulated {name} has one engine only", next_step="Leave --engine out.")
    made: Robot = replace(robot, engine=engine)  # type: ignore[type-var]
    return made


def _check_rehearsed(campaign: Campaign) -> None:
    """Check that no model learns from both a real robot and its simulation, which are two robots."""
    real = real_logs(campaign, campaign.state())
    if real:
        raise UsageError(
            f"log {real[0].number} is of the real robot: a model must not learn from real and simulated logs",
            where=str(campaign.path),
            next_step="Rehearse in a separate folder: etude init rehearsal --robot "
            f"{campaign.path / ROBOT}, then etude simulate rehearsal.",
        )


def simulate(
    campaign: Campaign,
    rounds: int,
    engine: str = "",
    say: Say = lambda _: None,
    change: Mapping[str, float] | None = None,
    online: Adaptation | None = None,
    *,
    feedforward: bool | None = None,
) -> Iterator[SimulatedRound]:
    """Propose, run and ingest `rounds` trajectories, and evaluate the controller after each one.

    The first motion is run under the robot's own feedback. Later motions add the model learned so far, or the
    addition of the kind (`collecting`). The stop rule is ignored, so that the whole learning curve results.
    Interrupted work is finished first, and each test of a round is evaluated once. A run whose log is refused
    is abandoned and replaced by another trajectory.

    With a `change` these rounds use a changed robot, and its logs are ingested like those of a real one: the
    first log with a detected change waits for an answer, and nothing is run after it.

    Args:
        campaign: the folder.
        rounds: trajectories to learn.
        engine: of the simulation, where the robot has several; "": its own.
        say: receives one sentence per step.
        change: as for `Robot.changed`; None: the robot is unchanged.
        online: online learning of each round's model in the same tests; None: no learning during tests.
        feedforward: whether training motions use the newest model beside the feedback, once there is one;
            None: according to [tracking] of campaign.toml, or with the addition of the kind.

    Raises:
        UsageError: the robot has no simulated plant, no such engine or change, a log waits for an answer, a
            log of the real robot was ingested, or nothing can be learned while the robot runs.
        DataError: too many logs were refused, or they lack the contribution of the feedback.
    """
    _check_answered(campaign)
    loop = replace(Loop.of(campaign, engine, change or {}, online), feedforward=feedforward)
    if online is not None:
        online.require(campaign, loop.robot)
    if isinstance(loop.robot, SupportsAssumptions):  # parts of the simulation without a description
        for sentence in loop.robot.assumed:
            say(sentence)
    with part(BASELINES):
        for name, controller in counted(loop.baselines.items()):
            loop.evaluate(0, same(controller), name)
    left = interrupted_round(campaign, say)
    if left is not None:  # otherwise its tests would be missing from the curve
        loop.evaluate_round(left)
    yield from _learned_rounds(campaign, loop, rounds, say)


def _learned_rounds(campaign: Campaign, loop: Loop, rounds: int, say: Say) -> Iterator[SimulatedRound]:
    """Learn so many runs and evaluate each, until a log waits for an answer. DataError: too few counted."""
    done = 0
    for _ in range(MOST_TRIES * rounds):
        if done == rounds:
            return
        with part((1.0 - BASELINES) / rounds):
            number = loop.learned_one(say)
        if campaign.state().awaiting_answer:
            return
        if number is not None:
            done += 1
            yield loop.evaluate_round(number)
    if done < rounds:
        raise DataError(
            f"only {done} of {rounds} runs gave a usable log",
            where=str(campaign.path),
            next_step=f"The feedback cannot follow the motions: lower the limits in {ROBOT}, or enlarge the "
            "tracking margins.",
        )


def simulate_confirmation(
    campaign: Campaign, engine: str = "", say: Say = lambda _: None, change: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """Propose a confirmation motion, run it without and with the model in use, and ingest both logs.

    Returns:
        the entry of this motion in `status`.

    Raises:
        UsageError: no simulated plant, or nothing was learned yet. DataError: a run cannot be used.
    """
    from etude.campaign.evaluate.confirm import ask_to_confirm
    from etude.campaign.record.confirmation import RUNS, confirmed
    from etude.campaign.record.deployed_model import deployed_model

    loop = Loop.of(campaign, engine, change or {}, None)
    number = ask_to_confirm(campaign, say=say).number
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    alone = next(iter(loop.baselines.values()), None)
    learned = kind.controller(spec, config, deployed_model(campaign).model)
    for run, controller in zip(RUNS, (alone, learned), strict=True):
        say(f"Running trajectory {number} on the simulated {campaign.name}, {run} the feedforward.")
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = loop.tried(stored_trajectory(campaign, number), controller, rng)
        path = campaign.path / SIMULATED / f"{number:04d}.{run}.parquet"
        write_log(path, log)
        tell(campaign, path, number=number, confirm=run, accept=CERTAIN, say=say)
    return confirmed(campaign, campaign.round(number))


def _check_answered(campaign: Campaign) -> None:
    held = campaign.state().awaiting_answer
    if held:
        raise UsageError(
            f"log {held[0].number} waits for an answer about a change of the robot",
            where=str(campaign.path),
            next_step=f"etude tell {typed(campaign.path)} --changed new (or forget, or same).",
        )
