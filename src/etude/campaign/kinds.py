"""What a campaign does differently for robots of joints and for flying vehicles: one object for each.

`ask`, `tell`, `learn` and `simulate` do what is the same for both (numbers, files, journal, hashes, seeds)
and hand the rest to the kind. A third kind is one more module with a `RobotKind`, and a case in `kind_of`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from etude.campaign.learner import Learned, Say
from etude.robots.spec import RobotSpec
from etude.trajectories.certificate import Certificate
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.samples import Trajectory

if TYPE_CHECKING:
    from etude.campaign.folder import Campaign
    from etude.campaign.state import State


class Written(Protocol):
    """The bytes of a proposal's files, certified as they are."""

    @property
    def trajectory(self) -> Any: ...

    @property
    def certificate(self) -> Certificate: ...

    def write(self, folder: Path) -> list[Path]: ...


@dataclass(frozen=True)
class TakenIn:
    """A log that can be stored: the bytes of its cleaned file, and facts for the journal.

    Attributes:
        content: of runs/NNNN.parquet.
        seconds: recorded motion, s.
        rows: samples.
    """

    content: bytes
    seconds: float
    rows: int


class RobotKind(Protocol):
    """Every method gets the campaign; logs and models are the kind's own types."""

    def first(self, campaign: Campaign, rng: np.random.Generator) -> tuple[FourierTrajectory, str]:
        """A trajectory to begin with, when nothing has been learned, and what it is."""
        ...

    def design(
        self, campaign: Campaign, model: Any, rng: np.random.Generator, tasks: Sequence[Trajectory]
    ) -> tuple[FourierTrajectory, dict[str, Any]]:
        """The trajectory that teaches `model` most, and facts of the `asked` event (status, gain, ...)."""
        ...

    def render(self, trajectory: FourierTrajectory, spec: RobotSpec) -> Written:
        """The proposal's files, proved inside the limits."""
        ...

    def read(self, path: Path, spec: RobotSpec, degrees: bool) -> Any:
        """The cleaned log in the file."""
        ...

    def align(self, log: Any, trajectory: FourierTrajectory, spec: RobotSpec) -> Any:
        """The log with t = 0 at the trajectory's start, or DataError if it is of another motion."""
        ...

    def take_in(self, campaign: Campaign, number: int, log: Any, source: str) -> TakenIn:
        """The log as it is stored; DataError if nothing could be learned from it."""
        ...

    def learn(self, campaign: Campaign, state: State, number: int, say: Say) -> Learned:
        """Scores log `number`, then trains on all logs told."""
        ...

    def load_model(self, folder: Path) -> Any:
        """The model that was chosen."""
        ...
