"""A small robot that a campaign moves: its clock is its own, so a minute of motion takes half a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from small_robot import make_campaign

from etude.campaign import Campaign, Event
from etude.campaign.run.campaign_run import RunOptions, RunResult, run_campaign
from etude.drivers import About, Person, Player, Sample, Streamed
from etude.testing import FakeRobot
from etude.types import Array

QUICK = """\
[trajectory]
duration = 4.0
[data]
cutoff_hz = 5.0
[model]
rung = "linear"
[design]
candidates = 4
refine = 1
steps = 3
points = 20
reference_points = 20
"""
JOINTS = ("knee", "hip")
"""In the driver's order, which is not the campaign's."""


class Robot(FakeRobot):
    """With what goes wrong.

    Attributes:
        says: what `about` says otherwise. at: by number of the set-point, what happens then.
    """

    def __init__(self, joints: Sequence[str] = JOINTS, start: Array | None = None, **says: Any) -> None:
        super().__init__(joints, rate=50.0, start=start, stiffness=400.0)
        self.says = says
        self.at: dict[int, Callable[[], None]] = {}
        self.fault = ""
        self.efforts: list[Array | None] = []

    def about(self) -> About:
        return replace(super().about(), **self.says)

    def state(self) -> Sample:
        return replace(super().state(), fault=self.fault)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.efforts.append(effort)
        self.at.pop(len(self.sent), lambda: None)()
        super().send(q, qd, qdd, effort)


class Somebody:
    """Who agrees, reads, and lets go of the dead-man switch after so many samples."""

    def __init__(self, word: str = "move", lets_go_after: int | None = None) -> None:
        self.word, self.left = word, lets_go_after
        self.read: list[str] = []

    def agrees(self, sentences: Sequence[str], word: str) -> bool:
        self.read += sentences
        return self.word == word

    def alive(self) -> bool:
        if self.left is None:
            return True
        self.left -= 1
        return self.left > 0


def lab(folder: Path, duration: float = 4.0) -> Campaign:
    """Motions of 4 s teach too little for a learned command that is not 0."""
    return make_campaign(folder, config=QUICK.replace("duration = 4.0", f"duration = {duration}"))


def moved(
    campaign: Campaign,
    robot: Robot | Player,
    person: Person | None = None,
    told: Callable[[str, Any], None] = lambda _, __: None,
    say: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> RunResult:
    """A run of one motion that is neither confirmed nor promoted, unless the options say otherwise."""
    player = Streamed(robot) if isinstance(robot, Robot) else robot
    usual = {"on": "small", "rounds": 1, "confirm": False, "promote": False}
    own = RunOptions(**{**usual, **options})
    return run_campaign(campaign, player, person or Somebody(), own, say=say, tell_event=told)


def facts(campaign: Campaign, kind: type) -> list[Any]:
    return [e.fact for e in events(campaign) if isinstance(e.fact, kind)]


def events(campaign: Campaign) -> list[Event]:
    return campaign.events()


def home(campaign: Campaign) -> Array:
    return np.asarray(campaign.kind.home(campaign.spec))
