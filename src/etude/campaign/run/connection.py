"""`etude.connect`: a robot for notebooks and programs, by the same code as `etude run`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from etude.campaign.record.folder import Campaign, Say, open_campaign
from etude.campaign.run.run_settings import driver_of, read_settings
from etude.drivers import About, Person

if TYPE_CHECKING:
    from etude.campaign.run.campaign_run import RunOptions, RunResult
    from etude.campaign.run.robot_session import RobotSession


class Typist:
    """The person at the keyboard of a program, asked by `input`."""

    def agrees(self, sentences: Sequence[str], word: str) -> bool:
        """Print the sentences and wait for the word."""
        return (
            input("\n".join([*sentences, f"Is the workspace clear? Type {word} to start the motion: "]))
            == word
        )

    def alive(self) -> bool:
        """Ctrl-C is how a person stops it here."""
        return True


@dataclass(frozen=True, eq=False)
class ConnectedRobot:
    """A robot that is ready; it moves when `run` is called and a person agrees.

    Attributes:
        session: the connection. options: as of `etude run`. say: receives one sentence per step.
    """

    session: RobotSession
    options: RunOptions
    say: Say

    @property
    def about(self) -> About:
        """The robot's description of itself."""
        return self.session.about

    def pose(self) -> dict[str, float]:
        """Where it stands, rad or m by axis."""
        return dict(zip(self.session.campaign.axes, self.session.pose().tolist(), strict=True))

    def plan(self) -> tuple[str, ...]:
        """Sentences on the planned motions; nothing moves."""
        return self._closed(replace(self.options, dry=True)).notes

    def run(self, rounds: int = 0) -> RunResult:
        """Closes the loop for so many motions; 0: until the stop rule fires. Errors as `run_campaign`."""
        return self._closed(replace(self.options, rounds=rounds))

    def _closed(self, options: RunOptions) -> RunResult:
        from etude.campaign.run.campaign_run import close_loop

        return close_loop(self.session, options, self.say)


@contextlib.contextmanager
def connect(
    campaign: Campaign | str | Path,
    on: str = "",
    *,
    yes: bool = False,
    resume: bool = False,
    identity: str = "",
    person: Person | None = None,
    say: Say = lambda _: None,
) -> Iterator[ConnectedRobot]:
    """The robot of a campaign: `with connect("lab", on="mujoco:arm.xml") as robot: robot.run(2)`.

    Args:
        campaign: the folder, or it opened. on: the driver; "": that of run.toml.
        yes: agreed beforehand, to a simulation alone. person: who agrees; None: whoever sits at the keyboard.
        resume, identity: as of `etude run`. say: receives one sentence per step.

    Raises:
        UsageError: no such driver, or something is open; nothing moved.
    """
    from etude.campaign.run.campaign_run import RunOptions, connected

    campaign = campaign if isinstance(campaign, Campaign) else open_campaign(Path(campaign))
    settings = read_settings(campaign, on)
    defaults = settings.defaults
    options = RunOptions(
        on=settings.on, yes=yes, learned=defaults.learned, confirm=defaults.confirm, promote=defaults.promote
    )
    player = driver_of(campaign, settings)
    with connected(campaign, player, person or Typist(), resume=resume, identity=identity) as session:
        yield ConnectedRobot(session, options, say)
