"""A campaign and the simulated robot that stands in for the real one: asks, runs, tells, and test runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from etude.campaign.ingest.abandon import abandon
from etude.campaign.ingest.ingest_result import How
from etude.campaign.ingest.simulated_logs import SIMULATED, real_logs
from etude.campaign.ingest.tell import tell
from etude.campaign.propose.ask import ask
from etude.campaign.record.controls import FEEDBACK, LEARNED, asked_under
from etude.campaign.record.folder import ROBOT, Campaign, Say
from etude.campaign.record.proposals import stored_trajectory
from etude.campaign.record.rounds import ERROR, SimulatedRound, known_evaluation, measured, robot_seconds
from etude.campaign.record.stored import newest_model, only_rung
from etude.errors import DataError, UsageError
from etude.logs.readers.log_file import write_log
from etude.progress import part
from etude.protocols import Controller, Robot, Trajectory
from etude.types import Log

RUN_STREAM, TEST_STREAM = 3, 4
"""Separate the random numbers of simulated runs and of the tests from those of `ask` and of training."""
CERTAIN = ("sign",)
"""Questions whose answer is known of a simulated robot. Joints that drag each other along exchange power, so
that one of many may take more out of the motion than its friction puts in."""
ASKING = 0.3
"""About the part that a design takes of its round; the rest is learning."""
IDENTIFIED, RIGID_BODY = "identified", "rigid_body"
"""The rung that a careful user has today, and what it is called as a baseline."""

ONLINE = "online"
"""The learned model that goes on learning in the test, as a baseline."""


def test_motions(campaign: Campaign) -> Mapping[str, Trajectory]:
    """The campaign's test motions by name; fixed by its seed, never trained on."""
    rng = np.random.default_rng([campaign.state().seed, TEST_STREAM])
    return campaign.kind.tests(campaign.spec, campaign.config, rng)


class Adaptation(Protocol):
    """How a model goes on learning in a simulated test: what a row of `etude.adaptations` makes."""

    def require(self, campaign: Campaign, robot: Robot) -> None:
        """UsageError: nothing can be learned while this robot runs."""
        ...

    def controllers(self, campaign: Campaign, robot: Robot) -> Callable[[], Controller]:
        """Makes a controller for each test, which begins with the campaign's newest model."""
        ...


