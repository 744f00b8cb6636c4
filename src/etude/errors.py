"""Errors, with one root class. Each message states the fact, its place, and what to do next."""

from __future__ import annotations

import shlex
from collections.abc import Iterable


def typed(path: object) -> str:
    """A path within a command that is printed, as a shell takes it: in quotes where it holds a space."""
    return shlex.quote(str(path))


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Start of a next step after a wrong name: the known name most like it; "" if none is."""
    import difflib  # only errors need it

    near = difflib.get_close_matches(name, known, 1)
    return f"Did you mean {near[0]}? " if near else ""


class EtudeError(Exception):
    """Root of every error that Étude raises on purpose.

    Args:
        fact: what is wrong, one sentence without the final full stop.
        where: file and column, joint, limit; empty if there is no such place.
        next_step: what the reader should do now.
    """

    exit_code = 1

    def __init__(self, fact: str, *, where: str = "", next_step: str = "") -> None:
        self.fact, self.where, self.next_step = fact, where, next_step
        place = f" [{where}]" if where else ""
        advice = f" {next_step}" if next_step else ""
        super().__init__(f"{fact}{place}.{advice}")


def reason(problem: Exception) -> str:
    """Why something failed, for a sentence: the fact of an error of Étude, or the type and the text."""
    return problem.fact if isinstance(problem, EtudeError) else f"{type(problem).__name__}: {problem}"


class UsageError(EtudeError):
    """A wrong option, robot description or campaign file."""

    exit_code = 2


class DataError(EtudeError):
    """A log that cannot be used."""

    exit_code = 3


class UnsafeTrajectoryError(EtudeError):
    """A trajectory outside its limits, or limits that no trajectory meets; no file is written.

    Args:
        limit: axis and quantity of the limit that is broken, of a single one.
    """

    exit_code = 4

    def __init__(
        self, fact: str, *, where: str = "", next_step: str = "", limit: tuple[str, str] | None = None
    ) -> None:
        super().__init__(fact, where=where, next_step=next_step)
        self.limit = limit


class UnsafeModelError(EtudeError):
    """A robot's compiled model that is not what its description says; nothing is made of it."""

    exit_code = 4


class StopRuleReached(EtudeError):
    """The campaign's stop rule fired: another trajectory is not worth its robot time."""

    exit_code = 5


class NumericalError(EtudeError):
    """A computation that could not be finished to the promised accuracy."""


class RobotStopped(EtudeError):
    """The robot or the supervisor stopped a motion; the robot is at rest."""

    exit_code = 7


class LinkLost(EtudeError):
    """No word from the robot: what it does then is its own."""

    exit_code = 8