@dataclass(frozen=True)
class Loop:
    """A campaign and the simulated robot that stands in for the real one.

    Attributes:
        answer: to whether the robot has changed; "" where that is rehearsed.
        feedforward: whether motions that teach are run with what was learned, too.
    """

    campaign: Campaign
    robot: Robot
    answer: str
    tests: Mapping[str, Trajectory]
    baselines: Mapping[str, Controller | None]
    online: Adaptation | None
    feedforward: bool = False

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
                next_step="Name its URDF or MJCF, with masses, as model_file there to rehearse, or run the "
                "real robot.",
            )
        if hasattr(robot, "assumed"):  # what stands in for a robot that exists
            _check_rehearsed(campaign)
        if engine:
            robot = _with_engine(robot, engine, campaign.name)
        robot, answer = (robot.changed(**change), "") if change else (robot, "same")
        baselines = kind.baselines(spec, config)
        return cls(campaign, robot, answer, test_motions(campaign), baselines, online)

    def learned_one(self, say: Say) -> int | None:
        """Asks, runs and tells one trajectory; its number, or None if its log was refused."""
        campaign = self.campaign
        with part(ASKING):
            number, beside = self._asked(say)
        say(f"Running trajectory {number} on the simulated {campaign.name}.")
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = self.robot.run(stored_trajectory(campaign, number), beside, rng)
        path = campaign.path / SIMULATED / f"{number:04d}.parquet"
        write_log(path, log)
        how: How = {"accept": CERTAIN, "control": _control(beside)}
        try:
            with part(1.0 - ASKING):
                told = tell(campaign, path, number=number, changed=self.answer, say=say, **how)
        except DataError as refused:  # it broke off: what a person would give up too
            say(f"Trajectory {number} is given up: {refused.fact}.")
            abandon(campaign, number)
            return None
        if told.foreign:  # it broke off, and teaches that far
            say(f"Trajectory {number} is given up: less than half of it was run, which log {told.number} is.")
            abandon(campaign, number)
        if told.held:
            for found in told.findings:
                say(f"Log {told.number} is not learned yet: {found.sentence}. {found.step}")
        return told.number

    def _asked(self, say: Say) -> tuple[int, Controller | None]:
        """The next trajectory, and what it is run with beside the feedback: what its margins are of."""
        campaign = self.campaign
        control = "" if campaign.state().proposals else _control(self._collecting())
        number = ask(campaign, go_on=True, control=control, say=say).number
        under = asked_under(campaign.round(number).asked)  # of proposals that are older than this: none
        return number, self._collecting() if LEARNED in (under or (LEARNED,)) else None

    def _collecting(self) -> Controller | None:
        """What motions that teach are run with, beside the feedback, once something was learned: what was
        learned, or what the kind adds; most add nothing.
        """
        campaign, state = self.campaign, self.campaign.state()
        kind = campaign.kind
        made = kind.controller if self.feedforward else getattr(kind, "collecting", None)
        if made is None or not state.trained:
            return None
        found: Controller | None = made(campaign.spec, campaign.config, newest_model(campaign, state))
        return found

    def evaluate_round(self, number: int) -> SimulatedRound:
        """Tests the model of that round, and what its identified physics alone would do."""
        campaign = self.campaign
        kind, spec, config = campaign.kind, campaign.spec, campaign.config
        model = newest_model(campaign, campaign.state())
        errors, unit = self.evaluate(number, same(kind.controller(spec, config, model)))
        identified = only_rung(model, IDENTIFIED)
        if identified is not None:
            self.evaluate(number, same(kind.controller(spec, config, identified)), RIGID_BODY)
        if self.online is not None:
            self.evaluate(number, self.online.controllers(campaign, self.robot), ONLINE)
        return SimulatedRound(number, robot_seconds(campaign), errors, unit, len(campaign.axes))

    def evaluate(
        self, number: int, made: Callable[[], Controller | None], baseline: str | None = None
    ) -> tuple[dict[str, list[float]], str]:
        """Runs each test once, unless it was run before; commits and returns the errors and their unit.

        `made` gives each test a controller, which may learn in it.
        """
        errors, unit = {}, ""
        for index, (name, motion) in enumerate(self.tests.items()):
            facts = known_evaluation(self.campaign, name, number, baseline)
            if facts is None:
                rng = np.random.default_rng([self.campaign.state().seed, index, TEST_STREAM, TEST_STREAM])
                facts = self._commit(number, baseline, name, self.tried(motion, made(), rng))
            errors[name], unit = measured(facts)
        return errors, unit

    def tried(self, motion: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        """A test run: to its end, however badly it goes, where the robot knows how."""
        run = getattr(self.robot, "test", self.robot.run)
        log: Log = run(motion, controller, rng)
        return log

    def _commit(self, number: int, baseline: str | None, test: str, log: Log) -> dict[str, object]:
        error, units = self.robot.error(log)
        facts = {"test": test, "robot_seconds": robot_seconds(self.campaign)}
        facts |= {} if baseline is None else {"baseline": baseline}
        facts[ERROR + (units[0] if len(set(units)) == 1 else "mixed")] = error.tolist()
        with self.campaign.writing():
            self.campaign.commit("evaluated", number, self._kept(number, baseline, test, log), **facts)
        return facts

    def _kept(self, number: int, baseline: str | None, test: str, log: Log) -> list[Path]:
        """Stores the runs that the report draws: the learned controller's, and the feedback's alone."""
        if baseline not in (None, next(iter(self.baselines), None)):
            return []
        path = self.campaign.path / "tests" / f"{number:04d}.{baseline or 'learned'}.{test}.parquet"
        write_log(path, log)
        return [path]


def _control(beside: Controller | None) -> str:
    """What a motion that teaches is run under: it is fed forward what was learned, or nothing."""
    return FEEDBACK if beside is None else LEARNED


def same(controller: Controller | None) -> Callable[[], Controller | None]:
    """The same controller for each test."""
    return lambda: controller


def _with_engine(robot: Robot, engine: str, name: str) -> Robot:
    """The same robot on another engine."""
    if not hasattr(robot, "engine"):
        raise UsageError(f"the simulated {name} has one engine only", next_step="Leave --engine out.")
    made: Robot = replace(robot, engine=engine)  # type: ignore[type-var]
    return made


def _check_rehearsed(campaign: Campaign) -> None:
    """A real robot and what stands in for it are two robots: no model may learn from both."""
    real = real_logs(campaign, campaign.state())
    if real:
        raise UsageError(
            f"log {real[0].number} is of the robot itself: no model may learn from it and from a stand-in",
            where=str(campaign.path),
            next_step="Rehearse in a folder of its own: etude init rehearsal --robot "
            f"{campaign.path / ROBOT}, then etude simulate rehearsal.",
        )
